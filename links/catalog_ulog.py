"""The table for PX4's ULog: which topic gives which sensor, in which unit, within which bounds.

Columns carry pyulog's names: elements of arrays as ``q[0]``, of topics within topics as
``esc[0].esc_rpm``. PX4 renames fields from release to release; a sensor then has a line for each
form, and the one whose columns are all there is used. Unlike HIGHRES_IMU, ``vehicle_imu`` and
``sensor_combined`` do not have the filter's bias estimate taken out.

A logger's profile may keep only every hundredth sample of a topic: :data:`RANKING` holds among
topics that are logged about as often, and an IMU that is logged less often than
:data:`IMU_LEAST_HZ` cannot be used at all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi

import numpy as np
from numpy.typing import NDArray

from links.catalog import AUTOPILOT_PX4, ZERO_CELSIUS_K, Fill, bounded
from links.conversions import DEG, Conversion, Floats, Op, Payload
from links.record_sources import Joined, RecordSource

__all__ = [
    "IMU_LEAST_HZ",
    "LOGGED",
    "NAMED",
    "PARAMETER",
    "RANKING",
    "RECEIVED",
    "SOURCES",
    "named_sources",
]

IMU_LEAST_HZ = 8.0
"""Rate below which an IMU's topic is no record of the motion [1/s]."""

PARAMETER, LOGGED, NAMED = "parameter", "logged_message", "debug_key_value"
"""Parameters and logged messages, as the reader calls them; the topic that NAMED_VALUE_FLOAT of
other components is logged as."""

RECEIVED = frozenset({"sensor_gps", "vehicle_gps_position"})
"""Topics timed by their reception (``timestamp``), others by their sample where they tell it."""

RHO_0 = 1.225  # kg/m^3
EARTH_M = 6_371_000.0  # as PX4's map projection
ARMED = 2  # vehicle_status.arming_state
_AUTO = (3, 4, 5, 12, 14, 17, 18, 19, 20, 21, 22)  # vehicle_status.nav_state: AUTO_*, OFFBOARD


def _elements(name: str, count: int = 3) -> tuple[str, ...]:
    return tuple(f"{name}[{k}]" for k in range(count))


def _column(p: Payload, name: str) -> Floats:
    return np.asarray(p[name], np.float64)


def _over_time(names: tuple[str, ...], dt_us: str) -> Callable[[Payload], Floats]:
    """An integral over its time in microseconds."""

    def compute(p: Payload) -> Floats:
        dt = _column(p, dt_us) * 1e-6
        dt[~(dt > 0.0)] = np.nan
        return np.stack([_column(p, name) for name in names], axis=1) / dt[:, None]

    return compute


def _not_below_zero(name: str) -> Callable[[Payload], Floats]:
    return lambda p: np.maximum(_column(p, name), 0.0)


def _cas_of_pressure(name: str) -> Callable[[Payload], Floats]:
    return lambda p: np.sqrt(np.maximum(_column(p, name), 0.0) * (2.0 / RHO_0))


def _pressure_of_airspeed(name: str) -> Callable[[Payload], Floats]:
    return lambda p: 0.5 * RHO_0 * _column(p, name) * np.abs(_column(p, name))


def _less(p: Payload, name: str, other: str) -> Floats:
    return np.asarray(_column(p, name) - _column(p, other))


def _velocity(p: Payload) -> Floats:
    v = np.stack([_column(p, f"vel_{axis}_m_s") for axis in "ned"], axis=1)
    v[p["vel_ned_valid"] == 0] = np.nan
    return v


def _position(p: Payload) -> tuple[Floats, Floats]:
    """Latitude and longitude [rad] of a place given north and east of the filter's origin."""
    lat0, lon0 = _column(p, "ref_lat") * DEG, _column(p, "ref_lon") * DEG
    x, y = _column(p, "x") / EARTH_M, _column(p, "y") / EARTH_M
    c = np.hypot(x, y)
    share = np.where(c > 0.0, np.sin(c) / np.where(c > 0.0, c, 1.0), 1.0)
    lat = np.arcsin(np.clip(np.cos(c) * np.sin(lat0) + x * share * np.cos(lat0), -1.0, 1.0))
    ahead = np.cos(lat0) * np.cos(c) - x * share * np.sin(lat0)
    return lat, lon0 + np.arctan2(y * share, ahead)


_VALID = ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "xy_global", "z_global")
_ANGLES, _SPEEDS = _elements("delta_angle"), _elements("delta_velocity")
_QUATERNION = _elements("q", 4)


def _receiver(message: str, sensor: str, old: bool) -> RecordSource:
    """A receiver's solution: integers up to PX4 1.13, degrees and metres since."""
    new = ("latitude_deg", "longitude_deg", "altitude_msl_m")
    lat, lon, alt = ("lat", "lon", "alt") if old else new
    scale, metres = (1e-7, 1e-3) if old else (1.0, 1.0)
    return RecordSource(
        message,
        message,
        sensor,
        (
            Fill("fix_type", ("fix_type",)),
            bounded("lat_rad", (lat,), scale * DEG),
            bounded("lon_rad", (lon,), scale * DEG),
            bounded("alt_m", (alt,), metres),
            Fill("vel_ned_m_s", compute=_velocity, required=False),
            Fill("h_std_m", ("eph",), required=False),
            Fill("v_std_m", ("epv",), required=False),
            Fill("vel_std_m_s", ("s_variance_m_s",), required=False),
            Fill("satellites", ("satellites_used",)),
        ),
        instance="instance" if sensor.endswith("{}") else None,
        needs=("vel_n_m_s", "vel_e_m_s", "vel_d_m_s", "vel_ned_valid"),
    )


def _pressure(column: str) -> RecordSource:
    return RecordSource(
        "differential_pressure",
        "differential_pressure",
        "airspeed{}",
        (
            bounded("diff_press_pa", (column,)),
            bounded("cas_m_s", compute=_cas_of_pressure(column)),
        ),
        instance="instance",
    )


def _selected(index: str, k: int) -> RecordSource:
    """A pitot while PX4 uses it; what is no pitot's (ground speed less wind) is left out."""
    return RecordSource(
        "airspeed_validated",
        "airspeed_validated",
        f"airspeed{k}",
        (
            bounded("cas_m_s", compute=_not_below_zero("indicated_airspeed_m_s")),
            Fill("diff_press_pa", compute=_pressure_of_airspeed("indicated_airspeed_m_s")),
        ),
        only=lambda p: np.asarray(p[index] == k + 1),
        needs=("indicated_airspeed_m_s", index),
    )


def _rpm(message: str, column: str) -> RecordSource:
    return RecordSource(
        message,
        message,
        "spool{}",
        (bounded("speed_rpm", (column,)),),
        instance="instance",
    )


def _esc(k: int) -> RecordSource:
    return RecordSource(
        "esc_status",
        "esc_status",
        f"spool{k}",
        (bounded("speed_rpm", (f"esc[{k}].esc_rpm",)),),
        only=lambda p: p["esc_count"] > k,
        needs=("esc_count",),
    )


def _air(temperature: str) -> RecordSource:
    return RecordSource(
        "vehicle_air_data",
        "vehicle_air_data",
        "baro0",
        (
            bounded("static_press_pa", ("baro_pressure_pa",)),
            bounded("temperature_k", (temperature,), 1.0, ZERO_CELSIUS_K),
        ),
    )


SOURCES: tuple[RecordSource, ...] = (
    RecordSource(
        "vehicle_imu",
        "vehicle_imu",
        "imu{}",
        (
            bounded(
                "acc_m_s2",
                compute=_over_time(_SPEEDS, "delta_velocity_dt"),
            ),
            bounded(
                "gyro_rad_s",
                compute=_over_time(_ANGLES, "delta_angle_dt"),
            ),
        ),
        instance="instance",
        needs=(*_SPEEDS, *_ANGLES, "delta_velocity_dt", "delta_angle_dt"),
    ),
    RecordSource(
        "sensor_combined",
        "sensor_combined",
        "imu0",
        (
            bounded("acc_m_s2", _elements("accelerometer_m_s2")),
            bounded("gyro_rad_s", _elements("gyro_rad")),
        ),
    ),
    RecordSource(
        "vehicle_attitude",
        "vehicle_attitude",
        "attitude",
        (Fill("q_ned_from_frd", compute=Conversion(Op.UNIT_QUATERNION, _QUATERNION)),),
        needs=_QUATERNION,
        joined=(
            Joined(
                "vehicle_angular_velocity",
                bounded("rate_rad_s", _elements("xyz"), required=False),
            ),
        ),
    ),
    *(_receiver("sensor_gps", "gps{}", old) for old in (False, True)),
    *(_receiver("vehicle_gps_position", "gps0", old) for old in (False, True)),
    RecordSource(
        "vehicle_local_position",
        "vehicle_local_position",
        "nav",
        (
            bounded("lat_rad", compute=lambda p: _position(p)[0]),
            Fill("lon_rad", compute=lambda p: _position(p)[1], low=-2 * pi, high=2 * pi),
            Fill("alt_m", compute=lambda p: _column(p, "ref_alt") - _column(p, "z")),
            bounded("height_m", ("z",), -1.0),
            Fill("vel_ned_m_s", ("vx", "vy", "vz")),
        ),
        only=lambda p: np.logical_and.reduce([p[name] != 0 for name in _VALID]),
        needs=("ref_lat", "ref_lon", "ref_alt", "x", "y", *_VALID),
    ),
    RecordSource(
        "airspeed",
        "airspeed",
        "airspeed{}",
        (
            bounded("cas_m_s", compute=_not_below_zero("indicated_airspeed_m_s")),
            Fill("diff_press_pa", compute=_pressure_of_airspeed("indicated_airspeed_m_s")),
        ),
        instance="instance",
        needs=("indicated_airspeed_m_s",),
    ),
    _pressure("differential_pressure_pa"),
    _pressure("differential_pressure_raw_pa"),
    *(_selected("airspeed_source", k) for k in range(3)),
    *(_selected("selected_airspeed_index", k) for k in range(3)),
    _air("ambient_temperature"),
    _air("baro_temp_celcius"),
    _rpm("rpm", "rpm_estimate"),
    _rpm("rpm", "indicated_frequency_rpm"),
    _rpm("internal_combustion_engine_status", "engine_speed_rpm"),
    *(_esc(k) for k in range(8)),
    RecordSource(
        "tecs_status",
        "tecs_status",
        "demand",
        (
            Fill("height_error_m", compute=lambda p: _less(p, "altitude_sp", "altitude_filtered")),
            Fill(
                "airspeed_error_sign",
                compute=lambda p: np.sign(_less(p, "true_airspeed_sp", "true_airspeed_filtered")),
            ),
        ),
        needs=("altitude_sp", "altitude_filtered", "true_airspeed_sp", "true_airspeed_filtered"),
    ),
    RecordSource(
        "actuator_outputs",
        "actuator_outputs",
        "servo",
        (Fill("pwm_us", _elements("output", 16), required=False),),
    ),
    RecordSource(
        "vehicle_status",
        "vehicle_status",
        "heartbeat",
        (
            Fill("vehicle_type", ("system_type",)),
            Fill("autopilot", compute=lambda p: np.full(len(p), float(AUTOPILOT_PX4))),
            Fill("armed", compute=lambda p: np.asarray(p["arming_state"] == ARMED, np.float64)),
            Fill("autonomous", compute=lambda p: np.isin(p["nav_state"], _AUTO).astype(np.float64)),
            Fill("system_status", compute=lambda p: np.where(p["arming_state"] == ARMED, 4.0, 3.0)),
        ),
        needs=("arming_state", "nav_state"),
    ),
    RecordSource(
        "vehicle_land_detected",
        "vehicle_land_detected",
        "landed",
        (Fill("landed_state", compute=lambda p: np.where(p["landed"] != 0, 1.0, 2.0)),),
        needs=("landed",),
    ),
    RecordSource(
        PARAMETER, PARAMETER, "param", (Fill("name", ("name",)), Fill("value", ("value",)))
    ),
    RecordSource(
        LOGGED, LOGGED, "text", (Fill("severity", ("severity",)), Fill("text", ("text",)))
    ),
    RecordSource(NAMED, NAMED, "named", (Fill("name", ("key",)), Fill("value", ("value",)))),
)
"""Every ULog input, in the order in which the rows of one message are numbered.

Where ``instance`` is set the topic's own is the sensor's; of other topics the first counts.
"""

RANKING: dict[str, tuple[str, ...]] = {
    "imu": ("vehicle_imu", "sensor_combined"),
    "attitude": ("vehicle_attitude",),
    "gps": ("sensor_gps", "vehicle_gps_position"),
    "nav": ("vehicle_local_position",),
    "airspeed": ("airspeed", "differential_pressure", "airspeed_validated", NAMED),
    "baro": ("vehicle_air_data",),
    "aoa": (NAMED,),
    "spool": ("rpm", "internal_combustion_engine_status", "esc_status", NAMED),
    "servo": ("actuator_outputs",),
    "demand": ("tecs_status",),
    "heartbeat": ("vehicle_status",),
    "landed": ("vehicle_land_detected",),
    "param": (PARAMETER,),
    "text": (LOGGED,),
    "named": (NAMED,),
}
"""Quantity -> topics, best first."""


def named_sources(inputs: Mapping[str, tuple[str, str, float]]) -> list[RecordSource]:
    """Sensors that come as named values (NAMED_VALUE_FLOAT name -> sensor, field, factor)."""
    out = []
    for name, (sensor, into, scale) in inputs.items():
        fills = [bounded(into, ("value",), scale)]
        if into == "cas_m_s":
            unknown = Conversion(Op.NO_VALUE)
            fills.append(Fill("diff_press_pa", compute=unknown, required=False))
        out.append(
            RecordSource(
                NAMED, NAMED, sensor, tuple(fills), only=_is_named(name.encode()), needs=("key",)
            )
        )
    return out


def _is_named(name: bytes) -> Callable[[Payload], NDArray[np.bool_]]:
    return lambda p: np.asarray(p["key"] == name)
