"""How far a healthy aircraft's residuals may be off, from what is not known of air and aircraft.

========  ==================================================================  ==========  =========
symbol    meaning                                                             shape       samar2006
========  ==================================================================  ==========  =========
c         airframe (:meth:`estimators.wing_model.Airframe.row`)               (41,)
d         standard deviation of each of its numbers, 0 for those that are known (41,)
g         residual gust: what the filtered residuals keep of unknown wind     m/s
s_V       error of the airspeed                                               m/s
s_tilt    error of roll and of pitch                                          rad
Q         covariance of the residuals of a healthy aircraft                   (6, 6)      (9)
y, S      residuals and signatures (:mod:`estimators.wing_residuals`)         (6,)(6, 4)
b_j       what coefficient j, off by d_j, makes of the row's faults           (4,)        %
L         Q = L L'; rows are whitened, L^-1 y and L^-1 S                      (6, 6)
========  ==================================================================  ==========  =========

Every cause moves the six accelerations in one fixed proportion, found by finite differences at the
row's own inputs::

    Q = sum over causes (phi(cause) - phi) (phi(cause) - phi)' + share of its diagonal + floor^2

A gust from the side moves side force, roll and yaw together, so that no wing is blamed for it; a
coefficient that is 15 % off counts as noise where it acts.

Differs: the paper, and the reproduction, take Q from recorded residuals of a healthy aircraft. Here
it needs no flight, fits any airframe and any speed, and shrinks as coefficients become known
(``mavsentry learn airframe`` gives the deviations d).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.linalg import cholesky, forward_vector, invert
from estimators.wing_model import AXES, FAULTS, predict

__all__ = ["noise_row", "whiten_rows"]

Array = NDArray[np.float64]

WIND0, TAS = 13, 17
P = len(FAULTS)


@kernel
def add_outer(moved: Array, phi: Array, Q: Array) -> None:
    """Q += (moved - phi) (moved - phi)'."""
    for i in range(AXES):
        for j in range(AXES):
            Q[i, j] += (moved[i] - phi[i]) * (moved[j] - phi[j])


@kernel
def noise_row(
    c: Array,
    d: Array,
    x: Array,
    gust: float,
    tas_std: float,
    tilt_std: float,
    share: float,
    floor: Array,
    Q: Array,
) -> None:
    """Covariance of one row's residuals.

    Parameters
    ----------
    c, d : (41,) float64
    x : (INPUTS,) float64
        See :func:`estimators.wing_model.inputs_of`; with a measured airspeed.
    gust, tas_std, tilt_std
        g, s_V, s_tilt [m/s, m/s, rad].
    share
        Of the diagonal, added to it.
    floor : (6,) float64 [m/s^2, rad/s^2]
        What every residual scatters by in calm air.
    Q : (6, 6) float64, written
    """
    phi, moved, none = np.empty(AXES), np.empty(AXES), np.zeros(P)
    cc, xx = c.copy(), x.copy()
    predict(cc, xx, none, phi)
    for i in range(AXES):
        for j in range(AXES):
            Q[i, j] = 0.0
    for a in range(3):
        xx[WIND0 + a] = x[WIND0 + a] + gust
        predict(cc, xx, none, moved)
        add_outer(moved, phi, Q)
        xx[WIND0 + a] = x[WIND0 + a]
    for a in range(2):
        xx[a] = x[a] + tilt_std
        predict(cc, xx, none, moved)
        add_outer(moved, phi, Q)
        xx[a] = x[a]
    xx[TAS] = x[TAS] + tas_std
    predict(cc, xx, none, moved)
    add_outer(moved, phi, Q)
    xx[TAS] = x[TAS]
    for n in range(len(c)):
        if d[n] > 0.0:
            cc[n] = c[n] + d[n]
            predict(cc, xx, none, moved)
            add_outer(moved, phi, Q)
            cc[n] = c[n]
    for i in range(AXES):
        Q[i, i] += share * Q[i, i] + floor[i] * floor[i]


@kernel
def whiten_rows(
    c: Array, d: Array, x: Array, gust: float, tas_std: float, tilt_std: float, share: float,
    floor: Array, y: Array, S: Array, lasting: Array,
) -> int:  # fmt: skip
    """Divide residuals and signatures by the square root of their row's Q, in place.

    Parameters
    ----------
    x : (n, INPUTS) float64
        Inputs at the rows' times.
    y, S : (n, 6), (n, 6, 4) float64, updated
        A row whose Q is not finite becomes NaN in both, which says nothing.
    lasting : (n, 2) float64 [%], written
        Deviation of right minus left, lift and drag, that coefficients which are off leave for as
        long as the aircraft flies so: root of the sum of squares of the b_j, least squares.
    others
        As of :func:`noise_row`.

    Returns
    -------
    int
        Rows that became NaN.
    """
    Q, L, column = np.empty((AXES, AXES)), np.empty((AXES, AXES)), np.empty(AXES)
    phi, none, info, b = np.empty(AXES), np.zeros(P), np.empty((AXES, AXES)), np.empty(P)
    cc = c.copy()
    lost = 0
    for k in range(len(y)):
        noise_row(c, d, x[k], gust, tas_std, tilt_std, share, floor, Q)
        if not cholesky(Q, L):
            lost += 1
            for i in range(AXES):
                y[k, i] = math.nan
                for j in range(P):
                    S[k, i, j] = math.nan
            lasting[k, 0] = lasting[k, 1] = math.inf
            continue
        forward_vector(L, y[k])
        for j in range(P):
            for i in range(AXES):
                column[i] = S[k, i, j]
            forward_vector(L, column)
            for i in range(AXES):
                S[k, i, j] = column[i]
        for i in range(AXES):
            for j in range(AXES):
                info[i, j] = 1.0 if i == j and i >= P else 0.0
        for i in range(P):
            for j in range(P):
                for a in range(AXES):
                    info[i, j] += S[k, a, i] * S[k, a, j]
        sound = invert(info)
        lasting[k, 0] = lasting[k, 1] = 0.0 if sound else math.inf
        predict(c, x[k], none, phi)
        for n in range(len(c)):
            if not (d[n] > 0.0 and sound):
                continue
            cc[n] = c[n] + d[n]
            predict(cc, x[k], none, column)
            cc[n] = c[n]
            for i in range(AXES):
                column[i] -= phi[i]
            forward_vector(L, column)
            for i in range(P):
                b[i] = 0.0
                for a in range(AXES):
                    b[i] += S[k, a, i] * column[a]
            for i in range(2):
                apart = 0.0
                for j in range(P):
                    apart += (info[i, j] - info[i + 2, j]) * b[j]
                lasting[k, i] += apart * apart
        lasting[k, 0], lasting[k, 1] = math.sqrt(lasting[k, 0]), math.sqrt(lasting[k, 1])
    return lost
