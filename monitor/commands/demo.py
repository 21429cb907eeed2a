"""``mavsentry demo``: about a minute in which sensors break one after another, and are named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from monitor.commands.common import Refused, console

__all__ = ["demo"]

SCENARIO, PROFILE = "demo", "transport"
SPEED = 3.0
FAILED = 1


def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for what it writes.")] = Path(
        "demo-out"
    ),
    speed: Annotated[
        float, typer.Option(min=0.5, max=10.0, help="Times real time.", metavar="FACTOR")
    ] = SPEED,
    web: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Serve the daemon's live page there meanwhile."),
    ] = None,
) -> None:
    """Fly a synthetic aircraft whose sensors break, and show what is found.

    Its MAVLink goes over UDP loopback into the daemon: the way that a real one goes.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise Refused(f"cannot make {out}: {error.strerror}; --out names another folder") from None
    from monitor.analyze import REPORT, have_report
    from monitor.commands.trial import try_out
    from monitor.commands.trial_table import judge, outcome_table

    screen = console()
    screen.print(
        f"A synthetic aircraft takes off at {speed:g} times real time; its MAVLink goes over UDP "
        "to `mavsentry run`.\nTimes are flight time; STATUSTEXT is what the daemon publishes."
    )

    def say(text: str) -> None:
        screen.print(text, markup=False, soft_wrap=True)

    trial = try_out(SCENARIO, PROFILE, speed, out, say, ("--web", web) if web else ())
    outcome = judge(trial, out / "truth.npz")
    screen.print(outcome_table(outcome))
    for fault in outcome.false:
        screen.print(
            f"[bold red]FALSE[/] {fault['sensor']} at {fault['detected_s']:.1f} s: "
            f"{fault['evidence']}"
        )
    found = sum(f is not None for _, f in outcome.rows)
    screen.print(
        f"{found} of {len(outcome.rows)} injected faults found, {len(outcome.false)} false; "
        f"the recording gives {'the same verdicts' if trial.agrees() else 'OTHER VERDICTS'} again."
    )
    latency = trial.status.get("latency", {})
    if latency.get("count"):
        screen.print(
            f"Answers left {latency['median_ms']:.1f} ms (median) and {latency['p99_ms']:.1f} ms "
            "(99 %) after the oldest datagram they rest on arrived."
        )
    folder = out / trial.recording.stem
    trial.analysis.write(folder, trial.estimates)
    if have_report():
        trial.analysis.write_report(folder, trial.estimates)
    (out / "injected_found.json").write_text(
        json.dumps([{"injected": i, "found": f} for i, f in outcome.rows], indent=1) + "\n",
        encoding="utf-8",
    )
    report = (folder / REPORT,) if have_report() else ()
    for k, file in enumerate((*report, folder / "summary.json")):
        screen.print(f"{'' if k else 'Written:':8} {file}", soft_wrap=True)
    screen.print(f"         {trial.recording}, {out / 'truth.json'}", soft_wrap=True)
    if not outcome.good:
        raise typer.Exit(FAILED)
