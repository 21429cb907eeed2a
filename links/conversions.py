"""Fields of a row that take more than a scale of one wire field: attitude, course, accuracy.

Each function reads a message's payload; beside it, where one is, stands the function that undoes
it, from a row's values to the wire fields before rounding. :mod:`links.catalog` says which field of
which message they fill.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan, pi

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DEG",
    "Floats",
    "Payload",
    "Wire",
    "accuracy",
    "armed",
    "autonomous",
    "course_from_velocity",
    "euler_from_quaternion",
    "quaternion_fields",
    "quaternion_from_euler",
    "unit_quaternion",
    "velocity_from_course",
]

Payload = NDArray[np.void]
Floats = NDArray[np.float64]
Wire = dict[str, Floats]
"""Wire field -> values."""

DEG = pi / 180.0


def quaternion_from_euler(p: Payload) -> Floats:
    """ATTITUDE's yaw, pitch, roll (Z-Y-X) as the quaternion ned_from_frd, scalar first."""
    half = [0.5 * p[name].astype(np.float64) for name in ("roll", "pitch", "yaw")]
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


def euler_from_quaternion(_: Payload, q: Floats) -> Wire:
    """The quaternion as ATTITUDE's roll, pitch and yaw."""
    w, x, y, z = q.T
    return {
        "roll": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        "pitch": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        "yaw": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    }


def unit_quaternion(p: Payload) -> Floats:
    """ATTITUDE_QUATERNION, normalised; a quaternion far from unit length is NaN."""
    q = np.stack([p[name].astype(np.float64) for name in ("q1", "q2", "q3", "q4")], axis=1)
    norm = np.sqrt(np.sum(q * q, axis=1))
    norm[~(np.abs(norm - 1.0) < 0.1)] = nan
    return np.asarray(q / norm[:, None], dtype=np.float64)


def quaternion_fields(_: Payload, q: Floats) -> Wire:
    """The quaternion as ATTITUDE_QUATERNION's four fields."""
    return dict(zip(("q1", "q2", "q3", "q4"), q.T, strict=True))


def velocity_from_course(p: Payload) -> Floats:
    """A receiver's speed and course over ground as north and east; it has no vertical velocity."""
    speed, course = p["vel"].astype(np.float64) * 1e-2, p["cog"].astype(np.float64) * 1e-2 * DEG
    unknown = (p["vel"] == 0xFFFF) | (p["cog"] == 0xFFFF)
    v = np.full((len(p), 3), nan)
    v[:, 0], v[:, 1] = speed * np.cos(course), speed * np.sin(course)
    v[unknown] = nan
    return v


def course_from_velocity(_: Payload, v: Floats) -> Wire:
    """North and east as speed and course over ground; the highest number would be "unknown"."""
    speed, course = np.hypot(v[:, 0], v[:, 1]), np.arctan2(v[:, 1], v[:, 0])
    return {
        "vel": np.minimum(speed * 1e2, 0xFFFE),
        "cog": np.mod(np.rint(course / DEG * 1e2), 36000.0),
    }


def accuracy(name: str) -> Callable[[Payload], Floats]:
    """A receiver's own accuracy in mm or mm/s; a short or MAVLink 1 message has 0 for none."""

    def compute(p: Payload) -> Floats:
        value = p[name].astype(np.float64) * 1e-3
        value[value == 0.0] = nan
        return value

    return compute


def armed(p: Payload) -> Floats:
    """HEARTBEAT's flag MAV_MODE_FLAG_SAFETY_ARMED, 0 or 1."""
    return np.asarray((p["base_mode"] & 128) != 0, dtype=np.float64)


def autonomous(p: Payload) -> Floats:
    """HEARTBEAT's flags MAV_MODE_FLAG_AUTO_ENABLED or GUIDED_ENABLED, 0 or 1."""
    return np.asarray((p["base_mode"] & 12) != 0, dtype=np.float64)
