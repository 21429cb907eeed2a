"""Section: with what configuration the flight was judged."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from monitor.report.configuration_found import (
    Key,
    changed_keys,
    learnt_from,
    thresholds,
)
from monitor.report.section import Column, Fold, Listing, Part, Section, Table, Text
from monitor.report.wording import count

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]

_KEY_COLUMNS = (
    Column("key"),
    Column("value", number=True),
    Column("profile's", number=True),
    Column("unit"),
    Column("meaning", long=True),
)


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Profile, changed keys, learnt and other thresholds in force, version, file."""
    summary, settings = flight.summary, flight.settings
    made_by = summary["made_by"]
    parts: list[Part] = [Listing(_facts(summary))]
    changed = changed_keys(settings, made_by["changed"])
    if changed:
        parts.append(_table("Changed from the profile", changed))
    else:
        parts.append(Text(f"Every key stands as the profile {made_by['profile']} has it."))
    for k, words in enumerate(learnt_from(settings, summary["learnt"])):
        parts.append(Text(words, "warn" if k else ""))
    quantities = sorted({s["sensor"].rstrip("0123456789") for s in summary["streams"]})
    if found := thresholds(settings, quantities):
        parts.append(Fold(f"Thresholds in force ({len(found)})", [_table("In force", found)]))
    return Section("configuration", "Configuration", "", parts)


def _facts(summary: dict[str, Any]) -> list[tuple[str, str]]:
    log, made_by = summary["log"], summary["made_by"]
    return [
        ("log", Path(log["path"]).name),
        ("format", f"{log['format']}, {count(log['messages'], 'message')}, {_size(log['bytes'])}"),
        ("judged by", f"mavsentry {made_by['version']}"),
        ("profile", made_by["profile"]),
    ]


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"


def _table(caption: str, keys: Sequence[Key]) -> Table:
    rows = [
        [
            key.name,
            key.value + (" (learnt)" if key.learnt else ""),
            key.usual if key.changed else "the same",
            key.unit or "–",
            key.meaning or "–",
        ]
        for key in keys
    ]
    return Table(caption, _KEY_COLUMNS, rows)
