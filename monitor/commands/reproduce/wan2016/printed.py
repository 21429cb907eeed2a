"""What wan2016 prints: Table 2 and the sentences of its section 6 that are claims."""

from __future__ import annotations

from typing import Final, NamedTuple

__all__ = [
    "DELAYS_S",
    "ERRORS",
    "FAULTY_MAX",
    "HEALTHY_MAX",
    "REFERENCE",
    "TITLE",
    "USUAL_DELAY_S",
    "Errors",
]

TITLE: Final = "wan2016: eight scenarios of air data faults"
REFERENCE: Final = (
    "Y. Wan, T. Keviczky: Implementation of real-time moving horizon estimation for robust air "
    "data sensor fault diagnosis in the RECONFIGURE benchmark. IFAC-PapersOnLine 49(17), 64-69, "
    "2016."
)


class Errors(NamedTuple):
    """Absolute estimation errors of one run."""

    aoa_max_deg: float
    aoa_mean_deg: float
    cas_max_kt: float
    cas_mean_kt: float


ERRORS: Final = {
    "1-H": Errors(0.0737, 0.0500, 1.7360, 0.0743),
    "1-F": Errors(0.1628, 0.0420, 1.7748, 0.1024),
    "2-H": Errors(0.1875, 0.1103, 1.8532, 0.1101),
    "2-F": Errors(0.4938, 0.1134, 74.3612, 42.3752),
    "3-H": Errors(0.4661, 0.0424, 0.5368, 0.0226),
    "3-F": Errors(0.4661, 0.0452, 0.8239, 0.0349),
    "4-H": Errors(0.3643, 0.0481, 0.6005, 0.0300),
    "4-F": Errors(0.3647, 0.0483, 0.6010, 0.0300),
    "5-H": Errors(0.3728, 0.0524, 0.6134, 0.0353),
    "5-F": Errors(0.3742, 0.0490, 0.6111, 0.0288),
    "6-H": Errors(0.3951, 0.0473, 0.6448, 0.0279),
    "6-F": Errors(0.6044, 0.0637, 1.0238, 0.0461),
    "7-H": Errors(0.3747, 0.2530, 0.2672, 0.1154),
    "7-F": Errors(0.4339, 0.2764, 0.2978, 0.1225),
    "8-H": Errors(0.3659, 0.2280, 0.2547, 0.1008),
    "8-F": Errors(0.3629, 0.2266, 0.3136, 0.1167),
}
"""Table 2, left half."""

DELAYS_S: Final = {
    "1": (0.378, 0.378),
    "2": (0.368, 0.368),
    "3": (0.433, 0.393),
    "4": (None, 0.363),
    "5": (None, 0.363),
    "6": (None, 0.920),
    "7": (0.398, 23.278),
    "8": (None, 0.373),
}
"""Table 2, right half: scenario -> delay of its vanes and of its pitots, the same for each."""

HEALTHY_MAX: Final = (0.5, 1.9)
"""Section 6: bounds of the largest errors without faults [deg, kt]."""
FAULTY_MAX: Final = (0.82, 1.85)
"""Section 6: largest errors with faults, but for 2-F, as its text says [deg, kt].

Its Table 2 says 0.6044 deg (6-F) and 1.7748 kt (1-F): 0.82 is the airspeed error of 3-F in kt.
"""
USUAL_DELAY_S: Final = 0.45
"""Section 6: most delays are below this, "except for 0.92 s"; Table 2 also has 23.278 s."""
