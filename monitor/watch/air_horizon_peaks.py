"""How near to its margins the long horizon came on a flight: what thresholds are learnt from."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS
from estimators.air_data_3d_bank import N_HYPOTHESES, WIND_CHANGED, evidence, parsimony
from estimators.air_horizon import (
    H_STAGES,
    NOTHING,
    SCALE_H,
    WIND_WALKED,
    HorizonLevels,
    LongHorizon,
)

__all__ = ["HorizonPeaks"]


class HorizonPeaks:
    """Largest evidence against one pitot, and against all, that held for two solves running.

    As in :func:`estimators.air_horizon_judge.weigh`, evidence counts where every pitot of the
    explanation has moved by ``min_shift`` and no simpler explanation does as well.
    """

    def __init__(self) -> None:
        self._last = (math.nan, math.nan)
        self._peak = [math.nan, math.nan]

    def note(self, z: LongHorizon, levels: HorizonLevels, active: int) -> None:
        """Use one set of solved explanations; ``active`` is the mask of judged pitots."""
        now = self._evidence(z, levels, active)
        for k in range(2):
            held = min(now[k], self._last[k])
            self._peak[k] = held if math.isnan(self._peak[k]) else max(held, self._peak[k])
        self._last = now

    def peaks(self) -> dict[str, float]:
        """By settings key; empty before the horizon was ever solved."""
        keys = ("air.horizon.margin_one", "air.horizon.margin_all")
        return {k: p for k, p in zip(keys, self._peak, strict=True) if not math.isnan(p)}

    def _evidence(self, z: LongHorizon, levels: HorizonLevels, active: int) -> tuple[float, float]:
        top: NDArray[np.float64] = z.L[:N_HYPOTHESES] - z.L[NOTHING]
        top[WIND_CHANGED] = z.L[WIND_WALKED:].max() - z.L[NOTHING]
        n = int(z.memory[H_STAGES])
        moved = np.abs(z.x[:, n - 1, SCALE_H] - z.x[:, 0, SCALE_H])
        one, every = 0.0, 0.0
        for h in range(1, N_HYPOTHESES):
            if top[h] == -np.inf or parsimony(top, h) > 0.5 * levels.margin_one:
                continue
            if all(moved[h, i] > levels.min_shift for i in range(N_PITOTS) if h >> i & 1):
                if h == active:
                    every = max(every, float(evidence(top, h)))
                else:
                    one = max(one, float(evidence(top, h)))
        return one, every
