"""What the engine watch says: rows of the judgement's log as verdicts with evidence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators import engine_state as es
from links.vocabulary import Kind, Reason, State
from monitor.verdict import Verdict

__all__ = ["verdict"]

Row = NDArray[np.float64]

_STATES = {
    es.UNMONITORED: State.UNMONITORED,
    es.OK: State.OK,
    es.SUSPECT: State.SUSPECT,
    es.FAULTY: State.FAULTY,
    es.STOPPED: State.STOPPED,
}
_REASONS = {
    es.REASON_GROUND: Reason.ON_GROUND,
    es.REASON_LEARNING: Reason.LEARNING,
    es.REASON_THROTTLE: Reason.REFERENCE_MISSING,
    es.REASON_MODEL: Reason.NO_ENGINE_MODEL,
}
STEADY = 0.5
"""Wrong readings whose errors scatter less than this share of their mean are a bias."""
ZERO = 0.05
UNCHANGED_S = 0.5
"""A fault that has lasted longer than this without a change of the reading is a stuck channel."""


def verdict(row: Row, epoch_us: int) -> Verdict:
    """One row of :func:`estimators.engine_judge.judge`'s log."""
    t_us = epoch_us + round(row[es.L_T] * 1e6)
    state = _STATES[float(row[es.L_STATUS])]
    is_engine = row[es.L_ENGINE] > 0.5
    sensor = f"{'engine' if is_engine else 'spool'}{int(row[es.L_INDEX])}"
    if state is State.UNMONITORED:
        return Verdict(t_us, sensor, state, _REASONS[float(row[es.L_REASON])])
    again = " again" if row[es.L_AGAIN] > 0.5 else ""
    if state is State.OK:
        said = "gives the power that the throttle asks for" if is_engine else "is believed"
        return Verdict(
            t_us, sensor, state, estimator="engine_judge", evidence=f"{sensor} {said}{again}"
        )
    onset_us = min(epoch_us + round(float(np.nan_to_num(row[es.L_ONSET])) * 1e6), t_us)
    lasting_s = (t_us - onset_us) * 1e-6
    if is_engine:
        return Verdict(
            t_us,
            sensor,
            state,
            onset_t_us=onset_us,
            statistic=float(row[es.L_STAT]),
            threshold=float(row[es.L_LIMIT]),
            estimator="engine_judge",
            evidence=_stopped(row, sensor, lasting_s),
        )
    cause = float(row[es.L_CAUSE])
    return Verdict(
        t_us,
        sensor,
        state,
        reason=Reason.SENSORS_DISAGREE if cause == es.CAUSE_DISAGREE else None,
        kind=_kind(row, lasting_s) if state is State.FAULTY else Kind.UNKNOWN,
        onset_t_us=onset_us,
        magnitude=float(row[es.L_SHOWN] - row[es.L_EXPECT]),
        unit="rpm",
        statistic=float(row[es.L_STAT]),
        threshold=float(row[es.L_LIMIT]),
        estimator="engine_judge",
        evidence=_channel(row, sensor, lasting_s),
    )


def _kind(row: Row, lasting_s: float) -> Kind:
    cause, shown, expect = (float(row[k]) for k in (es.L_CAUSE, es.L_SHOWN, es.L_EXPECT))
    if cause == es.CAUSE_STUCK:
        return Kind.STUCK
    if shown < ZERO * expect:
        return Kind.DROPOUT
    if lasting_s > UNCHANGED_S and row[es.L_SAME] > lasting_s - UNCHANGED_S:
        return Kind.STUCK
    if cause == es.CAUSE_WRONG and row[es.L_SPREAD] > STEADY * abs(shown - expect):
        return Kind.NOISE
    return Kind.BIAS


def _channel(row: Row, sensor: str, lasting_s: float) -> str:
    cause, shown = float(row[es.L_CAUSE]), row[es.L_SHOWN]
    expect, percent = row[es.L_EXPECT], 100.0 * row[es.L_THROTTLE]
    lasting = f"for {lasting_s:.1f} s"
    if cause == es.CAUSE_STUCK:
        return f"{sensor} has shown exactly {shown:.0f} rpm {lasting} while the throttle moved"
    if cause == es.CAUSE_DISAGREE:
        return f"{sensor} and the other channel of its shaft show different speeds {lasting}"
    if cause == es.CAUSE_UNDECIDED:
        return (
            f"{sensor} reads {shown:.0f} rpm at {percent:.0f} % throttle where {expect:.0f} is "
            "expected: whether the engine stopped is being settled"
        )
    if cause == es.CAUSE_DEAD:
        return (
            f"{sensor} has read {shown:.0f} rpm {lasting} where {expect:.0f} is expected at "
            f"{percent:.0f} % throttle, and the aircraft flies as with its engine running"
        )
    return (
        f"{sensor} was wrong in {100.0 * row[es.L_STAT]:.0f} % of the last readings: "
        f"{shown:.0f} rpm on average where {expect:.0f} is expected"
    )


def _stopped(row: Row, sensor: str, lasting_s: float) -> str:
    cause, percent = float(row[es.L_CAUSE]), 100.0 * row[es.L_THROTTLE]
    sinks = f"the aircraft loses {abs(min(row[es.L_POWER], 0.0)):.1f} m of energy height a second"
    if cause == es.CAUSE_CUT:
        return (
            f"{sensor}: the throttle output has stood idle for {lasting_s:.0f} s while the "
            f"autopilot misses airspeed and height; {sinks}"
        )
    if cause == es.CAUSE_NO_POWER:
        return f"{sensor}: {sinks} at {percent:.0f} % throttle for {lasting_s:.0f} s, as a glider"
    return (
        f"{sensor}: its speed fell {lasting_s:.0f} s ago at {percent:.0f} % throttle on every "
        f"working channel, and {sinks}"
    )
