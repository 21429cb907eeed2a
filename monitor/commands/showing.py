"""Verdicts and states for a person's eyes: lines, tables, colours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from math import isfinite
from typing import TYPE_CHECKING, Any

from links.vocabulary import GYRO_ACC_AXES, State
from monitor.announce import size_phrase
from monitor.verdict import Verdict

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

__all__ = ["as_json", "finite", "lines", "state_table", "styled", "why"]

_STYLES = {
    State.OK: "green",
    State.SUSPECT: "yellow",
    State.FAULTY: "bold red",
    State.STOPPED: "bold red",
    State.STALE: "magenta",
    State.ABSENT: "dim",
    State.UNMONITORED: "dim",
}


def finite(value: Any) -> Any:
    """The value, or None for a float that JSON cannot carry."""
    return None if isinstance(value, float) and not isfinite(value) else value


def as_json(verdict: Verdict) -> dict[str, Any]:
    """The verdict as JSON values: enums as words, NaN as null."""
    return {key: finite(value) for key, value in asdict(verdict).items()}


def why(verdict: Verdict) -> str:
    """What stands beside a state: the fault's size and evidence, or the reason."""
    if verdict.state is State.FAULTY:
        size = size_phrase(verdict)
        shape = "" if str(verdict.kind) in ("unknown", size) else f", {verdict.kind}"
        return f"{size}{shape}: {verdict.evidence}" if verdict.evidence else f"{size}{shape}"
    return str(verdict.reason or verdict.evidence)


def line(verdict: Verdict, sensor: str | None = None) -> str:
    """One change of state as a line: vehicle time, sensor, state, why."""
    name = sensor or verdict.sensor
    state = verdict.state.upper() if verdict.state is State.FAULTY else str(verdict.state)
    onset = ""
    if verdict.state is State.FAULTY and verdict.onset_t_us is not None:
        onset = f"since {verdict.onset_t_us / 1e6:.1f} s, "
    shown = f"{verdict.t_us / 1e6:9.2f} s  {name:<13} {state:<11} {onset}{why(verdict)}"
    return shown.rstrip()


def grouped(states: Mapping[str, Verdict]) -> list[tuple[str, Verdict]]:
    """Sensors by name; an IMU whose six axes are in one state for one reason is a single entry."""
    out: dict[str, Verdict] = {}
    for sensor, verdict in sorted(states.items()):
        imu, _, axis = sensor.partition(".")
        if axis in GYRO_ACC_AXES:
            axes = [states.get(f"{imu}.{a}") for a in GYRO_ACC_AXES]
            if all(
                a is not None and (a.state, a.reason) == (verdict.state, verdict.reason)
                for a in axes
            ):
                newest = max((a for a in axes if a is not None), key=lambda a: a.t_us)
                out[imu] = newest
                continue
        out[sensor] = verdict
    return list(out.items())


def styled(state: State) -> Text:
    """The state's word in its colour."""
    from rich.text import Text

    return Text(state.upper() if state is State.FAULTY else str(state), style=_STYLES[state])


def state_table(states: Mapping[str, Verdict], title: str | None = None) -> Table:
    """Sensor, state, since when, why."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", expand=True)
    table.add_column("sensor", no_wrap=True)
    table.add_column("state", no_wrap=True, width=11)
    table.add_column("since", justify="right", no_wrap=True)
    table.add_column("", ratio=1)
    for sensor, verdict in grouped(states):
        since_us = verdict.t_us if verdict.onset_t_us is None else verdict.onset_t_us
        table.add_row(sensor, styled(verdict.state), f"{since_us / 1e6:.1f} s", why(verdict))
    return table


def lines(verdicts: Iterable[Verdict]) -> list[str]:
    """The changes as lines, an IMU's six equal changes at one moment as one line."""
    out = []
    by_moment: dict[int, dict[str, Verdict]] = {}
    for verdict in verdicts:
        by_moment.setdefault(verdict.t_us, {})[verdict.sensor] = verdict
    for changes in by_moment.values():
        out += [line(verdict, sensor) for sensor, verdict in grouped(changes)]
    return out
