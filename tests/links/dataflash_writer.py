"""A small DataFlash writer: what an ArduPilot of any age would have logged."""

from __future__ import annotations

import struct
from typing import Any

HEAD = b"\xa3\x95"
CODES = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s",
    "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q",
    "Q": "Q",
}  # fmt: skip
SCALES = {"c": 1e2, "C": 1e2, "e": 1e2, "E": 1e2, "L": 1e7}
UNITS = {"#": "instance", "k": "deg/s", "s": "s", "E": "rad/s", "P": "Pa", "n": "m/s", "-": ""}
MULTIPLIERS = {"F": 1e-6, "C": 1e-3, "-": 0.0, "0": 1.0}


class DataflashWriter:
    """``define`` messages, ``put`` records; ``content`` is the file."""

    def __init__(self) -> None:
        self._types: dict[str, tuple[int, str]] = {}
        self._out = bytearray()
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
        number = number or 140 + len(self._types)
        length = 3 + struct.calcsize("<" + "".join(CODES[c] for c in letters))
        self._types[name] = number, letters
        body = struct.pack(
            "<BB4s16s64s", number, length, *map(str.encode, (name, letters, columns))
        )
        self._out += HEAD + bytes([128]) + body
        if units:
            self.put("FMTU", 1, number, units, mult)

    def tell_units(self) -> None:
        for letter, label in UNITS.items():
            self.put("UNIT", 1, ord(letter), label)
        for letter, value in MULTIPLIERS.items():
            self.put("MULT", 1, ord(letter), value)

    def put(self, name: str, *values: Any) -> None:
        number, letters = self._types[name]
        raw = [
            v.encode() if isinstance(v, str)
            else round(v * SCALES[c]) if c in SCALES else v
            for c, v in zip(letters, values, strict=True)
        ]  # fmt: skip
        form = "<" + "".join(CODES[c] for c in letters)
        self._out += HEAD + bytes([number]) + struct.pack(form, *raw)

    def content(self) -> bytes:
        return bytes(self._out)
