"""The report as a file: whole or not there, loading nothing, and readable without its charts."""

from __future__ import annotations

import itertools
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from links.vocabulary import State
from monitor.pages import html, palette
from monitor.report import REPORT, write_report
from monitor.report.flight import Flight
from monitor.report.page import frame, render
from monitor.report.section import (
    Column,
    Fold,
    Link,
    Listing,
    Said,
    Section,
    Table,
    Text,
)
from monitor.report.tables import MemoryTables
from monitor.report.verdict_sentence import Top
from monitor.settings import Settings
from monitor.verdict import Verdict
from tests.monitor.report.summaries import fault, summary

HOSTILE = "</script><script>alert('x')</script><img src=//evil.example>"


class Page(HTMLParser):
    """The elements of a page with their attributes, and the text of each kind of them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {key: value or "" for key, value in attrs}))
        self._open.append(tag)
        self.texts.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self._open:
            self.texts[self._open[-1]][-1] += data

    def every(self, attribute: str) -> list[str]:
        return [found[attribute] for _, found in self.tags if attribute in found]


@pytest.fixture(scope="module")
def report(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The synthetic flight: a pitot reads low, then an accelerometer is off."""
    return write_report(tmp_path_factory.mktemp("report"), flight).read_text("utf-8")


@pytest.fixture(scope="module")
def page(report: str) -> Page:
    return Page(report)


def head(**changed: Any) -> Top:
    known = {
        "title": "t",
        "log": "l",
        "state": State.OK,
        "verdict": "v",
        "besides": [],
        "facts": [],
    }
    return Top(**(known | changed))


def test_the_file_is_whole_or_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight(summary(), Settings(), [], MemoryTables({}))
    old = tmp_path / REPORT
    old.write_text("an earlier one")
    with monkeypatch.context() as m:
        m.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
        with pytest.raises(OSError, match="disk full"):
            write_report(tmp_path, flight)
    assert old.read_text() == "an earlier one"
    assert list(tmp_path.iterdir()) == [old]
    assert write_report(tmp_path, flight) == old
    assert old.read_text("utf-8").endswith("</html>\n")


def test_no_script_but_ours_and_no_request(report: str, page: Page) -> None:
    (policy,) = [a["content"] for t, a in page.tags if a.get("http-equiv")]
    assert policy.startswith("default-src 'none'; ")
    ours = [
        t
        for (_, a), t in zip(
            [(t, a) for t, a in page.tags if t == "script"], page.texts["script"], strict=True
        )
        if a.get("type") != "application/json"
    ]
    assert set(re.findall(r"'(sha256-[^']+)'", policy)) == {html.digest(text) for text in ours}
    assert not page.every("src")
    assert all(href.startswith("#") for href in page.every("href"))
    assert not [a for _, a in page.tags if any(key.startswith("on") for key in a)]


def test_charts_hold_no_code(page: Page) -> None:
    (charts,) = [t for t in page.texts["script"] if t.startswith("{")]
    document = json.loads(charts)
    assert len(document["roots"]) == len(page.every("data-root"))
    assert re.search(r'"name":"CustomJS', charts) is None


def test_every_link_leads_somewhere_and_every_name_is_given_once(page: Page) -> None:
    names = page.every("id")
    assert len(names) == len(set(names))
    assert {href[1:] for href in page.every("href")} <= set(names)
    assert {"fault-1", "fault-2"} <= {href[1:] for href in page.every("href")}


def test_links_to_findings_that_share_charts_or_have_none_lead_to_where_they_are_told() -> None:
    faults = [fault("airspeed0", 5.0 * k, 5.0 * k + 1, cleared_s=5.0 * k + 2) for k in range(1, 56)]
    flight = Flight(summary(faults=faults), Settings(), _verdicts(faults), MemoryTables({}))
    many = Page(render(flight))
    (charts,) = [t for t in many.texts["script"] if t.startswith("{")]
    led = [href[1:] for href in many.every("href")]
    led += re.findall(r'"#((?:fault|event|sensor)[a-z0-9-]*)"', charts)
    assert sum(key.startswith("fault-") for key in led) >= 2 * len(faults)
    assert set(led) <= set(many.every("id"))
    assert len(many.every("id")) == len(set(many.every("id")))


def _verdicts(faults: list[dict[str, Any]]) -> list[Verdict]:
    times = [
        (f[key], state)
        for f in faults
        for key, state in (("isolated_s", State.FAULTY), ("cleared_s", State.OK))
    ]
    return [Verdict(round(1e6 * t_s), "airspeed0", state) for t_s, state in times]


def test_headings_go_down_one_step_at_a_time(page: Page) -> None:
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in itertools.pairwise(levels))


def test_every_chart_says_in_words_what_it_shows(page: Page) -> None:
    pictures = [a for _, a in page.tags if a.get("role") == "img"]
    assert len(pictures) > 5
    assert all(len(a["aria-label"]) > 20 for a in pictures)
    assert sum(tag == "figcaption" for tag, _ in page.tags) == len(pictures)


def test_the_verdict_stands_on_top_and_its_faults_below(report: str) -> None:
    assert "2 faults: airspeed0 from " in report
    text = report.index
    assert text("2 faults") < text("Sensors over the flight") < text('id="fault-1"')


def test_the_timeline_is_also_a_table(report: str, flight: Flight) -> None:
    table = report.partition("<caption>States of every sensor</caption>")[2].partition("</table>")[
        0
    ]
    rows = [row.split("</th>")[0].rpartition('"row">')[2] for row in table.split("<tr>")[2:]]
    assert rows
    assert {sensor: rows.count(sensor) for sensor in rows} == {
        sensor: len(spans) for sensor, spans in flight.spans.items()
    }


def test_all_colours_of_the_charts_are_known_in_the_dark(page: Page) -> None:
    (charts,) = [t for t in page.texts["script"] if t.startswith("{")]
    unknown = set(re.findall(r'"(#[0-9a-fA-F]{3,8})"', charts)) - set(palette.dark_by_light())
    assert not unknown


def test_no_text_of_a_log_becomes_markup() -> None:
    parts = [
        Text(HOSTILE),
        Listing([HOSTILE, Link(HOSTILE, "#a"), Said(State.OK)]),
        Listing([(HOSTILE, HOSTILE)]),
        Table(HOSTILE, [Column(HOSTILE), Column("b", number=True)], [[HOSTILE, HOSTILE]]),
        Fold(HOSTILE, [Text(HOSTILE)]),
    ]
    section = Section("a", HOSTILE, HOSTILE, parts)
    hostile = frame(head(title=HOSTILE, verdict=HOSTILE, besides=[HOSTILE]), [section])
    harmless = frame(head(), [Section("a", "x", "x", [])])
    count = {tag: sum(t == tag for t, _ in Page(hostile).tags) for tag in ("script", "img")}
    assert count == {tag: sum(t == tag for t, _ in Page(harmless).tags) for tag in count}


def test_a_flight_of_which_nothing_is_known_has_a_report(tmp_path: Path) -> None:
    empty = summary(monitored=[], streams=[], log={"duration_s": 0.0, "first_t_us": None})
    flight = Flight(empty, Settings(), [], MemoryTables({}))
    text = write_report(tmp_path, flight).read_text("utf-8")
    assert "No sensor could be judged." in text
