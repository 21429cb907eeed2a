"""The faults of :mod:`sim_feeds.faults` on rows of samples, piece by piece, any split the same.

Each channel of each stream of rows keeps what a fault needs to remember: the last reading before
its onset, the pressures that were trapped. Noise is a function of the seed, the fault and the
row's time alone (a hash, made normal by Box and Muller), so that neither the split of a stream
nor the message that carries a reading changes it.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows, empty_rows, quantity_of
from links.vocabulary import GYRO_ACC_AXES
from sim_feeds.attitude_follow import AttitudeFollower, AttitudeFollows
from sim_feeds.fault_table import ATTITUDE_AXES
from sim_feeds.faults import DRAWN, PLUMBING, Fault, FaultKind, Trapped
from sim_feeds.rotation import (
    euler_from_matrix,
    matrix_from_euler,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from sim_feeds.sensors import GPS_AXES, OUTAGE_WANDER_M_S

__all__ = ["Changed", "InjectionCore", "Stream", "keyed_normal"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Changed = tuple[Rows, Mask]
"""Rows after the injection, and which of them the sensor still sends."""

DEFAULT_RATIO: Final = 2.0
"""ARSPD_RATIO of a pitot that has not shown its own yet."""

NO_FIX: Final = 1
"""GPS_FIX_TYPE of a receiver in an outage."""


# ----------------------------------------------------------------------------- noise


def _mixed(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The finaliser of splitmix64: each bit of the result depends on all of ``x``."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def keyed_normal(seed: int, name: str, t_us: NDArray[np.int64]) -> Floats:
    """Standard normal numbers that depend on the seed, the name and each time alone, (n,)."""
    key = np.array([seed & 0xFFFF_FFFF | zlib.crc32(name.encode()) << 32], np.uint64)
    first = _mixed(_mixed(key) ^ _mixed(t_us.astype(np.uint64)))
    second = _mixed(first + np.uint64(0x9E3779B97F4A7C15))
    u, v = ((bits >> np.uint64(11)).astype(np.float64) * 2.0**-53 for bits in (first, second))
    return np.asarray(np.sqrt(-2.0 * np.log1p(-u)) * np.cos(2.0 * pi * v))


# ----------------------------------------------------------------------------- memory


class _Held:
    """The last reading before an onset, for readings that come piece by piece."""

    def __init__(self) -> None:
        self._value: float | None = None

    def at(self, before: Mask, x: Floats) -> Floats:
        """For each reading the last one, up to it, where ``before`` holds; else the first ever."""
        if not len(x):
            return x
        if self._value is None:
            self._value = float(x[0])
        last = np.maximum.accumulate(np.where(before, np.arange(len(x)), -1))
        held = np.where(last >= 0, x[np.maximum(last, 0)], self._value)
        self._value = float(held[-1])
        return held


class _Latest:
    """The newest value of one stream as another one's rows arrive."""

    def __init__(self) -> None:
        self._seq = np.array([np.iinfo(np.int64).min])
        self._value = np.array([nan])

    def note(self, seq: NDArray[np.int64], value: Floats) -> None:
        """Take the stream's rows of a block; of those before only the last is kept."""
        self._seq = np.concatenate([self._seq[-1:], seq])
        self._value = np.concatenate([self._value[-1:], value])

    def at(self, seq: NDArray[np.int64]) -> Floats:
        """Value in force at each arrival number; NaN before the first."""
        place = np.searchsorted(self._seq, seq, side="right") - 1
        return np.asarray(self._value[place])


@dataclass(slots=True)
class _Port:
    """A fault of the tubes, and what it trapped at its onset."""

    fault: Fault
    trapped: Trapped | None = None


# ----------------------------------------------------------------------------- channels


class _Ratio:
    """ARSPD_RATIO in force, as the rows themselves show it."""

    def __init__(self) -> None:
        self._value = DEFAULT_RATIO

    def at(self, rows: Rows) -> Floats:
        """CAS squared over pressure at each row, or the last one that could be told: (n,)."""
        p, cas = rows["diff_press_pa"], rows["cas_m_s"]
        tells = (p > 1e-3) & (cas > 0.0)
        last = np.maximum.accumulate(np.where(tells, np.arange(len(p)), -1), axis=0)
        shown = np.square(cas) / np.where(tells, p, 1.0)
        ratio = np.where(last >= 0, shown[np.maximum(last, 0)], self._value)
        if len(ratio):
            self._value = float(ratio[-1])
        return ratio


_COLUMN: Final[dict[str, tuple[str, int | None]]] = {
    **{a: ("acc_m_s2" if k < 3 else "gyro_rad_s", k % 3) for k, a in enumerate(GYRO_ACC_AXES)},
    **{axis: ("vel_ned_m_s", k) for k, axis in enumerate(GPS_AXES)},
    "aoa": ("aoa_rad", None),
    "spool": ("speed_rpm", None),
    "baro": ("static_press_pa", None),
}
"""Axis, or quantity of a sensor with one channel -> field of its rows, column."""

_EULER: Final = {axis: k for k, axis in enumerate(ATTITUDE_AXES)}
_FROZEN: Final = ("lat_rad", "lon_rad", "alt_m", "stamp_us")
"""What a receiver without a fix goes on repeating."""


class _Channel:
    """One channel of a stream: its faults in order, and what each remembers."""

    def __init__(self, name: str, faults: Sequence[Fault], seed: int) -> None:
        self.axis = name.partition(".")[2]
        self._name, self._seed = name, seed
        self._faults = [(f, _Held()) for f in faults]

    def broken(self, t_us: NDArray[np.int64], t_s: Floats, x: Floats) -> Floats:
        """Readings after the faults."""
        for k, (fault, memory) in enumerate(self._faults):
            held = memory.at(t_s < fault.start_s, x)
            noise = None
            if fault.kind in DRAWN:
                noise = keyed_normal(self._seed, f"{self._name}#{k}", t_us)
            x = fault.disturb(t_s, x, held, noise)
        return x

    def active(self, t_s: Floats) -> Mask:
        """Where any of the faults acts."""
        on: Mask = np.logical_or.reduce([f.active(t_s) for f, _ in self._faults])
        return on


class _Stream:
    """All faults of one sensor, on one stream of its rows."""

    def __init__(self, sensor: str, faults: Sequence[Fault], seed: int, first_us: int) -> None:
        self._sensor, self._seed, self._first_us = sensor, seed, first_us
        self._quantity = quantity_of(sensor)
        own = [f for f in faults if f.sensor.partition(".")[0] == sensor]
        self._gone = [f for f in own if f.kind is FaultKind.DROPOUT]
        self._outages = [
            (f, {name: _Held() for name in _FROZEN}) for f in own if f.kind is FaultKind.OUTAGE
        ]
        self._ports = [_Port(f) for f in faults if f.kind in PLUMBING and _meets(f, sensor)]
        direct = [f for f in own if f.kind not in PLUMBING | _WHOLE]
        self._channels = [
            _Channel(name, [f for f in direct if f.sensor == name], seed)
            for name in dict.fromkeys(f.sensor for f in direct)
        ]
        self._ratio = _Ratio()

    def apply(self, rows: Rows, outside_pa: Floats) -> Changed:
        """Rows as the broken sensor sends them.

        Parameters
        ----------
        rows
            Consecutive rows of the stream.
        outside_pa : (n,) float64 [Pa]
            Static pressure at each, where faults of an airspeed sensor's tubes ask for it.
        """
        rows = rows.copy()
        t_s = (rows["t_us"] - self._first_us) * 1e-6
        pitot = self._quantity == "airspeed"
        ratio = self._ratio.at(rows) if pitot else np.empty(0)
        if self._ports and pitot:
            self._apply_pitot_ports(rows, t_s, outside_pa, ratio)
        elif self._ports:
            outside = rows["static_press_pa"].copy()
            _, static, on = self._through_ports(t_s, outside, outside)
            rows["static_press_pa"][on] = static[on]
        for channel in self._channels:
            self._apply_channel(channel, rows, t_s, ratio)
        for fault, memory in self._outages:
            self._apply_outage(fault, memory, rows, t_s)
        keep = np.ones(len(rows), np.bool_)
        for fault in self._gone:
            keep &= ~fault.active(t_s)
        return rows, keep

    def _apply_channel(self, channel: _Channel, rows: Rows, t_s: Floats, ratio: Floats) -> None:
        on, t_us = channel.active(t_s), rows["t_us"]
        if self._quantity == "airspeed":
            x = channel.broken(t_us, t_s, _signed_speed(rows, ratio))
            rows["cas_m_s"][on] = np.maximum(x, 0.0)[on]
            has = on & np.isfinite(rows["diff_press_pa"])
            rows["diff_press_pa"][has] = (np.sign(x) * x * x / ratio)[has]
        elif self._quantity == "attitude":
            q = rows["q_ned_from_frd"]
            euler = euler_from_matrix(matrix_from_quaternion(q))
            k = _EULER[channel.axis]
            euler[:, k] = channel.broken(t_us, t_s, euler[:, k].copy())
            turned = quaternion_from_matrix(matrix_from_euler(*euler.T))
            turned *= np.where(np.sum(turned * q, axis=1) < 0.0, -1.0, 1.0)[:, None]
            q[on] = turned[on]
        else:
            name, column = _COLUMN[channel.axis or self._quantity]
            values = rows[name] if column is None else rows[name][:, column]
            values[on] = channel.broken(t_us, t_s, values.copy())[on]

    def _through_ports(
        self, t_s: Floats, total: Floats, outside: Floats
    ) -> tuple[Floats, Floats, Mask]:
        """Total and static pressure behind the damaged tubes, and where they are damaged.

        Without a static pressure nothing happens.
        """
        static, on = outside, np.zeros(len(outside), np.bool_)
        for port in self._ports:
            acts = port.fault.active(t_s) & np.isfinite(outside)
            if port.trapped is None and acts.any():
                k = int(np.argmax(acts))
                port.trapped = Trapped(float(total[k]), float(static[k]), float(outside[k]))
            if port.trapped is not None:
                total, static = port.fault.port(t_s, total, static, outside, port.trapped)
                on |= acts
        return total, static, on

    def _apply_pitot_ports(self, rows: Rows, t_s: Floats, outside: Floats, ratio: Floats) -> None:
        shown = np.isfinite(rows["diff_press_pa"])
        impact = np.where(shown, rows["diff_press_pa"], np.square(rows["cas_m_s"]) / ratio)
        total, static, on = self._through_ports(t_s, outside + impact, outside)
        impact = total - static
        rows["cas_m_s"][on] = np.sqrt(np.maximum(ratio * impact, 0.0)[on])
        rows["diff_press_pa"][on & shown] = impact[on & shown]

    def _apply_outage(
        self, fault: Fault, memory: dict[str, _Held], rows: Rows, t_s: Floats
    ) -> None:
        """A receiver that goes on without a fix: old position and stamp, wandering velocity."""
        on, before = fault.active(t_s), t_s < fault.start_s
        for name, held in memory.items():
            old = held.at(before, rows[name].astype(np.float64))
            rows[name][on] = old[on].astype(rows[name].dtype)
        for k, axis in enumerate(GPS_AXES):
            noise = keyed_normal(self._seed, f"{self._sensor}.{axis}#outage", rows["t_us"])
            rows["vel_ned_m_s"][on, k] += OUTAGE_WANDER_M_S * noise[on]
        rows["fix_type"][on] = np.minimum(rows["fix_type"][on], NO_FIX)


_WHOLE: Final = frozenset({FaultKind.DROPOUT, FaultKind.OUTAGE})


def _meets(fault: Fault, sensor: str) -> bool:
    """Whether a fault of the tubes reaches this sensor: a static port feeds pitot and barometer."""
    if fault.kind is FaultKind.STATIC_BLOCKED:
        return sensor in (fault.sensor, _barometer(fault.sensor))
    return sensor == fault.sensor


def _barometer(pitot: str) -> str:
    """The barometer at the static port of an airspeed sensor."""
    return pitot.replace("airspeed", "baro")


def _signed_speed(rows: Rows, ratio: Floats) -> Floats:
    """Airspeed with the sign of its differential pressure, as faults see it [m/s]."""
    pressure = rows["diff_press_pa"]
    below = pressure < 0.0
    return np.where(below, -np.sqrt(ratio * np.where(below, -pressure, 0.0)), rows["cas_m_s"])


# ----------------------------------------------------------------------------- core

Stream = tuple[str, int]
"""A sensor as one message carries it: its name, and the message's rank (0 the best)."""


class InjectionCore:
    """Faults on streams of rows; each stream remembers by itself.

    Attributes
    ----------
    sensors
        Sensors whose rows may change.
    needs
        Sensors whose rows :meth:`apply` must be shown.
    """

    def __init__(
        self,
        faults: Sequence[Fault],
        follows: AttitudeFollows | None,
        seed: int,
        first_us: int,
    ) -> None:
        self._faults, self._seed, self._first_us = tuple(faults), seed, first_us
        self._streams: dict[Stream, _Stream] = {}
        self._pitots = {f.sensor for f in faults if f.kind in PLUMBING}
        self._outside = {s: _Latest() for s in {"baro0", *map(_barometer, self._pitots)}}
        self._best: dict[str, int] = {}
        self._imu = "" if follows is None else f"imu{follows.imu}"
        self._follower = None if follows is None else AttitudeFollower(follows)
        sensors = {f.sensor.partition(".")[0] for f in faults}
        sensors |= {_barometer(f.sensor) for f in faults if f.kind is FaultKind.STATIC_BLOCKED}
        if follows is not None:
            sensors.add("attitude")
        self.sensors = frozenset(sensors)
        self.needs = self.sensors | (self._outside.keys() if self._pitots else set())
        if follows is not None:
            self.needs |= {self._imu}

    def apply(self, rows: Mapping[Stream, Rows]) -> dict[Stream, Changed]:
        """The next rows of all streams as the broken sensors send them.

        Parameters
        ----------
        rows
            Consecutive rows of each stream that is among ``needs``; ``seq`` tells their order.
        """
        self._note_outside(rows)
        out: dict[Stream, Changed] = {}
        for stream, healthy in rows.items():
            sensor, _ = stream
            if sensor in self.sensors and sensor != "attitude":
                out[stream] = self._of(stream).apply(healthy, self._outside_at(sensor, healthy))
        attitude = {s: r for s, r in rows.items() if s[0] == "attitude"}
        if "attitude" in self.sensors:
            attitude = self._follow(rows, out, attitude)
            for stream, followed in attitude.items():
                out[stream] = self._of(stream).apply(followed, np.empty(0))
        return out

    def _of(self, stream: Stream) -> _Stream:
        found = self._streams.get(stream)
        if found is None:
            found = _Stream(stream[0], self._faults, self._seed, self._first_us)
            self._streams[stream] = found
        return found

    def _leading(self, sensor: str, rows: Mapping[Stream, Rows]) -> Stream | None:
        """The best message so far that carries a sensor, where it is among ``rows``."""
        ranks = [rank for name, rank in rows if name == sensor]
        best = min([*ranks, self._best.get(sensor, np.iinfo(np.int64).max)])
        if ranks:
            self._best[sensor] = best
        return (sensor, best) if best in ranks else None

    def _note_outside(self, rows: Mapping[Stream, Rows]) -> None:
        if not self._pitots:
            return
        for sensor, latest in self._outside.items():
            stream = self._leading(sensor, rows)
            if stream is not None:
                latest.note(rows[stream]["seq"], rows[stream]["static_press_pa"])

    def _outside_at(self, sensor: str, rows: Rows) -> Floats:
        """Static pressure outside at each row of a pitot: of its own barometer, or the first."""
        if sensor not in self._pitots:
            return np.empty(0)
        own, first = self._outside[_barometer(sensor)], self._outside["baro0"]
        static = own.at(rows["seq"])
        return np.where(np.isfinite(static), static, first.at(rows["seq"]))

    def _follow(
        self,
        rows: Mapping[Stream, Rows],
        changed: Mapping[Stream, Changed],
        attitude: dict[Stream, Rows],
    ) -> dict[Stream, Rows]:
        """Attitude rows after the filter; rows of all messages go through it in one order."""
        if self._follower is None:
            return attitude
        imu = self._leading(self._imu, rows)
        healthy = faulty = empty_rows(self._imu)
        if imu is not None:
            healthy = faulty = rows[imu]
            if imu in changed:
                faulty, keep = changed[imu]
                if not keep.all():
                    faulty = faulty.copy()
                    faulty[~keep] = healthy[~keep]
        if not attitude:
            self._follower.step(healthy, faulty, empty_rows("attitude"))
            return attitude
        together = np.concatenate(list(attitude.values()))
        order = np.argsort(together["seq"], kind="stable")
        followed = np.empty_like(together)
        followed[order] = self._follower.step(healthy, faulty, together[order])
        edges = np.cumsum([len(r) for r in attitude.values()])[:-1]
        return dict(zip(attitude, np.split(followed, edges), strict=True))
