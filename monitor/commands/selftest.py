"""``mavsentry selftest``: does it work on this very machine, and how fast is the machine?"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

from monitor.commands.common import console

__all__ = ["selftest"]

SCENARIO, PROFILE = "small-uav-imu-bias", "small-uav"
FAILED = 1


def selftest(
    speed: Annotated[float, typer.Option(min=0.5, max=40.0, help="Times real time.")] = 8.0,
) -> None:
    """Fly a synthetic aircraft into the daemon over UDP loopback: pass or fail, and how fast."""
    from monitor.commands.trial import try_out
    from monitor.commands.trial_table import judge, outcome_table

    screen = console()
    with tempfile.TemporaryDirectory(prefix="mavsentry-selftest-") as folder:
        out = Path(folder)
        began_s = time.monotonic()
        trial = try_out(SCENARIO, PROFILE, speed, out, lambda text: None)
        outcome = judge(trial, out / "truth.npz")
        analysis_speed = _times_real_time(trial.recording)
    checks = {
        "every injected fault found": all(found for _, found in outcome.rows),
        "no other fault raised": not outcome.false,
        "live verdicts are those of the recording": trial.agrees(),
    }
    screen.print(outcome_table(outcome))
    for check, good in checks.items():
        screen.print(f"{'[green]pass[/]' if good else '[bold red]FAIL[/]'}  {check}")
    latency = trial.status.get("latency", {})
    screen.print(
        f"this machine: a log is analysed at {analysis_speed:.0f} times real time; live at "
        f"{speed:g} times real time an answer takes {latency.get('median_ms') or float('nan'):.1f} "
        f"ms (median), {latency.get('p99_ms') or float('nan'):.1f} ms (99 %); "
        f"the test took {time.monotonic() - began_s:.0f} s"
    )
    if not all(checks.values()):
        raise typer.Exit(FAILED)


def _times_real_time(log: Path) -> float:
    from monitor.analyze import analyze_log
    from monitor.settings import load

    settings = load(PROFILE)
    began_s = time.perf_counter()
    analysis = analyze_log(log, settings)
    return float(analysis.summary["log"]["duration_s"]) / (time.perf_counter() - began_s)
