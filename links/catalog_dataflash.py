"""The table for ArduPilot's DataFlash (.BIN): which message gives which sensor.

:data:`links.dataflash_columns.COLUMNS` names what is read of each message and in which unit the
fills below expect it; a log that tells its units has them converted, an older one has ArduPilot's
own. Messages of before 2021, in which the number of a sensor is part of the name (``IMU2``,
``BAR2``), have lines of their own.

What the simulator logs of its truth (``SIM``, ``SIM2``) is no input, and neither is ``AOA``, which
ArduPilot computes from airspeed, wind and velocity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from links.catalog import ZERO_CELSIUS_K, Fill, bounded
from links.conversions import DEG, NO_VALUE, Conversion, Floats, Op, Payload
from links.dataflash_columns import (
    ACC,
    BIAS,
    CHANNELS,
    ESCS,
    GYRO,
    NAMED,
    PARAMETER,
    VEHICLE,
    VELOCITY,
)
from links.record_sources import Joined, Leader, RecordSource

__all__ = [
    "AUTOPILOT_ARDUPILOT",
    "RANKING",
    "SOURCES",
    "VEHICLE_TYPES",
    "named_sources",
]

AUTOPILOT_ARDUPILOT = 3
VEHICLE_TYPES = {3: 1, 2: 2, 1: 10, 7: 12, 12: 7}
"""VER.BU -> MAV_TYPE: Plane, Copter, Rover, Sub, Blimp."""

_AUTONOMOUS = (1, 10, 11, 12, 13, 14, 15, 21, 24, 25, 26)
"""ArduPlane's modes that its HEARTBEAT calls guided: CIRCLE, AUTO, RTL, LOITER, TAKEOFF,
AVOID_ADSB, GUIDED, QRTL, THERMAL, LOITER_ALT_QLAND, AUTOLAND."""

_DIFFERENTIAL_PRESSURE = 0x10  # MAV_SYS_STATUS_SENSOR
_ACTIVE, _STANDBY, _EMERGENCY = 4.0, 3.0, 6.0  # MAV_STATE
_ABSURD = 1e9  # no velocity
_INFO = 6  # MAV_SEVERITY: MSG does not tell one


def _column(p: Payload, name: str) -> Floats:
    return np.asarray(p[name], np.float64)


def _has(p: Payload, name: str) -> bool:
    return name in (p.dtype.names or ())


def _euler(p: Payload) -> Floats:
    angles = np.empty(len(p), [(name, "<f8") for name in ("Roll", "Pitch", "Yaw")])
    for name in angles.dtype.names or ():
        angles[name] = _column(p, name) * DEG
    return Conversion(Op.QUATERNION_OF_EULER, ("Roll", "Pitch", "Yaw"))(angles)


def _velocity(p: Payload) -> Floats:
    course, speed = _column(p, "GCrs") * DEG, _column(p, "Spd")
    down = _column(p, "VZ") if _has(p, "VZ") else np.full(len(p), np.nan)
    return np.stack([speed * np.cos(course), speed * np.sin(course), down], axis=1)


def _no_vertical(p: Payload) -> Floats:
    """Added to a velocity: makes its down component absurd where the receiver has none."""
    out = np.zeros((len(p), 3))
    out[p["VV"] == 0, 2] = _ABSURD
    return out


def _accuracy(name: str) -> Callable[[Payload], Floats]:
    def compute(p: Payload) -> Floats:
        value = _column(p, name)
        return np.where(value > 0.0, value, np.nan)

    return compute


def _pwm(names: tuple[str, ...]) -> Callable[[Payload], Floats]:
    """Those channels among sixteen, 0 for the others, as MAVLink has it."""

    def compute(p: Payload) -> Floats:
        out = np.zeros((len(p), 16))
        for name in names:
            if _has(p, name):
                out[:, int(name[1:]) - 1] = p[name]
        return out

    return compute


def _status(p: Payload) -> Floats:
    state = np.where(p["isFlying"] != 0, _ACTIVE, _STANDBY)
    return np.where(p["Crash"] != 0, _EMERGENCY, state) if _has(p, "Crash") else state


def _primary(p: Payload) -> NDArray[np.bool_]:
    """The pitot that ArduPilot flies by; the first where the log does not tell."""
    if not _has(p, "I"):
        return np.ones(len(p), np.bool_)
    return np.asarray(p["I"] == (p["Pri"] if _has(p, "Pri") else 0))


def _bit(name: str | None) -> Callable[[Payload], Floats]:
    def compute(p: Payload) -> Floats:
        there = np.ones(len(p), np.bool_) if name is None else p[name] != 0
        return np.where(there, float(_DIFFERENTIAL_PRESSURE), 0.0)

    return compute


def _constant(value: float) -> Callable[[Payload], Floats]:
    return lambda p: np.full(len(p), value)


# --------------------------------------------------------------------------- lines by quantity

_LANE = Leader("XKF4", "PI")
"""The filter's lane in use; each runs on the IMU of its number."""

_IN_BODY = (
    Joined(
        "IMU",
        bounded("rate_rad_s", GYRO, required=False),
        instance="I",
        leader=_LANE,
    ),
    Joined(
        "XKF1",
        bounded("rate_rad_s", BIAS, -DEG, required=False),
        instance="C",
        leader=_LANE,
        add=True,
    ),
)
"""The autopilot's body rates: its gyro's less the filter's bias."""


def _imu(message: str, sensor: str) -> RecordSource:
    return RecordSource(
        "IMU",
        message,
        sensor,
        (
            bounded("acc_m_s2", ACC),
            bounded("gyro_rad_s", GYRO),
        ),
        instance="I" if sensor.endswith("{}") else None,
    )


def _gps(message: str, accuracy: str, sensor: str) -> RecordSource:
    instance = "I" if sensor.endswith("{}") else None
    fields = (("HAcc", "h_std_m"), ("VAcc", "v_std_m"), ("SAcc", "vel_std_m_s"))
    # an accuracy message of this receiver alone counts as instance 0 of itself
    own = None if instance else Leader("(none)", "")
    joins = [
        Joined(
            accuracy,
            Fill(into, (name,), compute=_accuracy(name), required=False),
            instance=instance,
            leader=own,
        )
        for name, into in fields
    ]
    vertical = Fill(
        "vel_ned_m_s", ("VV",), compute=_no_vertical, required=False, low=-1e4, high=1e4
    )
    joins.append(Joined(accuracy, vertical, instance=instance, leader=own, add=True))
    return RecordSource(
        "GPS",
        message,
        sensor,
        (
            Fill("fix_type", ("Status",)),
            bounded("lat_rad", ("Lat",), DEG),
            bounded("lon_rad", ("Lng",), DEG),
            bounded("alt_m", ("Alt",)),
            Fill("vel_ned_m_s", compute=_velocity, required=False),
            *(Fill(into, compute=NO_VALUE, required=False) for _, into in fields),
            Fill("satellites", ("NSats",)),
        ),
        instance=instance,
        needs=("Spd", "GCrs"),
        joined=tuple(joins),
    )


def _airspeed(message: str, sensor: str) -> RecordSource:
    return RecordSource(
        "ARSP",
        message,
        sensor,
        (bounded("diff_press_pa", ("DiffPress",)),),
        instance="I" if sensor.endswith("{}") else None,
        ratio=True,
    )


def _baro(message: str, sensor: str) -> RecordSource:
    return RecordSource(
        "BARO",
        message,
        sensor,
        (
            bounded("static_press_pa", ("Press",)),
            bounded("temperature_k", ("Temp",), 1.0, ZERO_CELSIUS_K),
        ),
        instance="I" if sensor.endswith("{}") else None,
    )


def _rpm(key: str, message: str, sensor: str, name: str, instance: str = "") -> RecordSource:
    return RecordSource(
        key,
        message,
        sensor,
        (bounded("speed_rpm", (name,)),),
        instance=instance or None,
    )


SOURCES: tuple[RecordSource, ...] = (
    _imu("IMU", "imu{}"),
    _imu("IMU2", "imu1"),
    _imu("IMU3", "imu2"),
    RecordSource(
        "ATT",
        "ATT",
        "attitude",
        (Fill("q_ned_from_frd", compute=_euler),),
        needs=("Roll", "Pitch", "Yaw"),
        joined=_IN_BODY,
    ),
    RecordSource(
        "XKQ",
        "XKQ",
        "attitude",
        (
            Fill(
                "q_ned_from_frd",
                compute=Conversion(Op.UNIT_QUATERNION, ("Q1", "Q2", "Q3", "Q4")),
            ),
        ),
        only=lambda p: p["C"] == 0 if _has(p, "C") else np.ones(len(p), np.bool_),
        needs=("Q1", "Q2", "Q3", "Q4"),
        joined=_IN_BODY,
    ),
    _gps("GPS", "GPA", "gps{}"),
    _gps("GPS2", "GPA2", "gps1"),
    RecordSource(
        "POS",
        "POS",
        "nav",
        (
            bounded("lat_rad", ("Lat",), DEG),
            bounded("lon_rad", ("Lng",), DEG),
            bounded("alt_m", ("Alt",)),
            bounded("height_m", ("RelHomeAlt",)),
        ),
        joined=(
            Joined(
                "XKF1",
                Fill("vel_ned_m_s", VELOCITY, low=-1e4, high=1e4),
                instance="C",
                leader=_LANE,
            ),
        ),
    ),
    _airspeed("ARSP", "airspeed{}"),
    _airspeed("ASP2", "airspeed1"),
    RecordSource(
        "CTUN",
        "CTUN",
        "airspeed0",
        (
            bounded("cas_m_s", ("As",)),
            Fill("diff_press_pa", compute=NO_VALUE, required=False),
        ),
        synthetic=True,
    ),
    _baro("BARO", "baro{}"),
    _baro("BAR2", "baro1"),
    _baro("BAR3", "baro2"),
    _rpm("RPM", "RPM", "spool{}", "RPM", "I"),
    _rpm("RPM", "RPM", "spool0", "rpm1"),
    _rpm("RPM", "RPM", "spool1", "rpm2"),
    _rpm("EFI", "EFI", "spool0", "Rpm"),
    _rpm("ESC", "ESC", "spool{}", "RPM", "Instance"),
    *(_rpm("ESC", message, f"spool{k}", "RPM") for k, message in enumerate(ESCS)),
    RecordSource(
        "RCOU",
        "RCOU",
        "servo",
        (Fill("pwm_us", compute=_pwm(CHANNELS)),),
        needs=("C1",),
        joined=(
            Joined(
                "RCO2",
                Fill("pwm_us", ("C15", "C16"), compute=_pwm(("C15", "C16")), required=False),
                add=True,
            ),
        ),
    ),
    RecordSource(
        "NTUN",
        "NTUN",
        "demand",
        (
            Fill("height_error_m", ("AltE",)),
            Fill("airspeed_error_sign", compute=lambda p: np.sign(_column(p, "AsE"))),
        ),
        needs=("AsE",),
    ),
    RecordSource(
        "STAT",
        "STAT",
        "heartbeat",
        (
            Fill("autopilot", compute=_constant(AUTOPILOT_ARDUPILOT)),
            Fill("armed", compute=lambda p: np.asarray(p["Armed"] != 0, np.float64)),
            Fill("system_status", compute=_status),
        ),
        needs=("Armed", "isFlying"),
        joined=(
            Joined(VEHICLE, Fill("vehicle_type", ("Type",), low=0.0, high=255.0), add=True),
            Joined(
                "MODE",
                Fill(
                    "autonomous",
                    ("ModeNum",),
                    compute=lambda p: np.isin(p["ModeNum"], _AUTONOMOUS).astype(np.float64),
                    low=0.0,
                    high=1.0,
                ),
                add=True,
            ),
        ),
    ),
    RecordSource(
        "ARSP",
        "ARSP",
        "sys_status",
        (
            Fill("present", compute=_bit(None)),
            Fill("enabled", compute=_bit("U")),
            Fill("health", compute=_bit("H")),
        ),
        only=_primary,
        needs=("U", "H"),
    ),
    RecordSource(
        PARAMETER, PARAMETER, "param", (Fill("name", ("Name",)), Fill("value", ("Value",)))
    ),
    RecordSource(
        "MSG",
        "MSG",
        "text",
        (Fill("severity", compute=_constant(_INFO)), Fill("text", ("Message",))),
    ),
)
"""Every DataFlash input but :data:`NAMED`, in the order in which a record's rows are numbered."""

RANKING: dict[str, tuple[str, ...]] = {
    "imu": ("IMU",),
    "attitude": ("ATT", "XKQ"),
    "gps": ("GPS",),
    "nav": ("POS",),
    "airspeed": ("ARSP", NAMED, "CTUN"),
    "baro": ("BARO",),
    "aoa": (NAMED,),
    "spool": ("RPM", "EFI", "ESC", NAMED),
    "servo": ("RCOU",),
    "demand": ("NTUN",),
    "heartbeat": ("STAT",),
    "sys_status": ("ARSP",),
    "param": (PARAMETER,),
    "text": ("MSG",),
    "named": (NAMED,),
}
"""Quantity -> keys, best first."""


def named_sources(
    inputs: Mapping[str, tuple[str, str, float]],
    own_component: int,
    components: frozenset[int] | None = None,
) -> list[RecordSource]:
    """Rows of NVAL, what the autopilot logged of other components' NAMED_VALUE_FLOAT.

    Parameters
    ----------
    inputs
        Name -> (sensor, field, factor): values that are a sensor's.
    own_component
        What came from it is our own output, never an input.
    components
        Components that sensors are taken from; None for all others.
    """

    def others(p: Payload) -> NDArray[np.bool_]:
        return np.asarray(p["SCom"] != own_component)

    def is_named(name: bytes) -> Callable[[Payload], NDArray[np.bool_]]:
        def mask(p: Payload) -> NDArray[np.bool_]:
            theirs = others(p)
            if components is not None:
                theirs &= np.isin(p["SCom"], list(components))
            return np.asarray(theirs & (p["Name"] == name))

        return mask

    plain = (Fill("name", ("Name",)), Fill("value", ("Value",)))
    out = [RecordSource(NAMED, NAMED, "named", plain, only=others, needs=("SCom",))]
    for name, (sensor, into, scale) in inputs.items():
        fills = [bounded(into, ("Value",), scale)]
        if into == "cas_m_s":
            fills.append(Fill("diff_press_pa", compute=NO_VALUE, required=False))
        out.append(
            RecordSource(
                NAMED,
                NAMED,
                sensor,
                tuple(fills),
                only=is_named(name.encode()),
                needs=("Name", "SCom"),
            )
        )
    return out
