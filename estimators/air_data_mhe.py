"""The paper's constrained moving-horizon air data estimator, one sample at a time.

=============  =====================================================  ==========  =============
symbol         meaning                                                shape       wan2018
=============  =====================================================  ==========  =============
N              samples in the horizon, l = k - N + 1 .. k                         (21)
x, u           present estimate over the horizon                      (N,4)       (24)
x_prior        arrival mean x_{l|k}^-                                 (4,)        (21a)
P, Q, R        variances (their diagonals)                            (4,)        (22)
y, use         fused measurements [V_g, V_z, alpha, V_c] and which    (N, 4)      (20d)
               of them count (1 or 0)
kappa          barrier parameter: 1, falling tenfold                              Algorithm 1
=============  =====================================================  ==========  =============

One sample costs one linearisation and ``n_kappa n_qp`` runs of Algorithm 2 (the real-time
iteration); the converged mode repeats linearisation and a primal-dual solution until the steps
vanish. The horizon shifts by one sample: the arrival mean is the smoothed x_{l|k-1}, the newest
state is predicted with u = 0.

A bound on the wind's rate needs a time base: at t_s = 0.048 s turbulence of 3.5 m/s rms moves by
111 kt/s from sample to sample and by 22 kt/s over one second. Besides the bounds on x and u the
wind may therefore be confined to a band about a wind estimate of some seconds ago (``confine``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import EXACT, NU, NX, NY, air_outside, linearise
from estimators.jit import kernel
from estimators.mhe import (
    NON_FINITE,
    NOT_CONVERGED,
    SOLVED,
    barrier_qp,
    work_size,
)
from estimators.mhe_converged import converged_qp

__all__ = [
    "AirDataMHE",
    "AirDataTuning",
    "horizon_size",
    "mhe_advance",
    "mhe_run",
    "mhe_solve",
    "mhe_step",
    "window_size",
    "window_views",
]

Array = NDArray[np.float64]

CONVERGED_STEP = 1e-9
"""Largest component [rad, m/s] of an SQP step at which the converged mode stops."""

KT = 0.514444
"""One knot [m/s]."""

# rows of a tuning array
ROW_P, ROW_Q, ROW_R, ROW_XL, ROW_XU, ROW_UL, ROW_UU = range(7)


@dataclass(frozen=True)
class AirDataTuning:
    """Weights, bounds and iteration counts of the estimator.

    The variances are those that reproduce the paper's figures (its text gives only some), fitted on
    a synthetic transport; the bounds are the paper's 120 kt and 30 kt/s.
    """

    model: int = EXACT
    N: int = 3
    t_s: float = 0.048
    P_std: tuple[float, ...] = (np.radians(0.2), 0.1, 0.1, 0.1)
    Q_std: tuple[float, ...] = (np.radians(1.0), 0.5, np.sqrt(0.1), np.sqrt(0.1))
    R_std: tuple[float, ...] = (0.2, 0.2, np.radians(0.3), 0.5)
    wind_bound_m_s: tuple[float, float] = (120 * KT, 120 * KT)
    wind_rate_bound_m_s2: float = 30 * KT
    kappa: float = 1.0
    n_kappa: int = 2
    n_qp: int = 2
    sqp_iterations: int = 1
    converged: bool = False
    constrained: bool = True

    def table(self) -> Array:
        """Rows P, Q, R, xl, xu, ul, uu of the kernels, shape (7, 4)."""
        inf = np.inf
        big = self.constrained
        wx, wz = self.wind_bound_m_s if big else (inf, inf)
        rate = self.wind_rate_bound_m_s2 if big else inf
        x = np.array([inf, inf, wx, wz])
        u = np.array([inf, inf, rate, rate])
        rows = [np.square(v) for v in (self.P_std, self.Q_std, self.R_std)]
        return np.array([*rows, -x, x, -u, u])


def horizon_size(N: int) -> int:
    """Length of the scratch array of :func:`mhe_solve`."""
    return N * (3 * NX * NX + 9 * NX) + NX * NX + 2 * NX + work_size(N, NX, NU, NY)


def window_size(N: int) -> int:
    """Length of the array that holds one horizon (:func:`window_views`)."""
    return NX + N * (NX + NU + NY + NY + 6 + 2)


@kernel
def window_views(window: Array, N: int) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """Views x_prior (4,), x (N,4), u (N-1,4), y (N,4), use (N,4), theta (N,6), air (N,2)."""
    x_prior = window[0:4]
    blocks = window[4 : 4 + 16 * N].reshape(4, N, 4)
    theta = window[4 + 16 * N : 4 + 22 * N].reshape(N, 6)
    air = window[4 + 22 * N : 4 + 24 * N].reshape(N, 2)
    return x_prior, blocks[0], blocks[1, : N - 1], blocks[2], blocks[3], theta, air


@kernel
def mhe_solve(
    model: int,
    t_s: float,
    tuning: Array,
    confine: Array,
    kappa: float,
    n_kappa: int,
    n_qp: int,
    n_sqp: int,
    N: int,
    window: Array,
    work: Array,
) -> tuple[int, float]:
    """Improve the horizon's estimate by SQP iterations; returns (status, size of the last step).

    Parameters
    ----------
    model : int
        APPROXIMATE or EXACT of :mod:`estimators.air_data_2d`.
    t_s : float
        Sampling interval [s].
    tuning : (7, 4) float64
        Rows P, Q, R (variances), xl, xu, ul, uu.
    confine : (2, 2) float64 [m/s]
        Rows: centre and half-width of the band of (W_x, W_z); an infinite width is none.
    kappa : float
        First barrier parameter; 0 asks for the converged mode.
    n_kappa, n_qp, n_sqp : int
        Values of kappa, iterations at each, SQP iterations (their limit in the converged mode).
    N : int
        Samples in the horizon, at least 2.
    window : (window_size(N),) float64, read as the linearisation point and written
    work : (horizon_size(N),) float64, overwritten

    Source: wan2018 section V-A.
    Differs: f_i = F(x_i, u_i) - x_{i+1} with F the discrete map (the print adds x_i and t_s again);
    the whole row of a measurement that is not used is zero, not only that of C.
    """
    x_prior, x, u, y, use, theta, air = window_views(window, N)
    n = 4
    o = 0
    matrices = work[: 48 * N].reshape(3, N, n, n)
    A, B, C = matrices[0], matrices[1], matrices[2]
    o += 48 * N
    v = work[o : o + 36 * N].reshape(9, N, n)
    o += 36 * N
    f, ry, ru, xl, xu, ul, uu, dx, du = v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8]
    P = work[o : o + 16].reshape(n, n)
    o += 16
    rx = work[o : o + 4]
    o += 4
    F = work[o : o + 4]
    o += 4
    rest = work[o:]
    for a in range(n):
        for b in range(n):
            P[a, b] = 0.0
        P[a, a] = tuning[0, a]
    status = 0
    size = 0.0
    for _ in range(n_sqp):
        for i in range(N):
            j = min(i, N - 2)
            linearise(model, x[i], u[j], theta[i], air[i], t_s, F, A[i], B[i], ry[i], C[i])
            for a in range(n):
                if use[i, a] != 0.0:
                    ry[i, a] = y[i, a] - ry[i, a]
                else:
                    ry[i, a] = 0.0
                    for b in range(n):
                        C[i, a, b] = 0.0
                lo = tuning[3, a]
                hi = tuning[4, a]
                if a >= 2:
                    lo = max(lo, confine[0, a - 2] - confine[1, a - 2])
                    hi = min(hi, confine[0, a - 2] + confine[1, a - 2])
                xl[i, a] = lo - x[i, a]
                xu[i, a] = hi - x[i, a]
                if i < N - 1:
                    f[i, a] = F[a] - x[i + 1, a]
                    ru[i, a] = -u[i, a]
                    ul[i, a] = tuning[5, a] - u[i, a]
                    uu[i, a] = tuning[6, a] - u[i, a]
        for a in range(n):
            rx[a] = x_prior[a] - x[0, a]
        bounds = xl, xu, ul[: N - 1], uu[: N - 1]
        step = du[: N - 1]
        Q = tuning[1]
        R = tuning[2]
        if kappa > 0.0:
            status = barrier_qp(
                P, Q, R, A, B, C, f, rx, ru, ry, *bounds, kappa, n_kappa, n_qp, dx, step, rest
            )
        else:
            status = converged_qp(
                P, Q, R, A, B, C, f, rx, ru, ry, *bounds, 1e-13, 60, dx, step, rest
            )
        if status >= NON_FINITE:
            return status, np.inf
        size = 0.0
        for i in range(N):
            for a in range(n):
                x[i, a] += dx[i, a]
                size = max(size, abs(dx[i, a]))
                if i < N - 1:
                    u[i, a] += du[i, a]
        if kappa == 0.0 and size < CONVERGED_STEP:
            break
    if kappa == 0.0 and status == SOLVED and size > 1e-6:
        status = NOT_CONVERGED
    return status, size


@kernel
def mhe_advance(
    model: int,
    t_s: float,
    N: int,
    window: Array,
    y_new: Array,
    use_new: Array,
    theta_new: Array,
    warmer_k: float,
    work: Array,
) -> None:
    """Shift the horizon by one sample and predict the newest state with u = 0.

    ``y_new`` (4,), ``use_new`` (4,) and ``theta_new`` (6,) are the new sample, ``warmer_k`` as in
    :func:`estimators.air_data_2d.air_outside`.

    Source: wan2018 below (42): x_{l|k}^- = x_{l|k-1}, x_{k|k-1} = F(x_{k-1|k-1}, 0, theta_{k-1}).
    """
    x_prior, x, u, y, use, theta, air = window_views(window, N)
    for a in range(4):
        x_prior[a] = x[1, a]
    for i in range(N - 1):
        for a in range(4):
            x[i, a] = x[i + 1, a]
            y[i, a] = y[i + 1, a]
            use[i, a] = use[i + 1, a]
            if i < N - 2:
                u[i, a] = u[i + 1, a]
        for a in range(6):
            theta[i, a] = theta[i + 1, a]
        air[i, 0] = air[i + 1, 0]
        air[i, 1] = air[i + 1, 1]
    for a in range(4):
        u[N - 2, a] = 0.0
        y[N - 1, a] = y_new[a]
        use[N - 1, a] = use_new[a]
    for a in range(6):
        theta[N - 1, a] = theta_new[a]
    air_outside(theta_new[5], warmer_k, air[N - 1])
    A = work[0:16].reshape(4, 4)
    B = work[16:32].reshape(4, 4)
    C = work[32:48].reshape(4, 4)
    h = work[48:52]
    linearise(model, x[N - 2], u[N - 2], theta[N - 2], air[N - 2], t_s, x[N - 1], A, B, h, C)


@kernel
def mhe_step(
    model: int,
    t_s: float,
    tuning: Array,
    confine: Array,
    kappa: float,
    n_kappa: int,
    n_qp: int,
    n_sqp: int,
    N: int,
    window: Array,
    sample: Array,
    warmer_k: float,
    work: Array,
) -> int:
    """One sample: shift, predict, improve; returns a status of :mod:`estimators.mhe`.

    ``sample`` (14,) is y (4), use (4) and theta (6) in a row; the rest as in :func:`mhe_solve`.
    When the solver fails the prediction stands.
    """
    mhe_advance(model, t_s, N, window, sample[0:4], sample[4:8], sample[8:14], warmer_k, work)
    status, _ = mhe_solve(model, t_s, tuning, confine, kappa, n_kappa, n_qp, n_sqp, N, window, work)
    return status


@kernel
def mhe_run(
    model: int, t_s: float, tuning: Array, confine: Array, kappa: float, n_kappa: int, n_qp: int,
    n_sqp: int, N: int, window: Array, samples: Array, warmer_k: float, work: Array, states: Array,
) -> int:  # fmt: skip
    """Take the rows of ``samples`` (T, 14) one by one; returns the worst status.

    ``states`` (T, 4) receives the newest state after each sample.
    """
    worst = 0
    for row in range(samples.shape[0]):
        status = mhe_step(
            model, t_s, tuning, confine, kappa, n_kappa, n_qp, n_sqp, N, window, samples[row],
            warmer_k, work,
        )  # fmt: skip
        worst = max(worst, status)
        newest = 4 + 4 * (N - 1)
        for a in range(4):
            states[row, a] = window[newest + a]
    return worst


class AirDataMHE:
    """The estimator as an object: feed it samples, read ``x``.

    Attributes
    ----------
    x, u : (N, 4), (N-1, 4) float64
        Estimate over the horizon, the newest last (views into ``window``).
    x_prior, y, use, theta, air
        The horizon's prior mean, measurements, their use, parameters and air (views).
    confine : (2, 2) float64 [m/s]
        Rows: centre and half-width of the band that the wind (W_x, W_z) is confined to.
    status : int
        Of the last sample; see :mod:`estimators.mhe`.
    """

    def __init__(self, tuning: AirDataTuning, x0: Array, theta0: Array) -> None:
        N = tuning.N
        self.tuning = tuning
        self.table = tuning.table()
        self.confine = np.array([[0.0, 0.0], [np.inf, np.inf]])
        self.window = np.zeros(window_size(N))
        self.work = np.zeros(horizon_size(N))
        self.sample = np.zeros(14)
        views = window_views(self.window, N)
        self.x_prior, self.x, self.u, self.y, self.use, self.theta, self.air = views
        self.x[:] = self.x_prior[:] = x0
        self.theta[:] = theta0
        for air in self.air:
            air_outside(theta0[5], 0.0, air)
        self.status = SOLVED

    def solve(self) -> tuple[int, float]:
        """Improve the present horizon without a new sample; (status, size of the last step)."""
        t = self.tuning
        return mhe_solve(
            t.model, t.t_s, self.table, self.confine, 0.0 if t.converged else t.kappa,
            t.n_kappa, t.n_qp, t.sqp_iterations, t.N, self.window, self.work,
        )  # fmt: skip

    def step(self, y: Array, use: Array, theta: Array, warmer_k: float = 0.0) -> Array:
        """Take one sample and return the newest state, shape (4,).

        Parameters
        ----------
        y : (4,) float64 [m/s, m/s, rad, m/s]
            V_g, V_z (down), alpha, V_c.
        use : (4,) float64
            1 for a measurement that counts, else 0.
        theta : (6,) float64
        warmer_k : float
            Measured minus standard temperature [K].
        """
        t = self.tuning
        self.sample[:4] = y
        self.sample[4:8] = use
        self.sample[8:] = theta
        self.status = mhe_step(
            t.model, t.t_s, self.table, self.confine, 0.0 if t.converged else t.kappa,
            t.n_kappa, t.n_qp, t.sqp_iterations, t.N, self.window, self.sample, warmer_k, self.work,
        )  # fmt: skip
        newest: Array = self.x[-1].copy()
        return newest

    def run(self, samples: Array, warmer_k: float = 0.0) -> Array:
        """Take (T, 14) samples, each y (4), use (4) and theta (6); the newest states, (T, 4).

        The same as :meth:`step` for each row; ``status`` is then the worst of them.
        """
        t = self.tuning
        states = np.empty((len(samples), NX))
        self.status = mhe_run(
            t.model, t.t_s, self.table, self.confine, 0.0 if t.converged else t.kappa,
            t.n_kappa, t.n_qp, t.sqp_iterations, t.N, self.window,
            np.ascontiguousarray(samples), warmer_k, self.work, states,
        )  # fmt: skip
        return states
