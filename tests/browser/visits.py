"""Pages in headless Chromium, watched: what they ask the network for, what they complain of.

A :class:`Visit` is one page in a context of its own. Whatever it requests beside itself and the
hosts it was allowed, every console error and every uncaught exception is a problem; the fixture
``visit`` fails a test that leaves one.
"""

from __future__ import annotations

import os
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

PHONE = {"width": 400, "height": 800}
DESK = {"width": 1280, "height": 900}

FLAGS = (
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # A name that a page asks for resolves to nothing: the request is seen, and goes nowhere.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")


CHECKS = Path(__file__).with_name("checks.js").read_text("utf-8")


def find_chromium() -> str | None:
    """Path of a Chromium; ``MAVSENTRY_CHROMIUM`` goes before what is on the path."""
    chosen = os.environ.get("MAVSENTRY_CHROMIUM")
    return next(filter(None, map(shutil.which, [chosen] if chosen else NAMES)), None)


def flags() -> list[str]:
    """Of the command line; the sandbox cannot be used by root."""
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    return [*FLAGS, *(["--no-sandbox"] if root else [])]


@dataclass
class Visit:
    """A page and what it did.

    Attributes
    ----------
    page
        Playwright's page.
    allowed
        Beginnings of addresses that it may ask for.
    requests, complaints
        Every address that it asked for; console errors and uncaught exceptions.
    screens
        Folder for screenshots; None keeps none.
    """

    page: object
    allowed: tuple[str, ...]
    screens: Path | None
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def watch(self) -> None:
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.complaints.append(f"uncaught: {error}"))

    def _heard(self, message: object) -> None:
        if message.type == "error":
            self.complaints.append(f"console: {message.text} ({message.location.get('url')})")

    def problems(self) -> list[str]:
        """What no page of ours may do."""
        foreign = [url for url in self.requests if not url.startswith((*self.allowed, "data:"))]
        return [f"asked for {url}" for url in foreign] + self.complaints

    def screen(self, name: str) -> None:
        """Keep a picture of the whole page for people to look at, if a folder was given for it.

        The window is made as high as the page: charts that are off the screen are not drawn.
        """
        if self.screens is None:
            return
        window = self.page.viewport_size
        height = self.page.evaluate("document.documentElement.scrollHeight")
        self.page.set_viewport_size({"width": window["width"], "height": height})
        self.wait_drawn()
        self.page.wait_for_timeout(400)
        self.page.screenshot(path=self.screens / f"{name}.png")
        self.page.set_viewport_size(window)

    def text(self) -> str:
        """All text that a reader of the page sees, figures' shadow trees left out."""
        return self.page.locator("body").inner_text()

    def overflow_px(self) -> int:
        """By how much the page is wider than its window: what a thumb would have to scroll."""
        return self._check("overflow")

    def too_wide(self) -> list[str]:
        """Elements that reach beyond the window's right edge and are not scrolled in a box."""
        return self._check("tooWide")

    def low_contrast(self) -> list[str]:
        """Texts whose contrast with what is behind them is below 4.5 (large ones 3): WCAG AA."""
        return self._check("lowContrast")

    def unnamed(self) -> list[str]:
        """Links, buttons and pictures without words, doubled ids, a page without title or h1."""
        return self._check("unnamed")

    def tab_stops(self, most: int = 200) -> list[dict]:
        """Press Tab through the page; what took the focus, and whether that is to be seen.

        Each stop is ``{"tag", "name", "href", "seen"}``; it ends where the focus leaves the page.
        """
        stops: list[dict] = []
        self._check("blur")
        for _ in range(most):
            self.page.keyboard.press("Tab")
            stop = self._check("focused")
            if stop is None or (stops and stop["id"] == stops[0]["id"]):
                break
            stops.append(stop)
        return stops

    def figures(self) -> list[dict]:
        """Figures that Bokeh has drawn: name, title, width and height [px], labels of the axes."""
        self.wait_drawn()
        return self._check("figures")

    def wait_drawn(self, timeout_s: float = 20.0) -> None:
        """Wait until Bokeh has drawn all; a page without figures has nothing to wait for."""
        end_s = time.monotonic() + timeout_s
        while not self._check("drawn"):
            assert time.monotonic() < end_s, f"Bokeh has not drawn its figures in {timeout_s:g} s"
            self.page.wait_for_timeout(50)

    def remember(self, selector: str) -> None:
        """From now on keep every text that this place shows, however short a time it stands."""
        self._check("remember", selector)

    def remembered(self, selector: str) -> list[str]:
        return self._check("remembered", selector)

    def inks(self, place: str) -> int:
        """How many colours the canvases in this place (a CSS selector) show: 1 when blank."""
        return self._check("inks", place)

    def hover(self, name: str, x: float, y: float | None = None) -> str:
        """Text of the tooltips that the mouse raises in a figure; empty where it raises none.

        Parameters
        ----------
        name
            The figure's name, or the beginning of it.
        x, y
            Where, in the figure's own units; without ``y`` half way up the frame.
        """
        self.wait_drawn()
        assert self._check("scrollTo", name), f"no figure {name!r} in {self.figures()}"
        self.page.wait_for_timeout(100)
        at = self._check("point", [name, x, y])
        self.page.mouse.move(at["x"] - 3, at["y"])
        self.page.mouse.move(at["x"], at["y"], steps=3)
        for _ in range(20):
            if said := "\n".join(self._check("tips")):
                return said
            self.page.wait_for_timeout(50)
        return ""

    def _check(self, name: str, argument: object = None) -> object:
        """Call a function of ``checks.js`` in the page."""
        return self.page.evaluate(f"argument => {CHECKS}.{name}(argument)", argument)


def host_of(url: str) -> str:
    """Beginning that addresses of the page's own host share; a file is its own host."""
    parts = urlsplit(url)
    return url.partition("#")[0] if parts.scheme == "file" else f"{parts.scheme}://{parts.netloc}/"
