"""Tables of the air-data tests: how near pitots and vanes came to a verdict, what they should show.

The filter bank speaks for pitots and, beside it, another estimator for the vanes. Both stand in one
row, at the times of the bank's rows.
"""

from __future__ import annotations

from math import nan

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from monitor.verdict import AIR_EXPECTED, AIR_TESTS

__all__ = ["EXPECTED", "TESTS", "VaneTests", "bank_tests", "vote_tests"]

Array = NDArray[np.float64]

TESTS, EXPECTED = "air_tests", "air_expected"
_PITOTS = [f"airspeed{i}" for i in range(3)]
_VANES = [f"aoa{i}" for i in range(3)]
_EPOCH = -1
"""Column of the bank's rows: time of the newest epoch, for what comes with an epoch later."""


def _tables(t_us: NDArray[np.int64], pitots: Array, vanes: Array) -> dict[str, Rows]:
    """Rows of both tables where there is something to say.

    Parameters
    ----------
    t_us : (n,) int64
    pitots, vanes : (n, 9) float64
        Of three sensors each the ratio, what it should show, and the deviation of that.
    """
    tests, expected = np.zeros(len(t_us), AIR_TESTS), np.zeros(len(t_us), AIR_EXPECTED)
    tests["t_us"] = expected["t_us"] = t_us
    for sensors, unit, columns in ((_PITOTS, "m_s", pitots), (_VANES, "rad", vanes)):
        for i, sensor in enumerate(sensors):
            tests[f"{sensor}_ratio"] = columns[:, i]
            expected[f"{sensor}_{unit}"] = columns[:, 3 + i]
            expected[f"{sensor}_std_{unit}"] = columns[:, 6 + i]
    both = np.column_stack((pitots, vanes))
    tested = np.isfinite(both[:, [0, 1, 2, 9, 10, 11]]).any(axis=1)
    told = np.isfinite(both[:, [3, 4, 5, 12, 13, 14]]).any(axis=1)
    out = {TESTS: tests[tested], EXPECTED: expected[told]}
    return {name: rows for name, rows in out.items() if len(rows)}


def _t_us(t_s: Array, epoch_us: int) -> NDArray[np.int64]:
    return epoch_us + np.round(t_s * 1e6).astype(np.int64)


def bank_tests(rows: Array, epoch_us: int, vanes: Array | None = None) -> dict[str, Rows]:
    """Tables of the bank's rows (:mod:`estimators.air_tests`), with what VaneTests has beside."""
    vanes = np.full((len(rows), 9), nan) if vanes is None else vanes
    return _tables(_t_us(rows[:, 0], epoch_us), rows[:, 1:_EPOCH], vanes)


def vote_tests(rows: Array, epoch_us: int) -> dict[str, Rows]:
    """Tables of the votes' rows (:mod:`estimators.air_vote_tests`)."""
    by_kind = rows[:, 1:].reshape(len(rows), 3, 2, 3)  # ratio, expected, deviation; vanes, pitots
    vanes, pitots = (by_kind[:, :, kind].reshape(len(rows), 9) for kind in range(2))
    return _tables(_t_us(rows[:, 0], epoch_us), pitots, vanes)


class VaneTests:
    """Gathers what the vanes' estimator says until the bank's next row.

    It says something with every estimate of the bank. A row takes what belongs to epochs that were
    known when it was written, so that where the stream is cut changes nothing.
    """

    def __init__(self) -> None:
        self._t_us = np.zeros(0, np.int64)
        self._rows = np.zeros((0, 9))

    def __len__(self) -> int:
        """Rows that wait."""
        return len(self._t_us)

    def add(self, rows: Array, epoch_us: int) -> None:
        """Take rows of :func:`estimators.air_vane.run`."""
        self._t_us = np.concatenate((self._t_us, _t_us(rows[:, 0], epoch_us)))
        self._rows = np.concatenate((self._rows, rows[:, 1:]))

    def take(self, bank: Array, epoch_us: int) -> Array:
        """Vanes' columns (n, 9) beside rows of the bank: largest ratios, newest expectations."""
        out = np.full((len(bank), 9), nan)
        known_us = _t_us(np.maximum(bank[:, _EPOCH], -1.0), epoch_us)
        until = np.searchsorted(self._t_us, known_us, side="right")
        since = np.concatenate(([0], until))[:-1]
        some = np.flatnonzero(until > since)
        if len(some):
            last = int(until[some[-1]])
            out[some, :3] = np.fmax.reduceat(self._rows[:last, :3], since[some], axis=0)
            out[some, 3:] = self._rows[until[some] - 1, 3:]
            self._t_us, self._rows = self._t_us[last:], self._rows[last:]
        return out
