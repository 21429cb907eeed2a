"""What a DataFlash log says of its own records: names, layout, units and multipliers.

FMT gives a type its name, one letter per field and the fields' names; UNIT and MULT give meaning to
letters, and FMTU names the unit and the multiplier of each field by them. A letter of FMT may carry
a scale itself (``c`` is hundredths); then that counts and not the multiplier, which says the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.conversions import DEG
from links.samples import Rows

__all__ = ["CHAR_SIZES", "Column", "Format", "Table", "Units", "first_format", "in_unit"]

LETTERS: dict[str, tuple[str, float]] = {
    "a": ("(32,)<i2", 1.0),
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "g": ("<f2", 1.0),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "c": ("<i2", 1e2),
    "C": ("<u2", 1e2),
    "e": ("<i4", 1e2),
    "E": ("<u4", 1e2),
    "L": ("<i4", 1e7),
    "M": ("u1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}
"""Letter of a field -> its type, and what its value was multiplied by."""

CHAR_SIZES = np.zeros(256, np.int64)
for _letter, (_type, _) in LETTERS.items():
    CHAR_SIZES[ord(_letter)] = np.dtype(_type).itemsize

DIMENSIONS: dict[str, tuple[str, float]] = {
    "deg": ("angle", DEG),
    "degheading": ("angle", DEG),
    "deglatitude": ("angle", DEG),
    "deglongitude": ("angle", DEG),
    "rad": ("angle", 1.0),
    "deg/s": ("rate", DEG),
    "rad/s": ("rate", 1.0),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "m/s": ("speed", 1.0),
    "cm/s": ("speed", 1e-2),
    "mm/s": ("speed", 1e-3),
    "km/h": ("speed", 1 / 3.6),
    "m/s/s": ("acceleration", 1.0),
    "cm/s/s": ("acceleration", 1e-2),
    "Pa": ("pressure", 1.0),
    "hPa": ("pressure", 1e2),
    "kPa": ("pressure", 1e3),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "rpm": ("turns", 1.0),
    "Hz": ("turns", 60.0),
}
"""Label of a unit -> what it measures, and how much of that measure's first unit it is."""


def in_unit(label: str, wanted: str) -> float:
    """What one ``label`` is in the unit wanted; 1 where the two do not measure the same."""
    here, there = DIMENSIONS.get(label), DIMENSIONS.get(wanted)
    if here is None or there is None or here[0] != there[0] or label == wanted:
        return 1.0
    return here[1] / there[1]


@dataclass(frozen=True, slots=True)
class Column:
    """One field of a record.

    Attributes
    ----------
    name, letter
        As FMT has them.
    unit
        Label of its unit, "" when none was told.
    multiplier
        Its value times this is in that unit; 1 when none was told.
    """

    name: str
    letter: str
    unit: str = ""
    multiplier: float = 1.0

    @property
    def divisor(self) -> float:
        """What the value was multiplied by, as its letter says."""
        return LETTERS[self.letter][1]


@dataclass(frozen=True, slots=True)
class Format:
    """Layout of one type of record.

    Attributes
    ----------
    type, name, length
        Number, name and length with the header [bytes].
    columns
        Name -> field.
    dtype
        Of a body.
    """

    type: int
    name: str
    length: int
    columns: dict[str, Column]
    dtype: np.dtype[np.void]

    @staticmethod
    def of(type_: int, length: int, name: bytes, letters: bytes, labels: bytes) -> Format | None:
        """Layout that an FMT record describes; None where its letters do not fill its length."""
        name, letters, labels = (part.split(b"\0")[0] for part in (name, letters, labels))
        known = letters.decode("latin-1")
        if any(letter not in LETTERS for letter in known) or length <= 3:
            return None
        names = [part.strip() for part in labels.decode("latin-1").split(",")]
        columns: dict[str, Column] = {}
        for k, letter in enumerate(known):
            told = names[k] if k < len(names) else ""
            told = told if told and told not in columns else f"field{k}"
            columns[told] = Column(told, letter)
        if len(columns) < len(known):
            return None
        dtype = np.dtype([(c.name, LETTERS[c.letter][0]) for c in columns.values()])
        if dtype.itemsize + 3 != length:
            return None
        return Format(type_, name.decode("latin-1"), length, columns, dtype)

    def with_units(self, units: list[tuple[str, float]]) -> Format:
        """The same with the unit and multiplier of each field, as far as they are told."""
        told = zip(self.columns.items(), units, strict=False)
        changed = {
            name: Column(name, column.letter, unit, multiplier)
            for (name, column), (unit, multiplier) in told
        }
        return replace(self, columns={**self.columns, **changed})

    def kind(self, name: str) -> str:
        """What a field holds, as numpy's letter; "" where it is not one value."""
        return "" if name not in self.columns or self.dtype[name].shape else self.dtype[name].kind

    @property
    def instance(self) -> str | None:
        """The field that tells the instance, where FMTU names one."""
        return next((c.name for c in self.columns.values() if c.unit == "instance"), None)


def first_format() -> Format:
    """The one format that needs no telling: of FMT itself."""
    made = Format.of(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    assert made is not None
    return made


@dataclass(frozen=True, slots=True)
class Table:
    """Records of one type, one behind the other.

    Attributes
    ----------
    format
        Their layout.
    raw : (n,) structured
        Their bodies.
    place : (n,) int64
        Number of each record among all of the file.
    """

    format: Format
    raw: Rows
    place: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.raw)

    def column(self, name: str) -> NDArray[Any]:
        """Values of a field with its letter's scale, as every DataFlash reader gives them."""
        value = self.raw[name]
        divisor = self.format.columns[name].divisor
        return value if divisor == 1.0 else value / divisor

    def columns(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """All fields by name."""
        for name, column in self.format.columns.items():
            value, divisor = self.raw[name], LETTERS[column.letter][1]
            yield name, value if divisor == 1.0 else value / divisor

    def values(self, name: str, unit: str = "") -> NDArray[Any]:
        """Values of a field in a unit: by its own unit and multiplier where they are told."""
        column = self.format.columns[name]
        value = self.column(name)
        if value.dtype.kind not in "iuf":
            return value
        scale = in_unit(column.unit, unit) if unit and column.unit else 1.0
        if column.divisor == 1.0 and column.unit:
            scale *= column.multiplier
        return value if scale == 1.0 else value * scale

    def part(self, lo: int, hi: int, layout: Format) -> Table:
        """Records ``lo`` to ``hi`` under a format of the same layout."""
        return Table(layout, self.raw[lo:hi], self.place[lo:hi])


class Units:
    """The letters of UNIT and MULT."""

    def __init__(self) -> None:
        self._labels: dict[int, str] = {}
        self._multipliers: dict[int, float] = {}

    def note_unit(self, letter: int, label: bytes) -> None:
        """Take a UNIT record."""
        self._labels[letter & 0xFF] = label.decode("latin-1")

    def note_multiplier(self, letter: int, value: float) -> None:
        """Take a MULT record: 0 stands for none; a float of seven digits was made a double."""
        usable = np.isfinite(value) and value > 0.0
        self._multipliers[letter & 0xFF] = float(f"{value:.7g}") if usable else 1.0

    def of(self, unit_letters: bytes, multiplier_letters: bytes) -> list[tuple[str, float]]:
        """Label and multiplier of each field of an FMTU record."""
        multipliers = multiplier_letters.ljust(len(unit_letters), b"-")
        return [
            (self._labels.get(u, ""), self._multipliers.get(m, 1.0))
            for u, m in zip(unit_letters, multipliers, strict=False)
        ]
