"""Confidence bounds of shares and rates from a few trials, exact and one-sided."""

from __future__ import annotations

from collections.abc import Callable
from math import comb, exp

__all__ = ["CONFIDENCE", "rate_upper", "share_lower"]

CONFIDENCE = 0.95
"""Of every bound."""

_STEPS = 60


def share_lower(found: int, trials: int) -> float:
    """Smallest true share that leaves 5 % for as many successes or more (Clopper-Pearson).

    ``share_lower(20, 20)`` is 0.861 and ``share_lower(19, 20)`` is 0.784: twenty trials alone do
    not prove 95 %, which takes 59 of 59.
    """
    if found <= 0:
        return 0.0

    def tail(share: float) -> float:
        return sum(
            comb(trials, k) * share**k * (1.0 - share) ** (trials - k)
            for k in range(found, trials + 1)
        )

    return _root(tail, 0.0, 1.0)


def rate_upper(events: int, hours: float) -> float:
    """Largest true rate per hour that leaves 5 % for as few events (Poisson): 3 / hours for none.

    Without any time there is no bound: infinity.
    """
    if hours <= 0.0:
        return float("inf")

    def head(mean: float) -> float:
        term = total = exp(-mean)
        for k in range(1, events + 1):
            term *= mean / k
            total += term
        return -total

    return _root(head, 0.0, 5.0 * (events + 3.0), -(1.0 - CONFIDENCE)) / hours


def _root(
    rising: Callable[[float], float], low: float, high: float, level: float = 1.0 - CONFIDENCE
) -> float:
    """Where a rising function crosses ``level``."""
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if rising(middle) < level:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
