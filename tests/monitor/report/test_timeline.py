"""Every state of every sensor is drawn once, told without colour, and leads to its evidence."""

from __future__ import annotations

import itertools
from typing import Any

from bokeh.models import HBar, HoverTool, Range1d, TapTool

from links.vocabulary import Kind, Reason, State
from monitor.pages.palette import LOOKS
from monitor.report import timeline
from monitor.report.flight import Flight
from monitor.report.section import Chart, Fold, Section, Table
from monitor.report.tables import MemoryTables
from monitor.settings import Settings
from monitor.verdict import Verdict
from tests.monitor.report.summaries import fault, summary


def said(t_s: float, sensor: str, state: State, **more: Any) -> Verdict:
    return Verdict(round(1e6 * t_s), sensor, state, **more)


VERDICTS = [
    said(2.0, "airspeed0", State.UNMONITORED, reason=Reason.ON_GROUND),
    said(2.0, "imu2", State.ABSENT),
    said(30.0, "airspeed0", State.OK, evidence="airspeed0 agrees with GPS and wind"),
    said(30.0, "gps0", State.OK),
    said(100.0, "airspeed0", State.SUSPECT),
    said(101.004999, "airspeed0", State.FAULTY, kind=Kind.BIAS, evidence="3 m/s low"),
    said(110.0, "airspeed0", State.OK),
    said(200.0, "airspeed0", State.FAULTY, kind=Kind.STUCK, evidence="stands still"),
    said(250.0, "gps0", State.STALE),
]
FAULTS = [
    fault("airspeed0", 99.0, 101.005, cleared_s=110.0),
    fault("airspeed0", 198.0, 200.0, kind="stuck"),
]


def section(verdicts: list[Verdict] = VERDICTS, **changed: Any) -> Section:
    flight = Flight(summary(**changed), Settings(), verdicts, MemoryTables({}))
    made = timeline.section(flight, Range1d(0.0, 300.0))
    assert made is not None
    return made


def chart(made: Section) -> Chart:
    (found,) = [part for part in made.parts if isinstance(part, Chart)]
    return found


def bars(made: Section) -> list[tuple[str, float, float, str]]:
    """Sensor, beginning, end and colour of every bar that is seen."""
    (figure,) = chart(made).models
    return sorted(
        (name, a, b, renderer.glyph.fill_color)
        for renderer in figure.renderers
        if isinstance(renderer.glyph, HBar) and renderer.glyph.fill_alpha > 0
        for name, a, b in zip(
            *(renderer.data_source.data[k] for k in ("sensor", "from", "to")), strict=True
        )
    )


def test_bars_cover_the_flight_without_gap_or_overlap() -> None:
    by_sensor: dict[str, list[tuple[float, float]]] = {}
    for sensor, start, end, _ in bars(section(faults=FAULTS)):
        by_sensor.setdefault(sensor, []).append((start, end))
    assert set(by_sensor) == {"airspeed0", "gps0", "imu2"}
    for spans in by_sensor.values():
        assert (spans[0][0], spans[-1][1]) == (0.0, 300.0)
        assert all(a[1] == b[0] for a, b in itertools.pairwise(spans))


def test_a_bar_has_the_look_of_its_state() -> None:
    colours = {(name, start): colour for name, start, _, colour in bars(section())}
    assert colours["airspeed0", 200.0] == LOOKS[State.FAULTY].tone.light
    assert colours["gps0", 250.0] == LOOKS[State.STALE].tone.light
    (figure,) = chart(section()).models
    glyphs = [r.glyph for r in figure.renderers if isinstance(r.glyph, HBar)]
    looks = {g.fill_color: (g.height, g.hatch_pattern) for g in glyphs if g.fill_alpha > 0}
    assert len(set(looks.values())) == len(looks), "two states differ in colour alone"


def test_what_is_wrong_stands_on_top_and_what_is_absent_below() -> None:
    (figure,) = chart(section()).models
    assert list(reversed(figure.y_range.factors)) == ["airspeed0", "gps0", "imu2"]


def test_the_pointer_is_told_state_time_reason_and_evidence() -> None:
    (figure,) = chart(section()).models
    (hover,) = figure.select(HoverTool)
    (rows,) = hover.renderers
    told = {
        (sensor, start): (words, when, why)
        for sensor, start, words, when, why in zip(
            *(rows.data_source.data[k] for k in ("sensor", "from", "said", "when", "why")),
            strict=True,
        )
    }
    assert told["airspeed0", 2.0] == (
        "unmonitored",
        "0:02 to 0:30 (2.0 s, for 28.0 s)",
        "on ground",
    )
    assert told["airspeed0", 200.0][::2] == ("faulty (stuck)", "stands still")
    assert rows.glyph.height == 1.0


def test_a_tap_on_a_fault_leads_to_its_evidence() -> None:
    (figure,) = chart(section(faults=FAULTS)).models
    (tap,) = figure.select(TapTool)
    assert tap.callback.url == "@href"
    leads = {
        start: href
        for renderer in tap.renderers
        for start, href in zip(
            *(renderer.data_source.data[k] for k in ("from", "href")), strict=True
        )
    }
    assert leads == {100.0: "#fault-1", 101.0: "#fault-1", 200.0: "#fault-2"}


def test_the_table_says_what_the_chart_shows() -> None:
    made = section(faults=FAULTS)
    (fold,) = [part for part in made.parts if isinstance(part, Fold)]
    (table,) = fold.parts
    assert isinstance(table, Table)
    assert len(table.rows) == len(bars(made))
    assert [str(cell) for cell in table.rows[4]][2:] == ["1:41", "1:50", "bias: 3 m/s low"]


def test_a_flight_that_flutters_is_cut_short_in_the_table_and_says_so() -> None:
    states = [State.OK, State.STALE]
    many = [said(k / 10, "gps0", states[k % 2]) for k in range(1, 1500)]
    (fold,) = [part for part in section(many).parts if isinstance(part, Fold)]
    table, rest = fold.parts
    assert isinstance(table, Table)
    assert len(table.rows) == timeline.TABLE_ROWS
    assert rest.words == "1,100 more are not listed."


def test_nothing_watched_has_no_timeline() -> None:
    flight = Flight(summary(monitored=[]), Settings(), [], MemoryTables({}))
    assert timeline.section(flight, Range1d(0.0, 300.0)) is None
