"""Sections of tables, lists and timelines: what stands in them."""

from __future__ import annotations

from typing import Any

import pytest

from monitor.report import autopilots, configuration, coverage, live, rejected, streams
from monitor.report.section import Chart, Fold, Listing, Section, Table, Text
from tests.monitor.report import small_flight as small
from tests.monitor.report.summaries import fault, said, span, watched

models = pytest.importorskip("bokeh.models")

HOSTILE = "<script>alert(1)</script>"


def made(module: Any, **changed: Any) -> Section:
    flight = small.flight(**changed)
    section = module.section(flight, models.Range1d(0.0, flight.duration_s))
    assert isinstance(section, Section)
    return section


def parts(section: Section, kind: type) -> list[Any]:
    return [part for part in section.parts if isinstance(part, kind)]


def bars(chart: Chart) -> dict[str, list[tuple[float, float]]]:
    out: dict[str, list[tuple[float, float]]] = {}
    for renderer in chart.models[0].renderers:
        data = renderer.data_source.data
        if "from" in data:
            for row, a, b in zip(data["row"], data["from"], data["to"], strict=True):
                out.setdefault(row, []).append((a, b))
    return out


def test_judges_stand_above_each_other_on_the_time_axis() -> None:
    section = made(
        autopilots,
        faults=[fault("airspeed0", 100.0, 101.0, cleared_s=150.0), fault("aoa0", 60.0, 61.0)],
        baselines={
            "px4": [said("airspeed0", 105.0)],
            "autopilot_said": [{"t_s": 2.0, "severity": 6, "text": HOSTILE}],
        },
    )
    (chart,) = parts(section, Chart)
    assert bars(chart) == {
        "airspeed0 ours": [(101.0, 150.0)],
        "airspeed0 PX4": [(105.0, 300.0)],
        "aoa0 ours": [(61.0, 300.0)],
    }
    (figure,) = chart.models
    assert figure.x_range.end == 300.0
    assert list(reversed(figure.y_range.factors)) == [
        "airspeed0 ours",
        "airspeed0 ArduPilot",
        "airspeed0 PX4",
        "airspeed0 in flight",
        "aoa0 ours",
        "STATUSTEXT",
    ]
    (table,) = parts(section, Table)
    assert [row[0] for row in table.rows] == ["mavsentry", "mavsentry", "PX4's checks"]
    (listing,) = parts(section, Listing)
    assert len(listing.items) == 2


def test_a_silent_flight_has_a_sentence_and_no_empty_chart() -> None:
    section = made(autopilots)
    assert parts(section, Chart) == []
    (text,) = parts(section, Text)
    assert text.words.startswith("Nobody found anything")


def test_what_a_log_says_stays_text() -> None:
    from monitor.report.page import render

    flight = small.flight(
        log={"path": f"{HOSTILE}.tlog"},
        baselines={
            "autopilot_said": [{"t_s": 2.0, "severity": 2, "text": HOSTILE}],
            "ardupilot": [said("imu0", 20.0)],
        },
        rejected={HOSTILE: {HOSTILE: 3}},
    )
    page = render(flight)
    assert HOSTILE not in page
    assert "alert(1)" in page


def test_the_recording_is_drawn_only_where_it_has_holes() -> None:
    assert parts(made(streams), Chart) == []
    section = made(streams, log={"gaps": [{"at_s": 100.0, "seconds": 30.0}], "boots_s": [131.0]})
    (chart,) = parts(section, Chart)
    assert sorted(bars(chart)["recording"]) == [(0.0, 100.0), (100.0, 130.0), (130.0, 300.0)]
    assert [t.tone for t in parts(section, Text)][:2] == ["warn", "warn"]


def test_a_gap_of_milliseconds_is_told_and_not_drawn() -> None:
    section = made(streams, log={"gaps": [{"at_s": -0.004, "seconds": 0.03}]})
    assert parts(section, Chart) == []
    assert parts(section, Text)[0].words == "1 gap in the recording: 30 ms from 0:00."


def test_what_was_rejected_or_that_nothing_was() -> None:
    (text,) = parts(made(rejected), Text)
    assert "Nothing was rejected" in text.words
    (table,) = parts(made(rejected, rejected={"imu0": {"late": 2}}), Table)
    assert table.rows[0][:3] == ["imu0", "late", "2"]


def test_every_lack_of_judgement_comes_with_what_to_do() -> None:
    section = made(
        coverage,
        monitored=[
            watched("wing_left.lift", 0.0, span(0.0, 300.0, "no airframe coefficients "
                                                            "([wing] airframe)")),
            watched("imu0.acc_x", 250.0, span(0.0, 50.0, "on ground")),
        ],
    )  # fmt: skip
    fine, not_checked = parts(section, Table)
    assert [row[0] for row in fine.rows] == ["imu0 acc x"]
    (row,) = [row for row in not_checked.rows if row[0] == "wing_left.lift"]
    assert "mavsentry learn airframe" in row[-1]
    assert {r[0] for r in not_checked.rows} >= {"airspeed0", "gps0"}  # streams nobody judged
    assert all(len(r) == len(not_checked.columns) for r in not_checked.rows)
    soft = [t.words for t in parts(section, Text) if t.tone == "soft"]
    assert soft == ["On the ground nothing is judged: 0:00 to 0:50."]


def test_the_configuration_names_profile_version_and_what_was_changed() -> None:
    section = made(
        configuration,
        made_by={"version": "1.2", "profile": "small-uav", "changed": {"imu.acc_size_m_s2": 0.5}},
    )
    (facts,) = parts(section, Listing)
    assert dict(facts.items)["judged by"] == "mavsentry 1.2"
    (table,) = parts(section, Table)
    assert table.rows[0][:4] == ["imu.acc_size_m_s2", "0.5", "0.35", "m/s²"]
    (fold,) = parts(section, Fold)
    assert len(fold.parts[0].rows) > 5


def test_live_is_shown_only_where_a_monitor_was_heard() -> None:
    flight = small.flight()
    assert live.section(flight, models.Range1d(0.0, 300.0)) is None
    heard = {
        "monitors": [{"component_id": 191, "from_s": 1.0, "to_s": 290.0, "words": 9, "silent": []}],
        "faults": [],
    }
    section = made(live, live=heard)
    assert parts(section, Table) == []
    assert "it said of no fault" in parts(section, Text)[0].words
