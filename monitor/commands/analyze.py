"""``mavsentry analyze``: verdicts on recorded flights."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands.common import (
    ConfigFile,
    Profile,
    Refused,
    console,
    load_settings,
    note,
    progress,
)

if TYPE_CHECKING:
    from monitor.analyze import Analysis
    from monitor.settings import Settings

__all__ = ["analyze"]

FAULT_FOUND, UNUSABLE = 1, 2


def analyze(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Telemetry logs (.tlog).")],
    profile: Profile = None,
    config: ConfigFile = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for DIR/<log stem>/summary.json.")
    ] = Path("mavsentry-out"),
    exit_code: Annotated[
        bool, typer.Option("--exit-code", help="End with 1 when a fault was found.")
    ] = False,
) -> None:
    """Say what was faulty in recorded flights, since when, and why."""
    from estimators.jit import is_cold
    from monitor.warmup import COMPILING

    settings = load_settings(profile, config)
    if is_cold():
        note(COMPILING)
    found = unusable = False
    hint = ""
    for log in logs:
        try:
            analysis = _one(log, settings)
            written = _write(analysis, out)
        except Refused as error:
            note(f"mavsentry: {error}")
            unusable = True
            continue
        _show(analysis, written[0])
        found = found or bool(analysis.faults)
        if len(written) == 1:
            from monitor.analyze import MISSING_REPORT_EXTRA as hint
    if hint:
        note(f"mavsentry: {hint}")
    if unusable:
        raise typer.Exit(UNUSABLE)
    if found and exit_code:
        raise typer.Exit(FAULT_FOUND)


def _one(log: Path, settings: Settings) -> Analysis:
    """Analysis of one log.

    Raises
    ------
    Refused
        The file cannot be read as a log.
    """
    from links.logs import LogError
    from monitor.analyze import analyze_log

    with progress(log.name) as tell:
        try:
            return analyze_log(log, settings, lambda done, all_: tell(done / max(all_, 1)))
        except LogError as error:
            raise Refused(str(error)) from None


def _write(analysis: Analysis, out: Path) -> list[Path]:
    try:
        return analysis.write(out)
    except OSError as error:
        raise Refused(f"cannot write to {out}: {error.strerror}") from None


def _show(analysis: Analysis, file: Path) -> None:
    """The flight in one line, the faults as a table, what was not judged, the file."""
    from rich.table import Table

    from monitor.baselines import one_line

    log, vehicle = analysis.summary["log"], analysis.summary["vehicle"]
    screen = console()
    screen.print(
        f"{log['path']}: {log['duration_s']:.0f} s, {log['messages']} messages, vehicle "
        f"{vehicle['system_id']} ({vehicle['autopilot']}, {vehicle['type']})",
        soft_wrap=True,
    )
    if not analysis.faults:
        watched = [m["sensor"] for m in analysis.summary["monitored"] if m["seconds"] > 0]
        screen.print(
            f"  no fault found in {len(watched)} watched sensors"
            if watched
            else "  no sensor could be judged"
        )
    else:
        table = Table()
        for column in ("sensor", "kind"):
            table.add_column(column, no_wrap=True)
        for column in ("onset", "detected", "cleared", "size"):
            table.add_column(column, justify="right", no_wrap=True)
        table.add_column("evidence", ratio=1)
        for fault in analysis.faults:
            table.add_row(
                fault["sensor"],
                fault["kind"],
                f"{fault['onset_s']:.1f} s",
                f"{fault['detected_s']:.1f} s",
                "" if fault["cleared_s"] is None else f"{fault['cleared_s']:.1f} s",
                "" if fault["magnitude"] is None else f"{fault['magnitude']:+.3g} {fault['unit']}",
                fault["evidence"],
            )
        screen.print(table)
    for event in analysis.summary["events"]:
        screen.print(
            f"  {event['what']} {event['state']} at {event['detected_s']:.1f} s: "
            f"{event['evidence']}",
            soft_wrap=True,
        )
    learnt = analysis.summary["learnt"]
    if learnt is not None and learnt["note"] is not None:
        screen.print(f"  note: {learnt['note']}", soft_wrap=True)
    screen.print(f"  {one_line(analysis.summary['baselines'])}", soft_wrap=True, highlight=False)
    screen.print(f"  {file}", soft_wrap=True)
