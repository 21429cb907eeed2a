"""Section: what was not used, by sensor and reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

from monitor.report.section import Column, Part, Section, Table, Text
from monitor.report.streams_found import rejections

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]


def section(flight: Flight, axis: Range1d) -> Section | None:
    """What was refused, how often, and what each reason means."""
    rows = rejections(flight.summary)
    parts: list[Part]
    if rows:
        columns = [
            Column("sensor"),
            Column("reason"),
            Column("times", number=True),
            Column("which means", long=True),
        ]
        parts = [Table("Not used", columns, rows)]
    else:
        parts = [Text("Nothing was rejected: every message that arrived was used.")]
    return Section("rejected", "Rejected", "", parts)
