"""Robust adaptive Kalman filter of Hajiyev and Soken (2013), with its adaptation of R.

An instantaneous chi-square test of the whole innovation detects a fault; while it lasts, the noise
of each channel is multiplied by how much larger its innovations have been than the model expects,
averaged over a window.

===========  ================================================  ============  ====================
symbol       meaning                                           shape         equation
===========  ================================================  ============  ====================
x, P         estimate and covariance                           (n,) (n, n)
e            innovation y - C x                                (m,)
beta         e' (C P C' + R)^-1 e, chi-square with m degrees   ()            test of the fault
S            (mean of e e' - C P C') R^-1 over the window      (m, m)        matching
s*           max(1, S_ii): factors of the channels' variances  (m,)          adaptation
===========  ================================================  ============  ====================

Source: C. Hajiyev, H. E. Soken, docs/references ``hajiyev2013``, as wang2020 section IV-C uses it
(method 3): window 200, alpha 0.01. wang2020 prints no equations of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.chi_square_window import chi_square_limits
from estimators.imkf import LinearModel

__all__ = ["RobustAdaptiveFilter"]

Array = NDArray[np.float64]


class RobustAdaptiveFilter:
    """Kalman filter that doubts its channels in proportion to their past innovations.

    Parameters
    ----------
    model
        The system.
    x, P : (n,), (n, n) float64
        Initial estimate and covariance.
    window
        Innovations over which the covariance is matched.
    alpha
        Probability of detecting a fault where there is none.
    """

    def __init__(
        self, model: LinearModel, x: Array, P: Array, window: int = 200, alpha: float = 0.01
    ) -> None:
        self.model = model
        self.x, self.P = np.array(x, dtype=np.float64), np.array(P, dtype=np.float64)
        m = len(model.C)
        self.limit = float(chi_square_limits(m, alpha)[-1])
        self.squares = np.zeros((window, m))
        self.samples = 0
        self.factor = np.ones(m)
        self.detected = False

    def step(self, u: Array, y: Array) -> None:
        """Advance by one sample; ``factor`` has the channels' factors."""
        t = self.model
        x = t.A @ self.x + t.B @ u
        P = t.A @ self.P @ t.A.T + t.Q
        e = y - t.C @ x
        expected = t.C @ P @ t.C.T
        # only the diagonal of e e' is used
        self.squares[self.samples % len(self.squares)] = e**2
        self.samples += 1
        beta = e @ np.linalg.solve(expected + np.diag(t.r), e)
        self.detected = bool(beta > self.limit)
        self.factor = np.ones(len(y))
        if self.detected:
            mean = self.squares[: self.samples].mean(axis=0)
            self.factor = np.maximum((mean - np.diag(expected)) / t.r, 1.0)
        S = expected + np.diag(t.r * self.factor)
        K = np.linalg.solve(S, t.C @ P).T
        self.x = x + K @ e
        P = P - K @ t.C @ P
        self.P = 0.5 * (P + P.T)
