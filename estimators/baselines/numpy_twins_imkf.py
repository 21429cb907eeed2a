"""Numpy twins of the intermittent-measurement filter, in two forms of the same equations.

``LoopTwin`` is Algorithm 1 of wang2020 line by line, one hypothesis after the other, with the
information form (7) (8). ``BatchedTwin`` takes all hypotheses in one go of numpy, and corrects with
the classic Kalman gain on the channels that work: what the paper's section IV-C calls "classic KF
correction". The tests hold the compiled filter against both, ``mavsentry bench`` measures what the
kernels gain, and ``mavsentry reproduce wang2020`` shows that the two corrections are one.

Symbols as in :mod:`estimators.imkf`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from estimators.imkf import LinearModel, Settings

__all__ = ["BatchedTwin", "LoopTwin"]

Array = NDArray[np.float64]


class _Twin(ABC):
    """Prediction, prior, threshold and health: what the two forms have in common."""

    def __init__(self, model: LinearModel, settings: Settings, x: Array, P: Array) -> None:
        self.model, self.settings = model, settings
        self.x, self.P = np.array(x, dtype=np.float64), np.array(P, dtype=np.float64)
        self.h = np.array(settings.fault_free, dtype=np.float64)
        m = len(model.C)
        self.density = 1.0 / np.asarray(settings.ranges or (1.0,) * m, dtype=np.float64)
        first = 0 if settings.all_faulty else 1
        numbers = np.arange(first, 2**m)
        self.Gamma = (numbers[:, None] >> np.arange(m - 1, -1, -1)) & 1
        """Hypotheses, (5) (6)."""
        self.xi = np.zeros(len(numbers))
        self.w = np.zeros(m)
        self.rejected = False

    def step(self, u: Array, y: Array) -> None:
        """Advance by one sample, Algorithm 1."""
        t, s = self.model, self.settings
        xm = t.A @ self.x + t.B @ u
        Pm = t.A @ self.P @ t.A.T + t.Q
        works = self.h
        if s.memory_s is not None:
            works = np.clip(works, s.health_floor, s.health_ceiling)
        self.xi, xj, Pj = self._hypotheses(xm, Pm, y, works)
        x = self.xi @ xj
        self.rejected = math.dist(x, self.x) > s.variation_limit
        if not self.rejected:
            apart = xj - x
            T1 = np.tensordot(self.xi, Pj, 1)
            T2 = (self.xi[:, None] * apart).T @ apart
            self.x, self.P = x, T1 + T2
            # rounding errors in P - P' grow exponentially in P - K C P
            self.P = 0.5 * (self.P + self.P.T)
        elif s.on_rejection == "predict":
            self.x, self.P = xm, Pm
        self.w = self.xi @ self.Gamma
        if s.memory_s is not None:
            seen = np.isfinite(y)
            self.h[seen] += ((self.w - self.h) * t.dt_s / s.memory_s)[seen]

    @abstractmethod
    def _hypotheses(
        self, xm: Array, Pm: Array, y: Array, works: Array
    ) -> tuple[Array, Array, Array]:
        """xi, x and P under every hypothesis."""


class LoopTwin(_Twin):
    """The printed algorithm; every hypothesis has its turn in Python."""

    def _hypotheses(
        self, xm: Array, Pm: Array, y: Array, works: Array
    ) -> tuple[Array, Array, Array]:
        C, r = self.model.C, self.model.r
        seen = np.isfinite(y)
        information = np.linalg.inv(Pm)
        ln = np.empty(len(self.Gamma))
        xj = np.empty((len(self.Gamma), len(xm)))
        Pj = np.empty((len(self.Gamma), len(xm), len(xm)))
        for j, gamma in enumerate(self.Gamma):
            used = np.flatnonzero(gamma & seen)
            broken = np.flatnonzero(~gamma.astype(bool) & seen)
            # (7): C_j, R_j with zero rows where faulty, M_j the information of the others
            Mj = sum((np.outer(C[i], C[i]) / r[i] for i in used), np.zeros_like(Pm))
            # (8)
            Pj[j] = np.linalg.inv(information + Mj)
            K = Pj[j] @ C[used].T @ np.diag(1.0 / r[used])
            e = y[used] - C[used] @ xm
            xj[j] = xm + K @ e
            # (9)-(13)
            S = C[used] @ Pm @ C[used].T + np.diag(r[used])
            quadratic = e @ np.linalg.solve(S, e)
            ln_S = math.log(np.linalg.det(S)) if len(used) else 0.0
            prior = np.prod(np.where(gamma == 1, works, 1.0 - works))
            fault = np.prod(self.density[broken])
            ln[j] = math.log(prior * fault) if prior > 0.0 else -math.inf
            ln[j] -= 0.5 * (len(used) * math.log(2.0 * math.pi) + ln_S + quadratic)
        # (14)
        xi = np.exp(ln - ln.max())
        return xi / xi.sum(), xj, Pj


class BatchedTwin(_Twin):
    """All hypotheses at once; the classic gain on the channels that work."""

    def _hypotheses(
        self, xm: Array, Pm: Array, y: Array, works: Array
    ) -> tuple[Array, Array, Array]:
        C, r = self.model.C, self.model.r
        seen = np.isfinite(y)
        on = self.Gamma * seen
        e = np.where(seen, y - C @ xm, 0.0) * on
        PC = Pm @ C.T
        # S with an identity row and column where the channel is out of the game
        S = (C @ PC) * on[:, :, None] * on[:, None, :]
        diagonal = np.arange(len(C))
        S[:, diagonal, diagonal] += np.where(on == 1, r, 1.0)
        inverse = np.linalg.inv(S)
        K = (PC * on[:, None, :]) @ inverse
        xj = xm + (K @ e[:, :, None])[:, :, 0]
        Pj = Pm - K @ PC.T
        quadratic = np.einsum("ji,jik,jk->j", e, inverse, e)
        ln_S = np.log(np.linalg.det(S))
        with np.errstate(divide="ignore"):
            ln_works, ln_fails = np.log(works), np.log(1.0 - works)
        ln_fails = ln_fails + np.where(seen, np.log(self.density), 0.0)
        prior = np.where(self.Gamma == 1, ln_works, ln_fails).sum(axis=1)
        ln = prior - 0.5 * (on.sum(axis=1) * math.log(2.0 * math.pi) + ln_S + quadratic)
        xi = np.exp(ln - ln.max())
        return xi / xi.sum(), xj, Pj
