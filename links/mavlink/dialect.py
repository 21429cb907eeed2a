"""Message tables of a MAVLink dialect, read from pymavlink's generated classes.

Only the tables are used (wire order, types, CRC_EXTRA); framing, checksums, decoding and encoding
are our own, because pymavlink's per-message objects cost 20 us each and its log reader loses bytes.
"""

from __future__ import annotations

import importlib
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["CRC_TABLE", "Dialect", "Message", "enum_word", "load_dialect"]

_NUMPY_OF_WIRE = {
    "char": "S1",
    "uint8_t": "u1",
    "uint8_t_mavlink_version": "u1",
    "int8_t": "i1",
    "uint16_t": "<u2",
    "int16_t": "<i2",
    "uint32_t": "<u4",
    "int32_t": "<i4",
    "uint64_t": "<u8",
    "int64_t": "<i8",
    "float": "<f4",
    "double": "<f8",
}


def _crc_table() -> tuple[int, ...]:
    """Byte table of CRC-16/MCRF4XX (reflected polynomial 0x8408), as MAVLink uses it."""
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0x8408 if crc & 1 else crc >> 1
        table.append(crc)
    return tuple(table)


CRC_TABLE = _crc_table()
"""One checksum step by hand: ``crc = (crc >> 8) ^ CRC_TABLE[(crc ^ byte) & 0xFF]``."""


@dataclass(frozen=True, slots=True)
class Message:
    """One message of a dialect: its number, checksum seed and wire layout.

    Attributes
    ----------
    dtype
        Packed little-endian structured dtype of the payload in wire order, extensions included.
    packer
        The same layout as one ``struct.Struct``.
    wire_fields, wire_counts
        Field names in wire order; number of elements of each (1 for scalars and strings).
    base_size
        Payload size without the MAVLink 2 extension fields [bytes], what MAVLink 1 carries.
    """

    id: int
    name: str
    crc_extra: int
    dtype: np.dtype[np.void]
    packer: struct.Struct
    wire_fields: tuple[str, ...]
    wire_counts: tuple[int, ...]
    base_size: int


@dataclass(frozen=True, slots=True)
class Dialect:
    """Messages of one dialect by number and by name.

    Attributes
    ----------
    extras : (m,) int16
        Message number -> CRC_EXTRA + 1, 0 where the dialect has no such message: for the framer.
    """

    name: str
    by_id: Mapping[int, Message]
    by_name: Mapping[str, Message]
    extras: NDArray[np.int16]


def _extension_fields(cls: Any) -> int:
    """Count of trailing fields that are MAVLink 2 extensions.

    pymavlink keeps no list of them, but CRC_EXTRA covers the base fields only, so the number of
    base fields is the one whose checksum is the message's CRC_EXTRA.
    """
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    crc = 0xFFFF

    def accumulate(text: bytes) -> None:
        nonlocal crc
        for byte in text:
            crc = (crc >> 8) ^ CRC_TABLE[(crc ^ byte) & 0xFF]

    accumulate(cls.msgname.encode() + b" ")
    total = len(cls.ordered_fieldnames)
    matching = total
    for i, field in enumerate(cls.ordered_fieldnames):
        accumulate(types[field].removesuffix("_mavlink_version").encode() + b" ")
        accumulate(field.encode() + b" ")
        if cls.array_lengths[i]:
            accumulate(bytes([cls.array_lengths[i]]))
        if (crc & 0xFF) ^ (crc >> 8) == cls.crc_extra:
            matching = i + 1
            break
    return total - matching


def _message(cls: Any) -> Message:
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    fields: list[Any] = []
    counts = []
    for field, count in zip(cls.ordered_fieldnames, cls.array_lengths, strict=True):
        wire = types[field]
        if wire == "char":
            fields.append((field, f"S{count or 1}"))
            counts.append(1)
        else:
            code = _NUMPY_OF_WIRE[wire]
            fields.append((field, code, (count,)) if count else (field, code))
            counts.append(count or 1)
    dtype = np.dtype(fields)
    base = len(fields) - _extension_fields(cls)
    base_size = sum(dtype[i].itemsize for i in range(base))
    return Message(
        id=cls.id,
        name=cls.msgname,
        crc_extra=cls.crc_extra,
        dtype=dtype,
        packer=struct.Struct(cls.unpacker.format),
        wire_fields=tuple(cls.ordered_fieldnames),
        wire_counts=tuple(counts),
        base_size=base_size,
    )


def _extras(messages: Sequence[Message]) -> NDArray[np.int16]:
    extras = np.zeros(max(m.id for m in messages) + 1, np.int16)
    for m in messages:
        extras[m.id] = m.crc_extra + 1
    return extras


@lru_cache(maxsize=4)
def load_dialect(name: str = "ardupilotmega") -> Dialect:
    """Tables of a dialect that pymavlink ships (``"ardupilotmega"``, ``"common"``, ``"all"`` ...).

    Raises
    ------
    ValueError
        When pymavlink ships no such dialect; the sentence names it.
    """
    try:
        if not re.fullmatch(r"\w+", name):
            raise ModuleNotFoundError
        module = importlib.import_module(f"pymavlink.dialects.v20.{name}")
    except ModuleNotFoundError:
        raise ValueError(f"pymavlink has no MAVLink dialect called {name!r}") from None
    messages = [_message(cls) for cls in module.mavlink_map.values() if cls.id >= 0]
    return Dialect(
        name=name,
        by_id={m.id: m for m in messages},
        by_name={m.name: m for m in messages},
        extras=_extras(messages),
    )


def enum_word(enum: str, value: int) -> str:
    """Name of an enum's value without the enum's own: ``("MAV_TYPE", 1)`` is ``"FIXED_WING"``.

    A value that the common dialect does not have is given as its number.
    """
    module = importlib.import_module("pymavlink.dialects.v20.common")
    entry = module.enums[enum].get(value)
    return str(value) if entry is None else str(entry.name).removeprefix(f"{enum}_")
