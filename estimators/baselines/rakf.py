"""Robust adaptive Kalman filter of Hajiyev and Soken (2013), with its adaptation of R.

An instantaneous chi-square test of the innovation detects a fault; while it lasts, the noise of
each channel is multiplied by how much larger its innovations have been than the model expects,
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

The source has a factor for each channel and one for all (the ratio of the traces). wang2020 does
not say which, nor whether the test is of the whole innovation or of each channel; on failing
channels the readings are worlds apart, so all three stand here.

Source: C. Hajiyev, H. E. Soken, docs/references ``hajiyev2013``, as wang2020 section IV-C uses it
(method 3): window 200, alpha 0.01. wang2020 prints no equations of it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.chi_square_window import chi_square_limits
from estimators.imkf import LinearModel

__all__ = ["Reading", "RobustAdaptiveFilter"]

Array = NDArray[np.float64]


Reading = Literal["multiple", "single", "channel"]


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
    reading
        "multiple": a factor for each channel, one test of the whole innovation; "single": one
        factor for all, same test; "channel": each channel tested and adapted on its own.
    """

    def __init__(
        self,
        model: LinearModel,
        x: Array,
        P: Array,
        window: int = 200,
        alpha: float = 0.01,
        reading: Reading = "multiple",
    ) -> None:
        self.model, self.reading = model, reading
        self.x, self.P = np.array(x, dtype=np.float64), np.array(P, dtype=np.float64)
        m = len(model.C)
        limits = chi_square_limits(m, alpha)
        self.limit = float(limits[0 if reading == "channel" else -1])
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
        detected = self._test(e, expected)
        self.detected = bool(detected.any())
        self.factor = np.ones(len(y))
        if self.detected:
            mean, own = self.squares[: self.samples].mean(axis=0), np.diag(expected)
            factor = (mean - own) / t.r
            if self.reading == "single":
                factor = np.full(len(y), (mean.sum() - own.sum()) / t.r.sum())
            self.factor[detected] = np.maximum(factor, 1.0)[detected]
        S = expected + np.diag(t.r * self.factor)
        K = np.linalg.solve(S, t.C @ P).T
        self.x = x + K @ e
        P = P - K @ t.C @ P
        self.P = 0.5 * (P + P.T)

    def _test(self, e: Array, expected: Array) -> NDArray[np.bool_]:
        """Which channels' noise is to be adapted."""
        r = self.model.r
        if self.reading == "channel":
            alone: NDArray[np.bool_] = e**2 / (np.diag(expected) + r) > self.limit
            return alone
        beta = e @ np.linalg.solve(expected + np.diag(r), e)
        return np.full(len(e), beta > self.limit)
