"""Verdicts and estimates as the protocol's values: seconds, degrees, null for what is no number."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, isfinite
from typing import Any, Final, cast

import numpy as np

from links.vocabulary import State
from monitor.announce import size_phrase
from monitor.pages.units import on_screen
from monitor.verdict import (
    AIR_ESTIMATE,
    ENGINE_ESTIMATE,
    IMU_ESTIMATE,
    WING_ESTIMATE,
    Verdict,
)
from monitor.web.protocol import Event, Fault, Number, Standing

__all__ = ["estimate", "event", "expected", "fault", "number", "rounded", "seconds", "standing"]

_DIGITS = 6
"""Significant digits of a value: more than a screen shows, half the bytes of a whole float."""

_IMU_SHOWN: Final = (
    "acc_fault_m_s2",
    "acc_fault_std_m_s2",
    "gyro_fault_rad_s",
    "gyro_fault_std_rad_s",
)
_APART: Final = ("lift_apart_std_percent", "drag_apart_std_percent")


def rounded(value: float) -> float:
    """A finite value with as many digits as are shown."""
    return float(f"{value:.{_DIGITS}g}")


def number(value: float) -> Number:
    """The same; None of NaN and infinity."""
    return rounded(value) if isfinite(value) else None


def seconds(t_us: int) -> float:
    """Vehicle time in seconds, to the millisecond."""
    return round(t_us / 1e6, 3)


def standing(verdict: Verdict) -> Standing:
    """A change of state."""
    faulty = verdict.state is State.FAULTY
    onset_us = verdict.onset_t_us if faulty else None
    return Standing(
        t_s=seconds(verdict.t_us),
        state=str(verdict.state),
        reason=None if verdict.reason is None else str(verdict.reason),
        kind=str(verdict.kind) if faulty else None,
        size=size_phrase(verdict) if faulty else None,
        onset_t_s=None if onset_us is None else seconds(onset_us),
        evidence=verdict.evidence,
    )


def fault(count: int, verdict: Verdict, ended_us: int | None) -> Fault:
    """A fault by the verdict that named it, and the ``ok`` that ended it."""
    onset_us = verdict.t_us if verdict.onset_t_us is None else verdict.onset_t_us
    detected_us = verdict.t_us if verdict.detected_t_us is None else verdict.detected_t_us
    factor, unit = on_screen(verdict.unit)
    return Fault(
        number=count,
        sensor=verdict.sensor,
        kind=str(verdict.kind),
        size=size_phrase(verdict),
        onset_t_s=seconds(onset_us),
        detected_t_s=seconds(detected_us),
        isolated_t_s=seconds(verdict.t_us),
        cleared_t_s=None if ended_us is None else seconds(ended_us),
        magnitude=number(verdict.magnitude * factor),
        unit=unit,
        statistic=number(verdict.statistic),
        threshold=number(verdict.threshold),
        estimator=verdict.estimator,
        evidence=verdict.evidence,
    )


def event(count: int, verdict: Verdict, ended_us: int | None) -> Event:
    """An engine that stopped, and when it ran again."""
    onset_us = verdict.t_us if verdict.onset_t_us is None else verdict.onset_t_us
    return Event(
        number=count,
        what=verdict.sensor,
        state=str(verdict.state),
        onset_t_s=seconds(onset_us),
        detected_t_s=seconds(verdict.t_us),
        ended_t_s=None if ended_us is None else seconds(ended_us),
        evidence=verdict.evidence,
    )


def _fields(dtype: np.dtype[np.void], names: tuple[str, ...]) -> list[tuple[str, str, float]]:
    """(field, name on the wire, factor) of each; radians become degrees."""
    out = []
    for name in names:
        assert name in (dtype.names or ())
        stem, unit, rest = name.partition("_rad")
        shown = f"{stem}_deg{rest}" if unit else name
        out.append((name, shown, degrees(1.0) if unit else 1.0))
    return out


def _all(dtype: np.dtype[np.void], but: tuple[str, ...] = ()) -> list[tuple[str, str, float]]:
    return _fields(dtype, tuple(n for n in dtype.names or () if n not in ("t_us", *but)))


_SHOWN: Final[Mapping[str, list[tuple[str, str, float]]]] = {
    "air": _all(AIR_ESTIMATE),
    "imu": _fields(IMU_ESTIMATE, _IMU_SHOWN),
    "engine": _all(ENGINE_ESTIMATE),
    "wing": _all(WING_ESTIMATE, but=_APART),
}


def estimate(kind: str, row: np.void) -> dict[str, Any]:
    """A row of estimates: ``air``, ``imu``, ``engine`` or ``wing``."""
    out: dict[str, Any] = {"t_s": seconds(int(row["t_us"]))}
    for name, shown, factor in _SHOWN[kind]:
        value = row[name]
        if value.ndim:
            out[shown] = [number(one * factor) for one in value.tolist()]
        else:
            out[shown] = number(float(value) * factor)
    return out


def expected(row: np.void) -> dict[str, tuple[float, Number]]:
    """A row of ``air_expected``: sensor -> value and deviation, of those that have one."""
    out: dict[str, tuple[float, Number]] = {}
    names = cast(tuple[str, ...], row.dtype.names)
    for value_name, std_name in zip(names[1::2], names[2::2], strict=True):
        sensor, _, unit = value_name.partition("_")
        factor = degrees(1.0) if unit == "rad" else 1.0
        value = number(float(row[value_name]) * factor)
        if value is not None:
            out[sensor] = (value, number(float(row[std_name]) * factor))
    return out
