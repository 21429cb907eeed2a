"""The fields of a row out of the fields of a payload, in machine code.

What :class:`links.catalog.Fill` and :class:`links.conversions.Conversion` say in numpy for many
payloads at once, here for one, by the tables of :mod:`links.mavlink.plan`. Payloads and rows are
bytes, whose numbers stand wherever the wire and the row's dtype put them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.clock import OUT_OF_RANGE, REASONS, TIMED
from links.conversions import DEG, UNIT_WITHIN, UNKNOWN_COURSE, Op
from links.jit import inlined, kernel
from links.mavlink import plan
from links.memory import copy_bytes, load_word, store_word
from links.vocabulary import Rejection

__all__ = ["blank", "copy_payload", "fill_field", "put", "real", "whole"]

_NON_FINITE = REASONS.index(Rejection.NON_FINITE)
_EULER, _UNIT = int(Op.QUATERNION_OF_EULER), int(Op.UNIT_QUATERNION)
_COURSE, _ACCURACY = int(Op.VELOCITY_OF_COURSE), int(Op.ACCURACY)
_FLAG, _SIGN = int(Op.FLAG), int(Op.SIGN)
_INTEGER_PARAMETERS = 6  # MAV_PARAM_TYPE_UINT8 ... INT32 are 1 ... 6

Ints = NDArray[np.int64]


@inlined
def copy_payload(data: Any, p: int, length: int, payload: Any, size: int) -> None:
    """Copy a payload; what was cut off its end, or a version 1 never had, is zero."""
    n = min(length, size)
    at = 0
    while at + 8 <= n:
        store_word(payload, at, load_word(data, p + at))
        at += 8
    if at < n:
        word = np.uint64(0)
        for k in range(n - 1, at - 1, -1):
            word = word << np.uint64(8) | np.uint64(data[p + k])
        store_word(payload, at, word)
        at += 8
    blank(payload, at, size)


@inlined
def blank(memory: Any, at: int, end: int) -> None:
    """Make bytes zero, and up to seven after them."""
    while at < end:
        store_word(memory, at, np.uint64(0))
        at += 8


@inlined
def whole(payload: Any, at: int, what: int) -> Any:
    """A wire field that is an integer."""
    w = load_word(payload, at)
    if what == plan.U1:
        return np.int64(np.uint8(w))
    if what == plan.U2:
        return np.int64(np.uint16(w))
    if what == plan.U4:
        return np.int64(np.uint32(w))
    if what == plan.I2:
        return np.int64(np.int16(w))
    if what == plan.I4:
        return np.int64(np.int32(w))
    if what == plan.I1:
        return np.int64(np.int8(w))
    return np.int64(w)


@inlined
def real(payload: Any, at: int, what: int) -> Any:
    """A wire field as a floating-point number."""
    if what == plan.F4:
        return np.float64(np.uint32(load_word(payload, at)).view(np.float32))
    if what == plan.F8:
        return np.uint64(load_word(payload, at)).view(np.float64)
    if what == plan.U8:
        return np.float64(load_word(payload, at))
    return np.float64(whole(payload, at, what))


@inlined
def put(arena: Any, at: int, value: float) -> None:
    store_word(arena, at, np.float64(value).view(np.uint64))


@kernel
def fill_field(f: int, payload: Any, head: Ints, numbers: Any, arena: Any, row: int) -> int:
    """Fill one field of a row; :data:`~links.clock.TIMED`, or why its value cannot be used."""
    at = head[plan.FILLS] + f * plan.F_COLUMNS
    op, kind = head[at + plan.F_OP], head[at + plan.F_KIND]
    first = head[plan.INPUTS] + head[at + plan.F_FIRST] * plan.I_COLUMNS
    into = row + head[at + plan.F_INTO]
    if op == plan.COPY:
        _copy_field(payload, head, first, kind, head[at + plan.F_PARAMETER], arena, into)
        return TIMED
    own = plan.VALUES + plan.MOST_VALUES + 4 * f
    n = head[at + plan.F_COUNT]
    if op == plan.LINEAR:
        scale, offset = numbers[own + plan.SCALE], numbers[own + plan.OFFSET]
        for j in range(n):
            field = first + j * plan.I_COLUMNS
            v = real(payload, head[field + plan.I_AT], head[field + plan.I_TYPE]) * scale
            if n == 1 or offset != 0.0:
                v += offset
            numbers[plan.VALUES + j] = v
    else:
        n = _convert(op, payload, head, first, head[at + plan.F_PARAMETER], numbers)
    if head[at + plan.F_CHECKED]:
        low, high = numbers[own + plan.LOW], numbers[own + plan.HIGH]
        inside = True
        for j in range(n):
            v = numbers[plan.VALUES + j]
            if not math.isfinite(v):
                return _NON_FINITE
            inside = inside and low <= v <= high
        if not inside:
            return OUT_OF_RANGE
    if kind == plan.BOOL:
        arena[into] = numbers[plan.VALUES] != 0.0
    else:
        for j in range(n):
            put(arena, into + 8 * j, numbers[plan.VALUES + j])
    return TIMED


@inlined
def _copy_field(
    payload: Any, head: Any, first: int, kind: int, size: int, arena: Any, into: int
) -> None:
    """Characters as they are, an integer as 32 bits."""
    field = head[first + plan.I_AT]
    if kind == plan.BYTES:
        copy_bytes(payload, field, arena, into, size)
        return
    value = whole(payload, field, head[first + plan.I_TYPE])
    for j in range(4):
        arena[into + j] = np.uint8(value >> 8 * j)


@kernel
def _convert(op: int, payload: Any, head: Ints, first: int, parameter: int, numbers: Any) -> int:
    """Carry out an :class:`links.conversions.Op`; how many values it gave."""
    v = numbers[plan.VALUES : plan.VALUES + plan.MOST_VALUES]
    if op == _EULER:
        half_roll, half_pitch, half_yaw = (
            0.5 * _input(payload, head, first, 0),
            0.5 * _input(payload, head, first, 1),
            0.5 * _input(payload, head, first, 2),
        )
        cr, cp, cy = math.cos(half_roll), math.cos(half_pitch), math.cos(half_yaw)
        sr, sp, sy = math.sin(half_roll), math.sin(half_pitch), math.sin(half_yaw)
        v[0] = cr * cp * cy + sr * sp * sy
        v[1] = sr * cp * cy - cr * sp * sy
        v[2] = cr * sp * cy + sr * cp * sy
        v[3] = cr * cp * sy - sr * sp * cy
        return 4
    if op == _UNIT:
        norm = 0.0
        for j in range(4):
            v[j] = _input(payload, head, first, j)
            norm += v[j] * v[j]
        norm = math.sqrt(norm)
        if not abs(norm - 1.0) < UNIT_WITHIN:
            norm = math.nan
        for j in range(4):
            v[j] /= norm
        return 4
    if op == _COURSE:
        vel, cog = _input(payload, head, first, 0), _input(payload, head, first, 1)
        speed, course = vel * 1e-2, cog * 1e-2 * DEG
        if vel == UNKNOWN_COURSE or cog == UNKNOWN_COURSE:
            speed = math.nan
        v[0], v[1], v[2] = speed * math.cos(course), speed * math.sin(course), math.nan
        return 3
    v[0] = math.nan
    if op == _ACCURACY:
        value = _input(payload, head, first, 0) * 1e-3
        if value != 0.0:
            v[0] = value
    elif op == _SIGN:
        value = _input(payload, head, first, 0)
        v[0] = 1.0 if value > 0.0 else -1.0 if value < 0.0 else 0.0 if value == 0.0 else value
    elif op == _FLAG:
        bits = whole(payload, head[first + plan.I_AT], head[first + plan.I_TYPE])
        v[0] = 1.0 if bits & parameter else 0.0
    elif op == plan.PARAMETER_BITS:
        value = _input(payload, head, first, 0)
        which = np.int64(_input(payload, head, first, 1))
        if 1 <= which <= _INTEGER_PARAMETERS:
            bits = whole(payload, head[first + plan.I_AT], plan.I4)
            value = np.float64(np.float32(bits))
        v[0] = value
    return 1


@inlined
def _input(payload: Any, head: Any, first: int, j: int) -> Any:
    """An operation's wire field ``j``."""
    field = first + j * plan.I_COLUMNS
    return real(payload, head[field + plan.I_AT], head[field + plan.I_TYPE])
