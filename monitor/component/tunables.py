"""The parameters that a ground station may change in flight: one table, read by everything else.

Limits are narrower than those of the settings: within them the monitor still sees, so nothing that
can be sent makes it blind except muting, which it says. Those of the flight phase are locked in
flight: they could declare it over.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any, Final

import numpy as np

from monitor.masks import SENSORS
from monitor.retune import value_of
from monitor.settings import Settings

__all__ = ["RESET", "TUNABLES", "Refusal", "RefusedValue", "Tunable", "Type"]


class Type(IntEnum):
    """MAV_PARAM_TYPE of those that are used."""

    UINT8 = 1
    UINT16 = 3
    UINT32 = 5
    REAL32 = 9


_WHOLE: Final = {Type.UINT8: "<B", Type.UINT16: "<H", Type.UINT32: "<I"}
_KNOWN_TYPES: Final = range(1, 11)


class Refusal(StrEnum):
    """Why a value is not taken."""

    UNKNOWN = "no such parameter"
    TYPE = "wrong type"
    NOT_FINITE = "not a number"
    NOT_WHOLE = "not a whole number"
    RANGE = "out of range"
    LOCKED = "locked in flight"
    READ_ONLY = "read only"


class RefusedValue(ValueError):
    """A value that is not taken."""

    def __init__(self, why: Refusal) -> None:
        super().__init__(str(why))
        self.why = why


@dataclass(frozen=True, slots=True)
class Tunable:
    """A parameter.

    Attributes
    ----------
    name
        At most 16 characters.
    key
        Dotted key of the settings.
    type
        MAV_PARAM_TYPE.
    least, most
        Range, both ends included; of a mask ``most`` has every bit that means something.
    unit
        Empty for a number or a count.
    meaning
        In a few words.
    on_ground
        Locked in flight.
    mask
        Every bit is a sensor.
    """

    name: str
    key: str
    type: Type
    least: float
    most: float
    unit: str
    meaning: str
    on_ground: bool = False
    mask: bool = False

    def encode(self, value: Any, *, bytewise: bool) -> float:
        """A value of the settings as ``param_value``: cast to a float, or its bytes as one."""
        if not bytewise or self.type is Type.REAL32:
            return float(value)
        packed = struct.pack(_WHOLE[self.type], int(value)).ljust(4, b"\0")
        return float(struct.unpack("<f", packed)[0])

    def decode(self, sent: float, said_type: int, *, bytewise: bool, settings: Settings) -> Any:
        """A ``param_value`` as a value of the settings.

        Cast to a float, the number says all, and senders that know no types say REAL32: the type is
        not looked at, as ArduPilot does not. As bytes, it must be the parameter's own.

        Raises
        ------
        RefusedValue
            It cannot be taken.
        """
        if said_type not in _KNOWN_TYPES or (bytewise and said_type != self.type):
            raise RefusedValue(Refusal.TYPE)
        if bytewise and self.type is not Type.REAL32:
            form = _WHOLE[self.type]
            packed = struct.pack("<f", sent)
            number = float(struct.unpack(form, packed[: struct.calcsize(form)])[0])
        else:
            number = sent
        return self.checked(number, settings)

    def checked(self, number: float, settings: Settings) -> Any:
        """A number as a value of the settings, in their type.

        Raises
        ------
        RefusedValue
            It cannot be taken.
        """
        if not math.isfinite(number):
            raise RefusedValue(Refusal.NOT_FINITE)
        if self.type is Type.REAL32:
            number = _shortest(number) + 0.0  # no -0
        elif number != int(number):
            raise RefusedValue(Refusal.NOT_WHOLE)
        if not self.least <= number <= self.most or (self.mask and int(number) & ~int(self.most)):
            raise RefusedValue(Refusal.RANGE)
        return type(value_of(settings, self.key))(number) if self.key else int(number)


def _shortest(number: float) -> float:
    """The decimal number that was meant: 0.35, not the 0.3499999940395355 that a float32 holds."""
    return float(np.format_float_positional(np.float32(number), unique=True))


def _mask(name: str) -> int:
    return sum(1 << bit for bit in SENSORS[name])


_U8, _U16, _U32, _F32 = Type.UINT8, Type.UINT16, Type.UINT32, Type.REAL32

_MUTES: Final = tuple(
    Tunable(
        f"MUTE_{mask}",
        f"mute.{mask.lower()}",
        _U32 if mask == "ENG" else _U16 if mask == "AIR" else _U8,
        0,
        _mask(mask),
        "",
        f"sensors that nothing is said of, bits as in FLT_{mask}",
        mask=True,
    )
    for mask in SENSORS
)

TUNABLES: Final[tuple[Tunable, ...]] = (
    *_MUTES,
    Tunable("IMU_DIFF_SIG", "imu.difference_sigma", _F32, 3, 30, "sigma",
            "two IMUs disagree beyond this"),
    Tunable("IMU_LONE_SIG", "imu.single_sigma", _F32, 3, 30, "sigma",
            "a lone IMU is blamed beyond this"),
    Tunable("IMU_ACC_SIZE", "imu.acc_size_m_s2", _F32, 0.05, 3, "m/s^2",
            "nothing smaller is an accelerometer fault"),
    Tunable("IMU_GYR_SIZE", "imu.gyro_size_rad_s", _F32, 0.002, 0.2, "rad/s",
            "nothing smaller is a gyro fault"),
    Tunable("IMU_ARBITRATE", "imu.arbitration_nats", _F32, 3, 30, "nat",
            "odds at which one of two IMUs is blamed"),
    Tunable("IMU_NOISE_RATIO", "imu.noise_ratio", _F32, 4, 100, "",
            "an axis so many times noisier is faulty"),
    Tunable("IMU_CONFIRM", "imu.confirm_s", _F32, 0.2, 10, "s", "a test must hold this long"),
    Tunable("IMU_CLEAR", "imu.clear_s", _F32, 1, 120, "s",
            "an axis must agree this long to come back"),
    Tunable("AIR_MARGIN_ONE", "air.margin_one", _F32, 3, 50, "nat",
            "accuses one of several pitots"),
    Tunable("AIR_MARGIN_ALL", "air.margin_all", _F32, 3, 50, "nat", "accuses all pitots together"),
    Tunable("AIR_MARGIN_LONE", "air.margin_single", _F32, 3, 50, "nat", "accuses a single pitot"),
    Tunable("AIR_MIN_SHIFT", "air.min_shift", _F32, 0.02, 0.5, "",
            "nothing smaller is a pitot fault, share of the airspeed"),
    Tunable("AIR_CONFIRM", "air.confirm_s", _F32, 0, 10, "s", "a margin must hold this long"),
    Tunable("AIR_READMIT", "air.readmit_s", _F32, 1, 120, "s",
            "a pitot must agree this long to come back"),
    Tunable("AIR_STUCK", "air.constant_s", _F32, 0.5, 20, "s", "a constant reading is stuck"),
    Tunable("AIR_GROSS", "air.gross_ln", _F32, 0.1, 2, "", "gross error, logarithm"),
    Tunable("AIR_WIND_MAX", "air.wind_max_m_s", _F32, 5, 100, "m/s",
            "no stronger wind explains anything"),
    Tunable("AIR_SLOW_ONE", "air.horizon.margin_one", _F32, 3, 50, "nat",
            "a slow fault of one of several pitots"),
    Tunable("AIR_SLOW_ALL", "air.horizon.margin_all", _F32, 3, 50, "nat",
            "a slow fault of a single pitot, or of all"),
    Tunable("TRI_AOA_DEG", "triplex.aoa_threshold_deg", _F32, 0.2, 10, "deg",
            "a vane that differs so much is outvoted"),
    Tunable("TRI_CAS_MPS", "triplex.cas_threshold_m_s", _F32, 0.3, 20, "m/s",
            "a pitot that differs so much is outvoted"),
    Tunable("TRI_CAS_SHARE", "triplex.cas_threshold_share", _F32, 0.005, 0.2, "",
            "the same as a share of the airspeed"),
    Tunable("TRI_WIND_MAX", "triplex.wind_bound_m_s", _F32, 5, 100, "m/s",
            "largest horizontal wind"),
    Tunable("VANE_MARGIN", "vane.margin", _F32, 3, 50, "nat", "accuses a vane beside the pitots"),
    Tunable("VANE_LEAST", "vane.least_deg", _F32, 0.5, 20, "deg",
            "nothing smaller is a vane fault"),
    Tunable("VANE_CONFIRM", "vane.confirm_s", _F32, 0, 30, "s", "the margin must hold this long"),
    Tunable("ENG_WRONG", "engine.wrong_share", _F32, 0.01, 0.5, "",
            "share of wrong readings that makes a channel faulty"),
    Tunable("ENG_STUCK", "engine.stuck_s", _F32, 1, 30, "s",
            "a constant reading is stuck while the throttle moves"),
    Tunable("ENG_DEAD", "engine.dead_share", _F32, 0.02, 0.5, "",
            "a lower share of the usual speed is dead or stopped"),
    Tunable("ENG_NO_POWER", "engine.no_power_s", _F32, 2, 60, "s",
            "so long without power: stopped"),
    Tunable("ENG_CUT", "engine.cut_s", _F32, 2, 60, "s", "throttle idle against the demand"),
    Tunable("WNG_LIFT", "wing.lift_percent", _F32, 1, 50, "%",
            "lift lost more than the other wing"),
    Tunable("WNG_DRAG", "wing.drag_percent", _F32, 1, 100, "%",
            "drag gained more than the other wing"),
    Tunable("FLY_SPEED", "phase.flying_speed_m_s", _F32, 2, 100, "m/s",
            "ground speed above which it may be flying", on_ground=True),
    Tunable("FLY_TAKEOFF_HGT", "phase.takeoff_height_m", _F32, 1, 300, "m",
            "height from which it is judged", on_ground=True),
    Tunable("FLY_LANDING_HGT", "phase.landing_height_m", _F32, 0, 300, "m",
            "height below which it is judged no more", on_ground=True),
    Tunable("PUB_MASK_HZ", "publish.mask_rate_hz", _F32, 0.2, 20, "Hz", "rate of FLT_* and MON_*"),
    Tunable("PUB_VALUE_HZ", "publish.value_rate_hz", _F32, 0, 20, "Hz",
            "rate of reconstructed values; 0 sends none"),
    Tunable("PUB_NAMED", "publish.values_named", _U8, 0, 1, "", "reconstructed values by name"),
    Tunable("PUB_STANDARD", "publish.values_standard", _U8, 0, 1, "",
            "reconstructed values in AIRSPEED, AOA_SSA, WIND_COV"),
    Tunable("PUB_IMU_FAULTS", "publish.imu_faults", _U8, 0, 1, "", "IMU_FLT"),
    Tunable("PUB_TEXT", "publish.text", _U8, 0, 1, "", "changes as STATUSTEXT"),
    Tunable("PUB_TEXT_BURST", "publish.text_burst", _U8, 1, 20, "",
            "STATUSTEXT at once after a quiet time"),
    Tunable("PUB_TEXT_S", "publish.text_interval_s", _F32, 0.5, 60, "s",
            "mean time between STATUSTEXT"),
)  # fmt: skip
"""In the order of their indices; :data:`RESET` comes last."""

RESET: Final = Tunable(
    "PARAM_RESET", "", Type.UINT8, 0, 1, "", "1 puts every parameter back to the file's value"
)
"""Holds 0 again as soon as it is done."""
