"""What ``analyze`` prints of one log, out of its ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from monitor.commands.common import console
from monitor.doubts import REFERENCES
from monitor.report.wording import lasting

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

__all__ = ["show"]

NAMED = 3
WIDE = 105
"""Columns of a screen from which on the evidence has a place in the table."""


def show(summary: Mapping[str, Any], files: list[Path], doubts: Sequence[str] = ()) -> None:
    """The flight in one line, doubts, the faults as a table, what was not judged, the files."""
    from monitor.baselines import one_line

    log, vehicle = summary["log"], summary["vehicle"]
    screen = console()
    screen.print(
        f"{log['path']}: {log['duration_s']:.0f} s, {log['messages']} messages, vehicle "
        f"{vehicle['system_id']} ({vehicle['autopilot']}, {vehicle['type']})",
        soft_wrap=True,
        markup=False,
    )
    for line in (*_damage(log), *doubts):
        screen.print(f"  {line}", soft_wrap=True, markup=False)
    if summary["faults"]:
        wide = screen.width >= WIDE
        screen.print(_table(summary["faults"], evidence=wide))
        for fault in () if wide else summary["faults"]:
            screen.print(f"  {fault['sensor']}: {fault['evidence']}")
    else:
        watched = [m["sensor"] for m in summary["monitored"] if m["seconds"] > 0]
        if all(sensor.startswith(REFERENCES) for sensor in watched):
            watched = []  # only what others are judged by
        screen.print(
            f"  no fault found in {len(watched)} watched sensors"
            if watched
            else "  no sensor could be judged"
        )
    for event in summary["events"]:
        screen.print(
            f"  {event['what']} {event['state']} at {event['detected_s']:.1f} s: "
            f"{event['evidence']}",
            soft_wrap=True,
        )
    for what, count in summary["left_out"].items():
        if count:
            screen.print(f"  {count} more {what} are not listed")
    _show_live(summary.get("live"), screen)
    learnt = summary["learnt"]
    if learnt is not None and learnt["note"] is not None:
        screen.print(f"  note: {learnt['note']}", soft_wrap=True)
    screen.print(f"  {one_line(summary['baselines'])}", soft_wrap=True)
    for file in files[:1] + [file for file in files[1:] if file.suffix == ".html"]:
        screen.print(f"  {file}", soft_wrap=True, markup=False)


def _table(faults: Sequence[Mapping[str, Any]], *, evidence: bool) -> Table:
    from rich.table import Table

    table = Table()
    for column in ("sensor", "kind"):
        table.add_column(column, no_wrap=True)
    for column in ("onset", "detected", "cleared", "size"):
        table.add_column(column, justify="right", no_wrap=True)
    if evidence:
        table.add_column("evidence", ratio=1)
    for fault in faults:
        table.add_row(
            fault["sensor"],
            fault["kind"],
            f"{fault['onset_s']:.1f} s",
            f"{fault['detected_s']:.1f} s",
            _time(fault["cleared_s"]),
            "" if fault["magnitude"] is None else f"{fault['magnitude']:+.3g} {fault['unit']}",
            *([fault["evidence"]] if evidence else []),
        )
    return table


def _show_live(live: Mapping[str, Any] | None, screen: Console) -> None:
    """What a monitor said in flight, beside what this analysis says."""
    if live is None:
        return
    for monitor in live["monitors"]:
        number = monitor["component_id"]
        faults = [line for line in live["faults"] if line["component_id"] == number]
        spans = [f"{s['from_s']:.0f} to {s['to_s']:.0f} s" for s in monitor["silent"]]
        more = f" and {len(spans) - NAMED} more times" if len(spans) > NAMED else ""
        silent = f", silent {', '.join(spans[:NAMED])}{more}" if spans else ""
        screen.print(
            f"  live (component {number}), heard {monitor['from_s']:.0f} to {monitor['to_s']:.0f} s"
            f"{silent}:{'' if faults else ' no fault was said'}",
            soft_wrap=True,
        )
        if faults:
            wide = screen.width >= WIDE
            screen.print(_live_table(faults, said=wide))
            for line in () if wide else (line for line in faults if line["said"]):
                screen.print(f"  {line['said']}", markup=False)


def _live_table(lines: Sequence[Mapping[str, Any]], *, said: bool) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table()
    table.add_column("sensor", no_wrap=True)
    for column in ("live", "cleared", "replay", "cleared", "live is"):
        table.add_column(column, justify="right", no_wrap=True)
    if said:
        table.add_column("said in flight")
    for line in lines:
        delay_s, before = line["delay_s"], "before " if line["standing"] else ""
        table.add_row(
            line["sensor"],
            "" if line["live_s"] is None else f"{before}{line['live_s']:.1f} s",
            _time(line["live_cleared_s"]),
            _time(line["replay_s"]),
            _time(line["replay_cleared_s"]),
            ("" if line["agreement"] == "both" else line["agreement"])
            if delay_s is None
            else f"{abs(delay_s):.1f} s {'earlier' if delay_s < 0 else 'later'}",
            *([Text(line["said"] or "")] if said else []),  # a log's own words, no markup
        )
    return table


def _time(t_s: float | None) -> str:
    return "" if t_s is None else f"{t_s:.1f} s"


def _damage(log: Mapping[str, Any]) -> list[str]:
    """What is wrong with the file itself."""
    lines = []
    if log["bad_bytes"]:
        share = 100.0 * log["bad_bytes"] / max(log["bytes"], 1)
        lines.append(f"damaged: {log['bad_bytes']} bytes ({share:.2g} %) belong to no message")
    gaps = log["gaps"]
    if gaps:
        named = ", ".join(f"{lasting(g['seconds'])} at {round(g['at_s'])} s" for g in gaps[:NAMED])
        more = f" and {len(gaps) - NAMED} more" if len(gaps) > NAMED else ""
        lines.append(f"nothing was recorded for {named}{more}")
    boots = log["boots_s"]
    if boots:
        named = ", ".join(f"{t_s:.0f} s" for t_s in boots[:NAMED])
        more = f" and {len(boots) - NAMED} more times" if len(boots) > NAMED else ""
        lines.append(f"the vehicle booted anew at {named}{more}")
    return [*lines, *log["notes"]]
