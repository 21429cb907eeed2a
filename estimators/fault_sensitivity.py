"""How a residual answers to a sensor fault: wan2018 section IV, with and without active bounds.

=============  =======================================================  ==============  ==========
symbol         meaning                                                  shape           wan2018
=============  =======================================================  ==============  ==========
z              [x_l, u_l, x_{l+1}, ..., u_{k-1}, x_k]                   (n_z,)          (24)
I              data [x_l^-, 0, y_l, 0, ..., y_k] in the order of F_1    (n_I,)          (25)
V              diag(P, Q, R, Q, R, ..., R)                              (n_I,)          (26)
J_1, J_2, J_a  Jacobians of F_1, of the dynamics, of active bounds      (..., n_z)      (30), (37)
H              J_1' V^-1 J_1                                            (n_z, n_z)      (31)
X              its inverse on the null space of J_2 (and J_a)           (n_z, n_z)      (33), (40)
G              derivative of the prediction y_{k+1|k} by z              (4, n_z)        Phi J_1
K              derivative of the prediction by the data, G X J_1' V^-1  (4, n_I)        (36)
S              sensitivity of the residual, [-K, 1]                     (4, n_I + 4)    (36), (39)
=============  =======================================================  ==============  ==========

**Theorem 1** says S_a S_a' >= S S' when bounds become active. It does not hold: S S' = 1 + K K',
and a bound takes freedom from the estimate, so that K shrinks. In the metric of V the contrary is
certain: S diag(V, 1) S' = 1 + G X G', and X_a <= X. (The appendix concludes from
V - J_1 X_a J_1' >= V - J_1 X J_1' to the products S S', which does not follow: the matrices stand
between factors.) What an active bound does raise is the answer to a fault that *lasts*:
1 - sum_i K_i over the window's samples, the share of a constant fault that the residual shows. An
estimate that is free follows the fault and hides it; one that is held cannot.

Differs: (22) prints H with V for V^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import air_outside, linearise
from estimators.air_data_mhe import ROW_P, ROW_Q, ROW_R, ROW_UL, ROW_UU, ROW_XL, ROW_XU, AirDataMHE

__all__ = ["ActiveBounds", "LinearWindow", "active_bounds", "linear_window"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

N_STAGE = 8
"""Entries of z for one stage: x_i and u_i."""


@dataclass(frozen=True)
class ActiveBounds:
    """Which bounds hold with equality: (N, 4) for x and (N-1, 4) for u."""

    x: Flags
    u: Flags

    @property
    def count(self) -> int:
        """Number of active bounds."""
        return int(self.x.sum() + self.u.sum())

    def first(self, n: int) -> ActiveBounds:
        """The ``n`` newest of them: states from the newest stage back, then inputs."""
        x, u = np.zeros_like(self.x), np.zeros_like(self.u)
        places = [(x, i, a) for i, a in np.argwhere(self.x)[::-1]]
        places += [(u, i, a) for i, a in np.argwhere(self.u)[::-1]]
        for array, i, a in places[:n]:
            array[i, a] = True
        return ActiveBounds(x, u)


def active_bounds(estimator: AirDataMHE, tolerance: float = 1e-6) -> ActiveBounds:
    """Bounds that the present (converged) estimate touches within ``tolerance`` [SI]."""
    table = estimator.table

    def touching(v: Array, low: Array, high: Array) -> Flags:
        gap = np.minimum(v - low, high - v)
        return np.asarray(np.isfinite(gap) & (gap < tolerance))

    return ActiveBounds(
        touching(estimator.x, table[ROW_XL], table[ROW_XU]),
        touching(estimator.u, table[ROW_UL], table[ROW_UU]),
    )


@dataclass(frozen=True)
class LinearWindow:
    """A window linearised at its estimate.

    Attributes
    ----------
    N
        Samples.
    V : (n_I,) float64
        Variances of the data.
    J_1 : (n_I, n_z) float64
    J_2 : (4 (N - 1), n_z) float64
    G : (4, n_z) float64
    """

    N: int
    V: Array
    J_1: Array
    J_2: Array
    G: Array

    def X(self, active: ActiveBounds | None = None) -> Array:
        """Covariance of the estimate, (33), or with bounds that hold, (40).

        Differs: by a basis of the null space, scaled by the standard deviations, in place of the
        inverses of (33): H is singular where a measurement is not used.
        """
        J = self.J_2
        if active is not None and active.count:
            J = np.vstack([J, self._J_a(active)])
        scale = 1.0 / np.sqrt(np.maximum((self.J_1**2 / self.V[:, None]).sum(axis=0), 1e-30))
        _, s, vt = np.linalg.svd(J * scale)
        rank = int((s > 1e-12 * s[0]).sum())
        basis = scale[:, None] * vt[rank:].T
        root = self.J_1 @ basis / np.sqrt(self.V)[:, None]
        inverse: Array = basis @ np.linalg.solve(root.T @ root, basis.T)
        return inverse

    def K(self, active: ActiveBounds | None = None) -> Array:
        """Derivative of the predicted outputs by the data, (4, n_I)."""
        gain: Array = self.G @ self.X(active) @ self.J_1.T / self.V
        return gain

    def S(self, active: ActiveBounds | None = None) -> Array:
        """Sensitivity of the residual to the data and to the newest sensors, (36) or (39)."""
        return np.hstack([-self.K(active), np.eye(4)])

    def lasting_gain(self, output: int, active: ActiveBounds | None = None) -> float:
        """Share of a constant fault of one output, in all samples, that its residual shows."""
        return 1.0 - float(self.K(active)[output, self.columns(output)].sum())

    def lasting_gain_after(
        self, output: int, samples: int, active: ActiveBounds | None = None
    ) -> float:
        """The same when the arrival mean has followed the fault for a number of samples.

        The window is shifted over its own linearisation: x_{l|k}^- is the smoothed x_{l|k-1}.
        """
        z_by_data = self.X(active) @ self.J_1.T / self.V
        fault = z_by_data[:, self.columns(output)].sum(axis=1)
        by_prior = z_by_data[:, :4]
        z = fault
        for _ in range(samples):
            z = fault + by_prior @ z[N_STAGE : N_STAGE + 4]
        return 1.0 - float(self.G[output] @ z)

    def sensor_columns(self) -> list[int]:
        """Columns of S that belong to sensors: those of the data, and of the newest sample."""
        n_I = len(self.V)
        columns = sorted(c for output in range(4) for c in self.columns(output))
        return [*columns, *range(n_I, n_I + 4)]

    def columns(self, output: int) -> list[int]:
        """Where the output of each sample stands in the data."""
        newest = 4 + N_STAGE * (self.N - 1) + output
        return [*range(N_STAGE + output, newest, N_STAGE), newest]

    def _J_a(self, active: ActiveBounds) -> Array:
        rows = []
        for offset, flags in ((0, active.x), (4, active.u)):
            for i, a in np.argwhere(flags):
                row = np.zeros(self.J_1.shape[1])
                row[N_STAGE * i + offset + a] = 1.0
                rows.append(row)
        return np.array(rows)


def linear_window(estimator: AirDataMHE, theta_next: Array) -> LinearWindow:
    """Linearise the estimator's window, and the prediction of the sample that follows it.

    Parameters
    ----------
    estimator
        After a step in the converged mode.
    theta_next : (6,) float64
        Measured parameters of the next sample.

    Source: wan2018 (24)-(26), (29)-(31), (34)-(35).
    """
    t, table, N = estimator.tuning, estimator.table, estimator.tuning.N
    P, Q, R = table[ROW_P], table[ROW_Q], table[ROW_R]
    n_z = N_STAGE * N - 4
    V = [P]
    J_1, J_2 = [np.eye(4, n_z)], []
    F, h, jacobians = np.empty(4), np.empty(4), np.empty((3, 4, 4))
    A, B, C = jacobians
    for i in range(N):
        u = estimator.u[min(i, N - 2)] if i < N - 1 else np.zeros(4)
        linearise(
            t.model, estimator.x[i], u, estimator.theta[i], estimator.air[i], t.t_s, F, A, B, h, C
        )
        at = N_STAGE * i
        x_part = slice(at, at + 4)
        if i < N - 1:
            u_part, next_part = slice(at + 4, at + 8), slice(at + 8, at + 12)
            J_1.append(np.eye(4, n_z, k=at + 4))
            V.append(Q)
            J = np.zeros((4, n_z))
            J[:, next_part], J[:, x_part], J[:, u_part] = np.eye(4), -A, -B
            J_2.append(J)
        outputs = np.zeros((4, n_z))
        outputs[:, x_part] = C * (estimator.use[i] != 0.0)[:, None]
        J_1.append(outputs)
        V.append(R)
    A_newest, x_next, air = A.copy(), F.copy(), np.empty(2)
    air_outside(theta_next[5], 0.0, air)
    linearise(t.model, x_next, np.zeros(4), theta_next, air, t.t_s, F, A, B, h, C)
    G = np.zeros((4, n_z))
    G[:, n_z - 4 :] = C @ A_newest
    return LinearWindow(N, np.concatenate(V), np.vstack(J_1), np.vstack(J_2), G)
