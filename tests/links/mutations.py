"""Damage to log files: what a mutation does, where a format is easily hurt, how inputs are drawn.

A mutation is four numbers, so that hypothesis can shrink it, a generator can draw millions of them
and a failure is repeated by its seed. Those that hit on purpose what a reader relies on (a length,
a stamp, a number) are applied first, to places found in the undamaged log; telemetry frames get
their check sum back afterwards, or the reader would see next to nothing of them.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from fastcrc.crc16 import mcrf4xx

from links.mavlink.dialect import load_dialect

AIMED = ("length", "stamp", "value")
BLIND = ("flip", "noise", "set", "zero", "overwrite")
CUTTING = ("cut", "drop", "garbage", "prefix", "duplicate", "move")
KINDS = (*AIMED, *BLIND, *CUTTING)
NUMBERS = (0, 1, 2, 3, 0x7F, 0x80, 0xFE, 0xFF, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF)
FLOATS = [
    struct.pack(form, x)
    for form in ("<f", "<d")
    for x in (np.nan, np.inf, -np.inf, 1e38, -1e38, 1e-40, 0.0, 1e9)
]

Place = tuple[int, int]
"""Offset and bytes."""


@dataclass(frozen=True, slots=True)
class Mutation:
    """One damage: its kind, where (a share of what there is), how much, and a number for the rest.

    ``size`` counts bytes, or of ``noise`` and ``stamp`` how often; every other ``stamp`` hits all
    that follow, as a clock that jumps does.
    """

    kind: str
    at: float
    size: int
    value: int


@dataclass(frozen=True, slots=True)
class Sound:
    """An undamaged log and its places that matter.

    Attributes
    ----------
    name, data
        What it is; the file's content.
    lengths
        What says how long or of what kind something is.
    stamps
        Times of consecutive records.
    values
        Contents of consecutive records, their stamps left out.
    big
        Stamps have their first byte first.
    seal
        Makes the check sum around a place right again.
    """

    name: str
    data: bytes
    lengths: list[Place] = field(default_factory=list)
    stamps: list[Place] = field(default_factory=list)
    values: list[Place] = field(default_factory=list)
    seal: Callable[[bytearray, int], None] = lambda data, at: None


def mutated(sound: Sound, mutations: Sequence[Mutation]) -> bytes:
    """The log after all of these happened to it."""
    data = bytearray(sound.data)
    for m in mutations:
        if m.kind in AIMED:
            _aim(data, sound, m)
    for m in mutations:
        if m.kind not in AIMED:
            data = _blind(data, m)
    return bytes(data)


def drawn(rng: np.random.Generator) -> list[Mutation]:
    """Some mutations, as they come."""
    return [
        Mutation(
            str(rng.choice(KINDS)),
            float(rng.random()),
            int(np.exp(rng.uniform(0.0, np.log(6000.0)))),
            int(rng.integers(0, 1 << 32)),
        )
        for _ in range(int(rng.choice([1, 1, 2, 3, 5, 12])))
    ]


def _aim(data: bytearray, sound: Sound, m: Mutation) -> None:
    places = {"length": sound.lengths, "stamp": sound.stamps, "value": sound.values}[m.kind]
    if not places:
        return
    first = int(m.at * len(places))
    if m.kind == "length":
        at, size = places[first]
        number = NUMBERS[m.value % len(NUMBERS)] if m.value & 64 else m.value >> 8
        told = number if m.value & 128 else _number(data, at, size) ^ 1 << m.value % (8 * size)
        data[at : at + size] = (told % (1 << 8 * size)).to_bytes(size, "little")
        sound.seal(data, at)
    elif m.kind == "stamp":
        by_us = (-1 if m.value & 1 else 1) << (m.value >> 1) % 62
        upto = len(places) if m.value & 256 else first + m.size
        for at, size in places[first:upto]:
            told = _number(data, at, size)
            unit = 1000 if size == 4 else 1
            new = (told + by_us // unit) if m.value & 128 else told ^ abs(by_us)
            data[at : at + size] = (new % (1 << 8 * size)).to_bytes(size, "little")
            sound.seal(data, at)
    else:
        at, size = places[first]
        new = FLOATS[m.value % len(FLOATS)] if m.value & 256 else m.value.to_bytes(4, "little")
        offset = m.size % max(size, 1)
        data[at + offset : at + size] = (new + data[at + offset + len(new) : at + size])[
            : size - offset
        ]
        sound.seal(data, at)


def _number(data: bytearray, at: int, size: int) -> int:
    return int.from_bytes(data[at : at + size], "little")


def _blind(data: bytearray, m: Mutation) -> bytearray:
    if not data:
        return data
    at = int(m.at * len(data))
    end = at + m.size
    piece = data[at:end]
    other = m.value % len(data)
    match m.kind:
        case "flip":
            data[at] ^= 1 << m.value % 8
        case "noise":
            rng = np.random.default_rng(m.value)
            for k in rng.integers(0, len(data), m.size % 1000).tolist():
                data[k] ^= 1 << int(rng.integers(8))
        case "set":
            data[at] = NUMBERS[m.value % len(NUMBERS)] & 0xFF if m.value & 64 else m.value & 0xFF
        case "zero":
            data[at:end] = bytes(len(piece))
        case "cut":
            return data[:at]
        case "drop":
            return data[:at] + data[end:]
        case "garbage" | "prefix":
            at = at if m.kind == "garbage" else 0
            return data[:at] + np.random.default_rng(m.value).bytes(m.size) + data[at:]
        case "overwrite":
            data[other : other + len(piece)] = piece
        case "duplicate":
            return data[:other] + piece + data[other:]
        case "move":
            rest = data[:at] + data[end:]
            other = min(other, len(rest))
            return rest[:other] + piece + rest[other:]
    return data


# --------------------------------------------------------------------------- where it hurts


def tlog_of(name: str, data: bytes) -> Sound:
    """Places of a telemetry log of whole frames."""
    return stream_of(name, data, 8)


def stream_of(name: str, data: bytes, stamp: int = 0) -> Sound:
    """Places of whole frames, each with a stamp of so many bytes before it."""
    messages = load_dialect().by_id
    frames: list[Place] = []
    sound = Sound(name, data, seal=lambda changed, at: _seal(changed, frames, at))
    at = stamp
    while at + 8 <= len(data):
        two = data[at] == 0xFD
        size, head = data[at + 1], 10 if two else 6
        number = int.from_bytes(data[at + 7 : at + 10], "little") if two else data[at + 5]
        end = at + head + size + 2
        frames.append((at, end))
        sound.lengths.extend([(at + 1, 1), (at + 7, 3) if two else (at + 5, 1)])
        sound.lengths.extend([(at + 2, 1), (at + 4, 1)])
        body = at + head
        known = messages.get(number)
        first = (known.dtype.names or ("",))[0] if known else ""
        width = {"time_boot_ms": 4, "time_usec": 8}.get(first, 0)
        if width and size >= width:
            sound.stamps.append((body, width))
        if size > width:
            sound.values.append((body + width, size - width))
        at = end + stamp + (13 if two and data[at + 2] & 1 else 0)
    return sound


def _seal(data: bytearray, frames: list[Place], at: int) -> None:
    extras = load_dialect().extras
    k = bisect_right(frames, at, key=lambda frame: frame[0]) - 1
    if k < 0:
        return
    start, _ = frames[k]
    two = data[start] == 0xFD
    number = int.from_bytes(data[start + 7 : start + 10], "little") if two else data[start + 5]
    end = start + (10 if two else 6) + data[start + 1]
    extra = max(int(extras[number]) - 1, 0) if number < len(extras) else 0
    data[end : end + 2] = struct.pack("<H", mcrf4xx(bytes(data[start + 1 : end]) + bytes([extra])))


def bin_of(name: str, data: bytes) -> Sound:
    """Places of a DataFlash log of whole records."""
    sound, lengths, names = Sound(name, data), {128: 89}, {128: b"FMT"}
    at = 0
    while at + 3 <= len(data) and data[at : at + 2] == b"\xa3\x95" and data[at + 2] in lengths:
        kind, body = data[at + 2], at + 3
        end = at + lengths[kind]
        sound.lengths.append((at + 2, 1))
        if kind == 128:
            lengths[data[body]] = data[body + 1]
            names[data[body]] = data[body + 2 : body + 6].rstrip(b"\0")
            sound.lengths.extend([(body, 1), (body + 1, 1)])
            sound.lengths.extend((body + k, 1) for k in range(2, 26))
            sound.lengths.extend((body + k, 1) for k in range(26, 90 - 3))
        elif names[kind] in (b"FMTU", b"UNIT", b"MULT"):
            sound.lengths.extend((body + k, 1) for k in range(8, end - body))
        else:
            sound.stamps.append((body, 8))
            sound.values.append((body + 8, end - body - 8))
        at = end
    return sound


def ulg_of(name: str, data: bytes) -> Sound:
    """Places of a ULog of whole messages."""
    sound = Sound(name, data)
    at = 16
    while at + 3 <= len(data):
        size, kind, body = int.from_bytes(data[at : at + 2], "little"), data[at + 2], at + 3
        sound.lengths.extend([(at, 2), (at + 2, 1)])
        if kind == ord("D"):
            sound.lengths.append((body, 2))
            sound.stamps.append((body + 2, 8))
            sound.values.append((body + 10, size - 10))
        else:
            sound.lengths.extend((body + k, 1) for k in range(size))
        at = body + size
    return sound
