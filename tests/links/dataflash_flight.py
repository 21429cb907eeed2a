"""Flights of sim_feeds as ArduPilot would log them in a .BIN."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sim_feeds.scenario import Flight

from .dataflash_writer import DataflashWriter

Record = tuple[int, str, tuple[Any, ...]]

LAYOUTS = {
    "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "MSG": ("QZ", "TimeUS,Message"),
    "MODE": ("QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": ("Qfff", "TimeUS,Roll,Pitch,Yaw"),
    "XKF1": ("QBffffff", "TimeUS,C,VN,VE,VD,GX,GY,GZ"),
    "GPS": ("QBBBLLffff", "TimeUS,I,Status,NSats,Lat,Lng,Alt,Spd,GCrs,VZ"),
    "GPA": ("QBfffB", "TimeUS,I,HAcc,VAcc,SAcc,VV"),
    "POS": ("QLLff", "TimeUS,Lat,Lng,Alt,RelHomeAlt"),
    "ARSP": ("QBffBBB", "TimeUS,I,Airspeed,DiffPress,U,H,Pri"),
    "BARO": ("QBff", "TimeUS,I,Press,Temp"),
    "RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4"),
    "STAT": ("QBB", "TimeUS,isFlying,Armed"),
}
UNITS = {"IMU": ("s#EEE---", "F-------"), "GPS": ("s#--------", "F---------")}
RATIO = 2.0


def ardupilot_log(flight: Flight, *, boot_s: float | None = None) -> DataflashWriter:
    """The flight's readings as a DataFlash log that begins ``boot_s`` after the boot."""
    log = DataflashWriter()
    log.tell_units()
    for name, (letters, columns) in LAYOUTS.items():
        log.define(name, letters, columns, 0, *UNITS.get(name, ()))
    start_s = flight.scenario.start.boot_s if boot_s is None else boot_s
    records = sorted(_records(flight), key=lambda record: record[0])
    for t_us, name, values in records:
        log.put(name, t_us + round(start_s * 1e6), *values)
    return log


def _records(flight: Flight) -> Iterator[Record]:
    def us(t_s: Any) -> list[int]:
        return [int(t) for t in np.rint(np.asarray(t_s) * 1e6)]

    for k in range(2):
        yield 0, "PARM", (f"ARSPD{k + 1 if k else ''}_RATIO", RATIO, RATIO)
    yield 0, "PARM", ("SYSID_THISMAV", 7.0, 1.0)
    yield 0, "MSG", ("ArduPlane V4.6.0 (12345678)",)
    yield 0, "MODE", (10, 10, 1)
    for i in range(flight.scenario.imu.count):
        s = flight.readings[f"imu{i}"]
        for t, v in zip(us(s.stamp_s), s.values.tolist(), strict=True):
            yield t, "IMU", (i, *v[3:], *v[:3])
    nav = flight.navigation
    here, home = flight.truth.at(nav.t_s), flight.truth.at(np.zeros(1))
    w, x, y, z = nav.q_ned_from_frd.T
    roll = np.degrees(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    pitch = np.degrees(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)))
    yaw = np.degrees(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))) % 360.0
    height = here.height_m - home.height_m
    for k, t in enumerate(us(nav.t_s)):
        yield t, "ATT", (roll[k], pitch[k], yaw[k])
        yield t, "XKF1", (0, *nav.vel_ned_m_s[k], 0.0, 0.0, 0.0)
        place = np.degrees([here.lat_rad[k], here.lon_rad[k]]).tolist()
        yield t, "POS", (*place, here.height_m[k], height[k])
    g = flight.readings["gps0"]
    for t, v in zip(us(g.stamp_s), g.values.tolist(), strict=True):
        lat, lon, alt, north, east, down, fix = v
        course = np.degrees(np.arctan2(east, north)) % 360.0
        place = (*np.degrees([lat, lon]).tolist(), alt, np.hypot(north, east), course, down)
        yield t, "GPA", (0, 1.0, 1.5, 0.1, 1)
        yield t, "GPS", (0, 3 if fix > 0 else 0, 16, *place)
    for i in range(flight.scenario.airspeed.count):
        s = flight.readings[f"airspeed{i}"]
        for t, v in zip(us(s.stamp_s), s.values.tolist(), strict=True):
            yield t, "ARSP", (i, v[0], v[0] ** 2 / RATIO, 1, 1, 0)
    s = flight.readings["baro0"]
    for t, v in zip(us(s.stamp_s), s.values.tolist(), strict=True):
        yield t, "BARO", (0, v[0], v[1] - 273.15)
    for t in us(np.arange(0.0, flight.truth.t_s[-1], 1.0)):
        yield t, "STAT", (1, 1)
        yield t, "RCOU", (1500, 1500, 1600, 1500)
