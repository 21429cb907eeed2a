"""Flights as PX4 would have logged them (.ulg), and the writer that does it."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from sim_feeds.scenario import Flight

__all__ = ["UlogWriter", "dropout", "logged", "message", "parameter", "px4_log"]

MAGIC = b"ULog\x01\x12\x35"


def message(kind: str, body: bytes) -> bytes:
    """A message of any type."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def parameter(name: str, value: float) -> bytes:
    """A parameter's message."""
    key = f"float {name}".encode()
    return message("P", bytes([len(key)]) + key + struct.pack("<f", value))


def logged(t_us: int, text: str, level: str = "4") -> bytes:
    """A logged text's message."""
    return message("L", level.encode() + struct.pack("<Q", t_us) + text.encode())


def dropout(ms: int) -> bytes:
    """The message that tells how long nothing was logged."""
    return message("O", struct.pack("<H", ms))


class UlogWriter:
    """Gathers messages with their times; ``content`` puts them in order behind the definitions."""

    def __init__(self, start_us: int) -> None:
        self._head = MAGIC + b"\x01" + struct.pack("<Q", start_us) + message("B", bytes(40))
        self._data: list[tuple[int, int, bytes]] = []
        self._announced = b""
        self._topics = 0
        self.parameters = b""

    def topic(
        self, name: str, fields: str, t_us: Any, columns: dict[str, Any], instance: int = 0
    ) -> None:
        """A topic's rows; ``fields`` as a format message has them, ``columns`` by their names."""
        code = {"uint64_t": "<u8", "uint32_t": "<u4", "int32_t": "<i4", "uint8_t": "u1"}
        code |= {"float": "<f4", "double": "<f8", "bool": "u1", "int8_t": "i1"}
        parts = []
        for field in fields.split(";"):
            kind, label = field.split()
            kind, _, count = kind.rstrip("]").partition("[")
            one = f"S{count}" if kind == "char" else code[kind]
            parts.append((label, one) if kind == "char" or not count else (label, one, int(count)))
        rows = np.zeros(len(t_us), np.dtype([("timestamp", "<u8"), *parts]))
        rows["timestamp"] = t_us
        for label, values in columns.items():
            rows[label] = values
        number, self._topics = self._topics, self._topics + 1
        self._head += message("F", f"{name}:uint64_t timestamp;{fields};".encode())
        announced = struct.pack("<BH", instance, number) + name.encode()
        self._announced += message("A", announced)
        for t, row in zip(rows["timestamp"].tolist(), rows, strict=True):
            self.put(t, message("D", struct.pack("<H", number) + row.tobytes()))

    def put(self, t_us: int, content: bytes) -> None:
        """A message among the data."""
        self._data.append((t_us, len(self._data), content))

    def content(self, times: int = 1) -> bytes:
        """The file; its data stands in it ``times`` over."""
        body = b"".join(content for _, _, content in sorted(self._data))
        return self._head + self.parameters + self._announced + body * times


def px4_log(flight: Flight, *, seldom: bool = False) -> UlogWriter:
    """The flight's readings as PX4 topics; ``seldom``: vehicle_imu at 2 Hz, as by default."""
    boot_s = flight.scenario.start.boot_s
    log = UlogWriter(int(boot_s * 1e6))

    def us(t_s: Any) -> Any:
        return np.rint((np.asarray(t_s) + boot_s) * 1e6).astype(np.int64)

    for i in range(flight.scenario.imu.count):
        s = flight.readings[f"imu{i}"]
        every = slice(None, None, 25 if seldom else 1)
        columns = {
            "timestamp_sample": us(s.stamp_s)[every],
            "delta_angle": (s.values[:, 3:] * 4e-3)[every],
            "delta_velocity": (s.values[:, :3] * 4e-3)[every],
            "delta_angle_dt": 4000,
            "delta_velocity_dt": 4000,
        }
        fields = (
            "uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity;"
            "uint32_t delta_angle_dt;uint32_t delta_velocity_dt"
        )
        log.topic("vehicle_imu", fields, us(s.sent_s)[every], columns, i)
        if i == 0:
            columns = {"gyro_rad": s.values[:, 3:], "accelerometer_m_s2": s.values[:, :3]}
            fields = "float[3] gyro_rad;float[3] accelerometer_m_s2"
            log.topic("sensor_combined", fields, us(s.stamp_s), columns)
    nav = flight.navigation
    log.topic("vehicle_angular_velocity", "float[3] xyz", us(nav.t_s), {"xyz": nav.rate_rad_s})
    log.topic("vehicle_attitude", "float[4] q", us(nav.t_s), {"q": nav.q_ned_from_frd})
    here, start = flight.truth.at(nav.t_s), flight.truth.at(np.zeros(1))
    radius = 6_371_000.0
    local = {
        "x": (here.lat_rad - start.lat_rad) * radius,
        "y": (here.lon_rad - start.lon_rad) * radius * np.cos(start.lat_rad),
        "z": start.height_m - here.height_m,
        "ref_lat": np.degrees(start.lat_rad),
        "ref_lon": np.degrees(start.lon_rad),
        "ref_alt": start.height_m,
        **dict(zip(("vx", "vy", "vz"), nav.vel_ned_m_s.T, strict=True)),
        **dict.fromkeys(VALID, 1),
    }
    fields = "double ref_lat;double ref_lon;float x;float y;float z;float ref_alt;float vx;"
    fields += "float vy;float vz;" + ";".join(f"bool {name}" for name in VALID)
    log.topic("vehicle_local_position", fields, us(nav.t_s), local)
    g = flight.readings["gps0"]
    lat, lon, height, north, east, down, fix = g.values.T
    columns = {"latitude_deg": np.degrees(lat), "longitude_deg": np.degrees(lon)}
    columns |= {"altitude_msl_m": height, "vel_n_m_s": north, "vel_e_m_s": east}
    columns |= {"vel_d_m_s": down, "vel_ned_valid": 1, "fix_type": np.where(fix > 0, 3, 0)}
    columns |= {"eph": 1.0, "epv": 1.5, "s_variance_m_s": 0.1, "satellites_used": 16}
    fields = "double latitude_deg;double longitude_deg;double altitude_msl_m;float vel_n_m_s;"
    fields += "float vel_e_m_s;float vel_d_m_s;float eph;float epv;float s_variance_m_s;"
    fields += "uint8_t fix_type;uint8_t satellites_used;bool vel_ned_valid"
    log.topic("vehicle_gps_position", fields, us(g.stamp_s), columns)
    for i in range(flight.scenario.airspeed.count):
        s = flight.readings[f"airspeed{i}"]
        fields = "float indicated_airspeed_m_s"
        log.topic("airspeed", fields, us(s.stamp_s), {fields[6:]: s.values[:, 0]}, i)
    s = flight.readings["baro0"]
    columns = {"baro_pressure_pa": s.values[:, 0], "ambient_temperature": s.values[:, 1] - 273.15}
    fields = "float baro_pressure_pa;float ambient_temperature"
    log.topic("vehicle_air_data", fields, us(s.stamp_s), columns)
    t = np.arange(0.0, flight.truth.t_s[-1], 1.0)
    fields = "uint8_t arming_state;uint8_t nav_state;uint8_t system_type;uint8_t system_id"
    columns = {"arming_state": 2, "nav_state": 3, "system_type": 1, "system_id": 7}
    log.topic("vehicle_status", fields, us(t), columns)
    return log


VALID = ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "xy_global", "z_global")
