"""The explanations of the long horizon, solved: trajectories and log-likelihoods.

All windows are solved without bounds first, several at once (:mod:`estimators.air_horizon_lanes`).
One that keeps its bounds is done; only where one does not, the barrier iterations run, one
explanation at a time. See :mod:`estimators.air_horizon` for the symbols.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS
from estimators.air_horizon import (
    CHANGED_S,
    GUST_H,
    H_STAGES,
    MH,
    N_EXPLANATIONS,
    NH,
    SCALE_H,
    WIND_WALKED,
    HorizonLevels,
    LongHorizon,
    stage_rows,
    transition,
)
from estimators.air_horizon_lanes import HL, back, forward_rows, predict_stage
from estimators.air_horizon_stage import Z_DT, Z_T
from estimators.jit import kernel
from estimators.mhe import SOLVED, barrier_qp

__all__ = ["solve_explanations"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_G, _K = GUST_H.start, SCALE_H.start


@kernel
def _bounds(z: LongHorizon, levels: HorizonLevels, n: int) -> None:
    """Bounds on wind, on its change since the arrival, and on scale, for n stages."""
    for a in range(3):
        limit = levels.wind_max_m_s if a < 2 else levels.down_max_m_s
        change = levels.change_max_m_s if a < 2 else levels.down_max_m_s
        band = change + 3.0 * math.sqrt(z.P[a, a])
        lo, hi = max(-limit, z.x_p[a] - band), min(limit, z.x_p[a] + band)
        if not hi - lo > 0.5:
            lo, hi = -limit, limit
        for i in range(n):
            z.lo[i, a], z.hi[i, a] = lo, hi
    for a in range(_K, _K + N_PITOTS):
        for i in range(n):
            z.lo[i, a], z.hi[i, a] = -levels.scale_max, levels.scale_max


@kernel
def _square(P: Array, r: Array) -> float:
    """Return r' P^-1 r by elimination; P (n, n) and r (n,) are overwritten."""
    total = 0.0
    n = r.size
    for k in range(n):
        total += r[k] * r[k] / P[k, k]
        for i in range(k + 1, n):
            s = P[i, k] / P[k, k]
            r[i] -= s * r[k]
            for j in range(k + 1, n):
                P[i, j] -= s * P[k, j]
    return total


@kernel
def _cost(z: LongHorizon, x: Array, u: Array, n: int) -> float:
    """J of a trajectory: arrival, inputs and measurements, each as half its square."""
    P, r = np.empty((NH, NH)), np.empty(NH)
    for a in range(NH):
        r[a] = x[0, a] - z.x_p[a]
        for b in range(NH):
            P[a, b] = z.P[a, b]
    J = _square(P, r)
    for i in range(n):
        for k in range(MH):
            e = z.ry[i, k]
            for a in range(NH):
                e -= z.C[i, k, a] * x[i, a]
            J += e * e
        if i < n - 1:
            for a in range(NH):
                J += u[i, a] ** 2
    return 0.5 * J


@kernel
def _changed_since(z: LongHorizon, h: int, n: int) -> float:
    """Since when the wind changes under explanation h [s]; infinite if it does not."""
    if h < WIND_WALKED:
        return np.inf
    return float(z.stages[n - 1, Z_T] - CHANGED_S[h - WIND_WALKED])


@kernel
def _noises(z: LongHorizon, levels: HorizonLevels, which: Ints, i: int, n: int) -> None:
    """A and B of the step into stage i in every lane; neighbours that agree share them."""
    w, row = z.lanes, z.stages[i]
    A, B = z.A[i - 1], z.B[i - 1]
    like = -1
    for g in range(HL):
        h = which[g]
        windy = row[Z_T] > _changed_since(z, h, n)
        alike = 2 * int(windy) + int(0 < h < WIND_WALKED)
        if alike != like:
            transition(A, B, row, levels, h, windy)
            like = alike
        for a in range(NH):
            w.B2[a, g] = B[a, a] * B[a, a]
    w.phi[i], w.d[i] = A[_G, _G], row[Z_DT]


@kernel
def _forward(z: LongHorizon, levels: HorizonLevels, which: Ints, n: int) -> None:
    """The lanes' filters from the arrival to the newest stage."""
    w = z.lanes
    for g in range(HL):
        w.ln[g] = 0.0
        for i in range(N_PITOTS):
            drifts = which[g] < WIND_WALKED and (which[g] >> i) & 1
            w.drifts[_K + i, g] = 1.0 if drifts else 0.0
    for i in range(n):
        C, ry = z.C[i], z.ry[i]
        for g in range(HL):
            stage_rows(z.stages[i], z.x[which[g], i], C, ry)
            w.C0[i, 0, g], w.C0[i, 1, g], w.ry[i, g] = C[1, 0], C[1, 1], ry[1]
        if i == 0:
            for a in range(NH):
                for g in range(HL):
                    w.x[0, a, g] = z.x_p[a]
                for b in range(a, NH):
                    for g in range(HL):
                        w.P[0, a, b, g] = z.P[a, b]
        else:
            _noises(z, levels, which, i, n)
            predict_stage(w, i, _G)
        forward_rows(w, i, C, ry)


@kernel
def _misfit(z: LongHorizon, g: int, n: int) -> float:
    """J of lane g: half the squares of its innovations."""
    w, J = z.lanes, 0.0
    for i in range(n):
        for k in range(MH):
            J += 0.5 * w.e[i, k, g] ** 2 * w.S[i, k, g]
    return J


@kernel
def _within(z: LongHorizon, g: int, n: int) -> int:
    """1 if the trajectory of lane g lies strictly inside the bounds, else 0; -1: not finite."""
    x, total, inside = z.lanes.x, 0.0, 1
    for i in range(n):
        for a in range(NH):
            total += x[i, a, g]
            if not (z.lo[i, a] < x[i, a, g] < z.hi[i, a]):
                inside = 0
    return inside if np.isfinite(total) else -1


@kernel
def _solve_bounded(z: LongHorizon, levels: HorizonLevels, h: int, n: int) -> int:
    """Barrier iterations of explanation h from its linearisation point; returns a status."""
    A, B, C, ry = z.A[: n - 1], z.B[: n - 1], z.C[:n], z.ry[:n]
    f, zero, u, x = z.zero[: n - 1], z.zero[: n - 1], z.u[: n - 1], z.x[h, :n]
    free_ul, free_uu = z.inf[0, : n - 1], z.inf[1, : n - 1]
    size = n * (NH * NH + NH + (MH + NH) * (NH + 2)) + 3 * NH * NH + 6 * NH + NH + 16 * n * NH
    since = _changed_since(z, h, n)
    for i in range(n):
        stage_rows(z.stages[i], x[i], C[i], ry[i])
        if i > 0:
            transition(A[i - 1], B[i - 1], z.stages[i], levels, h, z.stages[i, Z_T] > since)
    return int(
        barrier_qp(
            z.P, z.one, z.one[:MH], A, B, C, f, z.x_p, zero, ry,
            z.lo[:n], z.hi[:n], free_ul, free_uu, levels.kappa, levels.n_kappa, levels.n_qp,
            x, u, z.work[:size],
        )
    )  # fmt: skip


@kernel
def _conclude(
    z: LongHorizon, levels: HorizonLevels, h: int, g: int, n: int, ln: float, J: float
) -> bool:
    """Take over what lane g found of explanation h, or solve it within its bounds."""
    inside = _within(z, g, n)
    if inside < 0:
        return False
    w = z.lanes
    for a in range(NH):
        for b in range(NH):
            z.end_P[h, a, b] = w.P[n - 1, min(a, b), max(a, b), g]
    if inside == 1:
        for i in range(n):
            for a in range(NH):
                z.x[h, i, a] = w.x[i, a, g]
        z.L[h] = ln
        return True
    if _solve_bounded(z, levels, h, n) != SOLVED:
        return False
    z.L[h] = ln + J - max(J, _cost(z, z.x[h], z.u, n))
    return True


@kernel
def _solve_together(z: LongHorizon, levels: HorizonLevels, which: Ints, m: int, n: int) -> int:
    """Solve the first m of ``which``; idle lanes repeat the first. Returns who was solved."""
    for g in range(m, HL):
        which[g] = which[0]
    J = np.empty(HL)
    solved = 0
    for g in range(m):
        solved |= 1 << which[g]
    for _ in range(levels.iterations):
        _forward(z, levels, which, n)
        for g in range(m):
            J[g] = _misfit(z, g, n)
        back(z.lanes, n, _G, z.C)
        for g in range(m):
            h = which[g]
            if (solved >> h) & 1 and not _conclude(z, levels, h, g, n, z.lanes.ln[g], J[g]):
                solved &= ~(1 << h)
    return solved


@kernel
def solve_explanations(z: LongHorizon, levels: HorizonLevels, wanted: int) -> int:
    """Estimate the horizon under explanations: trajectory, log-likelihood, end covariance of each.

    Parameters
    ----------
    wanted : int
        Bit h set: solve explanation h.

    Returns
    -------
    int
        Those solved. One that was not does not compete (L is -inf) and its trajectory stays.

    Source: wan2018 Algorithm 1, one Newton step where no bound is active.
    """
    n = int(z.memory[H_STAGES])
    _bounds(z, levels, n)
    which = np.empty(HL, np.int64)
    solved, m = 0, 0
    for h in range(N_EXPLANATIONS):
        if (wanted >> h) & 1:
            which[m] = h
            m += 1
        if m == HL or (m > 0 and h == N_EXPLANATIONS - 1):
            solved |= _solve_together(z, levels, which, m, n)
            m = 0
    for h in range(N_EXPLANATIONS):
        if (wanted >> h) & 1 and not (solved >> h) & 1:
            z.L[h] = -np.inf
    return solved
