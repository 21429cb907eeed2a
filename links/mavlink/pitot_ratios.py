"""ARSPD_RATIO of each pitot, from the PARAM_VALUE that tells it on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows

__all__ = ["HIGH", "LOW", "PITOT", "PitotRatios"]

PITOT = {b"ARSPD_RATIO": 0, b"ARSPD2_RATIO": 1, b"ARSPD3_RATIO": 2}
LOW, HIGH = 0.1, 20.0  # outside, the parameter was never set or is damaged


class PitotRatios:
    """Steps of the ratios within a block of frames, and what holds after it.

    Parameters
    ----------
    default
        Ratio of a pitot whose parameter was not heard yet.
    """

    def __init__(self, default: float) -> None:
        self._default = default
        self._steps: dict[int, list[tuple[int, float]]] = {}  # pitot -> (frame, ratio) ascending

    def begin_block(self) -> None:
        """Frames are counted from 0 again: what held at the end of the last block holds."""
        for steps in self._steps.values():
            steps[:] = [(-1, steps[-1][1])]

    def note(self, frame: NDArray[np.int64], payload: Rows) -> None:
        """Take the PARAM_VALUE payloads of a block, each with the index of its frame."""
        names, values = payload["param_id"].tolist(), payload["param_value"].tolist()
        for at, name, value in zip(frame.tolist(), names, values, strict=True):
            pitot = PITOT.get(name)
            if pitot is not None and LOW < value < HIGH:
                self._steps.setdefault(pitot, [(-1, self._default)]).append((at, value))

    def at(self, pitot: int, frame: NDArray[np.int64]) -> NDArray[np.float64]:
        """Ratio in force at each frame (ascending): (n,) float64."""
        steps = self._steps.get(pitot, [(-1, self._default)])
        since = np.array([f for f, _ in steps])
        ratio = np.array([r for _, r in steps])
        return np.asarray(ratio[np.searchsorted(since, frame, side="right") - 1], np.float64)
