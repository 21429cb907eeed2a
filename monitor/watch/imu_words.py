"""The sentences in which the IMU watch gives its reasons."""

from __future__ import annotations

import math

from links.vocabulary import GYRO_ACC_AXES, Kind

__all__ = [
    "axis_name",
    "contradiction_sentence",
    "disagreement_sentence",
    "dropout_sentence",
    "lone_sentence",
    "noise_sentence",
    "pair_sentence",
    "shown",
    "stuck_sentence",
    "swing_sentence",
    "unit_of",
    "vote_sentence",
]

_SHAPES = {
    Kind.BIAS: "",
    Kind.DRIFT: " and drifting",
    Kind.OSCILLATION: " and oscillating",
}


def axis_name(imu: int, axis: int) -> str:
    """Sensor name of an axis: ``axis_name(0, 5) == "imu0.gyro_z"``."""
    return f"imu{imu}.{GYRO_ACC_AXES[axis]}"


def unit_of(axis: int) -> str:
    """Unit of an axis, as verdicts give it."""
    return "m/s^2" if axis < 3 else "rad/s"


def shown(axis: int, size: float) -> str:
    """A fault's size in words a pilot reads: specific force in m/s^2, rates in deg/s."""
    sense = "high" if size > 0 else "low"
    if axis < 3:
        return f"{abs(size):.2g} m/s^2 {sense}"
    return f"{math.degrees(abs(size)):.2g} deg/s {sense}"


def _reference(with_attitude: bool, baro: bool) -> str:
    parts = ["GPS velocity"]
    if baro:
        parts.append("static pressure")
    if with_attitude:
        parts.append("attitude")
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1]


def pair_sentence(
    imu: int,
    other: int,
    axis: int,
    size: float,
    kind: Kind,
    held_s: float,
    *,
    attitude: bool,
    baro: bool,
) -> str:
    """Two IMUs differ and the references side with one of them."""
    return (
        f"{_reference(attitude, baro)} agree with imu{other} and not with imu{imu}: "
        f"{GYRO_ACC_AXES[axis]} {shown(axis, size)}{_SHAPES.get(kind, '')} for {held_s:.1f} s"
    )


def vote_sentence(imu: int, axis: int, size: float, kind: Kind, held_s: float) -> str:
    """Most IMUs agree and one does not."""
    return (
        f"the other IMUs agree with each other and not with imu{imu}: {GYRO_ACC_AXES[axis]} "
        f"{shown(axis, size)}{_SHAPES.get(kind, '')} for {held_s:.1f} s"
    )


def lone_sentence(
    imu: int,
    axis: int,
    size: float,
    held_s: float,
    rival: int | None,
    *,
    attitude: bool,
    baro: bool,
) -> str:
    """The only IMU contradicts the references."""
    name, what = GYRO_ACC_AXES[axis], f"{shown(axis, size)} for {held_s:.1f} s"
    text = f"{_reference(attitude, baro)} contradict imu{imu}:"
    if rival is None:
        return f"{text} {name} {what}"
    first, second = (GYRO_ACC_AXES[k] for k in sorted((axis, rival)))
    return f"{text} {first} or {second}, likelier {name} {what}"


def swing_sentence(imu: int, axis: int, size: float) -> str:
    """A rate swings to and fro against an attitude with gyros of its own."""
    return (
        f"imu{imu} {GYRO_ACC_AXES[axis]} swings by {math.degrees(size):.2g} deg/s against the "
        "attitude"
    )


def disagreement_sentence(imu: int, other: int, axis: int, *, undecided: bool) -> str:
    """Two IMUs differ and it is not known yet, or cannot be known, which is wrong."""
    rest = "no reference tells which is wrong" if undecided else "which is wrong is being settled"
    return f"imu{imu} and imu{other} disagree on {GYRO_ACC_AXES[axis]}; {rest}"


def contradiction_sentence() -> str:
    """The reference contradicts itself, or all IMUs at once."""
    return "GPS contradicts itself or all IMUs at once"


def stuck_sentence(imu: int, axis: int, value: float, held_s: float) -> str:
    """A value that does not move any more."""
    shown_value = f"{value:.2f} m/s^2" if axis < 3 else f"{math.degrees(value):.2f} deg/s"
    return f"imu{imu} {GYRO_ACC_AXES[axis]} has stood at {shown_value} for {held_s:.1f} s"


def dropout_sentence(imu: int, held_s: float) -> str:
    """All six channels read exactly zero."""
    return f"imu{imu} reads exactly zero on all axes for {held_s:.1f} s"


def noise_sentence(imu: int, axis: int, ratio: float, other: int | None) -> str:
    """One axis has become much noisier than its peers."""
    peers = "its other axes" if other is None else f"imu{other}"
    return (
        f"imu{imu} {GYRO_ACC_AXES[axis]} has become {ratio:.0f} times noisier than {peers} say "
        "is usual"
    )
