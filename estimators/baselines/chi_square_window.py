"""Fault detection by a chi-square test on a window of innovations, as wang2020 compares with.

Each channel keeps the normalised squares ``d = e^2 / s`` of its last fault-free innovations. A new
one is fault-free when the sum of the window with it is believable as chi-square at `alpha`; else
the channel is left out at this sample and the window stays. The Kalman filter corrects with the
channels that pass.

The paper gives the window (100), alpha (0.05) and the idea, no equations; this is the reading that
fits its remark that "a temporary error is not significant enough to trigger" the test: with 99
quiet innovations in the window a new one may reach about five standard deviations.

===========  ================================================  ==========
symbol       meaning                                           shape
===========  ================================================  ==========
x, P         estimate and covariance                           (n,) (n, n)
e, s         innovation of a channel and its variance          (m,)
d            e^2 / s, chi-square with one degree               (m,)
===========  ================================================  ==========

Source: wang2020 section IV-C, method 2.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from estimators.imkf import LinearModel

__all__ = ["ChiSquareWindowFilter", "chi_square_limits"]

Array = NDArray[np.float64]


def chi_square_limits(degrees: int, alpha: float) -> Array:
    """Values that chi-square with 1, 2 ... `degrees` degrees exceeds with probability `alpha`.

    Raises
    ------
    ImportError
        When scipy is not installed (extra ``compare``).
    """
    from scipy.special import chdtri

    return np.asarray(chdtri(np.arange(1, degrees + 1), alpha), dtype=np.float64)


class ChiSquareWindowFilter:
    """Kalman filter that leaves out channels whose window of innovations is no longer believable.

    Parameters
    ----------
    model
        The system.
    x, P : (n,), (n, n) float64
        Initial estimate and covariance.
    window
        Innovations in the test, the new one included.
    alpha
        Probability of leaving out a good channel.
    """

    def __init__(
        self, model: LinearModel, x: Array, P: Array, window: int = 100, alpha: float = 0.05
    ) -> None:
        self.model = model
        self.x, self.P = np.array(x, dtype=np.float64), np.array(P, dtype=np.float64)
        self.limits = chi_square_limits(window, alpha)
        self.windows: list[deque[float]] = [deque(maxlen=window - 1) for _ in model.C]
        self.works = np.ones(len(model.C), dtype=bool)

    def step(self, u: Array, y: Array) -> None:
        """Advance by one sample; ``works`` says which channels were believed."""
        t = self.model
        x = t.A @ self.x + t.B @ u
        P = t.A @ self.P @ t.A.T + t.Q
        e = y - t.C @ x
        S = t.C @ P @ t.C.T + np.diag(t.r)
        d = e**2 / np.diag(S)
        for i, past in enumerate(self.windows):
            self.works[i] = sum(past) + d[i] <= self.limits[len(past)]
            if self.works[i]:
                past.append(float(d[i]))
        on = np.flatnonzero(self.works)
        C = t.C[on]
        K = np.linalg.solve(S[np.ix_(on, on)], C @ P).T
        self.x = x + K @ e[on]
        P = P - K @ C @ P
        self.P = 0.5 * (P + P.T)
