"""What the sensors measured, thinned for drawing: least and greatest value of every 0.1 s.

:class:`Traces` looks at what the watches see and keeps, per sensor and tenth of a second of vehicle
time, the extremes of each quantity, so that no peak is lost however coarsely it is drawn later.
They leave as tables named ``measured_<sensor>``, beside the estimates and in the same form:
``t_us`` is the time of the first sample within the tenth, ``acc_x_low_m_s2`` and
``acc_x_high_m_s2`` are the extremes. Directions (``course``, ``heading``) and positions have no
extremes: they are those of the first sample. What no sample told is NaN. Values are 32-bit floats,
nearer to the sample than any sensor is to the truth; positions have 64 bits.

A tenth is closed by the first row of a later one, so where a stream is cut changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from monitor.settings.engine import EngineSettings
from monitor.throttle import Throttle

__all__ = ["BUCKET_US", "FIELDS", "MEASURED", "VALUES", "Traces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BUCKET_US: Final = 100_000
"""Vehicle time of which the extremes are kept [us]."""

FIX_3D: Final = 3


class _Field(NamedTuple):
    """One quantity of a sensor, of ``size`` axes; ``extremes`` or the first value are kept."""

    name: str
    unit: str = ""
    size: int = 1
    extremes: bool = True

    def parts(self) -> list[str]:
        """Names of the table's fields."""
        end = f"_{self.unit}" if self.unit else ""
        if self.extremes:
            return [f"{self.name}_low{end}", f"{self.name}_high{end}"]
        return [f"{self.name}{end}"]


_POSITION = (_Field("lat", "rad", extremes=False), _Field("lon", "rad", extremes=False))
FIELDS: Final[Mapping[str, tuple[_Field, ...]]] = {
    "imu": (_Field("acc", "m_s2", 3), _Field("gyro", "rad_s", 3)),
    "attitude": (
        _Field("roll", "rad"),
        _Field("pitch", "rad"),
        _Field("heading", "rad", extremes=False),
    ),
    "gps": (
        *_POSITION,
        _Field("course", "rad", extremes=False),
        _Field("speed", "m_s"),
        _Field("climb", "m_s"),
        _Field("alt", "m"),
    ),
    "nav": (
        *_POSITION,
        _Field("speed", "m_s"),
        _Field("climb", "m_s"),
        _Field("alt", "m"),
        _Field("height", "m"),
    ),
    "airspeed": (_Field("cas", "m_s"),),
    "baro": (_Field("static_press", "pa"),),
    "aoa": (_Field("aoa", "rad"),),
    "spool": (_Field("speed", "rpm"),),
    "throttle": (_Field("throttle"),),
}


def _dtype(fields: tuple[_Field, ...]) -> np.dtype[np.void]:
    columns: list[tuple[str, str] | tuple[str, str, tuple[int]]] = [("t_us", "<i8")]
    for field in fields:
        kind = "<f8" if field in _POSITION else "<f4"
        for part in field.parts():
            columns.append((part, kind) if field.size == 1 else (part, kind, (field.size,)))
    return np.dtype(columns)


MEASURED: Final[Mapping[str, np.dtype[np.void]]] = {q: _dtype(f) for q, f in FIELDS.items()}
"""Quantity -> dtype of its tables: that of ``measured_imu0`` is ``MEASURED["imu"]``."""


class Traces:
    """Keeps the extremes of what was measured (a :class:`monitor.verdict.Tap`).

    Memory is bounded as long as :meth:`take` is called after each step.

    Parameters
    ----------
    settings
        Of the engine: which servo output is the throttle.
    """

    def __init__(self, settings: EngineSettings) -> None:
        self._throttle = Throttle(settings)
        self._buckets: dict[str, _Buckets] = {}
        self._closed: dict[str, list[Rows]] = {}

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Use released rows, each sensor's in time order."""
        with np.errstate(all="ignore"):
            for sensor, released in rows.items():
                quantity = sensor.rstrip("0123456789")
                values = VALUES.get(quantity)
                if values is not None and len(released):
                    self._add(sensor, quantity, released["t_us"], values(released))
            throttle = self._throttle.step(rows)
            if throttle is not None:
                self._add("throttle", "throttle", *throttle)

    def take(self) -> dict[str, Rows]:
        """The tenths that were closed since the last call, by their table's name."""
        closed, self._closed = self._closed, {}
        return {
            name: parts[0] if len(parts) == 1 else np.concatenate(parts)
            for name, parts in closed.items()
        }

    def finish(self) -> dict[str, Rows]:
        """The same at the end of the stream: the last tenths, too."""
        for sensor, buckets in self._buckets.items():
            self._keep(sensor, buckets.finish())
        return self.take()

    def _add(self, sensor: str, quantity: str, t_us: Ints, values: Floats) -> None:
        buckets = self._buckets.get(sensor)
        if buckets is None:
            buckets = self._buckets[sensor] = _Buckets(quantity)
        self._keep(sensor, buckets.add(t_us, values))

    def _keep(self, sensor: str, closed: Rows | None) -> None:
        if closed is not None:
            self._closed.setdefault(f"measured_{sensor}", []).append(closed)


@dataclass(slots=True)
class _Some:
    """Buckets as columns: number and first time, (m,); extremes and first values, (k, m)."""

    number: Ints
    t_us: Ints
    low: Floats
    high: Floats
    first: Floats


class _Buckets:
    """The tenths of one sensor."""

    def __init__(self, quantity: str) -> None:
        self._fields = FIELDS[quantity]
        self._dtype = MEASURED[quantity]
        self._open: _Some | None = None

    def add(self, t_us: Ints, values: Floats) -> Rows | None:
        """Use samples in time order, values (k, n); return the rows that they closed, if any."""
        number = t_us // BUCKET_US
        begin = np.concatenate(([0], np.flatnonzero(number[1:] != number[:-1]) + 1))
        new = _Some(
            number[begin],
            t_us[begin],
            # + 0.0: which of -0.0 and 0.0 is the lesser depends on their order
            np.fmin.reduceat(values, begin, axis=1) + 0.0,
            np.fmax.reduceat(values, begin, axis=1) + 0.0,
            values[:, begin],
        )
        standing, self._open = self._open, None
        if standing is not None:
            new = _joined(standing, new)
        last = len(new.number) - 1
        self._open = _part(new, slice(last, None))
        return self._rows(_part(new, slice(last))) if last else None

    def finish(self) -> Rows | None:
        """The row of the tenth that is still open."""
        standing, self._open = self._open, None
        return None if standing is None else self._rows(standing)

    def _rows(self, closed: _Some) -> Rows:
        rows = np.empty(len(closed.number), self._dtype)
        rows["t_us"] = closed.t_us
        at = 0
        for field in self._fields:
            kept = (closed.low, closed.high) if field.extremes else (closed.first,)
            for part, of in zip(field.parts(), kept, strict=True):
                rows[part] = of[at] if field.size == 1 else of[at : at + field.size].T
            at += field.size
        return rows


def _joined(before: _Some, new: _Some) -> _Some:
    """The bucket that stood open, and those that follow; its first may be the same one."""
    if before.number[0] == new.number[0]:
        new.t_us[0] = before.t_us[0]
        new.low[:, 0] = np.fmin(before.low[:, 0], new.low[:, 0])
        new.high[:, 0] = np.fmax(before.high[:, 0], new.high[:, 0])
        new.first[:, 0] = before.first[:, 0]
        return new
    return _Some(
        np.concatenate((before.number, new.number)),
        np.concatenate((before.t_us, new.t_us)),
        np.concatenate((before.low, new.low), axis=1),
        np.concatenate((before.high, new.high), axis=1),
        np.concatenate((before.first, new.first), axis=1),
    )


def _part(some: _Some, part: slice) -> _Some:
    """Some of the buckets, in memory of their own: a batch is not to live on in its last one."""
    return _Some(
        some.number[part].copy(),
        some.t_us[part].copy(),
        some.low[:, part].copy(),
        some.high[:, part].copy(),
        some.first[:, part].copy(),
    )


# --------------------------------------------------------------------------- rows to values


def _columns(*columns: Floats | Rows) -> Floats:
    """Columns one below the other, (k, n) float64."""
    out = np.empty((len(columns), len(columns[0])))
    for i, column in enumerate(columns):
        out[i] = column
    return out


def _imu(r: Rows) -> Floats:
    return _columns(*r["acc_m_s2"].T, *r["gyro_rad_s"].T)


def _attitude(r: Rows) -> Floats:
    w, x, y, z = r["q_ned_from_frd"].T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - x * z), -1.0, 1.0))
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return _columns(roll, pitch, heading % (2.0 * np.pi))


def _gps(r: Rows) -> Floats:
    north, east, down = r["vel_ned_m_s"].T
    fixed = r["fix_type"] >= FIX_3D
    return _columns(
        np.where(fixed, r["lat_rad"], np.nan),
        np.where(fixed, r["lon_rad"], np.nan),
        np.arctan2(east, north) % (2.0 * np.pi),
        np.hypot(north, east),
        -down,
        np.where(fixed, r["alt_m"], np.nan),
    )


def _nav(r: Rows) -> Floats:
    north, east, down = r["vel_ned_m_s"].T
    speed = np.hypot(north, east)
    return _columns(r["lat_rad"], r["lon_rad"], speed, -down, r["alt_m"], r["height_m"])


VALUES: Final[Mapping[str, Callable[[Rows], Floats]]] = {
    "imu": _imu,
    "attitude": _attitude,
    "gps": _gps,
    "nav": _nav,
    "airspeed": lambda r: _columns(r["cas_m_s"]),
    "baro": lambda r: _columns(r["static_press_pa"]),
    "aoa": lambda r: _columns(r["aoa_rad"]),
    "spool": lambda r: _columns(r["speed_rpm"]),
}
"""Quantity -> what its rows say: values (k, n), in the order of :data:`FIELDS` and their axes."""
