"""Chromium, and pages in it that are watched; what a browser is missing for, and what then."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from .visits import DESK, PHONE, Visit, find_chromium, flags, host_of


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


@pytest.fixture
def visit(chromium, screens):
    """Opens a page: ``visit(url, dark=False, phone=False)``; fails the test if it misbehaves.

    ``forgiven`` holds words of complaints that the test brings about itself.
    """
    visits: list[Visit] = []
    contexts = []
    forgiven: list[str] = []

    def open_page(url: str | Path, dark: bool = False, phone: bool = False, **options) -> Visit:
        address = url.as_uri() if isinstance(url, Path) else url
        context = chromium.new_context(
            viewport=PHONE if phone else DESK,
            color_scheme="dark" if dark else "light",
            has_touch=phone,
            is_mobile=phone,
            device_scale_factor=2 if phone else 1,
            **options,
        )
        contexts.append(context)
        socket = host_of(address).replace("http:", "ws:", 1)
        visited = Visit(context.new_page(), (host_of(address), socket), screens)
        visited.watch()
        visits.append(visited)
        visited.page.goto(address)
        return visited

    open_page.forgiven = forgiven
    yield open_page
    problems = [p for v in visits for p in v.problems() if not any(f in p for f in forgiven)]
    for context in contexts:
        context.close()
    assert not problems, "\n".join(problems)
