"""Flights as ArduPilot's DataFlash (.BIN) would have logged them, and the writer that does it."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.rotation import euler_from_matrix
from sim_feeds.scenario import Flight
from sim_feeds.sensors import Series

__all__ = ["HEAD", "DataflashWriter", "ardupilot_log"]

HEAD: Final = b"\xa3\x95"
TYPES: Final = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "d": "<f8",
    "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4",
    "M": "u1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
SCALES: Final = {"c": 1e2, "C": 1e2, "e": 1e2, "E": 1e2, "L": 1e7}
UNITS: Final = {
    "#": "instance", "-": "", "s": "s", "d": "deg", "h": "degheading", "k": "deg/s", "E": "rad/s",
    "D": "deglatitude", "U": "deglongitude", "m": "m", "n": "m/s", "o": "m/s/s", "P": "Pa",
    "O": "degC", "S": "satellites", "Y": "us", "z": "Hz",
}  # fmt: skip
MULTIPLIERS: Final = {"-": 0.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6, "G": 1e-7}

US: Final = 1_000_000
WEEK_S: Final = 604_800
UNIX_START_S: Final = 1_735_732_800
GPS_FROM_UNIX_S: Final = 18 - 315_964_800

Floats = NDArray[np.float64]


class DataflashWriter:
    """``define`` messages, ``put`` single records or ``rows`` of them; ``content`` is the file."""

    def __init__(self) -> None:
        self._types: dict[str, tuple[int, str]] = {}
        self._out = bytearray()
        self._stamps: list[NDArray[np.int64]] = []
        self._records: list[NDArray[np.uint8]] = []
        self.define("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 128)
        self.define("UNIT", "QbZ", "TimeUS,Id,Label", 129)
        self.define("MULT", "Qbd", "TimeUS,Id,Mult", 130)
        self.define("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", 131)

    def define(
        self,
        name: str,
        letters: str,
        columns: str,
        number: int = 0,
        units: str = "",
        mult: str = "",
    ) -> None:
        """Write the FMT record of a message, and its FMTU where units are given."""
        number = number or 140 + len(self._types)
        length = len(HEAD) + 1 + sum(np.dtype(TYPES[c]).itemsize for c in letters)
        self._types[name] = number, letters
        body = struct.pack(
            "<BB4s16s64s", number, length, *map(str.encode, (name, letters, columns))
        )
        self._out += HEAD + bytes([128]) + body
        if units:
            self.put("FMTU", 1, number, units, mult)

    def tell_units(self) -> None:
        """Write what the letters of FMTU mean."""
        for letter, label in UNITS.items():
            self.put("UNIT", 1, ord(letter), label)
        for letter, value in MULTIPLIERS.items():
            self.put("MULT", 1, ord(letter), value)

    def put(self, name: str, *values: Any) -> None:
        """Write one record right here, before all ``rows``."""
        self._out += self._packed(name, 1, values).tobytes()

    def rows(self, name: str, t_us: NDArray[np.int64], *values: Any) -> None:
        """Write a record for each time; ``values`` are columns or constants."""
        self._stamps.append(t_us)
        self._records.append(self._packed(name, len(t_us), [t_us, *values]))

    def _packed(self, name: str, n: int, values: Sequence[Any]) -> NDArray[np.uint8]:
        """Bytes of n records, one a row."""
        number, letters = self._types[name]
        fields = [(f"f{k}", TYPES[c]) for k, c in enumerate(letters)]
        rows = np.empty(n, [("head", "S2"), ("type", "u1"), *fields])
        rows["head"], rows["type"] = HEAD, number
        for (field, _), letter, value in zip(fields, letters, values, strict=True):
            rows[field] = np.rint(np.asarray(value) * SCALES[letter]) if letter in SCALES else value
        return rows.view(np.uint8).reshape(n, rows.itemsize)

    def content(self, times: int = 1) -> bytes:
        """The file; what ``rows`` wrote stands in it ``times`` over, in order of its times."""
        if not self._records:
            return bytes(self._out)
        order = np.argsort(np.concatenate(self._stamps), kind="stable")
        size = np.repeat([r.shape[1] for r in self._records], [len(r) for r in self._records])
        start = np.empty(len(order), np.int64)
        end = np.cumsum(size[order])
        start[order] = end - size[order]
        body = np.empty(int(end[-1]), np.uint8)
        first = 0
        for records in self._records:
            n, width = records.shape
            body[start[first : first + n, None] + np.arange(width)] = records
            first += n
        return bytes(self._out) + body.tobytes() * times


DEFINED: Final = (
    ("PARM", "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    ("MSG", "QZ", "TimeUS,Message", "s-", "F-"),
    ("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
    ("STAT", "QBfBBB", "TimeUS,isFlying,isFlyProb,Armed,Safety,Crash", "s-----", "F-----"),
    (
        "IMU",
        "QBffffffIIfBBHH",
        "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
        "s#EEEooo--O--zz",
        "F-000000-----00",
    ),
    (
        "ATT",
        "QccccCCCCB",
        "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF",
        "sddddhhdh-",
        "FBBBBBBBB-",
    ),
    (
        "XKF1",
        "QBccCfffffffccce",
        "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH",
        "s#ddhnnnnmmmkkkm",
        "F-BBB0000000BBBB",
    ),
    ("XKQ", "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4", "s#----", "F-0000"),
    (
        "XKF4",
        "QBcccccfffHBIHb",
        "TimeUS,C,SV,SP,SH,SM,SVT,errRP,OFN,OFE,FS,TS,SS,GPS,PI",
        "s#------mm-----",
        "F-------00-----",
    ),
    ("POS", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "sDUmmm", "FGG000"),
    (
        "GPS",
        "QBBIHBcLLeffffB",
        "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        "s#-s-S-DUmnhnh-",
        "F--C-0BGGB000--",
    ),
    ("GPA", "QBCCCCfB", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV", "s#-mmnd-", "F-BBBB0-"),
    (
        "BARO",
        "QBfffcfIffB",
        "TimeUS,I,Alt,AltAMSL,Press,Temp,CRt,SMS,Offset,GndTemp,Health",
        "s#mmPOnsmO-",
        "F-000B0C00-",
    ),
    (
        "ARSP",
        "QBffcffBBffB",
        "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Hp,TR,Pri",
        "s#nPOPP-----",
        "F-00B00-----",
    ),
    (
        "CTUN",
        "QccccffffBffi",
        "TimeUS,NavRoll,Roll,NavPitch,Pitch,ThO,RdO,ThD,As,AsT,SAs,E2T,GU",
        "sdddd---n-n-n",
        "FBBBB---000-B",
    ),
    (
        "RCOU",
        "Q" + "H" * 14,
        "TimeUS," + ",".join(f"C{k}" for k in range(1, 15)),
        "s" + "Y" * 14,
        "F" + "-" * 14,
    ),
)
"""Name, letters, columns, units and multipliers of what is logged, as ArduPlane 4 defines them."""


def ardupilot_log(flight: Flight) -> DataflashWriter:
    """The flight's readings as ArduPlane logs them, two cores of its filter running."""
    log = DataflashWriter()
    log.tell_units()
    for name, letters, columns, units, multipliers in DEFINED:
        log.define(name, letters, columns, 0, units, multipliers)
    begin_us = _us(flight, np.zeros(1))
    log.rows("PARM", begin_us, "SYSID_THISMAV", 1.0, 1.0)
    for i in range(flight.scenario.airspeed.count):
        prefix = f"ARSPD{i + 1 if i else ''}"
        log.rows("PARM", begin_us, f"{prefix}_TYPE", 1.0, 0.0)
        log.rows("PARM", begin_us, f"{prefix}_RATIO", flight.scenario.airspeed.ratio, 2.0)
    log.rows("MSG", begin_us, "ArduPlane V4.5.7 (00000000)")
    log.rows("MODE", begin_us, 10, 10, 1)
    flying = flight.truth.airborne > 0.5
    t = np.arange(0.0, flight.truth.t_s[-1], 0.5)
    share = np.interp(t, flight.truth.t_s, flying)
    log.rows("STAT", _us(flight, t), share > 0.5, share, 1, 1, 0)
    _inertial(log, flight)
    _navigation(log, flight)
    _satellites(log, flight)
    _air(log, flight)
    return log


def _us(flight: Flight, t_s: Floats) -> NDArray[np.int64]:
    """Vehicle time of times of the flight [us]."""
    whole = np.rint((np.asarray(t_s) + flight.scenario.start.boot_s) * US)
    return np.asarray(whole.astype(np.int64))


def _inertial(log: DataflashWriter, flight: Flight) -> None:
    for i in range(flight.scenario.imu.count):
        s = flight.readings[f"imu{i}"]
        rate = round(flight.scenario.imu.rate_hz)
        gyro, acc = s.values[:, 3:].T, s.values[:, :3].T
        log.rows("IMU", _us(flight, s.stamp_s), i, *gyro, *acc, 0, 0, 45.0, 1, 1, rate, rate)


def _navigation(log: DataflashWriter, flight: Flight) -> None:
    nav, truth = flight.navigation, flight.truth
    t_us, here = _us(flight, nav.t_s), truth.at(nav.t_s)
    roll, pitch, yaw = np.degrees(euler_from_matrix(nav.ned_from_frd)).T
    yaw %= 360.0
    log.rows("ATT", t_us, roll, roll, pitch, pitch, yaw, yaw, 0.0, 0.0, 3)
    up = here.height_m - truth.height_m[0]
    lat, lon = np.degrees(here.lat_rad), np.degrees(here.lon_rad)
    for core in range(2):
        vel, gyro_bias = nav.vel_ned_m_s.T, [0.0] * 3
        place = [0.0, 0.0, -up]
        log.rows("XKF1", t_us, core, roll, pitch, yaw, *vel, vel[2], *place, *gyro_bias, 0.0)
        log.rows("XKQ", t_us, core, *nav.q_ned_from_frd.T)
        ratios = [0.05, 0.04, 0.03, 0.02, 0.1]
        log.rows("XKF4", t_us, core, *ratios, 0.0, 0.0, 0.0, 0, 0, 831, 0, 0)
    log.rows("POS", t_us, lat, lon, here.height_m, up, up)
    pitot = flight.readings.get("airspeed0")
    speed = np.hypot(*nav.vel_ned_m_s[:, :2].T) if pitot is None else _held(pitot, nav.t_s)
    log.rows("CTUN", t_us, roll, roll, pitch, pitch, 40.0, 0.0, 40.0, speed, 1, 0.0, 1.0, 0)
    outputs = [1500 + np.rint(5.0 * roll).astype(np.int64), 1500 - np.rint(5.0 * pitch)]
    log.rows("RCOU", t_us, *outputs, 1400, 1500, *[0] * 10)


def _held(series: Series, t_s: Floats) -> Floats:
    """Last reading's first value before each time; the first one before that."""
    i = np.clip(np.searchsorted(series.valid_s, t_s, "right") - 1, 0, None)
    return np.asarray(series.values[i, 0])


def _satellites(log: DataflashWriter, flight: Flight) -> None:
    spec = flight.scenario.gps
    for i in range(min(spec.count, 2)):
        s = flight.readings[f"gps{i}"]
        lat, lon, height, north, east, down, fix = s.values.T
        course = np.degrees(np.arctan2(east, north)) % 360.0
        gps_s = s.valid_s + UNIX_START_S + GPS_FROM_UNIX_S
        week, ms = gps_s // WEEK_S, np.rint(gps_s % WEEK_S * 1000.0)
        place = [np.degrees(lat), np.degrees(lon), height]
        velocity = [np.hypot(north, east), course, down]
        status = np.where(fix > 0.0, 3, 0)
        head = [status, ms, week, spec.satellites, 0.8]
        t_us = _us(flight, s.stamp_s)
        log.rows("GPS", t_us, i, *head, *place, *velocity, 0.0, i == 0)
        speed_std = np.hypot(spec.velocity_std_m_s, spec.slow_velocity_std_m_s)
        stds = [spec.position_std_m, spec.height_std_m, speed_std]
        log.rows("GPA", t_us, i, 1.2, *stds, 0.0, 1)


def _air(log: DataflashWriter, flight: Flight) -> None:
    for i in range(flight.scenario.baro.count):
        s = flight.readings[f"baro{i}"]
        pressure, celsius = s.values[:, 0], s.values[:, 1] - 273.15
        height = flight.truth.at(s.valid_s).height_m
        t_us = _us(flight, s.stamp_s)
        up = height - flight.truth.height_m[0]
        log.rows("BARO", t_us, i, up, height, pressure, celsius, 0.0, t_us // 1000, 0.0, 20.0, 1)
    for i in range(flight.scenario.airspeed.count):
        s = flight.readings[f"airspeed{i}"]
        cas, difference = s.values[:, 0], s.values[:, 1]
        state = [1, 1, 1.0, 0.0, 0]
        t_us = _us(flight, s.stamp_s)
        log.rows("ARSP", t_us, i, cas, difference, 20.0, difference, 0.0, *state)
