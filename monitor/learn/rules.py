"""Which settings can be learnt from healthy flights, and how far each may move.

A verdict takes a statistic beyond its threshold *and* a size that matters. Only thresholds of
statistics are learnt: they are what differs between airframes, and raising one is enough to silence
a test. A size says what is worth calling a fault; it is kept, and shown beside its maximum. What
keeps a bad reference from being believed may be raised for a receiver that is noisier.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

__all__ = ["LEVELS", "RULES", "Kind", "Level", "Rule"]


class Kind(Enum):
    """What a key is to a verdict."""

    STATISTIC = "statistic"
    SIZE = "size"
    REFERENCE = "reference"
    LEVEL = "level"


@dataclass(frozen=True, slots=True)
class Rule:
    """How one threshold is learnt.

    Attributes
    ----------
    key
        Dotted settings key; the watches give its peak under the same name.
    quantity
        Sensors that the test judges.
    why
        What the floor rests on, or why the key is kept.
    floor
        Never learnt below this, in the key's unit; None: never below the default.
    power
        The smallest fault that is found grows as threshold ** power: a statistic in sigma is
        proportional to the fault, a log likelihood to its square.
    least, most
        How many sensors of the quantity an aircraft has for the test to be made.
    kind
        What it is to a verdict; a size is never learnt.
    """

    key: str
    quantity: str
    why: str
    floor: float | None = None
    power: float = 1.0
    least: int = 1
    most: int = 99
    kind: Kind = Kind.STATISTIC

    def scaled(self, value: float, factor: float) -> float:
        """The value that goes with a fault so many times as large."""
        return value * math.pow(factor, 1.0 / self.power)

    def least_value(self, default: float) -> float:
        """The floor in force over this default."""
        return default if self.floor is None else min(self.floor, default)


RULES = (
    Rule(
        "imu.difference_sigma",
        "imu",
        "where suspicion begins; ordinary noise would be accused below it",
        floor=3.5,
        least=2,
    ),
    Rule(
        "imu.single_sigma",
        "imu",
        "ordinary noise would be accused below it",
        floor=3.5,
        most=1,
    ),
    Rule(
        "imu.noise_ratio",
        "imu",
        "noise that doubles or triples in a manoeuvre harms no estimate",
        floor=6.0,
    ),
    Rule("imu.acc_size_m_s2", "imu", "a physical size, no statistic", kind=Kind.SIZE),
    Rule("imu.gyro_size_rad_s", "imu", "a physical size, no statistic", kind=Kind.SIZE),
    Rule(
        "air.margin_one",
        "airspeed",
        "the best of 400 explanations (8 kinds, 50 starts) gains ln 400 by chance",
        floor=6.0,
        power=0.5,
        least=2,
    ),
    Rule(
        "air.margin_all",
        "airspeed",
        "without a healthy pitot beside it, as much as the default asks with one",
        floor=8.0,
        power=0.5,
    ),
    Rule(
        "air.horizon.margin_one",
        "airspeed",
        "the best of 400 explanations (8 kinds, 50 starts) gains ln 400 by chance",
        floor=6.0,
        power=0.5,
        least=2,
    ),
    Rule(
        "air.horizon.margin_all",
        "airspeed",
        "without a healthy pitot beside it, as much as the default asks with one",
        floor=10.0,
        power=0.5,
    ),
    Rule(
        "air.margin_single",
        "airspeed",
        "the best of 100 explanations (2 kinds, 50 starts) gains ln 100 by chance",
        floor=5.0,
        power=0.5,
        most=1,
    ),
    Rule("air.min_shift", "airspeed", "a physical size, no statistic", kind=Kind.SIZE),
    Rule(
        "air.gross_ln",
        "airspeed",
        "what is less than a third is no gross error and left to the filters",
        floor=0.3,
    ),
    Rule(
        "air.noise_rms",
        "airspeed",
        "three times the scatter of a healthy pitot",
        floor=0.01,
        least=2,
    ),
    Rule("air.dead_wind_m_s", "airspeed", "the wind of another day may be stronger"),
    Rule(
        "air.reference_apart_m_s",
        "airspeed",
        "satellites may stand worse on another day",
        kind=Kind.REFERENCE,
    ),
    Rule(
        "air.reference_noise_m_s",
        "airspeed",
        "satellites may stand worse on another day",
        kind=Kind.REFERENCE,
    ),
)
"""Every threshold, in the order in which it is shown."""


@dataclass(frozen=True, slots=True)
class Level:
    """A noise level of the model that a noisier aircraft raises; it is never lowered.

    Below the default it is not the white noise that counts but what the model leaves out.

    Attributes
    ----------
    key
        Dotted settings key.
    measured
        Name of the measurement (:mod:`monitor.learn.levels`).
    factor
        Key's value over the measured one.
    """

    key: str
    measured: str
    factor: float = 1.0


LEVELS = (
    Level("imu.gps_std_m_s", "gps_noise_m_s"),
    Level("triplex.gps_std_m_s", "gps_noise_m_s"),
    Level("imu.baro_std_m", "baro_noise_m"),
    Level("air.scale_prior", "pitot_apart", 0.5**0.5),
    Level("triplex.scale_limit", "pitot_apart", 0.5),
)
"""Every level. Two pitots apart by d have scales of d / sqrt(2) each, rms, or half of d at best.
Gusts, vibration and a pitot's own noise are followed in flight: they need no key."""
