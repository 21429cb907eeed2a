"""Windows of the filters: what a step, or a course, of each fault has done to the innovations.

A window starts with ``F`` the unit steps of the six faults, ``L`` and ``y`` empty (see
:mod:`estimators.ins_bank_model` for the symbols). Two windows of every length restart half a length
apart, so that one of them began shortly before any fault. The last window starts on demand and
follows the *measured course* of a difference between two IMUs instead of a step.

A fault that swings to and fro is no step for long, but every short window sees one: the mean over
eight seconds of their z^2, one without a fault, tells (Basseville and Nikiforov 1993: the energy of
the innovations, here per axis).

Source: lu2016 eq. (45)-(52): V, P_f and K_f with Q^f = 0, in information form; :func:`accept` is
its ``x = x_bar + V f`` (eq. 38) once a fault was called.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.ins_bank_model import F_ACC, N, inject, scalar_update
from estimators.ins_bank_state import C_NOW, Bank, Tuning
from estimators.jit import inlined, kernel

__all__ = [
    "NIS_LEAST",
    "SWING_Z2",
    "accept",
    "columns_of",
    "drive",
    "mark",
    "observe_fault",
    "restart_windows",
    "roll",
    "roll_windows",
    "windows_in_use",
]

Array = NDArray[np.float64]

NIS_LEAST = 0.5
"""Normaliser of the statistics: running mean of the innovations' square, not below this."""

SWING_S = 8.0
SWING_CLIP = 25.0
SWING_NIS_LEAST = 0.25
SWING_Z2 = 9.0
"""Time constant of the mean z^2 of the shortest windows, the largest term, the least normaliser and
the mean that no healthy gyro reaches: eight seconds hold five windows that do not overlap, and
chi-square of five degrees of freedom passes 45 once in 70 million."""


def columns_of(w: int) -> slice:
    """Columns of F that belong to a window."""
    return slice(6 * w, 6 * w + 6)


@inlined
def windows_in_use(start_s: Array) -> int:
    """Number of windows, the last one only if it was started."""
    return int(start_s.shape[0] - (1 if math.isnan(start_s[-1]) else 0))


@kernel
def _empty(F: Array, L: Array, Y: Array, w: int) -> None:
    """Begin a window: unit steps, and nothing known of them."""
    for k in range(6):
        for i in range(N):
            F[i, 6 * w + k] = 0.0
        F[F_ACC + k, 6 * w + k] = 1.0
        Y[w, k] = 0.0
        for m in range(6):
            L[w, k, m] = 0.0


@kernel
def restart_windows(
    F: Array, L: Array, Y: Array, start_s: Array, start_nis: Array, nis: float, t: float
) -> None:
    """Empty all windows of one filter (in place).

    Parameters
    ----------
    F : (17, 66), L : (W, 6, 6), Y : (W, 6), start_s : (W,), start_nis : (W,) float64
        Windows of the filter.
    nis : float
        Its running mean of the normalised innovation squared.
    t : float [s]
    """
    for w in range(start_s.shape[0] - 1):
        _empty(F, L, Y, w)
        start_s[w] = t
        start_nis[w] = max(NIS_LEAST, nis)
    start_s[-1] = math.nan


@kernel
def _note_swing(L: Array, Y: Array, swing: Array, nis: float, gain: float) -> None:
    """Gather what a finished short window says of each single axis (in place)."""
    for k in range(6):
        if L[k, k] > 0.0:
            fault = Y[k] / L[k, k]
            z2 = fault * Y[k] / max(SWING_NIS_LEAST, nis)
            swing[0, k] += gain * (min(z2, SWING_CLIP) - swing[0, k])
            swing[1, k] += gain * (fault * fault - swing[1, k])


@kernel
def roll_windows(
    F: Array,
    L: Array,
    Y: Array,
    start_s: Array,
    start_nis: Array,
    swing: Array,
    nis: float,
    window_s: Array,
    now: float,
) -> None:
    """Restart the windows of one filter that have reached their length (in place).

    The two windows of a length restart half a length apart, on a grid of vehicle time; ``swing``,
    (2, 6), gathers what the shortest have seen.
    """
    for w in range(start_s.shape[0] - 1):
        length = window_s[w // 2]
        phase = 0.5 * (w % 2)
        if math.floor(now / length + phase) > math.floor(start_s[w] / length + phase):
            if w < 2 and now - start_s[w] > 0.9 * length:
                _note_swing(L[w], Y[w], swing, nis, 0.5 * length / SWING_S)
            _empty(F, L, Y, w)
            start_s[w] = now
            start_nis[w] = max(NIS_LEAST, nis)


def roll(b: Bank, p: Tuning) -> None:
    """Restart the windows that have reached their length, after ``run`` stopped."""
    for c in np.flatnonzero(~np.isnan(b.aligned_s)):
        roll_windows(
            b.F[c],
            b.L[c],
            b.Y[c],
            b.start_s[c],
            b.start_nis[c],
            b.swing[c],
            float(b.nis[c]),
            p.window_s,
            float(b.clock[C_NOW]),
        )


def mark(b: Bank, t: float) -> None:
    """Start the last window of every filter: two IMUs have just begun to disagree.

    Its columns are not unit steps but the course that :func:`drive` gives each fault.
    """
    for c in np.flatnonzero(~np.isnan(b.aligned_s)):
        b.F[c, :, columns_of(b.last_window)] = 0.0
        b.L[c, -1], b.Y[c, -1] = 0.0, 0.0
        b.start_s[c, -1] = t
        b.start_nis[c, -1] = max(NIS_LEAST, b.nis[c])


def drive(b: Bank, imu: int, change: Array) -> None:
    """Let the faults that the last window supposes of an IMU change by this much now.

    Parameters
    ----------
    b : Bank
    imu : int
    change : (6,) float64 [m/s^2, rad/s]
    """
    k = np.arange(6)
    for c in (2 * imu, 2 * imu + 1):
        b.F[c, F_ACC + k, 6 * b.last_window + k] += change


def accept(
    b: Bank, c: int, w: int, axes: Array, prior: Array, prior_std: Array, now: float
) -> Array:
    """Take the faults that a window estimates on some axes into a filter's state.

    ``x <- x + F f``, ``P <- P + F L^-1 F'``: the bias filter of the two stages is folded back.

    Parameters
    ----------
    b : Bank
    c, w : int
        Filter and window.
    axes : (6,) float64
        1 on the axes to take, 0 elsewhere.
    prior, prior_std : (6,) float64 [m/s^2, rad/s]
        What other sensors say of the faults, and its standard deviation (infinite: nothing).
    now : float [s]
        All windows restart here.

    Returns
    -------
    (6,) float64
        The faults taken [m/s^2, rad/s].
    """
    on = np.flatnonzero(axes > 0.0)
    information = b.L[c, w][np.ix_(on, on)] + np.diag(prior_std[on] ** -2.0)
    covariance = np.linalg.inv(information)
    f = np.zeros(6)
    f[on] = covariance @ (b.Y[c, w, on] + prior[on] * prior_std[on] ** -2.0)
    F = b.F[c][:, columns_of(w)][:, on]
    b.x[c] += F @ f[on]
    b.P[c] += F @ covariance @ F.T
    inject(b.x[c], b.R[c])
    b.swing[c] = 0.0
    restart_windows(b.F[c], b.L[c], b.Y[c], b.start_s[c], b.start_nis[c], float(b.nis[c]), now)
    return f


def observe_fault(b: Bank, c: int, axis: int, fault: float, std: float) -> None:
    """Let a filter know what another IMU says of one of its faults."""
    h = np.zeros(N)
    h[F_ACC + axis] = 1.0
    nu = fault - b.x[c, F_ACC + axis]
    in_use = windows_in_use(b.start_s[c])
    scalar_update(b.x[c], b.P[c], b.F[c], b.L[c], b.Y[c], in_use, h, nu, std * std)
    inject(b.x[c], b.R[c])
