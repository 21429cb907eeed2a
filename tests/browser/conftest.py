"""Chromium, and pages in it that are watched; what a browser is missing for, and what then."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from .visits import DESK, PHONE, Visit, find_chromium, flags, host_of

COMMAND = (sys.executable, "-m", "monitor.cli")


def missing(what: str) -> None:
    """Skip; in continuous integration, where everything must be there, fail."""
    if os.environ.get("CI", "").lower() in ("true", "1"):
        pytest.fail(f"{what}; `make test-external` installs it", pytrace=False)
    pytest.skip(f"{what}; `make test-external` installs it")


@pytest.fixture(scope="session")
def screens(request) -> Path | None:
    """Folder for pictures (``--screens DIR`` or ``MAVSENTRY_SCREENS``), None without."""
    folder = request.config.getoption("screens") or os.environ.get("MAVSENTRY_SCREENS")
    if not folder:
        return None
    path = Path(folder)
    path.mkdir(parents=True, exist_ok=True)
    return path


@pytest.fixture(scope="session")
def chromium():
    """The system's Chromium, driven by Playwright; its own downloads are never used."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright is not installed")
    path = find_chromium()
    if path is None:
        missing("no Chromium on the path")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=flags())
        yield browser
        browser.close()


class Visits:
    """Opens pages; at the end none of them may have done what no page of ours does.

    ``forgiven`` holds words of complaints that a test brings about itself.
    """

    def __init__(self, browser, screens: Path | None) -> None:
        self._browser = browser
        self._screens = screens
        self._opened: list[Visit] = []
        self.forgiven: list[str] = []

    def __call__(
        self, url: str | Path, dark: bool = False, phone: bool = False, **options
    ) -> Visit:
        address = url.as_uri() if isinstance(url, Path) else url
        context = self._browser.new_context(
            **{
                "viewport": PHONE if phone else DESK,
                "color_scheme": "dark" if dark else "light",
                "has_touch": phone,
                "is_mobile": phone,
                "device_scale_factor": 2 if phone else 1,
                **options,
            }
        )
        socket = host_of(address).replace("http:", "ws:", 1)
        visited = Visit(context.new_page(), (host_of(address), socket), self._screens)
        visited.watch()
        self._opened.append(visited)
        visited.page.goto(address)
        return visited

    def close(self) -> list[str]:
        """Close all; return what they did wrong."""
        problems = [p for visited in self._opened for p in visited.problems()]
        for visited in self._opened:
            visited.page.context.close()
        return [p for p in problems if not any(words in p for words in self.forgiven)]


@contextmanager
def visiting(browser, screens: Path | None) -> Iterator[Visits]:
    visits = Visits(browser, screens)
    try:
        yield visits
    finally:
        problems = visits.close()
    assert not problems, "\n".join(problems)


@pytest.fixture
def visit(chromium, screens):
    """Opens a page: ``visit(url, dark=False, phone=False)``; fails the test if it misbehaves."""
    with visiting(chromium, screens) as visits:
        yield visits
