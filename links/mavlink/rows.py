"""Payloads of one message to checked rows of one sensor, a whole block at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.catalog import MAX_INSTANCES, Fill, Source
from links.mavlink.dialect import Message
from links.mavlink.framing import Frames
from links.samples import Rows, empty_rows
from links.vocabulary import Rejection

__all__ = ["build_rows", "cas_from_pressure", "gather_payloads", "instances"]

Mask = NDArray[np.bool_]

_FEW = 16  # payloads that are joined one by one, which is faster for so few


def gather_payloads(frames: Frames, index: NDArray[np.int64], message: Message) -> Rows:
    """Payloads of the frames ``index``, which all carry ``message``, as its structured dtype.

    What MAVLink 2 cut off (trailing zeros) and what MAVLink 1 never had (extensions) reads as zero.
    """
    size = message.dtype.itemsize
    if len(index) <= _FEW:
        spans = zip(frames.payload[index].tolist(), frames.length[index].tolist(), strict=True)
        joined = b"".join(frames.data[p : p + min(n, size)].ljust(size, b"\0") for p, n in spans)
        return np.frombuffer(joined, message.dtype)
    raw = np.frombuffer(frames.data, np.uint8)
    column = np.arange(size)
    at = frames.payload[index, None] + column
    length = frames.length[index]
    short = length < size
    if short.any():
        np.minimum(at, len(raw) - 1, out=at)
        cells = raw[at]
        cells[column >= length[:, None]] = 0
    else:
        cells = raw[at]
    return np.ascontiguousarray(cells).view(message.dtype)[:, 0]


def instances(source: Source, payload: Rows) -> Iterator[tuple[str, Mask | None]]:
    """Sensor names that the payloads speak of, each with its rows (None: all).

    An instance number beyond what the monitor names gives the quantity's bare name.
    """
    if source.instance is None:
        yield source.sensor, None
        return
    number = payload[source.instance].astype(np.int64)
    limit = MAX_INSTANCES[source.quantity]
    numbers = sorted(set(number.tolist()))
    for k in numbers:
        if k < limit:
            yield source.sensor.format(k), (None if len(numbers) == 1 else number == k)
    if numbers and numbers[-1] >= limit:
        yield source.quantity, number >= limit


def cas_from_pressure(
    diff_press_pa: NDArray[np.float64], ratio: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Calibrated airspeed as ArduPilot computes it [m/s].

    ``sqrt(max(ratio * diff_press, 0))``: ``ratio`` is ARSPD_RATIO, ideally 2 / rho0 = 1.633 and
    2.0 with the losses of a common pitot.
    """
    return np.asarray(np.sqrt(np.maximum(ratio * diff_press_pa, 0.0)), dtype=np.float64)


def build_rows(
    source: Source,
    sensor: str,
    payload: Rows,
    rejected: Counter[tuple[str, Rejection]],
    ratio: NDArray[np.float64] | None = None,
) -> tuple[Rows, Mask]:
    """Rows of ``sensor`` without their keys, and which of them are usable.

    Parameters
    ----------
    payload : (n,) structured
        Payloads that carry this sensor.
    rejected
        What is not usable is counted here.
    ratio : (n,) float64
        ARSPD_RATIO in force at each row, for sources with ``source.ratio``.
    """
    rows = empty_rows(sensor, len(payload))
    good = np.ones(len(payload), np.bool_)
    for fill in source.fills:
        value = _value(fill, payload, rows[fill.into])
        rows[fill.into] = value
        if value.dtype.kind != "f" or not fill.required:
            continue
        inside: NDArray[Any] = (value >= fill.low) & (value <= fill.high)
        if not fill.bounded:
            inside &= np.isfinite(value)
        if inside.all():
            continue
        finite: NDArray[Any] = np.isfinite(value)
        if value.ndim > 1:
            finite, inside = np.all(finite, axis=1), np.all(inside, axis=1)
        _count(rejected, sensor, Rejection.NON_FINITE, good & ~finite)
        _count(rejected, sensor, Rejection.OUT_OF_RANGE, good & finite & ~inside)
        good &= finite & inside
    if source.ratio and ratio is not None:
        rows["cas_m_s"] = cas_from_pressure(rows["diff_press_pa"], ratio)
    return rows, good


def _value(fill: Fill, payload: Rows, like: NDArray[Any]) -> NDArray[Any]:
    if fill.compute is not None:
        return fill.compute(payload)
    if like.dtype.kind != "f":
        return payload[fill.fields[0]]
    if len(fill.fields) == 1:
        return payload[fill.fields[0]] * np.float64(fill.scale) + fill.offset
    value = np.empty((len(payload), len(fill.fields)))
    for k, name in enumerate(fill.fields):
        np.multiply(payload[name], fill.scale, out=value[:, k], dtype=np.float64)
    if fill.offset:
        value += fill.offset
    return value


def _count(
    rejected: Counter[tuple[str, Rejection]], sensor: str, reason: Rejection, mask: Mask
) -> None:
    if n := int(np.count_nonzero(mask)):
        rejected[sensor, reason] += n
