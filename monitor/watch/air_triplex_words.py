"""The words for a change of state of a pitot or vane, with evidence a pilot understands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators import air_vote_record as vote
from links.vocabulary import Kind, Reason, State
from monitor.verdict import Verdict

__all__ = ["fault_kind", "verdict"]

_STATES = {
    vote.UNMONITORED: State.UNMONITORED,
    vote.OK: State.OK,
    vote.SUSPECT: State.SUSPECT,
    vote.FAULTY: State.FAULTY,
}
_REASONS = {
    vote.GROUND: Reason.ON_GROUND,
    vote.LEARNING: Reason.LEARNING,
    vote.MISSING: Reason.REFERENCE_MISSING,
}
_NAMES = ("aoa", "airspeed")
_UNITS = ("rad", "m/s")
RUNAWAY = (math.radians(0.5), 2.0)
"""A drift faster than this, rad/s and m/s^2, is called a runaway (4 kt/s for a pitot)."""
STILL_S = 0.65
"""A reading that has not changed for this long when it is convicted is stuck, s."""
WHITE = 0.9, 3.1
"""Squared steps over squares (von Neumann's ratio) between which a ragged residual is noise: white
noise has 2, an oscillation of 1 Hz seen at 10 Hz has 0.4, one of 4 Hz has 3.6."""


def fault_kind(row: NDArray[np.float64]) -> Kind:
    """Kind of the fault from the residual's history in a log row."""
    ch = int(row[vote.L_CH])
    if row[vote.L_CAUSE] == vote.CONSTANT or row[vote.L_CONSTANT] > STILL_S:
        return Kind.STUCK
    mean, ragged, slope = abs(row[vote.L_MEAN]), row[vote.L_RAGGED], row[vote.L_SLOPE]
    if ragged > mean or row[vote.L_CAUSE] == vote.RAGGED:
        low, high = WHITE
        return Kind.NOISE if low < row[vote.L_ROUGH] < high else Kind.OSCILLATION
    peak, last = row[vote.L_PEAK], abs(row[vote.L_MAGNITUDE])
    if last < 0.7 * peak and row[vote.L_FIRST] < 0.6 * peak:
        return Kind.OSCILLATION
    span_s = row[vote.L_ONSET] * vote.STAGE_S
    grown = slope * span_s * math.copysign(1.0, row[vote.L_MEAN])
    if grown > 0.6 * mean:
        return Kind.RUNAWAY if abs(slope) > RUNAWAY[ch] else Kind.DRIFT
    return Kind.BIAS


def verdict(row: NDArray[np.float64], epoch_us: int) -> Verdict:
    """The verdict of one log row; ``epoch_us`` is the time that the row counts from."""
    ch = int(row[vote.L_CH])
    sensor = f"{_NAMES[ch]}{int(row[vote.L_I])}"
    t_us = epoch_us + round(row[vote.L_T] * 1e6)
    state = _STATES[float(row[vote.L_STATE])]
    if state is State.UNMONITORED:
        return Verdict(t_us, sensor, state, reason=_REASONS[float(row[vote.L_REASON])])
    if state is State.OK:
        return Verdict(t_us, sensor, state)
    if state is State.SUSPECT:
        return Verdict(
            t_us,
            sensor,
            state,
            magnitude=float(row[vote.L_MAGNITUDE]),
            unit=_UNITS[ch],
            statistic=float(row[vote.L_STATISTIC]),
            threshold=float(row[vote.L_THRESHOLD]),
            estimator="air_vote",
            evidence=f"{sensor} differs from the other one by {_size(row, ch)}, and the wind "
            "cannot tell which is wrong.",
        )
    age_s = float(row[vote.L_ONSET]) * vote.STAGE_S
    if row[vote.L_CAUSE] == vote.CONSTANT:
        age_s = max(age_s, float(row[vote.L_CONSTANT]))
    onset_us = t_us - round(age_s * 1e6)
    return Verdict(
        t_us,
        sensor,
        state,
        kind=fault_kind(row),
        onset_t_us=onset_us,
        magnitude=float(row[vote.L_MAGNITUDE]),
        unit=_UNITS[ch],
        statistic=float(row[vote.L_STATISTIC]),
        threshold=float(row[vote.L_THRESHOLD]),
        estimator="air_mhe_3d" if row[vote.L_CAUSE] == vote.BOUND else "air_vote",
        evidence=_evidence(row, ch, sensor),
    )


def _size(row: NDArray[np.float64], ch: int) -> str:
    value = abs(float(row[vote.L_MAGNITUDE]))
    return f"{math.degrees(value):.1f} deg" if ch == 0 else f"{value:.1f} m/s"


def _evidence(row: NDArray[np.float64], ch: int, sensor: str) -> str:
    """One sentence: who disagreed, by how much."""
    cause = float(row[vote.L_CAUSE])
    others = "vanes" if ch == 0 else "airspeed sensors"
    side = "above" if row[vote.L_MAGNITUDE] > 0 else "below"
    if cause == vote.CONSTANT:
        still = row[vote.L_CONSTANT]
        return f"{sensor} has not changed for {still:.1f} s while the other {others} moved."
    if cause == vote.VOTE:
        if row[vote.L_RAGGED] > abs(row[vote.L_MEAN]):
            scatter = row[vote.L_RAGGED]
            shown = f"{math.degrees(scatter):.1f} deg" if ch == 0 else f"{scatter:.1f} m/s"
            return f"{sensor} scatters by {shown} about the other two {others}, which agree."
        return f"{sensor} reads {_size(row, ch)} {side} the other two {others}, which agree."
    if cause == vote.MEMORY:
        return (
            f"{sensor} and another one of the {others} left the third, which alone agrees with the "
            f"wind from before; it reads {_size(row, ch)} {side} that."
        )
    if cause == vote.PAIR:
        return (
            f"{sensor} disagrees with the other one, which agrees with ground speed and the wind "
            f"from before; it reads {_size(row, ch)} {side} that."
        )
    if cause == vote.RAGGED:
        return f"{sensor} scatters, while the other one follows ground speed and wind smoothly."
    asked = "more wind than there can be" if ch == 1 else "an updraft that there cannot be"
    who = f"All {others}" if cause == vote.BOUND else "The last one of the " + others
    return f"{who} would need {asked}: {sensor} reads {_size(row, ch)} {side} the bounded estimate."
