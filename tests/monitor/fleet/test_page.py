"""The fleet page: its figures by hand, and that no text of a log can do anything in it."""

from __future__ import annotations

import base64
import hashlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from monitor.fleet.figures import SHOWN, figures, lower_bound
from monitor.fleet.page import PAGE, rendered, write_page
from monitor.fleet.places import Place
from tests.monitor.fleet.small_fleet import KEY, dataset, fault, flight, lost

MADE_BY_HOSTILE = '<script>alert("x")</script>'


class Elements(HTMLParser):
    """The page's elements with their attributes, and the texts of some."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self._open = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._open = tag

    def handle_endtag(self, tag: str) -> None:
        self._open = ""

    def handle_data(self, data: str) -> None:
        self.texts[self._open] = self.texts.get(self._open, "") + data

    def every(self, attribute: str) -> list[str]:
        return [a[attribute] or "" for _, a in self.tags if attribute in a]

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.tags)


@pytest.fixture(scope="module")
def fleet() -> dict[str, pa.Table]:
    """Eight flights of two aircraft, a copy, and four logs without a verdict."""
    gone = {"cleared_s": 610.0}
    return dataset(
        *(flight(f"/logs/plane-a/{k}.tlog", month=3 + k % 2) for k in range(6)),
        flight("/logs/plane-a/odd.tlog", [fault(**gone), fault("imu0.acc_x", 900.0)], month=4),
        flight("/logs/plane-b/one.tlog", [fault(kind="drift")], digest="b1", hours=1.0),
        flight("/logs/plane-b/copy.tlog", [fault(kind="drift")], digest="b1", hours=1.0),
        lost("/logs/plane-b/empty.tlog", "the log is empty"),
        lost("/logs/plane-b/none.tlog", "the log is empty"),
        lost("/logs/plane-b/late.tlog", "gave up after 3600 s", again=True),
    )


@pytest.fixture(scope="module")
def shown(fleet: dict[str, pa.Table]) -> dict[str, Any]:
    return figures(fleet, KEY)


def test_the_totals_count_a_copied_flight_once(shown: dict[str, Any]) -> None:
    counts = {k: v for k, v in shown.items() if k.startswith("n_")}
    assert counts == {
        "n_logs": 12,
        "n_flights": 8,
        "n_flown": 8,
        "n_faulty": 2,
        "n_aircraft": 2,
        "n_copies": 1,
        "n_other_key": 0,
        "n_learnt": 0,
        "n_faults": 3,
        "n_doubted": 1,
    }
    assert shown["hours"] == pytest.approx(7 * 0.5 + 1.0)
    assert shown["doubted_per_hour"] == pytest.approx(1 / 4.5)


def test_faults_by_sensor_by_aircraft_and_by_month(shown: dict[str, Any]) -> None:
    def table(name: str) -> list[tuple[Any, ...]]:
        rows = shown[name].rows
        return [(g.name, g.flights, g.faulty, g.faults, g.doubtful, dict(g.by)) for g in rows]

    assert table("by_sensor") == [
        ("airspeed0", 8, 2, 2, 1, {"bias": 1, "drift": 1}),
        ("imu0.acc_x", 8, 1, 1, 0, {"bias": 1}),
        ("gps0", 8, 0, 0, 0, {}),
        ("imu0.acc_y", 8, 0, 0, 0, {}),
    ]
    assert table("by_aircraft") == [
        ("plane-b", 1, 1, 1, 0, {"airspeed0": 1}),
        ("plane-a", 7, 1, 2, 1, {"airspeed0": 1, "imu0.acc_x": 1}),
    ]
    assert table("by_month") == [
        ("2026-04", 4, 1, 2, 1, {"airspeed0": 1, "imu0.acc_x": 1}),
        ("2026-03", 4, 1, 1, 0, {"airspeed0": 1}),
    ]


def test_an_instrument_is_faulty_in_a_flight_once(shown: dict[str, Any]) -> None:
    matrix = shown["matrix"]
    assert matrix.instruments == ["airspeed0", "gps0", "imu0"]
    cells = {a: [(c.faulty, c.flights) for c in row] for a, row in matrix.rows}
    assert cells == {"plane-a": [(1, 7), (0, 7), (1, 7)], "plane-b": [(1, 1), (0, 1), (0, 1)]}


def test_the_worst_offender_is_the_one_that_its_flights_prove() -> None:
    always = [flight(f"/l/plane-x/{k}.tlog", [fault()]) for k in range(4)]
    sometimes = [flight(f"/l/plane-y/{k}.tlog", [fault()] if k < 6 else ()) for k in range(40)]
    shown = figures(dataset(*always, *sometimes, flight("/l/plane-z/0.tlog", [fault()])), KEY)
    ranked = [(a, g.faulty, g.flights) for a, g in shown["offenders"].rows]
    assert ranked == [("plane-x", 4, 4), ("plane-z", 1, 1), ("plane-y", 6, 40)]


def test_wilsons_bound_in_the_cases_that_are_closed() -> None:
    zz = 1.2816**2
    assert lower_bound(3, 3) == pytest.approx(3 / (3 + zz))
    assert lower_bound(0, 9) == lower_bound(0, 0) == 0.0
    assert lower_bound(500_000, 1_000_000) == pytest.approx(0.5, abs=1e-3)


def test_a_fault_that_stands_alone_is_said_so_and_is_no_candidate_by_itself(
    shown: dict[str, Any],
) -> None:
    (candidate,) = shown["doubted"].rows
    assert (candidate["sensor"], candidate["alone"]) == ("airspeed0", True)
    alone = {(f["aircraft"], f["sensor"]): f["alone"] for f in shown["faults"].rows}
    assert alone == {
        ("plane-a", "airspeed0"): True,
        ("plane-a", "imu0.acc_x"): True,
        ("plane-b", "airspeed0"): False,
    }


def test_what_the_autopilot_saw_too_is_no_candidate() -> None:
    said = {"baselines": {"ardupilot": [{"sensor": "airspeed0", "from_s": 605.0}], "px4": []}}
    tables = dataset(flight("/l/plane-a/0.tlog", [fault(cleared_s=610.0)], **said))
    assert figures(tables, KEY)["n_doubted"] == 0


def test_logs_without_a_verdict_stand_by_their_reason(shown: dict[str, Any]) -> None:
    assert [(g["reason"], g["status"], g["count"]) for g in shown["not_judged"].rows] == [
        ("the log is empty", "unusable", 2),
        ("gave up after 3600 s", "failed", 1),
    ]
    page = rendered(shown)
    assert "/logs/plane-b/empty.tlog, /logs/plane-b/none.tlog" in page
    assert "tried again by the next run" in page


def test_every_link_leads_to_a_file_beside_the_page(
    tmp_path: Path, fleet: dict[str, pa.Table]
) -> None:
    place = Place(str(tmp_path))
    for report in fleet["logs"]["report"].to_pylist():
        if report:
            place.write(report, b"{}")
    write_page(place, fleet, KEY)
    elements = Elements((tmp_path / PAGE).read_text("utf-8"))
    away = [href for href in elements.every("href") if not href.startswith("#")]
    assert len(away) >= 5
    flown = (r for r in fleet["logs"].to_pylist() if r["status"] == "judged")
    assert {row["report"] for row in flown} <= set(away)
    assert all((tmp_path / href).is_file() for href in away)
    anchors = {href[1:] for href in elements.every("href") if href.startswith("#")}
    assert anchors <= set(elements.every("id"))


def test_a_page_loads_nothing_and_admits_its_own_script_alone(shown: dict[str, Any]) -> None:
    page = rendered(shown)
    elements = Elements(page)
    for attribute in ("src", "srcset", "style", "onclick", "onerror"):
        assert elements.every(attribute) == []
    assert elements.count("link") == 0
    for loads in ("http:", "https:", "@import", "url("):
        assert loads not in page
    policy = next(c for c in elements.every("content") if c.startswith("default-src 'none'"))
    for tag in ("style", "script"):
        digest = base64.b64encode(hashlib.sha256(elements.texts[tag].encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy


def test_texts_of_logs_are_shown_and_never_run() -> None:
    hostile = fault(
        evidence=f"{MADE_BY_HOSTILE} & '", kind='"><img src=x onerror=y>', cleared_s=610.0
    )
    page = rendered(
        figures(
            dataset(
                flight(f"/l/plane-<b>/{MADE_BY_HOSTILE}.tlog", [hostile]),
                lost("/l/<i>.tlog", "no <table> in it"),
            ),
            KEY,
        )
    )
    elements = Elements(page)
    assert elements.count("script") == 1
    assert not {"b", "img", "i"} & {tag for tag, _ in elements.tags}
    assert "alert(&#34;x&#34;)&lt;/script&gt;" in page
    assert "no &lt;table&gt; in it" in page
    assert "plane-&lt;b&gt;" in page


def test_long_lists_end_and_say_how_much_is_left_out() -> None:
    entries = [flight(f"/l/plane-{k:03d}/0.tlog", [fault(cleared_s=610.0)]) for k in range(130)]
    shown = figures(dataset(*entries), KEY)
    for name in ("faults", "doubted", "by_aircraft"):
        assert (len(shown[name].rows), shown[name].more) == (SHOWN, 30)
    page = rendered(shown)
    for what in ("30 more faults", "30 more candidates", "30 more aircraft", "105 more sensors"):
        assert f"{what}: see the dataset." in page
    assert "100 more aircraft have faults." in page


def test_the_newest_faults_stand_first_and_each_group_links_to_its_newest() -> None:
    shown = figures(
        dataset(*(flight(f"/l/plane-a/{m}.tlog", [fault()], month=m) for m in (2, 5, 3))), KEY
    )
    assert [f["month"] for f in shown["faults"].rows] == ["2026-05", "2026-03", "2026-02"]
    newest = shown["faults"].rows[0]["report"]
    assert [g.report for g in shown["by_aircraft"].rows] == [newest]


def test_flights_that_cannot_be_compared_are_counted_aloud() -> None:
    tables = dataset(flight("/l/plane-a/0.tlog", learnt={"from_this_flight": True}))
    page = rendered(figures(tables, "another key"))
    assert "1 flights were judged by other settings or another version" in page
    assert "1 flights were judged by thresholds that were learnt from them" in page


def test_an_empty_fleet_has_a_page() -> None:
    page = rendered(figures(dataset(), KEY))
    assert "No fault was found." in page
    assert "nothing was judged" in page


def test_angles_are_shown_in_degrees_and_what_is_unknown_as_a_dash() -> None:
    turn = fault("imu0.acc_x", magnitude=0.0349, unit="rad/s")
    unknown = fault(magnitude=None, unit="")
    page = rendered(figures(dataset(flight("/l/plane-a/0.tlog", [turn, unknown])), KEY))
    assert "+2 deg/s" in page
    assert '<td class="n" data-label="size">–</td>' in page
