"""Arrays of samples, wherever they come from, to the batches that the monitor takes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from links.samples import QUANTITIES, Batch, Rows, empty_rows, quantity_of
from links.vocabulary import Rejection
from monitor.warmup import numbered

__all__ = ["ArraySource"]

_KEY = ("seq", "t_us")
_A_FIX = 3
_LATEST_S = 1e9
"""Vehicle time starts at boot: thirty years of it are a mistake [s]."""


class ArraySource:
    """Numpy arrays of each sensor, a whole flight or a piece of it at a time, to batches.

    Sensors and the fields of their samples are those of :data:`monitor.QUANTITIES`: ``imu0`` has
    ``acc_m_s2`` (n, 3) and ``gyro_rad_s`` (n, 3), ``gps0`` has ``vel_ned_m_s`` (n, 3) and others.
    Units are in the names, axes are forward-right-down of the body and north-east-down of the
    earth.

    Air data need ``attitude``, ``gps0``, ``baro0`` and ``airspeed0``; the IMU ``imu0``,
    ``attitude`` and ``gps0``. Whether the aircraft flies is seen by ``gps0`` or ``nav``.
    """

    def __init__(self) -> None:
        self._next = 0

    def batch(self, sensors: Mapping[str, Mapping[str, ArrayLike]]) -> Batch:
        """Samples of one or more sensors, numbered as they come: in time order within a batch.

        Parameters
        ----------
        sensors
            Sensor name -> field -> array, one row a sample, with either ``t_us`` or ``t_s``, the
            vehicle's time in microseconds or seconds, among the fields. Numbers that are left out
            are unknown (NaN), samples with an infinite one are rejected; of a ``gps``, each sample
            is a fix of its own unless ``fix_type`` and ``stamp_us`` say otherwise.

        Returns
        -------
        Batch
            What :meth:`monitor.Monitor.feed` takes.

        Raises
        ------
        ValueError
            There is no such sensor or field, a time or a count is missing, or an array has another
            shape, in one plain sentence.
        """
        rows = {sensor: _rows(sensor, fields) for sensor, fields in sensors.items()}
        if not any(len(part) for part in rows.values()):
            return Batch()
        numbered(rows)
        rejected: Counter[tuple[str, Rejection]] = Counter()
        taken = {}
        self._next, first = self._next + sum(len(part) for part in rows.values()), self._next
        for sensor, part in rows.items():
            part["seq"] += first
            usable = ~_infinite(part)
            taken[sensor] = part[usable]
            if count := len(part) - len(taken[sensor]):
                rejected[sensor, Rejection.NON_FINITE] = count
        return Batch(taken, rejected)


def _rows(sensor: str, fields: Mapping[str, ArrayLike]) -> Rows:
    try:
        quantity = quantity_of(sensor)
    except KeyError:
        known = ", ".join(QUANTITIES)
        raise ValueError(f"there is no sensor {sensor}; known are {known}, numbered") from None
    dtype = QUANTITIES[quantity]
    names = [name for name in dtype.names or () if name not in _KEY]
    if strange := sorted(set(fields) - {*names, "t_us", "t_s"}):
        raise ValueError(f"{sensor} has no field {strange[0]}; known are {', '.join(names)}")
    t_us = _times(sensor, fields)
    rows = empty_rows(sensor, len(t_us))
    rows["t_us"] = t_us
    for name in names:
        place = rows[name]
        if name in fields:
            given = np.asarray(fields[name])
            if given.shape != place.shape:
                raise ValueError(f"{sensor}.{name} has shape {given.shape}, not {place.shape}")
            place[:] = given
        elif place.dtype.kind == "f":
            place[:] = np.nan
        elif quantity == "gps":
            place[:] = {"fix_type": _A_FIX, "stamp_us": t_us}.get(name, 0)
        else:
            raise ValueError(f"{sensor} lacks {name}, which cannot be left out")
    return rows


def _infinite(rows: Rows) -> NDArray[np.bool_]:
    """Which samples hold an infinite number."""
    found = np.zeros(len(rows), np.bool_)
    for name in rows.dtype.names or ():
        values = rows[name]
        if values.dtype.kind == "f":
            found |= np.isinf(values).reshape(len(rows), -1).any(axis=1)
    return found


def _times(sensor: str, fields: Mapping[str, ArrayLike]) -> NDArray[np.int64]:
    if ("t_us" in fields) == ("t_s" in fields):
        raise ValueError(f"{sensor} needs its times, as t_us or as t_s")
    if "t_us" in fields:
        t_us = np.asarray(fields["t_us"])
        if t_us.dtype.kind not in "iu":
            raise ValueError(f"{sensor}.t_us must be integers; t_s takes seconds")
    else:
        t_s = np.asarray(fields["t_s"], np.float64)
        if not (np.abs(t_s) < _LATEST_S).all():
            raise ValueError(f"{sensor}.t_s must be seconds since the vehicle's boot, all finite")
        t_us = np.round(t_s * 1e6)
    if t_us.ndim != 1:
        raise ValueError(f"{sensor} has times of shape {t_us.shape}, not (n,)")
    return t_us.astype(np.int64)
