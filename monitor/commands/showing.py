"""Verdicts and states for a person's eyes: lines, JSON, colours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from math import degrees, isfinite
from typing import TYPE_CHECKING, Any, Final

from links.vocabulary import GYRO_ACC_AXES, State
from monitor.announce import size_phrase
from monitor.verdict import Verdict

if TYPE_CHECKING:
    import numpy as np

__all__ = ["STYLES", "as_json", "duration", "finite", "lines", "true_value", "why"]

STYLES: Final = {
    State.OK: "green",
    State.SUSPECT: "yellow",
    State.FAULTY: "bold red",
    State.STOPPED: "bold red",
    State.STALE: "magenta",
    State.ABSENT: "dim",
    State.UNMONITORED: "dim",
}
"""Colour of a state's word on a terminal; the word is always there too."""


FRESH_US: Final = 2_000_000
"""A reconstructed value older than this is not the true value now [us]."""


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


def lines(verdicts: Iterable[Verdict]) -> list[str]:
    """The changes as lines, an IMU's six equal changes at one moment as one line."""
    out = []
    by_moment: dict[int, dict[str, Verdict]] = {}
    for verdict in verdicts:
        by_moment.setdefault(verdict.t_us, {})[verdict.sensor] = verdict
    for changes in by_moment.values():
        out += [line(verdict, sensor) for sensor, verdict in grouped(changes)]
    return out


def true_value(sensor: str, newest: Mapping[str, np.void], t_us: int) -> str:
    """``"1.25 m/s^2"``: what the sensor should read now; empty where that is not known.

    Parameters
    ----------
    newest
        Newest row of each estimate.
    t_us
        Vehicle time now [us]; older rows are not believed.
    """
    group, _, axis = sensor.partition(".")
    name = group if axis else "engine" if group.startswith("spool") else "air"
    row = newest.get(name)
    if row is None or t_us - int(row["t_us"]) > FRESH_US:
        return ""
    if axis in GYRO_ACC_AXES:
        place = GYRO_ACC_AXES.index(axis)
        if place < 3:
            value, unit, digits = float(row["acc_m_s2"][place]), "m/s^2", 2
        else:
            value, unit, digits = degrees(row["gyro_rad_s"][place - 3]), "deg/s", 2
    elif group.startswith("airspeed"):
        value, unit, digits = float(row["cas_m_s"]), "m/s", 1
    elif group.startswith("aoa"):
        value, unit, digits = degrees(row["aoa_rad"]), "deg", 1
    elif group.startswith("spool") and int(group[5:]) < len(row["speed_rpm"]):
        value, unit, digits = float(row["speed_rpm"][int(group[5:])]), "rpm", 0
    else:
        return ""
    return f"{value:.{digits}f} {unit}" if isfinite(value) else ""


def duration(seconds: float) -> str:
    """``12 s``, ``3:05``, ``1:02:05``."""
    whole = max(0, int(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, second = divmod(whole, 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"
