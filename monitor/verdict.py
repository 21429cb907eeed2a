"""What a watch says: verdicts on sensors and the estimates behind them.

A :class:`Verdict` is a *change of state* of one sensor. A sensor keeps its state until the next
verdict on it. Estimates are structured arrays with the unit in every field name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Protocol

import numpy as np

from links.samples import Rows
from links.vocabulary import Kind, Reason, State

__all__ = [
    "AIR_ESTIMATE",
    "ENGINE_ESTIMATE",
    "IMU_ESTIMATE",
    "PHASE_ROW",
    "WING_ESTIMATE",
    "StepResult",
    "Tap",
    "Verdict",
    "Watch",
]


@dataclass(frozen=True, slots=True)
class Verdict:
    """One sensor's change of state.

    Attributes
    ----------
    t_us
        Vehicle time at which the state was decided (for a fault: when this sensor was named) [us].
    sensor
        ``"imu0.acc_x"``, ``"airspeed1"``, ``"aoa0"`` ... (DESIGN section 3).
    state
        The new state.
    reason
        Why it is unmonitored; None for every other state.
    kind
        Shape of the fault, when faulty.
    onset_t_us
        Estimated start of the fault [us], at most ``t_us``.
    magnitude
        Measured minus reconstructed at detection, in ``unit`` (SI, rad).
    statistic, threshold
        The test statistic and the threshold that it crossed, dimensionless unless the evidence says
        otherwise.
    estimator
        Module of ``estimators`` that decided.
    evidence
        One sentence that a pilot understands.
    detected_t_us
        When it was first said that something is wrong, if that was earlier: two sensors disagreed,
        and it took until ``t_us`` to tell which of them is at fault [us]. None: at ``t_us``.
    """

    t_us: int
    sensor: str
    state: State
    reason: Reason | None = None
    kind: Kind = Kind.UNKNOWN
    onset_t_us: int | None = None
    magnitude: float = nan
    unit: str = ""
    statistic: float = nan
    threshold: float = nan
    estimator: str = ""
    evidence: str = ""
    detected_t_us: int | None = None


AIR_ESTIMATE = np.dtype(
    [
        ("t_us", "<i8"),
        ("cas_m_s", "<f8"),
        ("cas_std_m_s", "<f8"),
        ("tas_m_s", "<f8"),
        ("tas_std_m_s", "<f8"),
        ("aoa_rad", "<f8"),
        ("aoa_std_rad", "<f8"),
        ("ssa_rad", "<f8"),
        ("ssa_std_rad", "<f8"),
        ("wind_ned_m_s", "<f8", (3,)),
        ("wind_std_ned_m_s", "<f8", (3,)),
    ]
)
"""Estimates named ``air``; what is not observable is NaN.

The wind is the mean wind, without gusts; airspeeds and angles are of the moment, gusts included.
Without vanes the vertical wind is not observable: it is zero with the deviation that says so.
"""

IMU_ESTIMATE = np.dtype(
    [
        ("t_us", "<i8"),
        ("acc_fault_m_s2", "<f8", (3,)),
        ("acc_fault_std_m_s2", "<f8", (3,)),
        ("gyro_fault_rad_s", "<f8", (3,)),
        ("gyro_fault_std_rad_s", "<f8", (3,)),
        ("acc_m_s2", "<f8", (3,)),
        ("gyro_rad_s", "<f8", (3,)),
    ]
)
"""Estimates named ``imu0`` ...: reconstructed faults; specific force and rates freed of them."""

N_SHAFTS = 4
ENGINE_ESTIMATE = np.dtype(
    [
        ("t_us", "<i8"),
        ("speed_rpm", "<f8", (N_SHAFTS,)),
        ("speed_std_rpm", "<f8", (N_SHAFTS,)),
        ("throttle", "<f8"),
        ("climb_power_m_s", "<f8"),
    ]
)
"""Estimates named ``engine``: reconstructed speed of each shaft, NaN for those not modelled.

Beside them the throttle (0 to 1), and what engine and drag together did to the aircraft's energy:
the climb rate that it would have given at constant airspeed.
"""

WING_ESTIMATE = np.dtype(
    [
        ("t_us", "<i8"),
        ("right_lift_percent", "<f8"),
        ("right_lift_std_percent", "<f8"),
        ("right_drag_percent", "<f8"),
        ("right_drag_std_percent", "<f8"),
        ("left_lift_percent", "<f8"),
        ("left_lift_std_percent", "<f8"),
        ("left_drag_percent", "<f8"),
        ("left_drag_std_percent", "<f8"),
        ("lift_apart_std_percent", "<f8"),
        ("drag_apart_std_percent", "<f8"),
    ]
)
"""Estimates named ``wing``: lift lost and drag gained by each wing.

What both wings have in common is hardly observable, as their deviations say; the deviations of the
difference right minus left are the last two.
"""

PHASE_ROW = np.dtype([("seq", "<i8"), ("t_us", "<i8"), ("flying", "?")])
"""Rows named ``phase``: the aircraft takes off to fly (True) or is no longer flying (False)."""


@dataclass(slots=True)
class StepResult:
    """What one step of a watch gave: verdicts in time order and new estimate rows per name."""

    verdicts: list[Verdict] = field(default_factory=list)
    estimates: dict[str, Rows] = field(default_factory=dict)


class Watch(Protocol):
    """Watches one group of sensors.

    ``step`` receives, per sensor name, the rows released since the last step in (t_us, seq) order,
    all with ``t_us < until_us``; ``phase`` rows come among them. The verdicts must be a function
    of the concatenated rows alone: where a stream is cut into steps changes nothing, to the last
    bit. ``t_us`` is the time at which the sample was *valid* (latency already taken off).
    """

    name: str
    quantities: frozenset[str]

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        """Use the newly released rows."""
        ...

    def peaks(self) -> dict[str, float]:
        """Settings key -> largest value of what is held to it, while judged and not faulty."""
        ...


class Tap(Protocol):
    """Sees what the watches see and says nothing about any sensor's state."""

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Look at the newly released rows, ``phase`` rows among them."""
        ...
