"""Section: what arrived and how fast, gaps and restarts of the log, what was refused and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

from monitor.pages import palette
from monitor.pages.charts import LegendEntry
from monitor.pages.html import clock
from monitor.report.rows import Bar, Mark, rows_figure
from monitor.report.section import Chart, Column, Part, Section, Table, Text
from monitor.report.streams_found import damage, recorded, stream_rows
from monitor.report.wording import count, lasting

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]

SHOWN_S = 0.5
"""Shorter gaps are told in words only [s]."""


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Streams with their rates and gaps, and the log's own gaps, restarts and damage."""
    summary = flight.summary
    wrong = damage(summary)
    parts: list[Part] = [Text(words, "warn") for words in wrong]
    if not wrong:
        parts.append(Text("The log is whole: no gap, no restart, no byte out of place."))
    if (chart := _chart(flight, axis)) is not None:
        parts.append(chart)
    columns = [
        Column("sensor"),
        Column("from the message", long=True),
        Column("samples", number=True),
        Column("rate (Hz)", number=True),
        Column("gaps", number=True),
    ]
    parts.append(Table("Streams", columns, stream_rows(summary)))
    parts.append(
        Text(
            "A gap is a silence longer than the sensor's time-out, or than a second where it has "
            "none. The rate is the mean over the time in which samples came.",
            "soft",
        )
    )
    return Section("streams", "Streams and gaps", "", parts)


def _chart(flight: Flight, axis: Range1d) -> Chart | None:
    """What of the time was recorded; None where there is nothing to see."""
    log = flight.summary["log"]
    gaps = [g for g in log["gaps"] if g["seconds"] >= SHOWN_S]
    if not gaps and not log["boots_s"]:
        return None
    row = "recording"
    bars = [
        Bar(row, a, b, palette.REFERENCE, "", f"recorded from {clock(a, 1)} to {clock(b, 1)}")
        for a, b in recorded(flight.summary)
    ]
    bars += [
        Bar(
            row,
            max(g["at_s"], 0.0),
            g["at_s"] + g["seconds"],
            palette.THRESHOLD,
            "right_diagonal_line",
            f"nothing recorded for {lasting(g['seconds'])} from {clock(g['at_s'], 1)}",
            0.25,
        )
        for g in gaps
    ]
    marks = [
        Mark(row, at_s, palette.INK, "inverted_triangle", f"restart at {clock(at_s, 1)}")
        for at_s in log["boots_s"]
    ]
    legend = [LegendEntry("recorded", palette.REFERENCE, "shade")]
    if gaps:
        legend.append(LegendEntry("nothing recorded", palette.THRESHOLD, "shade"))
    said = f"{count(len(gaps), 'gap')} and {count(len(marks), 'restart')} of the vehicle"
    return Chart(
        "recording",
        rows_figure(axis, [row], bars, marks),
        f"{said}; a triangle is a restart.",
        f"Timeline of the recording: {said}.",
        more_legend=legend,
    )
