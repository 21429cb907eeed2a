"""``mavsentry selftest``: does it work on this very machine, and how fast is the machine?"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from monitor.commands.common import console, note

if TYPE_CHECKING:
    from rich.console import Console

    from monitor.commands.machine_speed import LiveCost
    from monitor.commands.trial import Trial
    from monitor.commands.trial_table import Outcome

__all__ = ["selftest"]

SCENARIO, PROFILE = "small-uav-imu-bias", "small-uav"
FAILED = 1

SPEEDS = (8.0, 2.0, 1.0)
"""Times real time; a machine that cannot keep up is tried again at the next."""

SATURATED = 0.85
"""A daemon that is busy for more of the time could not keep up [s/s]."""

ROOM, TOO_SLOW = 0.5, 0.9
"""Share of a processor up to which there is room for other programs, and from which a flight in
real time cannot be followed [s/s]."""


def selftest(
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR",
            min=0.5,
            max=40.0,
            help="Times real time of the flight; without it 8, and slower where the machine "
            "cannot keep up.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Try it on this machine: pass or fail, and how fast it is.

    A synthetic aircraft flies into the daemon over UDP loopback: no vehicle and no network is
    needed. Ends with status 1 when something failed.
    """
    from monitor.commands.trial_table import outcome_table

    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="mavsentry-selftest-") as folder:
        flown, trial, outcome = _fly((speed,) if speed else SPEEDS, Path(folder))
        analysis, cost = _speeds(trial)
    checks = {
        "every injected fault found": all(found for _, found in outcome.rows),
        "no other fault raised": not outcome.false,
        "live verdicts are those of the recording": trial.agrees(),
        "a flight is followed in real time": cost.share < TOO_SLOW,
    }
    result = _result(checks, flown, trial, analysis, cost, time.monotonic() - began_s)
    if as_json:
        print(json.dumps(result, indent=1))
    else:
        screen = console()
        screen.print(outcome_table(outcome))
        _show(screen, result)
    if not all(checks.values()):
        raise typer.Exit(FAILED)


def _fly(speeds: tuple[float, ...], out: Path) -> tuple[float, Trial, Outcome]:
    """The flight at the first speed that the machine keeps up with, else at the last."""
    from monitor.commands.trial import try_out
    from monitor.commands.trial_table import judge

    for speed in speeds:
        trial = try_out(SCENARIO, PROFILE, speed, out, _say_compiling)
        outcome = judge(trial, out / "truth.npz")
        if not trial.busy > SATURATED or (outcome.good and trial.agrees()):
            break
    return speed, trial, outcome


def _say_compiling(text: str) -> None:
    if text.startswith("compiling"):
        note(f"mavsentry: {text}")


def _speeds(trial: Trial) -> tuple[float, LiveCost]:
    """How many times real time a log is analysed at; what a live flight costs."""
    from monitor.analyze import analyze_log
    from monitor.commands.machine_speed import live_cost
    from monitor.settings import load

    settings = load(PROFILE)
    began_s = time.perf_counter()
    analysis = analyze_log(trial.recording, settings)
    took_s = time.perf_counter() - began_s
    duration_s = float(analysis.summary["log"]["duration_s"])
    return duration_s / took_s, live_cost(trial.recording, duration_s, settings)


def _result(
    checks: dict[str, bool],
    speed: float,
    trial: Trial,
    analysis: float,
    cost: LiveCost,
    took_s: float,
) -> dict[str, Any]:
    """All of it as JSON values."""
    from importlib.metadata import version

    from estimators.jit import cache_root
    from monitor.commands.machine_speed import missing_extras
    from monitor.commands.timing import machine
    from monitor.places import state_folder

    latency = trial.status.get("latency", {})
    return {
        "schema": "mavsentry/selftest/1",
        "version": version("mavsentry"),
        "machine": machine(),
        "passed": all(checks.values()),
        "checks": checks,
        "flown_times_real_time": speed,
        "analysis_times_real_time": round(analysis, 1),
        "live": {
            "processor_share": round(cost.share, 4),
            "times_real_time": round(1.0 / cost.share, 1),
            "messages_hz": round(cost.messages_hz),
            "parts": {name: round(share, 5) for name, share in cost.parts.items()},
            "answer_median_ms": latency.get("median_ms"),
            "answer_p99_ms": latency.get("p99_ms"),
        },
        "missing_extras": missing_extras(),
        "folders": {"kernels": str(cache_root()), "state": str(state_folder())},
        "took_s": round(took_s, 1),
    }


def _show(screen: Console, result: dict[str, Any]) -> None:
    """The same for people, the verdict last."""
    from monitor.commands.machine_speed import EXTRAS

    for check, good in result["checks"].items():
        screen.print(f"{'[green]pass[/]' if good else '[bold red]FAIL[/]'}  {check}")
    here, live = result["machine"], result["live"]
    share, cores = live["processor_share"], here["cores"]
    screen.print(
        f"\nthis machine: {here['processor']}, {cores} processors, {here['system']}, Python "
        f"{here['python']}, load {here['load_1min']}\n"
        f"live, {live['messages_hz']} messages a second: {share:.1%} of one processor "
        f"({live['times_real_time']:.0f} times real time): {_shares(live['parts'], share)}\n"
        f"an answer at {result['flown_times_real_time']:g} times real time: "
        f"{_ms(live['answer_median_ms'])} (median), {_ms(live['answer_p99_ms'])} (99 %)\n"
        f"a log: {result['analysis_times_real_time']:.0f} times real time\n"
        f"kernels: {result['folders']['kernels']}\nstate: {result['folders']['state']}",
        soft_wrap=True,
        markup=False,
    )
    for extra in result["missing_extras"]:
        screen.print(
            f"not installed: {EXTRAS[extra][1]} (pip install 'mavsentry[{extra}]')", markup=False
        )
    screen.print(f"\n{_verdict(result)} ({result['took_s']:.0f} s)", soft_wrap=True, markup=False)


def _verdict(result: dict[str, Any]) -> str:
    """The verdict in a sentence."""
    share, cores = result["live"]["processor_share"], result["machine"]["cores"]
    if share >= TOO_SLOW:
        return (
            "FAIL: this machine is too slow to follow such a flight; ask for fewer messages a "
            "second (docs/mavlink.md)"
        )
    if not result["passed"]:
        return "FAIL: what is marked above does not work here; the rest does"
    left = f"leaves {1.0 - share:.0%} of one of its {cores} processors"
    if share > ROOM:
        return f"PASS, narrowly: it works here, and {left}: little for other programs"
    return f"PASS: it works here, and {left}"


def _shares(parts: dict[str, float], whole: float) -> str:
    """Parts, the largest first, in percent of the whole."""
    total = sum(parts.values()) or whole
    ordered = sorted(parts.items(), key=lambda item: -item[1])
    return ", ".join(f"{name} {share / total:.0%}" for name, share in ordered)


def _ms(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.1f} ms"
