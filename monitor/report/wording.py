"""How the report writes moments, durations, numbers and groups of sensors."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

from links.vocabulary import GYRO_ACC_AXES
from monitor.pages.html import clock

__all__ = ["count", "grouped", "instrument", "lasting", "listed", "moments", "number"]

_IMU_AXIS = re.compile(r"(imu\d+)\.(acc|gyro)_([xyz])")
_WING = re.compile(r"wing_(left|right)\.(lift|drag)")


def lasting(seconds: float) -> str:
    """A duration: ``30 ms``, ``0.4 s``, ``34 s``, ``4 min 12 s``, ``1 h 02 min``."""
    if 0.0 < seconds < 0.0995:
        return f"{1000.0 * seconds:.0f} ms"
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    minutes = round(seconds / 60.0)
    return f"{minutes // 60} h {minutes % 60:02d} min"


def moments(spans: Sequence[tuple[float, float]], most: int = 3) -> str:
    """Spans of time; of more than ``most`` the number, the first and last moment, the longest."""
    if len(spans) <= most:
        return ", ".join(f"{clock(a)} to {clock(b)}" for a, b in spans)
    longest = max(b - a for a, b in spans)
    return (
        f"{len(spans)} times between {clock(spans[0][0])} and {clock(spans[-1][1])}, "
        f"{lasting(longest)} at the longest"
    )


def number(value: float, digits: int = 3) -> str:
    """A number of a sensor, without exponents where they can be avoided: ``1.51``, ``24,300``."""
    if not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -4 or size >= 7:
        return f"{value:.{digits - 1}e}"
    text = f"{value:,.{max(digits - 1 - size, 0)}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return text


def count(many: int, one: str, more: str | None = None) -> str:
    """``1 gap``, ``3 gaps``, ``12,345 samples``."""
    return f"{many:,} {one if many == 1 else more or one + 's'}"


def listed(words: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def instrument(sensor: str) -> str:
    """What can be exchanged: ``imu0`` of ``imu0.acc_x``."""
    return sensor.partition(".")[0]


def grouped(sensors: Iterable[str]) -> str:
    """Sensors with the axes of an IMU and the parts of the wings together.

    ``imu0 all axes``, ``imu1 acc x y``, ``wings``; others by their names.
    """
    axes: dict[str, list[str]] = {}
    wings: list[str] = []
    others: list[str] = []
    for sensor in sensors:
        if found := _IMU_AXIS.fullmatch(sensor):
            axes.setdefault(found[1], []).append(f"{found[2]}_{found[3]}")
        elif _WING.fullmatch(sensor):
            wings.append(sensor)
        else:
            others.append(sensor)
    said = [f"{imu} {_axes(found)}" for imu, found in sorted(axes.items())]
    if len(wings) == 4:
        wings = ["both wings, lift and drag"]
    named = [*sorted(others), *said, *sorted(wings)]
    return "; ".join(named) if any("," in name for name in named) else listed(named)


def _axes(axes: Sequence[str]) -> str:
    if len(axes) == len(GYRO_ACC_AXES):
        return "(all six axes)"
    parts = []
    for kind in ("acc", "gyro"):
        letters = " ".join(sorted(axis[-1] for axis in axes if axis.startswith(kind)))
        if letters:
            parts.append(f"{kind} {letters}")
    return ", ".join(parts)
