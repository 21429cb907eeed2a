"""What wang2020 prints, in one place."""

from __future__ import annotations

from typing import Final, NamedTuple

__all__ = [
    "AREA_REDUCTION",
    "FIG6_WITHIN",
    "MEAN_REDUCTION",
    "MEMORY_KB",
    "OPERATIONS",
    "TABLE3",
    "TABLE4",
    "Row",
]


class Row(NamedTuple):
    """Norm of the mean error [% of full scale] and area of the 95 % ellipse [%^2]."""

    mean: float
    a95: float


TABLE3: Final = {
    "rakf": Row(1.02, 685.80),
    "classic": Row(1.73, 332.87),
    "chi-square": Row(1.01, 175.58),
    "proposed": Row(0.77, 26.79),
}

TABLE4: Final = {
    "gaussian": Row(0.77, 26.79),
    "laplace": Row(0.31, 40.87),
    "cauchy": Row(1.40, 193.18),
}

AREA_REDUCTION: Final = {"rakf": 96, "classic": 92, "chi-square": 85}
MEAN_REDUCTION: Final = {"rakf": 24, "classic": 55, "chi-square": 24}
"""By how many per cent the proposed method's Table 3 is said to be below the others'."""

FIG6_WITHIN: Final = ((6.0, 11.0), (0.6, 1.0))
"""Errors [%] of LPC and HPC that 68 % and 95 % stay within (text under Fig. 6)."""

OPERATIONS: Final = 578
MEMORY_KB: Final = 164
