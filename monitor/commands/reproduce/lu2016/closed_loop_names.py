"""What closed_loop compares: names of filters and feedbacks, medians over the draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.study import Result

__all__ = [
    "AIR",
    "ANGLE_RAD",
    "EXACT",
    "FAULTY",
    "FLOWN",
    "GROUND",
    "TRUE",
    "VELOCITY_M_S",
    "change_of",
    "deviations",
    "draws_of",
    "median_of",
    "steered_on",
    "winds_of",
]

Floats = NDArray[np.float64]

GROUND: Final = "GS-KM"
EXACT: Final = "GS-KM, linearised at x"
AIR: Final = "AS-KM"
TRUE: Final = "true values"
FAULTY: Final = "faulty values"

VELOCITY_M_S: Final = 0.2
ANGLE_RAD: Final = 5e-3
"""Section 3.3: the flights' true states differ by less than this."""

FLOWN: Final = (
    "height [m]",
    "airspeed [m/s]",
    "bank [deg]",
    "sideslip [deg]",
    "heading [deg]",
    "load factor",
)
"""What of two flights is compared."""


def steered_on(name: str) -> str:
    """What the autopilot is given when this filter reconstructs."""
    return f"reconstructed, {name}"


def draws_of(results: Mapping[str, Result], wind: str) -> list[Result]:
    """Results of one wind, one a draw."""
    prefix = f"closed_loop/{wind}/"
    return [results[n] for n in sorted(results) if n.startswith(prefix)]


def winds_of(results: Mapping[str, Result]) -> list[str]:
    """Winds that there are results of, calm first."""
    found = [n.split("/")[1] for n in results if n.startswith("closed_loop/")]
    return [w for w in ("calm", "shear", "turbulence") if w in found]


def median_of(rows: Sequence[Result], name: str, key: str) -> Floats:
    """Median over the draws of one filter's numbers, (6,)."""
    return np.asarray(np.median([r["filters"][name][key] for r in rows], axis=0))


def change_of(rows: Sequence[Result], name: str, axes: int = 6) -> float:
    """Largest relative change of the first axes' RMSE."""
    opened, closed = median_of(rows, name, "rmse_open"), median_of(rows, name, "rmse_closed")
    return float(np.max(np.abs(closed / opened - 1.0)[:axes]))


def deviations(rows: Sequence[Result], fed: str) -> Floats:
    """Median of the largest deviations of the flights that steer on this, in order of FLOWN."""
    return np.asarray(np.median([r["deviation"][fed] for r in rows], axis=0))
