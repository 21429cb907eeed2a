"""Whether the vehicle's attitude turns as a gyro says: their increments, sample by sample.

=========  =========================================================================  ========
symbol     meaning                                                                    unit
=========  =========================================================================  ========
A_i        attitude sample i, ned_from_frd                                            1
theta_i    integral of the gyro up to the time of that sample                         rad
e_i        ``(theta_i - theta_{i-1} - log(A_{i-1}' A_i)) / (t_i - t_{i-1})``: the     rad/s
           gyro's error, if the attitude is right
psi        heading that the attitude has jumped by, undone before it is used          rad
=========  =========================================================================  ========

The *median* of e_i since a supposed onset tells a rate from a step: when the attitude jumps (the
autopilot changes its lane, or aligns its heading anew) a filter sees a rate that fades as the
inverse of time, but a single increment has jumped and the median stays.

A *heading* that jumps (a reset to another compass, or to the receiver's course) says nothing about
the gyro: :func:`undo_jump` goes on in the frame from before, which leaves the filters undisturbed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.attitude import dcm_from_quaternion
from estimators.jit import kernel

__all__ = ["TURNS", "forget_turns", "note_turn", "undo_jump", "usual_error"]

Array = NDArray[np.float64]

TURNS = 32
"""Increments that are kept of each IMU: 6 s of attitude samples 0.2 s apart."""
LEAST_TURNS = 4
"""Fewer increments since the onset have no median worth the name."""
LONGEST_TURN_S = 0.6
"""Over a longer interval the body rates do not integrate to a rotation vector."""

JUMP_RAD = 0.05
JUMPS_APART_S = 2.0
JUMP_SHARE = 0.3
"""A heading has jumped when one increment disagrees by three degrees, the one before by less than
this share of it, and none for two seconds: what goes on is a rate."""
SLEW_RAD_S = 0.15
"""An attitude computed from this very gyro that turns otherwise by nine degrees a second is being
corrected, however long it takes."""

PSI, JUMPED_S = 0, 1
"""Columns of ``heading``."""

T_S, E, Q, THETA = 0, slice(1, 4), slice(4, 8), slice(8, 11)
"""Columns of a row of ``turns``: time of the sample, e_i (NaN for none), quaternion, integral."""


@kernel
def note_turn(turns: Array, t: float, q: Array, theta: Array) -> None:
    """Append an attitude sample and its increment's disagreement with a gyro (in place).

    Parameters
    ----------
    turns : (TURNS, 11) float64
        Newest row last.
    t : float [s]
    q : (4,) float64
        Quaternion ned_from_frd.
    theta : (3,) float64 [rad]
        Integral of the gyro up to t.
    """
    turns[:-1] = turns[1:].copy()
    dt = t - turns[-2, T_S]
    turns[-1, T_S] = t
    turns[-1, Q] = q
    turns[-1, THETA] = theta
    turns[-1, E] = np.nan
    if not 0.0 < dt < LONGEST_TURN_S:
        return
    A, B = dcm_from_quaternion(turns[-2, Q].copy()), dcm_from_quaternion(q)
    D = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                D[i, j] += A[k, i] * B[k, j]
    angle = math.acos(min(1.0, max(-1.0, 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0))))
    scale = 0.5 if angle < 1e-6 else 0.5 * angle / math.sin(angle)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turned = scale * (D[k, j] - D[j, k])
        turns[-1, 1 + i] = (theta[i] - turns[-2, 8 + i] - turned) / dt


@kernel
def _heading_error(row: Array) -> float:
    """The gyro's error about the vertical by one increment [rad/s]; zero where there is none."""
    if math.isnan(row[1]):
        return 0.0
    A = dcm_from_quaternion(row[4:8].copy())
    return float(A[2, 0] * row[1] + A[2, 1] * row[2] + A[2, 2] * row[3])


@kernel
def undo_jump(turns: Array, heading: Array, alone: bool) -> None:
    """Note how far the attitude's heading has just jumped (in place).

    Parameters
    ----------
    turns : (TURNS, 11) float64
    heading : (2,) float64 [rad, s]
        What must be added to the attitude's heading; when it last jumped.
    alone : bool
        The attitude comes from this gyro and nothing else: every fast correction is undone.
    """
    t = turns[-1, T_S]
    dt = t - turns[-2, T_S]
    e, before = _heading_error(turns[-1]), _heading_error(turns[-2])
    jumped = abs(e) * dt > JUMP_RAD and abs(before) < JUMP_SHARE * abs(e)
    jumped = jumped and t - heading[JUMPED_S] > JUMPS_APART_S
    if jumped:
        heading[JUMPED_S] = t
    if jumped or (alone and abs(e) > SLEW_RAD_S):
        heading[PSI] += e * dt


@kernel
def forget_turns(turns: Array) -> None:
    """Forget all increments: the gyro's integral has a hole (in place)."""
    turns[:] = np.nan


def usual_error(turns: Array, since_s: float) -> Array:
    """Median of e_i since a time.

    Parameters
    ----------
    turns : (TURNS, 11) float64
    since_s : float [s]
        Increments that began earlier do not count.

    Returns
    -------
    (3,) float64 [rad/s]
        Zero when there are too few.
    """
    before = np.concatenate(([np.nan], turns[:-1, T_S]))
    errors = turns[(before >= since_s) & np.isfinite(turns[:, 1]), E]
    return np.median(errors, axis=0) if len(errors) >= LEAST_TURNS else np.zeros(3)
