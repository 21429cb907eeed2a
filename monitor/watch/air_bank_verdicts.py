"""The words for the filter bank's changes of state: verdicts with evidence a pilot understands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators import air_data_3d_judge as judge
from estimators.air_checks import (
    CHECK_BANK,
    CHECK_CONSTANT,
    CHECK_DEAD,
    CHECK_HORIZON,
    CHECK_NOISE,
    CHECK_NONE,
    CHECK_OSCILLATION,
)
from links.vocabulary import Kind, Reason, State
from monitor.verdict import Verdict

__all__ = ["verdict"]

_STATES = {
    judge.UNMONITORED: State.UNMONITORED,
    judge.OK: State.OK,
    judge.SUSPECT: State.SUSPECT,
    judge.FAULTY: State.FAULTY,
    judge.ABSENT: State.ABSENT,
}
_REASONS = {
    judge.ON_GROUND: Reason.ON_GROUND,
    judge.LEARNING: Reason.LEARNING,
    judge.WIND_NOT_OBSERVABLE: Reason.WIND_NOT_OBSERVABLE,
    judge.REFERENCE_MISSING: Reason.REFERENCE_MISSING,
    judge.REFERENCE_NOT_TRUSTED: Reason.REFERENCE_NOT_TRUSTED,
    judge.SENSORS_DISAGREE: Reason.SENSORS_DISAGREE,
}
_BANK = "air_data_3d"
_HORIZON = "air_horizon"
_CHECKS = "air_checks"

DEAD_SHARE = 0.2
"""Of the expected airspeed; a pitot that shows less has dropped out rather than changed scale."""


def verdict(row: NDArray[np.float64], epoch_us: int) -> Verdict:
    """The verdict of one row of the judge's log; its times count from ``epoch_us``."""
    t_us = epoch_us + round(row[judge.G_T] * 1e6)
    sensor = _name(int(row[judge.G_SENSOR]))
    state = _STATES[float(row[judge.G_STATUS])]
    if state is State.UNMONITORED:
        return Verdict(t_us, sensor, state, _REASONS[float(row[judge.G_REASON])])
    if state is State.ABSENT:
        return Verdict(t_us, sensor, state, evidence=f"{sensor} shows nothing: it is not fitted")
    if state is not State.FAULTY:
        return _unproved(row, t_us, sensor, state)
    shown, expected = row[judge.G_SHOWN], row[judge.G_EXPECT]
    check = float(row[judge.G_CHECK])
    onset_s = row[judge.G_ONSET]
    return Verdict(
        t_us,
        sensor,
        state,
        kind=_kind(row, check, shown, expected),
        onset_t_us=min(epoch_us + round(onset_s * 1e6), t_us),
        magnitude=float(shown - expected),
        unit="m/s",
        statistic=float(row[judge.G_STAT]),
        threshold=float(row[judge.G_LIMIT]),
        estimator={CHECK_BANK: _BANK, CHECK_HORIZON: _HORIZON}.get(check, _CHECKS),
        evidence=_evidence(row, check, sensor, shown, expected),
    )


def _name(i: int) -> str:
    return f"airspeed{i}"


def _names(mask: int) -> list[str]:
    return [_name(i) for i in range(mask.bit_length()) if mask >> i & 1]


def _unproved(row: NDArray[np.float64], t_us: int, sensor: str, state: State) -> Verdict:
    stat, limit = float(row[judge.G_STAT]), float(row[judge.G_LIMIT])
    reason = _REASONS.get(float(row[judge.G_REASON]))
    if reason is Reason.SENSORS_DISAGREE:
        said = f"{sensor} and another pitot disagree; not clear yet which of them is wrong"
    elif state is State.SUSPECT:
        said = f"{sensor} no longer fits GPS and wind; not enough to be sure yet"
    elif row[judge.G_CHECK] != CHECK_NONE:
        said = f"{sensor} agrees with GPS and wind again"
    else:
        said = f"{sensor} agrees with GPS and wind"
    return Verdict(
        t_us, sensor, state, reason, statistic=stat, threshold=limit, estimator=_BANK, evidence=said
    )


def _kind(row: NDArray[np.float64], check: float, shown: float, expected: float) -> Kind:
    if check == CHECK_CONSTANT:
        return Kind.STUCK
    if check == CHECK_NOISE:
        return Kind.NOISE
    if check == CHECK_OSCILLATION:
        return Kind.OSCILLATION
    if check == CHECK_DEAD or shown < DEAD_SHARE * expected:
        return Kind.DROPOUT
    return Kind.DRIFT if row[judge.G_DRIFT] else Kind.SCALE


def _evidence(
    row: NDArray[np.float64], check: float, sensor: str, shown: float, expected: float
) -> str:
    lasting = f"for {max(row[judge.G_T] - row[judge.G_ONSET], 0.1):.1f} s"
    if check == CHECK_CONSTANT:
        said = f"{sensor} has shown exactly {shown:.1f} m/s {lasting} while the aircraft flies"
    elif check == CHECK_DEAD:
        said = f"{sensor} has shown {shown:.1f} m/s {lasting}, far below the speed over the ground"
    elif check == CHECK_NOISE:
        scatter = 100.0 * row[judge.G_STAT]
        said = f"{sensor} has scattered by {scatter:.0f} % against the others {lasting}"
    elif check == CHECK_OSCILLATION:
        swing = 100.0 * math.sqrt(2.0) * row[judge.G_STAT]
        said = f"{sensor} has swung by {swing:.0f} % up and down against the others {lasting}"
    elif math.isfinite(expected):
        percent = 100.0 * (shown / expected - 1.0)
        word = "below" if percent < 0.0 else "above"
        if check == CHECK_HORIZON:
            minutes = max(row[judge.G_T] - row[judge.G_ONSET], 1.0) / 60.0
            grown = f"{sensor} has drifted to {abs(percent):.0f} % {word} what GPS and wind say"
            return f"{grown} within {minutes:.1f} min" + _others(row, sensor)
        said = f"{sensor} has read {abs(percent):.0f} % {word} what GPS and wind say {lasting}"
    else:
        said = f"{sensor} has not fitted GPS and wind {lasting}"
    return said + _others(row, sensor)


def _others(row: NDArray[np.float64], sensor: str) -> str:
    together = [n for n in _names(int(row[judge.G_TOGETHER])) if n != sensor]
    if together:
        return f"; so does {' and '.join(together)}"
    agree = _names(int(row[judge.G_AGREE]))
    if agree:
        return f"; {' and '.join(agree)} agree{'s' if len(agree) == 1 else ''} with them"
    return ""
