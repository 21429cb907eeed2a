"""Section: what ArduPilot's and PX4's own checks would have said on this log, beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.charts import LegendEntry
from monitor.pages.html import clock
from monitor.report.autopilots_compared import (
    ARDUPILOT,
    CHECKED,
    JUDGES,
    OURS,
    PX4,
    SPOKEN,
    Judged,
    judged,
    sentences,
)
from monitor.report.rows import Bar, Mark, rows_figure
from monitor.report.section import Chart, Column, Fold, Listing, Part, Section, Table, Text
from monitor.report.wording import instrument, listed, number

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]

LINES: Final = 300
"""Rows of the table, and lines of the autopilot, that are shown."""
GRAVE: Final = 4
"""MAVLink's severity up to which a line is a warning."""

_TONES: Final = {
    OURS: (palette.LOOKS[State.FAULTY].tone, ""),
    ARDUPILOT: (palette.MEASURED, "right_diagonal_line"),
    PX4: (palette.REFERENCE, "vertical_line"),
    SPOKEN: (palette.MORE[3], "dot"),
}
"""Colour and hatch of a judge's bars; the row's name tells it too."""
_SHORT: Final = {OURS: "ours", ARDUPILOT: "ArduPilot", PX4: "PX4", SPOKEN: "in flight"}


def section(flight: Flight, axis: Range1d) -> Section | None:
    """A timeline, the comparison in words, every verdict with its evidence, what was set."""
    summary = flight.summary
    verdicts = judged(summary)
    said = sentences(summary)
    parts: list[Part] = [Listing(said) if len(said) > 1 else Text(said[0])]
    if verdicts:
        parts.append(_chart(flight, axis, verdicts))
        parts.append(_table(verdicts))
    parts += _spoken(summary["baselines"]["autopilot_said"])
    if settings := summary["baselines"]["settings"]:
        parts.append(Fold("Parameters of ArduPilot's checks", [_settings(settings)]))
    return Section(
        "autopilots",
        "The autopilots' own checks",
        "What ArduPilot's and PX4's checks of airspeed and IMUs would have said of the same data, "
        "whichever autopilot flew: their logic, modelled after their sources, ran beside ours.",
        parts,
    )


def _chart(flight: Flight, axis: Range1d, verdicts: Sequence[Judged]) -> Chart:
    instruments = sorted({instrument(v.sensor) for v in verdicts})
    texts = flight.summary["baselines"]["autopilot_said"]
    spoken = bool(texts)
    judges = JUDGES if spoken else JUDGES[:-1]
    rows = [
        f"{name} {_SHORT[judge]}"
        for name in instruments
        for judge in _rows_of(name, judges, verdicts)
    ]
    bars = []
    for v in verdicts:
        tone, hatch = _TONES[v.judge]
        to_s = flight.duration_s if v.to_s is None else v.to_s
        until = "the end" if v.to_s is None else clock(v.to_s, 1)
        words = f"{v.judge}: {v.sensor} {v.what}, {clock(v.from_s, 1)} to {until}. {v.evidence}"
        row = f"{instrument(v.sensor)} {_SHORT[v.judge]}"
        bars.append(Bar(row, v.from_s, to_s, tone, hatch, words))
    marks = []
    if spoken:
        rows.append("STATUSTEXT")
        for line in texts[:LINES]:
            grave = line["severity"] <= GRAVE
            tone = palette.THRESHOLD if grave else palette.SOFT
            words = f"{clock(line['t_s'], 1)} {line['text']}"
            marks.append(
                Mark("STATUSTEXT", line["t_s"], tone, "triangle" if grave else "dash", words)
            )
    said_of = listed([f"{v.sensor} by {v.judge} at {clock(v.from_s)}" for v in verdicts[:6]])
    return Chart(
        "autopilots-timeline",
        rows_figure(axis, rows, bars, marks),
        "A row for each judge of each instrument; an empty row said nothing. Triangles are "
        "warnings of the autopilot, dashes its other lines about these sensors."
        if spoken
        else "A row for each judge of each instrument; an empty row said nothing. The log holds no "
        "text of the autopilot about these sensors.",
        f"Timeline of verdicts: {said_of}{' and more' if len(verdicts) > 6 else ''}.",
        more_legend=[LegendEntry(judge, _TONES[judge][0], "shade") for judge in judges],
    )


def _rows_of(name: str, judges: Sequence[str], verdicts: Sequence[Judged]) -> Sequence[str]:
    """Judges that look at an instrument; of the IMUs together only those that spoke of them."""
    if name == "imu":
        return [j for j in judges if any(v.sensor == name and v.judge == j for v in verdicts)]
    return judges if name.startswith(CHECKED) else JUDGES[:1]


def _table(verdicts: Sequence[Judged]) -> Table:
    columns = [
        Column("who"),
        Column("sensor"),
        Column("said"),
        Column("from", number=True),
        Column("until", number=True),
        Column("evidence", long=True),
    ]
    rows = [
        [
            v.judge,
            v.sensor,
            v.what,
            clock(v.from_s, 1),
            "the end" if v.to_s is None else clock(v.to_s, 1),
            v.evidence or "–",
        ]
        for v in verdicts[:LINES]
    ]
    more = f", the first {LINES} of {len(verdicts)}" if len(verdicts) > LINES else ""
    return Table(f"Every verdict{more}", columns, rows)


def _spoken(texts: Sequence[Mapping[str, Any]]) -> list[Part]:
    if not texts:
        return []
    columns = [Column("time"), Column("severity"), Column("text", long=True)]
    rows = [
        [clock(line["t_s"], 1), _SEVERITIES.get(line["severity"], "?"), line["text"]]
        for line in texts[:LINES]
    ]
    many = len(texts)
    title = f"What the autopilot said of airspeed, IMU, EKF and GPS ({many})"
    more = f"The first {LINES} of them" if many > LINES else "STATUSTEXT"
    return [Fold(title, [Table(more, columns, rows)])]


_SEVERITIES: Final = {
    0: "emergency",
    1: "alert",
    2: "critical",
    3: "error",
    4: "warning",
    5: "notice",
    6: "info",
    7: "debug",
}


def _settings(settings: Mapping[str, Mapping[str, Any]]) -> Table:
    columns = [Column("parameter"), Column("value", number=True), Column("from")]
    rows = [
        [name, number(s["value"]), "the log" if s["from"] == "log" else "ArduPilot's default"]
        for name, s in settings.items()
    ]
    return Table("As the checks were run", columns, rows)
