"""Names of the forms in which a recording is used, and medians over its onsets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.study import Result

__all__ = [
    "FOLLOWED",
    "FORMS",
    "MENDED",
    "OWN_TIMES",
    "OWN_TIMES_SLOW",
    "PAPER",
    "PAPER_FAST",
    "PIPELINE",
    "PIPELINE_FOLLOWED",
    "flights_of",
    "median_of",
    "overall",
    "spread",
    "swing",
]

Floats = NDArray[np.float64]

PAPER: Final = "interpolated, GPS 1 Hz"
MENDED: Final = "interpolated, (53) and (57) mended"
PAPER_FAST: Final = "interpolated, GPS 5 Hz"
OWN_TIMES_SLOW: Final = "own times, GPS 1 Hz"
OWN_TIMES: Final = "own times, GPS 5 Hz"
PIPELINE: Final = "pipeline"
FOLLOWED: Final = "interpolated, attitude follows"
PIPELINE_FOLLOWED: Final = "pipeline, attitude follows"
FORMS: Final = (
    PAPER,
    MENDED,
    PAPER_FAST,
    OWN_TIMES_SLOW,
    OWN_TIMES,
    PIPELINE,
    FOLLOWED,
    PIPELINE_FOLLOWED,
)


def flights_of(results: Mapping[str, Result]) -> list[Result]:
    """Results of the recordings, in the order of the scenario file."""
    from sim_feeds.papers.lu2016_validation import validation

    names = [f"recorded/{f.name}" for f in validation().recorded.flight]
    return [results[n] for n in names if n in results]


def median_of(flight: Result, form: str, key: str) -> Floats:
    """Median over the onsets of one recording, (6,)."""
    return np.asarray(np.median([o["forms"][form][key] for o in flight["onsets"]], axis=0))


def overall(flights: Sequence[Result], form: str, key: str) -> Floats:
    """Median over all onsets of all recordings, (6,)."""
    every = [o["forms"][form][key] for r in flights for o in r["onsets"]]
    return np.asarray(np.median(every, axis=0))


def swing(flights: Sequence[Result], form: str) -> tuple[float, float]:
    """Share of the oscillating f_Az that comes out, and its delay [s]; medians of all onsets."""
    all_of = [o["forms"][form] for r in flights for o in r["onsets"]]
    share, delay = (np.median([o[key] for o in all_of]) for key in ("swing_share", "swing_delay_s"))
    return float(share), float(delay)


def spread(flights: Sequence[Result], form: str) -> Floats:
    """RMSE of each axis, largest over smallest of the recordings, (6,)."""
    each = np.array([median_of(r, form, "rmse") for r in flights])
    return np.asarray(each.max(axis=0) / each.min(axis=0))
