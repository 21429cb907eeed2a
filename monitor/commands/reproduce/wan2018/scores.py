"""What one run of wan2018 VI-B is worth: which faults could be seen, which were, how soon.

A fault can be *seen* when a perfect observer with the paper's own rule would find it: an observer
who knows the true air data (but not the true wind) and confirms as (18) does. A sensor that has a
healthy neighbour is seen when its deviation passes the threshold. Where a whole channel is broken
only the wind's bounds speak against the readings: a reading is then as wrong as it is away from the
nearest one that a wind within 120 kt (40 kt up and down) changing by at most 15 kt/s could give.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.triplex import TriplexRecord
from sim_feeds.faults import KNOT_M_S
from sim_feeds.papers.wan import WAN_SAMPLE_S, LongitudinalExperiment
from sim_feeds.papers.wan2018 import WIND_KT, WIND_RATE_KT_S, Run

__all__ = ["ALPHA_TH_DEG", "CAS_TH_KT", "UNITS", "WIND_BOUNDS_KT", "score", "visible_from_s"]

Floats = NDArray[np.float64]

ALPHA_TH_DEG: Final = 2.9
CAS_TH_KT: Final = 12.0
N_EVAL: Final = 10
N_D: Final = 8
"""Samples of ``N_EVAL`` that confirm; the paper names neither n_D nor a value for it."""
WIND_BOUNDS_KT: Final = (WIND_KT, 40.0)
"""Told to the constrained estimator: along the flight, and up or down."""
UNITS: Final = (np.radians(1.0), KNOT_M_S)
"""deg in rad, kt in m/s: the tables' units."""
SETTLED_S: Final = 2.0
MEMORY_S: Final = (0.0, 10.0, 30.0, 60.0, 120.0, 700.0)
"""Edges of the ages of a held wind at which the reconstructed airspeed is judged."""


def _confirmed_at(excess: Floats, threshold: float) -> int | None:
    """First sample at which (18) and its confirmation fire on a known deviation."""
    square = np.concatenate([np.zeros(N_EVAL), np.square(excess)])
    J = np.sqrt(np.convolve(square, np.ones(N_EVAL) / N_EVAL)[N_EVAL : len(square)])
    above = np.concatenate([np.zeros(N_EVAL), J > threshold])
    count = np.convolve(above, np.ones(N_EVAL))[N_EVAL : len(above)]
    hits = np.flatnonzero(count >= N_D - 0.5)
    return int(hits[0]) if len(hits) else None


def _nearest_wind(implied: Floats, start: float, bound: float, rate: float) -> Floats:
    """The wind nearest to the implied one that keeps its bound and changes by ``rate`` at most."""
    out = np.empty_like(implied)
    wind, step = start, rate * WAN_SAMPLE_S
    for k, want in enumerate(np.clip(implied, -bound, bound).tolist()):
        wind += min(max(want - wind, -step), step)
        out[k] = wind
    return out


def visible_from_s(w: LongitudinalExperiment) -> Floats:
    """Time from which each sensor's fault can be seen, (2, 3); NaN where none ever is."""
    out = np.full((2, 3), np.nan)
    cas, tas = w.cas_true_m_s, w.truth.tas_m_s
    for ch in range(2):
        broken = w.faulty[:, 3 * ch : 3 * ch + 3]
        readings, true = (w.aoa_rad, w.x[:, 0]) if ch == 0 else (w.cas_m_s, cas)
        whole = broken.any(axis=0).all()
        for i in range(3):
            if not broken[:, i].any():
                continue
            on = np.flatnonzero(broken[:, i])
            excess = (readings[on, i] - true[on]) / UNITS[ch]
            if whole:
                # kt of wind per deg or kt of reading, and the wind itself
                gain = -tas[on] / cas[on] if ch == 1 else tas[on] * UNITS[0] / KNOT_M_S
                wind = w.x[on, 3 - ch] / KNOT_M_S
                implied = wind - excess * gain if ch == 0 else wind + excess * gain
                bound = WIND_BOUNDS_KT[1 - ch]
                nearest = _nearest_wind(implied, wind[0], bound, WIND_RATE_KT_S)
                excess = (implied - nearest) / gain
            first = _confirmed_at(excess, (ALPHA_TH_DEG, CAS_TH_KT)[ch])
            if first is not None:
                out[ch, i] = w.t_s[on[first]]
    return out


def score(run: Run, w: LongitudinalExperiment, record: TriplexRecord) -> dict[str, Any]:
    """Judge one record of one run; plain values, deg and kt, times from the onset on.

    Returns
    -------
    dict
        ``found_s`` (2, 3): first flag after the onset; NaN where there is none.
        ``wrongly``, ``released`` (2, 3) bool: flagged without a fault; flagged and, with the fault
        still there, no longer.
        ``errors``: largest, mean and number of the absolute errors of alpha, and of the airspeed
        while a pitot is left. ``memory``: see :data:`MEMORY_S`. ``remembered_s``: how long after
        the last pitot was lost the told deviation stayed below the threshold; None without a loss.
    """
    t, onset = w.t_s, run.onset_s
    broken = w.faulty.any(axis=0).reshape(2, 3)
    flagged = record.faulty
    before, after = flagged[t < onset], flagged[t >= onset]
    wrongly = before.any(axis=0) | (flagged.any(axis=0) & ~broken)
    late = t[t >= onset]
    found = after.any(axis=0) & broken
    found_s = np.full((2, 3), np.nan)
    if len(late):
        found_s[found] = (late[after.argmax(axis=0)] - onset)[found]
    falls = (np.diff(after.astype(np.int8), axis=0) < 0).any(axis=0)
    lost = record.configuration >= 2
    settled = t >= SETTLED_S
    alpha = np.abs(record.alpha - w.x[:, 0])[settled] / UNITS[0]
    cas = np.abs(record.cas - w.cas_true_m_s)[settled & ~lost] / UNITS[1]
    return {
        "found_s": found_s.tolist(),
        "wrongly": wrongly.tolist(),
        "released": (falls & broken).tolist(),
        "errors": {
            name: [float(e.max()), float(e.mean()), len(e)]
            for name, e in (("alpha", alpha), ("cas", cas))
        },
        "memory": _memory(w, record, lost),
        "remembered_s": _remembered_s(record, lost),
    }


def _memory(
    w: LongitudinalExperiment, record: TriplexRecord, lost: NDArray[np.bool_]
) -> list[list[float]]:
    """Airspeed without a pitot, per age of the held wind.

    Rows of samples, sum and maximum of the absolute error, samples within three of the deviations
    that are told.
    """
    starts = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(np.int8)])) > 0)
    age = np.full(len(lost), np.nan)
    for k in starts:
        stop = k + int(np.argmin(np.append(lost[k:], False)))
        age[k:stop] = (np.arange(k, stop) - k) * WAN_SAMPLE_S
    error = np.abs(record.cas - w.cas_true_m_s) / UNITS[1]
    inside = error <= 3.0 * record.cas_std / UNITS[1]
    rows = []
    for low, high in pairwise(MEMORY_S):
        use = (age >= low) & (age < high)
        n = int(use.sum())
        worst = float(error[use].max()) if n else 0.0
        rows.append([n, float(error[use].sum()), worst, int(inside[use].sum())])
    return rows


def _remembered_s(record: TriplexRecord, lost: NDArray[np.bool_]) -> float | None:
    """Time from the first loss of all pitots for which the airspeed was told to the threshold."""
    if not lost.any():
        return None
    since = int(lost.argmax())
    over = ~lost[since:] | (record.cas_std[since:] / UNITS[1] > CAS_TH_KT)
    return float((int(over.argmax()) if over.any() else len(over)) * WAN_SAMPLE_S)
