"""The documentation's site in Chromium, read from the disk: wide, narrow, light and dark."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from .visits import DESK, PHONE

pytestmark = pytest.mark.external

DOCS = Path(__file__).parents[2] / "docs"
NAMES = sorted(
    page.relative_to(DOCS).with_suffix("").as_posix()
    for page in DOCS.rglob("*.md")
    if "_build" not in page.parts
)
SHOWN = """() => {
  const pictures = [...document.images].filter(e => e.checkVisibility());
  const equations = [...document.querySelectorAll("math")];
  return {
    blank: pictures.filter(e => !e.complete || !e.naturalWidth).map(e => e.src),
    flat: equations.filter(e => e.getBoundingClientRect().height < 6).map(e => e.textContent),
    wrong: equations.filter(e => e.querySelector("merror")).map(e => e.textContent),
  };
}"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the built pages."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-j", "auto", DOCS, folder]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def opened(site, visit):
    """Opens a page, which may ask for what lies beside it and for nothing else."""

    def opening(name, **how):
        visited = visit(site / f"{name}.html", **how)
        visited.allowed += (site.as_uri() + "/",)
        return visited

    return opening


@pytest.mark.parametrize("name", NAMES)
def test_a_page_reads_well_at_every_width_and_light(opened, name):
    visited = opened(name)
    assert visited.unnamed() == []
    for dark in (False, True):
        visited.page.emulate_media(color_scheme="dark" if dark else "light")
        for window in (DESK, PHONE):
            visited.page.set_viewport_size(window)
            assert visited.overflow_px() <= 0, visited.too_wide()
            if window is DESK:
                assert visited.low_contrast() == []
            visited.screen(f"docs {name} {window['width']}{' dark' * dark}".replace("/", "-"))
    # pictures that are not in sight yet are fetched when they are
    visited.page.evaluate("for (const e of document.images) e.loading = 'eager'")
    visited.page.wait_for_function("[...document.images].every(e => e.complete)")
    assert visited.page.evaluate(SHOWN) == {"blank": [], "flat": [], "wrong": []}


def test_every_part_is_reached_from_every_page(opened):
    visited = opened("developing/index")
    tree = visited.page.locator(".sidebar-tree")
    index = (DOCS / "index.md").read_text("utf-8")
    parts = dict(re.findall(r"```{toctree}\n:caption: ([^\n]*)\n(.*?)```", index, re.DOTALL))
    assert len(parts) == 5
    for part, pages in parts.items():
        if set(pages.split()) & set(NAMES):
            assert tree.get_by_text(part, exact=True).is_visible()
    assert tree.get_by_role("link").count() == len(NAMES) - 1  # all but the first page itself


def test_on_a_telephone_the_tree_opens(opened):
    visited = opened("developing/index", phone=True)
    tree = visited.page.locator(".sidebar-tree")
    assert tree.bounding_box()["x"] < 0
    visited.page.locator(".mobile-header .nav-overlay-icon").click()
    visited.page.wait_for_timeout(500)
    assert tree.bounding_box()["x"] >= 0


def test_a_search_finds_without_a_server(opened):
    visited = opened("index")
    visited.page.locator(".sidebar-search").fill("GENERATOR_STATUS")
    visited.page.keyboard.press("Enter")
    found = visited.page.locator("#search-results li a").first
    found.wait_for(timeout=10_000)
    assert found.inner_text() == "Adding a message"


def test_the_reader_chooses_light_or_dark(opened):
    visited = opened("index")
    theme = visited.page.locator("body")
    chosen = {theme.get_attribute("data-theme")}
    for _ in range(2):
        visited.page.locator(".theme-toggle-content .theme-toggle").click()
        chosen.add(theme.get_attribute("data-theme"))
        assert visited.low_contrast() == []
    assert chosen == {"auto", "light", "dark"}
