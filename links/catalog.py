"""The table: which message gives which sensor, in which unit, within which bounds.

One :class:`Source` per line of DESIGN's input table; everything else (the decoder, the tests)
reads this. A source fills the fields of the sensor's dtype (:mod:`links.samples`) by
:class:`Fill` entries: wire fields times a scale, or a small function where it takes more.
A required value that is not finite, or outside its bounds, rejects the row and is counted.

``RANKING`` orders the sources of a quantity, best first; a source that is not ranked is not used.
Rows are given even where an instance is plainly unused (an all-zero SCALED_IMU3, rpm2 = -1): that
it is absent is for the pipeline to say, which sees the whole stream.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.clock import Stamp
from links.conversions import (
    DEG,
    EULER,
    FROM_COURSE,
    NO_VALUE,
    QUATERNION,
    Condition,
    Floats,
    Payload,
    Wire,
    accuracy,
    course_from_velocity,
    element,
    euler_from_quaternion,
    flag,
    put_element,
    quaternion_fields,
    sign,
)

__all__ = [
    "AUTOPILOT_INVALID",
    "AUTOPILOT_PX4",
    "BOUNDS",
    "FROM_ANY_COMPONENT",
    "MAX_INSTANCES",
    "NAMED_INPUTS",
    "RANKING",
    "RANKING_BY_AUTOPILOT",
    "SOURCES",
    "STAMPS",
    "Fill",
    "Source",
    "bounded",
]

STANDARD_GRAVITY = 9.80665
"""MAVLink's mG is a thousandth of this [m/s^2]."""

MILLI_G = 1e-3 * STANDARD_GRAVITY
HPA = 100.0
ZERO_CELSIUS_K = 273.15
AUTOPILOT_INVALID = 8
"""MAV_AUTOPILOT of a component that is no autopilot."""
AUTOPILOT_PX4 = 12
SAFETY_ARMED, AUTO_OR_GUIDED = 0x80, 0x0C
"""MAV_MODE_FLAG bits of HEARTBEAT.base_mode."""
MAX_INSTANCES = {"imu": 5, "airspeed": 3, "aoa": 3, "gps": 2, "baro": 3, "spool": 16}
"""Instances that DESIGN section 3 names; a message for a higher one is out of range."""


@dataclass(frozen=True, slots=True)
class Fill:
    """How one field of a row is filled.

    Attributes
    ----------
    into
        Field of the sensor's dtype.
    fields
        Wire fields, one per element of the field.
    scale, offset
        Row value = wire value times ``scale`` plus ``offset``.
    low, high
        Bounds of the row value [the field's unit].
    required
        Whether a row without this value is rejected; otherwise NaN stays NaN.
    compute
        (payload) -> values, instead of ``fields``; a MAVLink source has a
        :class:`links.conversions.Conversion` here.
    invert
        (payload, values) -> wire fields with their values before rounding: undoes ``compute``.
    """

    into: str
    fields: tuple[str, ...] = ()
    scale: float = 1.0
    offset: float = 0.0
    low: float = -inf
    high: float = inf
    required: bool = True
    compute: Callable[[Payload], Floats] | None = None
    invert: Callable[[Payload, Floats], Wire] | None = None

    @property
    def bounded(self) -> bool:
        """Whether being within the bounds implies being finite."""
        return self.low > -inf and self.high < inf


@dataclass(frozen=True, slots=True)
class Source:
    """One message as a source of one sensor.

    Attributes
    ----------
    key
        Name in :data:`RANKING`; several messages of one family share it.
    message
        MAVLink message name.
    sensor
        Sensor name; ends in ``{}`` where ``instance`` names the wire field with the number.
    fills
        What it fills.
    only
        (payload) -> which payloads really carry this sensor; None for all. A MAVLink source has a
        :class:`links.conversions.Condition` here.
    named
        For NAMED_VALUE_FLOAT: the name that it must have.
    ratio
        CAS comes from differential pressure and the pitot's ARSPD_RATIO.
    synthetic
        Not a sensor's own reading but the autopilot's mixture: used only where no better source
        has ever spoken.
    """

    key: str
    message: str
    sensor: str
    fills: tuple[Fill, ...]
    instance: str | None = None
    only: Callable[[Payload], NDArray[np.bool_]] | None = None
    named: str | None = None
    ratio: bool = False
    synthetic: bool = False

    @property
    def quantity(self) -> str:
        """Quantity of the sensor."""
        return self.sensor.removesuffix("{}").rstrip("0123456789")


BOUNDS: dict[str, tuple[float, float]] = {
    "acc_m_s2": (-400.0, 400.0),  # 40 g: int16 milli-g ends at 32.8 g
    "gyro_rad_s": (-70.0, 70.0),  # 4000 deg/s
    "rate_rad_s": (-70.0, 70.0),
    "cas_m_s": (0.0, 700.0),
    "diff_press_pa": (-3e4, 3e5),
    "static_press_pa": (1e3, 1.3e5),
    "temperature_k": (150.0, 450.0),
    "lat_rad": (-pi / 2, pi / 2),
    "lon_rad": (-pi, pi),
    "alt_m": (-1e4, 1e5),
    "height_m": (-1e5, 1e5),
    "aoa_rad": (-pi, pi),
    "speed_rpm": (-1e6, 1e6),
}
"""Field of a row -> least and largest value that is believed, whatever the format of the log."""


def bounded(
    into: str,
    fields: tuple[str, ...] = (),
    scale: float = 1.0,
    offset: float = 0.0,
    **other: Any,
) -> Fill:
    """A fill within :data:`BOUNDS`; arguments as of :class:`Fill`."""
    low, high = BOUNDS[into]
    return Fill(into, fields, scale, offset, low, high, **other)


# --------------------------------------------------------------------------- fields by quantity

_ACC = ("xacc", "yacc", "zacc")
_GYRO = ("xgyro", "ygyro", "zgyro")
_RATE = ("rollspeed", "pitchspeed", "yawspeed")


def _imu(acc_scale: float, gyro_scale: float) -> tuple[Fill, ...]:
    return (
        bounded("acc_m_s2", _ACC, acc_scale),
        bounded("gyro_rad_s", _GYRO, gyro_scale),
    )


_BODY_RATE = bounded("rate_rad_s", _RATE)
_DIFF_PRESS = bounded("diff_press_pa", ("press_diff",), HPA)
_BARO = (
    bounded("static_press_pa", ("press_abs",), HPA),
    bounded("temperature_k", ("temperature",), 1e-2, ZERO_CELSIUS_K),
)
_GPS = (
    Fill("fix_type", ("fix_type",)),
    bounded("lat_rad", ("lat",), 1e-7 * DEG),
    bounded("lon_rad", ("lon",), 1e-7 * DEG),
    bounded("alt_m", ("alt",), 1e-3),
    Fill(
        "vel_ned_m_s",
        compute=FROM_COURSE,
        invert=course_from_velocity,
        required=False,
    ),
    Fill("h_std_m", compute=accuracy("h_acc"), required=False),
    Fill("v_std_m", compute=accuracy("v_acc"), required=False),
    Fill("vel_std_m_s", compute=accuracy("vel_acc"), required=False),
    Fill("satellites", ("satellites_visible",)),
)
_NAV = (
    bounded("lat_rad", ("lat",), 1e-7 * DEG),
    bounded("lon_rad", ("lon",), 1e-7 * DEG),
    bounded("alt_m", ("alt",), 1e-3),
    bounded("height_m", ("relative_alt",), 1e-3),
    Fill("vel_ned_m_s", ("vx", "vy", "vz"), 1e-2),
)
_NO_PRESSURE = Fill("diff_press_pa", compute=NO_VALUE, required=False)
_HIGHRES_PRESSURE, _HIGHRES_DIFFERENTIAL = 1 << 9, 1 << 10  # HIGHRES_IMU_UPDATED_FLAGS


def _rpm(wire: str) -> tuple[Fill, ...]:
    return (bounded("speed_rpm", (wire,)),)


def _aoa(wire: str) -> tuple[Fill, ...]:
    return (bounded("aoa_rad", (wire,), DEG),)


def _escs() -> tuple[Source, ...]:
    """ESC_TELEMETRY_1_TO_4 ... 13_TO_16: four speeds in each message."""
    return tuple(
        Source(
            "ESC_TELEMETRY",
            f"ESC_TELEMETRY_{first}_TO_{first + 3}",
            f"spool{first - 1 + k}",
            (
                bounded(
                    "speed_rpm",
                    compute=element("rpm", k),
                    invert=put_element("rpm", k),
                ),
            ),
        )
        for first in (1, 5, 9, 13)
        for k in range(4)
    )


NAMED_INPUTS: dict[str, tuple[str, str, float]] = {
    "AS2": ("airspeed1", "cas_m_s", 1.0),
    "AOA1": ("aoa0", "aoa_rad", DEG),
    "AOA2": ("aoa1", "aoa_rad", DEG),
    "AOA3": ("aoa2", "aoa_rad", DEG),
    "RPM1": ("spool0", "speed_rpm", 1.0),
    "RPM2": ("spool1", "speed_rpm", 1.0),
    "RPM3": ("spool2", "speed_rpm", 1.0),
    "RPM4": ("spool3", "speed_rpm", 1.0),
}
"""NAMED_VALUE_FLOAT name -> sensor, field, factor to SI."""


def named_source(name: str, sensor: str, into: str, scale: float) -> Source:
    """Source of a sensor that comes as a NAMED_VALUE_FLOAT."""
    fills: tuple[Fill, ...] = (bounded(into, ("value",), scale),)
    if into == "cas_m_s":
        fills += (_NO_PRESSURE,)
    return Source("NAMED_VALUE_FLOAT", "NAMED_VALUE_FLOAT", sensor, fills, named=name)


def _scaled_pressure(message: str, instance: int) -> tuple[Source, ...]:
    return (
        Source("SCALED_PRESSURE", message, f"baro{instance}", _BARO),
        Source("SCALED_PRESSURE", message, f"airspeed{instance}", (_DIFF_PRESS,), ratio=True),
    )


SOURCES: tuple[Source, ...] = (
    # specific force and rates
    Source("HIGHRES_IMU", "HIGHRES_IMU", "imu{}", _imu(1.0, 1.0), instance="id"),
    Source("RAW_IMU", "RAW_IMU", "imu{}", _imu(MILLI_G, 1e-3), instance="id"),
    Source("SCALED_IMU", "SCALED_IMU", "imu0", _imu(MILLI_G, 1e-3)),
    Source("SCALED_IMU", "SCALED_IMU2", "imu1", _imu(MILLI_G, 1e-3)),
    Source("SCALED_IMU", "SCALED_IMU3", "imu2", _imu(MILLI_G, 1e-3)),
    # attitude
    Source(
        "ATTITUDE_QUATERNION",
        "ATTITUDE_QUATERNION",
        "attitude",
        (
            Fill("q_ned_from_frd", compute=QUATERNION, invert=quaternion_fields),
            _BODY_RATE,
        ),
    ),
    Source(
        "ATTITUDE",
        "ATTITUDE",
        "attitude",
        (
            Fill("q_ned_from_frd", compute=EULER, invert=euler_from_quaternion),
            _BODY_RATE,
        ),
    ),
    # position and velocity
    Source("GPS_RAW_INT", "GPS_RAW_INT", "gps0", _GPS),
    Source("GPS2_RAW", "GPS2_RAW", "gps1", _GPS),
    Source("GLOBAL_POSITION_INT", "GLOBAL_POSITION_INT", "nav", _NAV),
    # airspeed and pressure
    Source(
        "AIRSPEED",
        "AIRSPEED",
        "airspeed{}",
        (
            bounded("cas_m_s", ("airspeed",)),
            Fill("diff_press_pa", ("raw_press",), HPA, required=False),
        ),
        instance="id",
    ),
    *_scaled_pressure("SCALED_PRESSURE", 0),
    *_scaled_pressure("SCALED_PRESSURE2", 1),
    *_scaled_pressure("SCALED_PRESSURE3", 2),
    Source(
        "HIGHRES_IMU",
        "HIGHRES_IMU",
        "baro{}",
        (
            bounded("static_press_pa", ("abs_pressure",), HPA),
            bounded("temperature_k", ("temperature",), 1.0, ZERO_CELSIUS_K),
        ),
        instance="id",
        only=Condition("fields_updated", _HIGHRES_PRESSURE),
    ),
    Source(
        "HIGHRES_IMU",
        "HIGHRES_IMU",
        "airspeed{}",
        (bounded("diff_press_pa", ("diff_pressure",), HPA),),
        instance="id",
        only=Condition("fields_updated", _HIGHRES_DIFFERENTIAL),
        ratio=True,
    ),
    Source(
        "VFR_HUD",
        "VFR_HUD",
        "airspeed0",
        (bounded("cas_m_s", ("airspeed",)), _NO_PRESSURE),
        synthetic=True,
    ),
    # angle of attack
    Source(
        "SENSOR_AIRFLOW_ANGLES",
        "SENSOR_AIRFLOW_ANGLES",
        "aoa0",
        _aoa("angleofattack"),
        only=Condition("angleofattack_valid"),
    ),
    Source("AOA_SSA", "AOA_SSA", "aoa0", _aoa("AOA")),
    # engine speeds
    Source("RPM", "RPM", "spool0", _rpm("rpm1")),
    Source("RPM", "RPM", "spool1", _rpm("rpm2")),
    Source("RAW_RPM", "RAW_RPM", "spool{}", _rpm("frequency"), instance="index"),
    Source("EFI_STATUS", "EFI_STATUS", "spool0", _rpm("rpm")),
    *_escs(),
    # the rest of what the monitor asks for
    Source(
        "SERVO_OUTPUT_RAW",
        "SERVO_OUTPUT_RAW",
        "servo",
        (Fill("pwm_us", tuple(f"servo{k}_raw" for k in range(1, 17))),),
        only=Condition("port", equals=0),
    ),
    Source(
        "NAV_CONTROLLER_OUTPUT",
        "NAV_CONTROLLER_OUTPUT",
        "demand",
        (
            Fill("height_error_m", ("alt_error",)),
            Fill("airspeed_error_sign", compute=sign("aspd_error")),
        ),
    ),
    Source(
        "HEARTBEAT",
        "HEARTBEAT",
        "heartbeat",
        (
            Fill("vehicle_type", ("type",)),
            Fill("autopilot", ("autopilot",)),
            Fill("armed", compute=flag("base_mode", SAFETY_ARMED)),
            Fill("autonomous", compute=flag("base_mode", AUTO_OR_GUIDED)),
            Fill("system_status", ("system_status",)),
        ),
        only=Condition("autopilot", unlike=AUTOPILOT_INVALID),
    ),
    Source(
        "EXTENDED_SYS_STATE",
        "EXTENDED_SYS_STATE",
        "landed",
        (Fill("landed_state", ("landed_state",)),),
    ),
    Source(
        "SYS_STATUS",
        "SYS_STATUS",
        "sys_status",
        tuple(Fill(w, (f"onboard_control_sensors_{w}",)) for w in ("present", "enabled", "health")),
    ),
    Source(
        "PARAM_VALUE",
        "PARAM_VALUE",
        "param",
        (Fill("name", ("param_id",)), Fill("value", ("param_value",))),
    ),
    Source(
        "STATUSTEXT",
        "STATUSTEXT",
        "text",
        (Fill("severity", ("severity",)), Fill("text", ("text",))),
    ),
    Source(
        "NAMED_VALUE_FLOAT",
        "NAMED_VALUE_FLOAT",
        "named",
        (Fill("name", ("name",)), Fill("value", ("value",))),
    ),
)
"""Every MAVLink input, in the order in which the rows of one message are numbered.

The named values of :data:`NAMED_INPUTS` come besides, by :func:`named_source`.
"""

RANKING: dict[str, tuple[str, ...]] = {
    "imu": ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU"),
    "attitude": ("ATTITUDE_QUATERNION", "ATTITUDE"),
    "gps": ("GPS_RAW_INT", "GPS2_RAW"),
    "nav": ("GLOBAL_POSITION_INT",),
    "airspeed": ("AIRSPEED", "SCALED_PRESSURE", "HIGHRES_IMU", "NAMED_VALUE_FLOAT", "VFR_HUD"),
    "baro": ("SCALED_PRESSURE", "HIGHRES_IMU"),
    "aoa": ("NAMED_VALUE_FLOAT", "SENSOR_AIRFLOW_ANGLES"),
    "spool": ("RPM", "RAW_RPM", "EFI_STATUS", "ESC_TELEMETRY", "NAMED_VALUE_FLOAT"),
    "servo": ("SERVO_OUTPUT_RAW",),
    "demand": ("NAV_CONTROLLER_OUTPUT",),
    "heartbeat": ("HEARTBEAT",),
    "landed": ("EXTENDED_SYS_STATE",),
    "sys_status": ("SYS_STATUS",),
    "param": ("PARAM_VALUE",),
    "text": ("STATUSTEXT",),
    "named": ("NAMED_VALUE_FLOAT",),
}
"""Quantity -> sources, best first. AOA_SSA is computed by ArduPilot, not a vane: it is used only
where a configuration ranks it."""

RANKING_BY_AUTOPILOT: dict[int, dict[str, tuple[str, ...]]] = {
    AUTOPILOT_PX4: {"imu": ("SCALED_IMU", "RAW_IMU", "HIGHRES_IMU")},
}
"""What differs by HEARTBEAT.autopilot: PX4 takes its filter's bias estimate out of HIGHRES_IMU."""

STAMPS: dict[str, tuple[str, Stamp, int]] = {
    "HIGHRES_IMU": ("time_usec", Stamp.USEC, 1),
    "RAW_IMU": ("time_usec", Stamp.USEC, 1),
    "SCALED_IMU": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SCALED_IMU2": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SCALED_IMU3": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "ATTITUDE": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "ATTITUDE_QUATERNION": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "GLOBAL_POSITION_INT": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SCALED_PRESSURE": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SCALED_PRESSURE2": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SCALED_PRESSURE3": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SYSTEM_TIME": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SENSOR_AIRFLOW_ANGLES": ("timestamp", Stamp.USEC, 1),
    "AOA_SSA": ("time_usec", Stamp.USEC, 1),
    "NAMED_VALUE_FLOAT": ("time_boot_ms", Stamp.BOOT_MS, 1000),
    "SERVO_OUTPUT_RAW": ("time_usec", Stamp.USEC_32, 1),
    "GPS_RAW_INT": ("time_usec", Stamp.FIX, 1),
    "GPS2_RAW": ("time_usec", Stamp.FIX, 1),
}
"""Message -> field with its stamp, how to read it, microseconds per unit. Others have none."""

FROM_ANY_COMPONENT = frozenset({"text", "named"})
"""Quantities taken from every component of the vehicle but our own; others from the autopilot's.

So a named value becomes a *sensor* only when it comes from where sensors are taken from.
"""
