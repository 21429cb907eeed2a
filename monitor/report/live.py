"""Section: what a monitor said in flight, beside what this analysis says."""

from __future__ import annotations

from typing import TYPE_CHECKING

from monitor.report.live_found import live_lines
from monitor.report.section import Column, Part, Section, Table, Text

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]


def section(flight: Flight, axis: Range1d) -> Section | None:
    """What a monitor said in flight beside this analysis; None where none was heard."""
    heard = flight.summary.get("live")
    if heard is None:
        return None
    sentences, rows = live_lines(heard)
    parts: list[Part] = [Text(words) for words in sentences]
    if rows:
        columns = [
            Column("sensor"),
            Column("said in flight"),
            Column("this analysis"),
            Column("live was"),
            Column("its words", long=True),
        ]
        parts.append(Table("Live beside replay", columns, rows))
    lead = (
        "A monitor ran during the flight and its words stand in the log. It is later than this "
        "analysis by its time horizon and the way of its words into the log."
    )
    return Section("live", "Said in flight", lead, parts)
