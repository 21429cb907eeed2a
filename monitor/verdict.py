"""What a watch says: verdicts on sensors and the estimates behind them.

A :class:`Verdict` is a *change of state* of one sensor. A sensor keeps its state until the next
verdict on it. Estimates are structured arrays with the unit in every field name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from typing import TYPE_CHECKING, Protocol

import numpy as np

from links.samples import Rows
from links.vocabulary import Kind, Reason, State

if TYPE_CHECKING:
    from monitor.retune import Retuned
    from monitor.settings import Settings

__all__ = [
    "AIR_ESTIMATE",
    "AIR_EXPECTED",
    "AIR_TESTS",
    "ENGINE_ESTIMATE",
    "ENGINE_TESTS",
    "IMU_ESTIMATE",
    "IMU_TESTS",
    "PHASE_ROW",
    "WING_ESTIMATE",
    "WING_TESTS",
    "StepResult",
    "Tap",
    "Verdict",
    "Watch",
    "ratio_column",
]


@dataclass(frozen=True, slots=True)
class Verdict:
    """One sensor's change of state.

    Attributes
    ----------
    t_us
        Vehicle time at which the state was decided (for a fault: when this sensor was named) [us].
    sensor
        ``"imu0.acc_x"``, ``"airspeed1"``, ``"aoa0"``, ``"spool0"``, ``"wing_left.lift"`` ...
    state
        The new state.
    reason
        Why it is unmonitored, or that sensors disagree where it is suspect; else None.
    kind
        Shape of the fault, when faulty.
    onset_t_us
        Estimated start of the fault [us], at most ``t_us``.
    magnitude, unit
        Measured minus reconstructed at detection, and its unit (SI, rad).
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


def _ratios(*sensors: str) -> np.dtype[np.void]:
    return np.dtype([("t_us", "<i8"), *((f"{sensor}_ratio", "<f8") for sensor in sensors)])


IMU_TESTS = _ratios("acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z", "blame")
"""Estimates named ``imu0_tests`` ...: how near each axis came to a verdict.

**What a ratio is**, in all four tables. Of the tests that can blame the sensor, the largest
statistic over its threshold since the row before: 1 is the threshold. Where a test asks for more
than one thing *at one moment* (a statistic and a size, mostly), it is the statistic's ratio once
the rest is there, and until then no more than the share of what is missing most, hence below 1. So
a ratio above 1 is an alarm of this moment, and a verdict takes two more things: **duration**, the
alarm must last, and **isolation**, it must be clear whose fault it is. One that falls back below 1
without a verdict was too short, or remained undecided.

From the verdict on, the ratio is of what is held against the sensor's *return*: its distance from
agreement over the distance that is agreement. It stays above 1 while the fault does, and the sensor
is ok again some time after it fell below 1.

NaN: no test was made of that sensor. Rows are where a sensor of the table was tested, at 5 Hz at
most (a verdict may add one of its own moment), stamped when the tests were made: the row of a
verdict's ``t_us`` holds what it rests on. A hole of more than a second between rows: no tests.
Negative statistics count as 0.

**Of an IMU's axis** the tests are: zeros (seconds with all six values zero / 0.3 s), standstill
(improbability of an unchanged value / 1), noise (log of the rms over that of the peers / log of
``imu.noise_ratio``), against each other IMU the difference (sigma / ``imu.difference_sigma``, and
its size), and, of an IMU that is alone, the steps that its filters see (sigma /
``imu.single_sigma``, and the size). A difference counts for both IMUs: until the dispute is
settled, nobody knows whose it is. ``blame_ratio`` is that settlement: the log odds that a standing
dispute is *this* IMU's fault, over the odds that decide; negative where they speak for it, NaN
without a dispute that the filters can settle (of three IMUs, two outvote the third).

The statistic and threshold of a verdict are those of ``blame_ratio`` where two IMUs differed, else
of the axis (of an IMU with a called fault, a second one must be 1.5 times as clear).
"""

_AIR_SENSORS = ("airspeed0", "airspeed1", "airspeed2", "aoa0", "aoa1", "aoa2")
AIR_TESTS = _ratios(*_AIR_SENSORS)
"""Estimates named ``air_tests``: how near pitots and vanes came to a verdict; see ``IMU_TESTS``.

**One or two pitots** (filter bank): the evidence that the pitot shifted over the margin (with the
shift itself), that of the long horizon for slow faults, and the checks of single samples: a value
that stands still (seconds / ``air.constant_s``), one grossly off (log error / ``air.gross_ln`` and
three deviations of what is expected; the verdict's threshold is the former alone), a dead pitot
before the wind is known (m/s of wind that it would take / ``air.dead_wind_m_s``), scatter and
swinging against the other pitots (rms / limit). The evidence of all explanations stands in one
ratio: several pitots that would have to be blamed together show the same. **Vanes beside them**:
evidence of a shift (with its size), scatter, standing still, and being far off.

**Three pitots, or two vanes and more** (votes): mean or rms of the residual against the others of
its kind over a second, over its threshold; against the bounded wind, where all of a kind agree or
one is left; standing still (seconds / limit, while the others move).

A value that stands still has no statistic but its seconds; a verdict that two of three were wrong
rests on the wind from before, and its own ratio may be anything.
"""

AIR_EXPECTED = np.dtype(
    [
        ("t_us", "<i8"),
        ("airspeed0_m_s", "<f8"),
        ("airspeed0_std_m_s", "<f8"),
        ("airspeed1_m_s", "<f8"),
        ("airspeed1_std_m_s", "<f8"),
        ("airspeed2_m_s", "<f8"),
        ("airspeed2_std_m_s", "<f8"),
        ("aoa0_rad", "<f8"),
        ("aoa0_std_rad", "<f8"),
        ("aoa1_rad", "<f8"),
        ("aoa1_std_rad", "<f8"),
        ("aoa2_rad", "<f8"),
        ("aoa2_std_rad", "<f8"),
    ]
)
"""Estimates named ``air_expected``: what each pitot (CAS) and vane should show now.

With the scale or offset that was learnt of it while it worked, unlike ``cas_m_s`` and ``aoa_rad``
of ``air``, which are free of any sensor's error: this is what a reading is compared with. The
deviation is that of the expectation; the sensor's noise and gusts come on top. NaN where nothing
was learnt yet, or the sensor is not there.
"""

_ENGINES = 4
_CHANNELS = 16
ENGINE_TESTS = _ratios(
    *(f"spool{i}" for i in range(_CHANNELS)), *(f"engine{i}" for i in range(_ENGINES))
)
"""Estimates named ``engine_tests``: engine-speed channels and engines; see ``IMU_TESTS``.

**Of a channel**: share of wrong readings / ``engine.wrong_share``, standing still while the
throttle moved (seconds / ``engine.stuck_s``), and, where all channels of a shaft are low at once,
the log odds that they failed over those that decide. **Of an engine**: the log odds that it
stopped, and, of the first, seconds without power (/ ``engine.no_power_s``) or cut (/
``engine.cut_s``).
"""

WING_TESTS = _ratios("right_lift", "right_drag", "left_lift", "left_drag")
"""Estimates named ``wing_tests``; see ``IMU_TESTS``.

What a wing lost more than the other one [%] / its threshold: the physical limit, or so many
deviations of the difference, whichever is greater. It is the verdict's statistic and threshold.
"""


def ratio_column(sensor: str) -> tuple[str, str]:
    """Table and column of a sensor's ratio.

    ``ratio_column("imu0.acc_x") == ("imu0_tests", "acc_x_ratio")``; of ``"wing_left.lift"`` it is
    ``("wing_tests", "left_lift_ratio")``.
    """
    group, _, part = sensor.partition(".")
    if group.startswith("wing_"):
        return "wing_tests", f"{group.removeprefix('wing_')}_{part}_ratio"
    if part:
        return f"{group}_tests", f"{part}_ratio"
    table = "engine_tests" if group.startswith(("spool", "engine")) else "air_tests"
    return table, f"{group}_ratio"


PHASE_ROW = np.dtype([("seq", "<i8"), ("t_us", "<i8"), ("flying", "?")])
"""Rows named ``phase``: the aircraft takes off to fly (True) or is no longer flying (False)."""


@dataclass(slots=True)
class StepResult:
    """What became due in one step.

    Attributes
    ----------
    verdicts
        Changes of state, in time order.
    estimates
        Name -> new rows: ``air`` of :data:`AIR_ESTIMATE`, ``imu0`` ... of :data:`IMU_ESTIMATE`,
        ``engine``, ``wing``, and what their tests said.
    """

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

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings without losing state; keys that cannot be taken now are named.

        The same settings change nothing, to the last bit. What is taken before the first row has
        the same effect as having started with it.
        """
        ...

    def peaks(self) -> dict[str, float]:
        """Settings key -> largest value of what is held to it, while judged and not faulty."""
        ...


class Tap(Protocol):
    """Sees what the watches see and says nothing about any sensor's state."""

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Look at the newly released rows, ``phase`` rows among them."""
        ...
