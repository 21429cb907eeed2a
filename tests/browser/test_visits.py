"""The watch over pages sees what it is there for: each bad page is caught for its own fault."""

import pytest

from .visits import PHONE

pytestmark = pytest.mark.external

HEAD = (
    "<!doctype html><html lang=en><meta name=viewport content='width=device-width'><title>t</title>"
)


@pytest.fixture
def page_of(tmp_path, visit):
    visit.forgiven.append("")  # the problems of these pages are what is looked at

    def opened(body, **how):
        path = tmp_path / "page.html"
        path.write_text(HEAD + body)
        return visit(path, **how)

    return opened


def test_a_quiet_page_has_no_problem(page_of):
    visited = page_of("<h1>Quiet</h1><p>Nothing happens.")
    assert visited.problems() == []
    assert visited.low_contrast() == []
    assert visited.unnamed() == []


@pytest.mark.parametrize(
    ("body", "word"),
    [
        ("<img src='https://example.org/spy.png'>", "asked for https://example.org/spy.png"),
        (
            "<script>fetch('http://127.0.0.1:9/beacon')</script>",
            "asked for http://127.0.0.1:9/beacon",
        ),
        ("<script>new WebSocket('ws://127.0.0.1:9/x')</script>", "asked for ws://127.0.0.1:9/x"),
        ("<link rel=stylesheet href=other.css>", "other.css"),
        ("<script>console.error('broken')</script>", "console: broken"),
        ("<script>undefined_name()</script>", "uncaught: "),
    ],
)
def test_what_a_page_does_wrong_is_seen(page_of, body, word):
    visited = page_of("<h1>Bad</h1>" + body)
    visited.page.wait_for_timeout(200)
    assert any(word in problem for problem in visited.problems()), visited.problems()


def test_a_page_wider_than_a_phone_is_seen(page_of):
    wide = page_of("<h1>W</h1><p id=w style='width:700px'>wide", phone=True)
    assert wide.overflow_px() > 250
    assert wide.too_wide()
    boxed = page_of(
        "<h1>B</h1><div style='overflow-x:auto'><p style='width:700px'>w</div>", phone=True
    )
    assert boxed.overflow_px() <= 0
    assert boxed.too_wide() == []
    assert boxed.page.viewport_size == PHONE


def test_grey_on_grey_is_seen_in_both_themes(page_of):
    style = "<style>:root{color-scheme:light dark} p{color:#777;background:#555}</style>"
    assert page_of(style + "<h1>H</h1><p>hard to read", dark=True).low_contrast()
    assert page_of(style + "<h1>H</h1>").low_contrast() == []


def test_tab_reaches_links_and_the_ring_is_looked_for(page_of):
    visited = page_of(
        "<style>.bare:focus{outline:none}</style><h1>T</h1><a href=#a>one</a>"
        "<a href=#b class=bare>two</a><span tabindex=0>three</span><a>no link</a>"
    )
    stops = visited.tab_stops()
    assert [(s["name"], s["seen"]) for s in stops] == [
        ("one", True),
        ("two", False),
        ("three", True),
    ]


def test_nameless_pictures_and_doubled_ids_are_seen(page_of):
    faults = page_of("<h1>N</h1><p id=a><p id=a><button></button>").unnamed()
    assert any("button" in f for f in faults)
    assert "twice: #a" in faults
