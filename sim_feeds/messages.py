"""Readings turned into the fields of MAVLink messages: units, scales and stamps as ArduPlane sends.

Each function gives a :class:`Sending`: when each message goes out and its fields, vectorised over
the flight. Rounding to the message's integers happens here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi, radians
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim_feeds.airframe import AIRFRAMES
from sim_feeds.earth import STANDARD_GRAVITY_M_S2
from sim_feeds.rotation import euler_from_matrix, rotate_back
from sim_feeds.scenario import Flight
from sim_feeds.sensors import Series, lagged, markov, stream

__all__ = ["UNIX_START_S", "Sending", "sendings"]

Floats = NDArray[np.float64]

UNIX_START_S: Final = 1_735_732_800
"""Unix time of every flight's first moment (2025-01-01 12:00 UTC): part of what is reproducible."""
FIELD_NED_MGAUSS: Final = np.array([195.0, 5.0, 445.0])
DELAY_S: Final = 0.002
"""From computing a value to its transmission."""
MS: Final = 1_000
US: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Sending:
    """One message type, or one instance of it, over the flight.

    Attributes
    ----------
    message
        Class of the dialect.
    sent_us : (n,) int64
        Vehicle time of transmission, ascending.
    columns
        Per field a sequence of n values or one constant.
    """

    message: type[Any]
    sent_us: NDArray[np.int64]
    columns: Sequence[Any]

    def __iter__(self) -> Iterator[tuple[int, tuple[Any, ...]]]:
        """Time and fields, in order of time."""
        n = len(self.sent_us)
        lists = [
            c.tolist() if isinstance(c, np.ndarray) else c if isinstance(c, list) else [c] * n
            for c in self.columns
        ]
        return zip(self.sent_us.tolist(), zip(*lists, strict=True), strict=True)


def sendings(flight: Flight) -> list[Sending]:
    """Everything that the autopilot sends during the flight."""
    m = flight.scenario.messages
    out = [*_status(flight), *_parameters(flight), *_inertial(flight), *_air(flight)]
    out += [*_vanes(flight), *_satellites(flight), *_attitude(flight), *_position(flight)]
    out += _hud(flight) if m.hud_hz else []
    out += _engine(flight)
    return [s for s in out if len(s.sent_us)]


def _boot(flight: Flight, t_s: Floats, per_s: int) -> NDArray[np.int64]:
    """Vehicle time in units of 1 / per_s of times of the flight."""
    whole = np.rint((np.asarray(t_s) + flight.scenario.start.boot_s) * per_s)
    return np.asarray(whole.astype(np.int64))


def _whole(x: Floats, low: float = -32768, high: float = 32767) -> NDArray[np.int64]:
    return np.asarray(np.clip(np.rint(x), low, high).astype(np.int64))


def _unsigned(x: Floats) -> NDArray[np.int64]:
    return _whole(x, 0, 65535)


def _even(flight: Flight, rate_hz: float, name: str) -> tuple[Floats, NDArray[np.int64]]:
    """Even times of a message that the autopilot computes, and when each is sent."""
    rng = stream(flight.seed, f"message {name}")
    end = flight.truth.t_s[-1]
    t = np.arange(0.0, end, 1.0 / rate_hz)
    late = DELAY_S * (1.0 + rng.exponential(size=len(t)))
    return t, _boot(flight, np.maximum.accumulate(t + late), US)


def _hold(series: Series, t_s: Floats, column: int) -> Floats:
    """Last reading before each time; the first one before that."""
    i = np.clip(np.searchsorted(series.valid_s, t_s, "right") - 1, 0, None)
    return np.asarray(series.values[i, column])


def _status(flight: Flight) -> Iterator[Sending]:
    """HEARTBEAT, SYSTEM_TIME, SYS_STATUS, EXTENDED_SYS_STATE."""
    truth, m = flight.truth, flight.scenario.messages
    t = np.arange(0.0, truth.t_s[-1], 1.0)
    sent = _boot(flight, t, US)
    moving = np.flatnonzero(np.hypot(truth.vel_ned_m_s[:, 0], truth.vel_ned_m_s[:, 1]) > 0.1)
    last_s = float(truth.t_s[moving[-1]]) + 2.0 if len(moving) else 0.0
    armed = (t >= min(m.arm_s, last_s)) & (t < last_s)
    armed |= (t < last_s) & (truth.airborne[0] > 0.5)
    safety = np.where(armed, dialect.MAV_MODE_FLAG_SAFETY_ARMED, 0)
    mode = safety | dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_AUTO_ENABLED
    state = np.where(armed, dialect.MAV_STATE_ACTIVE, dialect.MAV_STATE_STANDBY)
    yield Sending(
        dialect.MAVLink_heartbeat_message,
        sent,
        [
            dialect.MAV_TYPE_FIXED_WING,
            dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mode,
            AUTO_MODE,
            state,
            3,
        ],
    )
    unix = _boot(flight, t, US) - _boot(flight, np.zeros(1), US) + UNIX_START_S * US
    yield Sending(dialect.MAVLink_system_time_message, sent, [unix, _boot(flight, t, MS)])

    t, sent = _even(flight, m.status_hz, "status")
    bits = (
        dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO
        | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL
        | dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
        | dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
        | dialect.MAV_SYS_STATUS_AHRS
    )
    if flight.scenario.airspeed.count:
        bits |= dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
    if flight.scenario.gps.count:
        bits |= dialect.MAV_SYS_STATUS_SENSOR_GPS
    yield Sending(
        dialect.MAVLink_sys_status_message,
        sent,
        [bits, bits, bits, 250, 22_200, 1_500, 80, *[0] * 6],
    )
    share = np.interp(t, truth.t_s, truth.airborne)
    climb = np.gradient(share)
    landed = np.select(
        [share >= 1.0, share <= 0.0, climb > 0.0],
        [
            dialect.MAV_LANDED_STATE_IN_AIR,
            dialect.MAV_LANDED_STATE_ON_GROUND,
            dialect.MAV_LANDED_STATE_TAKEOFF,
        ],
        dialect.MAV_LANDED_STATE_LANDING,
    )
    yield Sending(dialect.MAVLink_extended_sys_state_message, sent, [0, landed])


AUTO_MODE: Final = 10
"""custom_mode of ArduPlane's AUTO."""


def _parameters(flight: Flight) -> Iterator[Sending]:
    """PARAM_VALUE of what a listener needs to know of pitots and servos, once at the start."""
    a = flight.scenario.airspeed
    values = {
        f"ARSPD{i + 1 if i else ''}_{key}": value
        for i in range(min(a.count, 2))
        for key, value in (("TYPE", 1.0), ("RATIO", a.ratio))
    }
    if flight.controls is not None:
        for i, servo in enumerate(SERVOS, start=1):
            keys = ("FUNCTION", "MIN", "TRIM", "MAX", "REVERSED")
            values |= {f"SERVO{i}_{key}": x for key, x in zip(keys, servo, strict=True)}
    names = [name.encode() for name in values]
    yield Sending(
        dialect.MAVLink_param_value_message,
        _boot(flight, np.linspace(0.01, 0.05, len(names)), US),
        [
            names,
            list(values.values()),
            dialect.MAV_PARAM_TYPE_REAL32,
            len(names),
            np.arange(len(names)),
        ],
    )


def _inertial(flight: Flight) -> Iterator[Sending]:
    """RAW_IMU and SCALED_IMU2/3, or HIGHRES_IMU(id)."""
    classes = (
        dialect.MAVLink_raw_imu_message,
        dialect.MAVLink_scaled_imu2_message,
        dialect.MAVLink_scaled_imu3_message,
    )
    highres = flight.scenario.messages.imu == "highres"
    for i in range(flight.scenario.imu.count):
        s = flight.readings[f"imu{i}"]
        sent = _boot(flight, s.sent_s, US)
        field = rotate_back(flight.truth.at(s.valid_s).ned_from_frd, FIELD_NED_MGAUSS)
        if highres:
            columns = [
                _boot(flight, s.stamp_s, US),
                *s.values.T,
                *(field.T / 1000.0),
                *[0.0] * 4,
                HIGHRES_FIELDS,
                i,
            ]
            yield Sending(dialect.MAVLink_highres_imu_message, sent, columns)
            continue
        whole = [
            *(_whole(x) for x in s.values[:, :3].T * (1000.0 / STANDARD_GRAVITY_M_S2)),
            *(_whole(x) for x in s.values[:, 3:].T * 1000.0),
            *(_whole(x) for x in field.T),
        ]
        stamp = _boot(flight, s.stamp_s, US if i == 0 else MS)
        tail = [0, 4500] if i == 0 else [4500]
        yield Sending(classes[i], sent, [stamp, *whole, *tail])


HIGHRES_FIELDS: Final = 0x1FF
"""fields_updated: acceleration, rates, magnetic field."""


def _air(flight: Flight) -> Iterator[Sending]:
    """SCALED_PRESSURE/2/3, timed by the airspeed sensor that shares it, and AIRSPEED(id)."""
    classes = (
        dialect.MAVLink_scaled_pressure_message,
        dialect.MAVLink_scaled_pressure2_message,
        dialect.MAVLink_scaled_pressure3_message,
    )
    spec = flight.scenario
    for i, message in enumerate(classes):
        pitot, baro = flight.readings.get(f"airspeed{i}"), flight.readings.get(f"baro{i}")
        source = pitot or baro
        if source is None:
            continue
        port = baro or flight.readings.get("baro0")
        t, sent = source.valid_s, _boot(flight, source.sent_s, US)
        absolute = _hold(port, t, 0) / 100.0 if port else np.zeros(len(t))
        kelvin = _hold(port, t, 1) if port else np.full(len(t), 293.15)
        difference = pitot.values[:, 1] / 100.0 if pitot else np.zeros(len(t))
        celsius = _whole((kelvin - 273.15) * 100.0)
        stamp = _boot(flight, source.stamp_s, MS)
        yield Sending(message, sent, [stamp, absolute, difference, celsius, 0])
        if pitot and spec.messages.airspeed == "airspeed":
            columns = [i, pitot.values[:, 0], celsius, pitot.values[:, 1] / 100.0, 0]
            yield Sending(dialect.MAVLink_airspeed_message, sent + 100, columns)


def _vanes(flight: Flight) -> Iterator[Sending]:
    """NAMED_VALUE_FLOAT AOA1..AOA3, degrees."""
    for i in range(flight.scenario.aoa.count):
        s = flight.readings[f"aoa{i}"]
        stamp, degrees = _boot(flight, s.stamp_s, MS), np.degrees(s.values[:, 0])
        name = f"AOA{i + 1}".encode()
        sent = _boot(flight, s.sent_s, US)
        yield Sending(dialect.MAVLink_named_value_float_message, sent, [stamp, name, degrees])


def _satellites(flight: Flight) -> Iterator[Sending]:
    """GPS_RAW_INT, GPS2_RAW."""
    spec = flight.scenario.gps
    for i in range(min(spec.count, 2)):
        s = flight.readings[f"gps{i}"]
        lat, lon, height, north, east, _, fix = s.values.T
        speed = np.hypot(north, east)
        course = np.degrees(np.arctan2(east, north)) % 360.0
        alt = _whole(height * 1000.0, -2e9, 2e9)
        head = [
            _boot(flight, s.stamp_s, US),
            np.where(fix > 0.0, dialect.GPS_FIX_TYPE_3D_FIX, dialect.GPS_FIX_TYPE_NO_FIX),
            _whole(np.degrees(lat) * 1e7, -9e8, 9e8),
            _whole(np.degrees(lon) * 1e7, -18e8, 18e8),
            alt,
            80,
            120,
            _unsigned(speed * 100.0),
            _unsigned(course * 100.0) % 36_000,
            spec.satellites,
        ]
        accuracy = [
            int(spec.position_std_m * 1000.0),
            int(spec.height_std_m * 1000.0),
            int(1000.0 * np.hypot(spec.velocity_std_m_s, spec.slow_velocity_std_m_s)),
            0,
        ]
        sent = _boot(flight, s.sent_s, US)
        if i == 0:
            yield Sending(dialect.MAVLink_gps_raw_int_message, sent, [*head, alt, *accuracy, 0])
        else:
            tail = [0, 0, 0, alt, *accuracy]
            yield Sending(dialect.MAVLink_gps2_raw_message, sent, [*head, *tail])


def _at_solution(flight: Flight, rate_hz: float, name: str) -> tuple[Any, NDArray[np.int64]]:
    """Indices of the newest solutions at even times, and when they are sent."""
    t, sent = _even(flight, rate_hz, name)
    i = np.searchsorted(flight.navigation.t_s, t, "right") - 1
    return i[i >= 0], sent[i >= 0]


def _attitude(flight: Flight) -> Iterator[Sending]:
    """ATTITUDE and ATTITUDE_QUATERNION."""
    nav, m = flight.navigation, flight.scenario.messages
    i, sent = _at_solution(flight, m.attitude_hz, "attitude")
    stamp = _boot(flight, nav.t_s[i], MS)
    angles = euler_from_matrix(nav.ned_from_frd[i])
    yield Sending(dialect.MAVLink_attitude_message, sent, [stamp, *angles.T, *nav.rate_rad_s[i].T])
    if m.quaternion_hz:
        i, sent = _at_solution(flight, m.quaternion_hz, "quaternion")
        stamp = _boot(flight, nav.t_s[i], MS)
        turn = [*nav.q_ned_from_frd[i].T, *nav.rate_rad_s[i].T]
        yield Sending(dialect.MAVLink_attitude_quaternion_message, sent, [stamp, *turn])


def _position(flight: Flight) -> Iterator[Sending]:
    """GLOBAL_POSITION_INT of the autopilot's own filter."""
    nav, truth = flight.navigation, flight.truth
    i, sent = _at_solution(flight, flight.scenario.messages.position_hz, "position")
    t = nav.t_s[i]
    here = truth.at(t)
    rng = stream(flight.seed, "position error")
    error = np.column_stack([markov(rng, t, 0.6, 30.0) for _ in "NED"])
    home_m = flight.scenario.start.field_m if flight.controls else truth.height_m[0]
    radius = 6_367_000.0
    lat = here.lat_rad + error[:, 0] / radius
    lon = here.lon_rad + error[:, 1] / (radius * np.cos(here.lat_rad))
    velocity = nav.vel_ned_m_s[i] * 100.0
    heading = np.degrees(euler_from_matrix(nav.ned_from_frd[i])[:, 2]) % 360.0
    yield Sending(
        dialect.MAVLink_global_position_int_message,
        sent,
        [
            _boot(flight, t, MS),
            _whole(np.degrees(lat) * 1e7, -9e8, 9e8),
            _whole(np.degrees(lon) * 1e7, -18e8, 18e8),
            _whole((here.height_m + error[:, 2]) * 1000.0, -2e9, 2e9),
            _whole((here.height_m + error[:, 2] - home_m) * 1000.0, -2e9, 2e9),
            *(_whole(v) for v in velocity.T),
            _unsigned(heading * 100.0) % 36_000,
        ],
    )


def _hud(flight: Flight) -> list[Sending]:
    """VFR_HUD, with the first airspeed sensor's reading."""
    nav, m = flight.navigation, flight.scenario.messages
    i, sent = _at_solution(flight, m.hud_hz, "hud")
    t, vel = nav.t_s[i], nav.vel_ned_m_s[i]
    pitot = flight.readings.get("airspeed0")
    heading = np.degrees(euler_from_matrix(nav.ned_from_frd[i])[:, 2]) % 360.0
    throttle = 100.0 * np.interp(t, flight.truth.t_s, _throttle(flight))
    return [
        Sending(
            dialect.MAVLink_vfr_hud_message,
            sent,
            [
                _hold(pitot, t, 0) if pitot else np.hypot(vel[:, 0], vel[:, 1]),
                np.hypot(vel[:, 0], vel[:, 1]),
                _whole(heading, 0, 359),
                _unsigned(throttle),
                flight.truth.at(t).height_m,
                -vel[:, 2],
            ],
        )
    ]


def _throttle(flight: Flight) -> Floats:
    """Throttle in 0..1 on the truth grid.

    What the autopilot asks; of a kinematic aircraft level flight, plus what accelerates or climbs.
    """
    truth = flight.truth
    if flight.controls is not None:
        return flight.controls.throttle
    cruise = AIRFRAMES[flight.scenario.aircraft].cruise_m_s
    drag = 0.08 * STANDARD_GRAVITY_M_S2 * (0.5 + 0.5 * (truth.cas_m_s / cruise) ** 2)
    wanted = np.where(truth.tas_m_s > 1.0, drag + truth.thrust_acc_m_s2, 0.0)
    return np.asarray(np.clip(wanted / (0.25 * STANDARD_GRAVITY_M_S2), 0.0, 1.0))


def _engine(flight: Flight) -> Iterator[Sending]:
    """Engine speeds and servo outputs."""
    yield from _shafts(flight) if flight.controls else _invented_rpm(flight)
    if flight.scenario.messages.servo_hz:
        yield _servos(flight)


def _invented_rpm(flight: Flight) -> Iterator[Sending]:
    """RPM of a kinematic aircraft: one engine; the second reads -1 as where none is fitted."""
    truth, m, a = flight.truth, flight.scenario.messages, AIRFRAMES[flight.scenario.aircraft]
    if m.rpm_hz:
        t, sent = _even(flight, m.rpm_hz, "rpm")
        throttle = lagged(_throttle(flight), truth.dt_s, 1.0)
        speed = a.idle_rpm + (a.full_rpm - a.idle_rpm) * throttle**0.5
        rng = stream(flight.seed, "rpm0")
        rpm = np.interp(t, truth.t_s, speed) * (1.0 + 0.002 * rng.standard_normal(len(t)))
        yield Sending(dialect.MAVLink_rpm_message, sent, [rpm, -1.0])


def _shafts(flight: Flight) -> Iterator[Sending]:
    """RPM for one or two channels, RAW_RPM for more; -1 or no message where one drops out."""
    s = flight.readings["rpm"]
    sent = _boot(flight, s.sent_s, US)
    channels = s.values.shape[1]
    if 1 <= channels <= 2:
        speeds = [np.nan_to_num(x, nan=-1.0) for x in s.values.T]
        yield Sending(dialect.MAVLink_rpm_message, sent, [*speeds, -1.0][:2])
        return
    for i, x in enumerate(s.values.T):
        there = np.isfinite(x)
        yield Sending(dialect.MAVLink_raw_rpm_message, sent[there], [i, x[there]])


def _servos(flight: Flight) -> Sending:
    """SERVO_OUTPUT_RAW: aileron, elevator, throttle, rudder, see :data:`SERVOS`.

    Real ones are what the autopilot asks; the surfaces of a kinematic aircraft follow its rates.
    """
    truth, c = flight.truth, flight.controls
    t, sent = _even(flight, flight.scenario.messages.servo_hz, "servo")
    if c is not None:
        asked = (c.aileron, c.elevator, c.throttle, c.rudder)
        # A command holds until the next: no value between two.
        now = np.clip(np.searchsorted(c.t_s, t, "right") - 1, 0, None)
        roll, pitch, power, yaw = (column[now] for column in asked)
    else:
        roll, pitch, yaw = (
            np.interp(t, truth.t_s, truth.rate_rad_s[:, k] / radians(60.0)) for k in range(3)
        )
        pitch = -pitch - np.interp(t, truth.t_s, truth.aoa_rad) * 2.0 / pi
        power = np.interp(t, truth.t_s, _throttle(flight))
    pulses = [1500 + 400 * roll, 1500 + 400 * pitch, 1000 + 1000 * power, 1500 + 400 * yaw]
    columns = [_boot(flight, t, US) % 2**32, 0, *(_unsigned(p) for p in pulses), *[0] * 4]
    return Sending(dialect.MAVLink_servo_output_raw_message, sent, columns)


SERVOS: Final = (
    # function of ArduPlane, pulses at -1 (throttle: 0), 0 and 1, reversed
    (4, 1100.0, 1500.0, 1900.0, 0.0),
    (19, 1100.0, 1500.0, 1900.0, 1.0),
    (70, 1000.0, 1000.0, 2000.0, 0.0),
    (21, 1100.0, 1500.0, 1900.0, 1.0),
)
"""Outputs 1 to 4. A longer pulse turns the right wing down, the nose down, the nose to the left.

ArduPlane counts nose up and nose right as positive: its elevator and rudder are reversed.
"""
