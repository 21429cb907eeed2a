"""Fields of a row that take more than a scale of one wire field: attitude, course, accuracy.

A :class:`Conversion` is an operation, the wire fields that it reads and a parameter. It is data, so
that the compiled decoder (:mod:`links.mavlink.kernels`) can carry it out; called with payloads it
carries itself out in numpy, one payload or a million. Beside it stand the functions that undo one,
from a row's values to the wire fields before rounding. :mod:`links.catalog` says which field of
which message they fill.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from math import nan, pi

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DEG",
    "EULER",
    "FROM_COURSE",
    "NO_VALUE",
    "QUATERNION",
    "Condition",
    "Conversion",
    "Floats",
    "Op",
    "Payload",
    "Wire",
    "accuracy",
    "course_from_velocity",
    "element",
    "euler_from_quaternion",
    "flag",
    "put_element",
    "quaternion_fields",
    "sign",
]

Payload = NDArray[np.void]
Floats = NDArray[np.float64]
Wire = dict[str, Floats]
"""Wire field -> values."""

DEG = pi / 180.0

UNIT_WITHIN = 0.1
"""A quaternion whose length is off by more than this is no attitude."""

UNKNOWN_COURSE = 0xFFFF
"""GPS_RAW_INT's word for a speed or course that the receiver does not know."""


class Op(IntEnum):
    """What a :class:`Conversion` does to its wire fields; ``p`` is its parameter."""

    QUATERNION_OF_EULER = 1
    """roll, pitch, yaw (Z-Y-X) to the quaternion ned_from_frd, scalar first."""
    UNIT_QUATERNION = 2
    """q1 ... q4, normalised; far from unit length it is NaN."""
    VELOCITY_OF_COURSE = 3
    """speed [cm/s] and course [cdeg] to north and east; down is not known."""
    ACCURACY = 4
    """mm or mm/s; 0 (a short or MAVLink 1 message) is none."""
    FLAG = 5
    """Whether any bit of p is set, 0 or 1."""
    SIGN = 6
    """-1, 0 or 1."""
    ELEMENT = 7
    """Element p of an array."""
    NO_VALUE = 8
    """NaN."""


@dataclass(frozen=True, slots=True)
class Conversion:
    """An operation on wire fields; calling it with payloads (n,) gives the values.

    Attributes
    ----------
    op
        What is done.
    fields
        Wire fields that it reads.
    parameter
        What the operation needs besides: the bits of a flag, the index of an element.
    factor
        The result is so many times as large.
    """

    op: Op
    fields: tuple[str, ...] = ()
    parameter: int = 0
    factor: float = 1.0

    def __call__(self, payload: Payload) -> Floats:
        value = _OPERATIONS[self.op](self, payload)
        return value if self.factor == 1.0 else self.factor * value


@dataclass(frozen=True, slots=True)
class Condition:
    """Which payloads carry a sensor; called with payloads (n,) it gives a mask.

    Attributes
    ----------
    field
        Wire field, an integer.
    mask
        Bits of it that count.
    equals, unlike
        The value that those bits must have, or must not have; 0 must not be when none is given.
    """

    field: str
    mask: int = 0xFFFF_FFFF
    equals: int | None = None
    unlike: int = 0

    def __call__(self, payload: Payload) -> NDArray[np.bool_]:
        value = payload[self.field].astype(np.int64) & self.mask
        return np.asarray(value != self.unlike if self.equals is None else value == self.equals)


# --------------------------------------------------------------------------- operations in numpy


def _quaternion_of_euler(c: Conversion, p: Payload) -> Floats:
    half = [0.5 * p[name].astype(np.float64) for name in c.fields]
    (cr, cp, cy), (sr, sp, sy) = [np.cos(h) for h in half], [np.sin(h) for h in half]
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=1,
    )


def _unit_quaternion(c: Conversion, p: Payload) -> Floats:
    q = np.stack([p[name].astype(np.float64) for name in c.fields], axis=1)
    norm = np.sqrt(np.sum(q * q, axis=1))
    norm[~(np.abs(norm - 1.0) < UNIT_WITHIN)] = nan
    return np.asarray(q / norm[:, None], dtype=np.float64)


def _velocity_of_course(c: Conversion, p: Payload) -> Floats:
    vel, cog = (p[name] for name in c.fields)
    speed, course = vel.astype(np.float64) * 1e-2, cog.astype(np.float64) * 1e-2 * DEG
    v = np.full((len(p), 3), nan)
    v[:, 0], v[:, 1] = speed * np.cos(course), speed * np.sin(course)
    v[(vel == UNKNOWN_COURSE) | (cog == UNKNOWN_COURSE)] = nan
    return v


def _accuracy(c: Conversion, p: Payload) -> Floats:
    value = p[c.fields[0]].astype(np.float64) * 1e-3
    value[value == 0.0] = nan
    return np.asarray(value)


def _flag(c: Conversion, p: Payload) -> Floats:
    return np.asarray((p[c.fields[0]] & c.parameter) != 0, dtype=np.float64)


def _sign(c: Conversion, p: Payload) -> Floats:
    return np.asarray(np.sign(p[c.fields[0]], dtype=np.float64))


def _element(c: Conversion, p: Payload) -> Floats:
    return np.asarray(p[c.fields[0]][:, c.parameter], dtype=np.float64)


def _no_value(_: Conversion, p: Payload) -> Floats:
    return np.full(len(p), nan)


_OPERATIONS: dict[Op, Callable[[Conversion, Payload], Floats]] = {
    Op.QUATERNION_OF_EULER: _quaternion_of_euler,
    Op.UNIT_QUATERNION: _unit_quaternion,
    Op.VELOCITY_OF_COURSE: _velocity_of_course,
    Op.ACCURACY: _accuracy,
    Op.FLAG: _flag,
    Op.SIGN: _sign,
    Op.ELEMENT: _element,
    Op.NO_VALUE: _no_value,
}


# --------------------------------------------------------------------------- conversions in use

EULER = Conversion(Op.QUATERNION_OF_EULER, ("roll", "pitch", "yaw"))
QUATERNION = Conversion(Op.UNIT_QUATERNION, ("q1", "q2", "q3", "q4"))
FROM_COURSE = Conversion(Op.VELOCITY_OF_COURSE, ("vel", "cog"))
NO_VALUE = Conversion(Op.NO_VALUE)


def accuracy(name: str) -> Conversion:
    """A receiver's own accuracy."""
    return Conversion(Op.ACCURACY, (name,))


def flag(name: str, bits: int) -> Conversion:
    """Whether one of some bits is set."""
    return Conversion(Op.FLAG, (name,), bits)


def sign(name: str) -> Conversion:
    """The sign of a field."""
    return Conversion(Op.SIGN, (name,))


def element(name: str, index: int) -> Conversion:
    """One element of an array."""
    return Conversion(Op.ELEMENT, (name,), index)


# --------------------------------------------------------------------------- and back


def euler_from_quaternion(_: Payload, q: Floats) -> Wire:
    """The quaternion as ATTITUDE's roll, pitch and yaw."""
    w, x, y, z = q.T
    return {
        "roll": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        "pitch": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        "yaw": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    }


def quaternion_fields(_: Payload, q: Floats) -> Wire:
    """The quaternion as ATTITUDE_QUATERNION's four fields."""
    return dict(zip(QUATERNION.fields, q.T, strict=True))


def course_from_velocity(_: Payload, v: Floats) -> Wire:
    """North and east as speed and course over ground; the highest number would be "unknown"."""
    speed, course = np.hypot(v[:, 0], v[:, 1]), np.arctan2(v[:, 1], v[:, 0])
    return {
        "vel": np.minimum(speed * 1e2, UNKNOWN_COURSE - 1),
        "cog": np.mod(np.rint(course / DEG * 1e2), 36000.0),
    }


def put_element(name: str, index: int) -> Callable[[Payload, Floats], Wire]:
    """The array with one element changed."""

    def invert(p: Payload, value: Floats) -> Wire:
        array = p[name].astype(np.float64)
        array[:, index] = value
        return {name: array}

    return invert
