"""A window without bounds, solved for several explanations at once.

The explanations of :mod:`estimators.air_horizon` share the stages; they differ in how fast the wind
may walk, which pitots drift, and where the airspeed is linearised. Side by side, one explanation a
lane (:mod:`estimators.air_data_3d_lanes`), they go through the Riccati recursion of
:func:`estimators.mhe.kkt_step` together: the Kalman filter forward, its adjoint back. Without
bounds one pass is the solution.

========  ==============================================================  =====================
symbol    meaning                                                         shape
========  ==============================================================  =====================
x, P      state and covariance of a stage, its data used; j >= i of P     (N, 10, HL),
                                                                          (N, 10, 10, HL)
PH, S, e  of each row: P H, 1 / innovation variance, innovation           (N, 4, 10, HL),
                                                                          (N, 4, HL) twice
phi, d    A of the step into a stage: the gust's decay; what the rate     (N,), (N,)
          of a drift adds to k, in the lanes whose pitots drift
drifts    1 for a k that drifts in a lane, else 0                         (10, HL)
lam, xi   multiplier of the dynamics                                      (10, HL)
========  ==============================================================  =====================
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d_lanes import update_lanes
from estimators.jit import kernel

__all__ = ["HL", "HorizonLanes", "back", "forward_rows", "new_horizon_lanes", "predict_stage"]

Array = NDArray[np.float64]

HL = 8
"""Explanations side by side."""
_NH, _MH = 10, 4
_RATE = _NH - 1
_NO_GATE = 1e9
_HALF_LN_2PI = 0.5 * math.log(2.0 * math.pi)


class HorizonLanes(NamedTuple):
    """Room for N stages; see the table."""

    x: Array
    P: Array
    PH: Array
    S: Array
    e: Array
    phi: Array
    d: Array
    drifts: Array
    H: Array
    C0: Array
    ry: Array
    B2: Array
    lam: Array
    xi: Array
    ln: Array


def new_horizon_lanes(N: int) -> HorizonLanes:
    """Room for N stages."""
    z = np.zeros
    return HorizonLanes(
        x=z((N, _NH, HL)),
        P=z((N, _NH, _NH, HL)),
        PH=z((N, _MH, _NH, HL)),
        S=z((N, _MH, HL)),
        e=z((N, _MH, HL)),
        phi=z(N),
        d=z(N),
        drifts=z((_NH, HL)),
        H=z((_NH, HL)),
        C0=z((N, 2, HL)),
        ry=z((N, HL)),
        B2=z((_NH, HL)),
        lam=z((_NH, HL)),
        xi=z((_NH, HL)),
        ln=z(HL),
    )


@kernel
def predict_stage(z: HorizonLanes, i: int, gust: int) -> None:
    """State and covariance of stage i from those of the stage before: A P A' + B B'.

    ``z.phi[i]``, ``z.d[i]``, ``z.drifts`` and ``z.B2`` say what A and B are.

    Parameters
    ----------
    gust : int
        First of the two states that decay.
    """
    x, P, x1, P1 = z.x[i - 1], z.P[i - 1], z.x[i], z.P[i]
    phi, dt, drifts = z.phi[i], z.d[i], z.drifts
    lanes = z.ln.size
    for a in range(_NH):
        A_a = phi if gust <= a < gust + 2 else 1.0
        for g in range(lanes):
            x1[a, g] = A_a * x[a, g] + dt * drifts[a, g] * x[_RATE, g]
        for b in range(a, _NH):
            A_b = phi if gust <= b < gust + 2 else 1.0
            for g in range(lanes):
                with_b = A_a * P[a, b, g] + dt * drifts[a, g] * P[b, _RATE, g]
                with_rate = A_a * P[a, _RATE, g] + dt * drifts[a, g] * P[_RATE, _RATE, g]
                P1[a, b, g] = with_b * A_b + with_rate * dt * drifts[b, g]
        for g in range(lanes):
            P1[a, a, g] += z.B2[a, g]


@kernel
def forward_rows(z: HorizonLanes, i: int, C: Array, ry: Array) -> None:
    """Use the rows of stage i; log-likelihoods go to ``z.ln``.

    Parameters
    ----------
    C, ry : (4, 10), (4,) float64
        Rows of the stage. Of row 1, the pitots' mean, the first two elements and ry are of each
        lane: ``z.C0[i]`` and ``z.ry[i]``.
    """
    lanes = z.ln.size
    for k in range(_MH):
        rows = 0
        for a in range(_NH):
            if C[k, a] != 0.0:
                rows |= 1 << a
        e = z.e[i, k]
        for g in range(lanes):
            z.S[i, k, g] = 0.0
            e[g] = ry[k]
        if rows == 0:
            continue
        for a in range(_NH):
            for g in range(lanes):
                z.H[a, g] = C[k, a]
        if k == 1:
            rows |= 3
            for g in range(lanes):
                z.H[0, g] = z.C0[i, 0, g]
                z.H[1, g] = z.C0[i, 1, g]
                e[g] = z.ry[i, g]
        for a in range(_NH):
            if (rows >> a) & 1:
                for g in range(lanes):
                    e[g] -= z.H[a, g] * z.x[i, a, g]
        update_lanes(z.x[i], z.P[i], z.H, z.PH[i, k], e, z.S[i, k], z.ln, rows, 1.0, _NO_GATE)
        for g in range(lanes):
            z.ln[g] += _HALF_LN_2PI


@kernel
def back(z: HorizonLanes, n: int, gust: int, C: Array) -> None:
    """From the last of n stages to the first: ``z.x`` becomes the smoothed trajectory.

    Parameters
    ----------
    C : (N, 4, 10) float64
        Rows of the stages, as of :func:`forward_rows`.
    """
    x, lam, xi, lanes = z.x, z.lam, z.xi, z.ln.size
    for a in range(_NH):
        for g in range(lanes):
            lam[a, g] = 0.0
    for i in range(n - 1, -1, -1):
        for a in range(_NH):
            A_a = 1.0
            if i < n - 1 and gust <= a < gust + 2:
                A_a = z.phi[i + 1]
            for g in range(lanes):
                xi[a, g] = A_a * lam[a, g]
        if i < n - 1:
            for a in range(_NH):
                for g in range(lanes):
                    xi[_RATE, g] += z.d[i + 1] * z.drifts[a, g] * lam[a, g]
        for a in range(_NH):
            for b in range(_NH):
                p, q = min(a, b), max(a, b)
                for g in range(lanes):
                    x[i, a, g] -= z.P[i, p, q, g] * xi[b, g]
        for a in range(_NH):
            for g in range(lanes):
                lam[a, g] = xi[a, g]
        for k in range(_MH - 1, -1, -1):
            if z.S[i, k, 0] == 0.0:
                continue
            t = z.e[i, k]
            for a in range(_NH):
                for g in range(lanes):
                    t[g] += z.PH[i, k, a, g] * lam[a, g]
            for g in range(lanes):
                t[g] *= z.S[i, k, g]
            for a in range(_NH):
                for g in range(lanes):
                    c = C[i, k, a]
                    if k == 1 and a < 2:
                        c = z.C0[i, a, g]
                    lam[a, g] -= c * t[g]
