"""A Kalman filter for every fault condition, side by side: multiple-model estimation of wang2020.

The paper calls its "classic KF correction" an extended multiple-model adaptive estimation, and in
Magill's scheme the filters of a bank never exchange estimates. Here filter j believes for good that
exactly the channels of gamma_j work; at each sample the filters' estimates are weighed with (14) by
their own innovations. It shares everything with :class:`estimators.imkf.IntermittentFilter` but the
return of the merged estimate into the next prediction.

===========  ================================================  ===============
symbol       meaning                                           shape
===========  ================================================  ===============
xj, Pj       estimate and covariance of filter j               (L, n) (L, n, n)
Gamma        which channels filter j believes, L = 2^m - 1     (L, m)
xi           weights, (14)                                     (L,)
x            their weighted mean, (15)                         (n,)
===========  ================================================  ===============

Source: wang2020 section IV-C, method 1, and its references [6]-[10].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.imkf import LinearModel

__all__ = ["FaultConditionBank"]

Array = NDArray[np.float64]


class FaultConditionBank:
    """State from a bank of Kalman filters that are merged in the output only.

    Parameters
    ----------
    model
        The system.
    fault_free : (m,) float64
        lambda, prior probability that a channel works.
    x, P : (n,), (n, n) float64
        Initial estimate and covariance of every filter.
    """

    def __init__(self, model: LinearModel, fault_free: Array, x: Array, P: Array) -> None:
        self.model = model
        m = len(model.C)
        numbers = np.arange(1, 2**m)
        self.Gamma = (numbers[:, None] >> np.arange(m - 1, -1, -1)) & 1
        prior = np.where(self.Gamma == 1, fault_free, 1.0 - np.asarray(fault_free)).prod(axis=1)
        with np.errstate(divide="ignore"):
            self.ln_prior = np.log(prior)
        self.ln_prior -= 0.5 * np.log(2.0 * np.pi) * self.Gamma.sum(axis=1)
        self.xj = np.tile(np.asarray(x, dtype=np.float64), (len(numbers), 1))
        self.Pj = np.tile(np.asarray(P, dtype=np.float64), (len(numbers), 1, 1))
        self.x, self.P = np.array(x, dtype=np.float64), np.array(P, dtype=np.float64)
        self.w = np.zeros(m)

    def step(self, u: Array, y: Array) -> None:
        """Advance every filter by one sample and merge what they say."""
        t, on = self.model, self.Gamma
        x = self.xj @ t.A.T + t.B @ u
        P = t.A @ self.Pj @ t.A.T + t.Q
        PC = P @ t.C.T
        # S with an identity row and column where the filter does not believe the channel
        S = (t.C @ PC) * on[:, :, None] * on[:, None, :]
        channels = np.arange(len(t.C))
        S[:, channels, channels] += np.where(on == 1, t.r, 1.0)
        inverse = np.linalg.inv(S)
        K = (PC * on[:, None, :]) @ inverse
        e = (y - x @ t.C.T) * on
        self.xj = x + (K @ e[:, :, None])[:, :, 0]
        P = P - K @ PC.transpose(0, 2, 1)
        self.Pj = 0.5 * (P + P.transpose(0, 2, 1))
        quadratic = np.einsum("ji,jik,jk->j", e, inverse, e)
        ln = self.ln_prior - 0.5 * (np.log(np.linalg.det(S)) + quadratic)
        xi = np.exp(ln - ln.max())
        xi /= xi.sum()
        self.x = xi @ self.xj
        apart = self.xj - self.x
        self.P = np.tensordot(xi, self.Pj, 1) + (xi[:, None] * apart).T @ apart
        self.w = xi @ on
