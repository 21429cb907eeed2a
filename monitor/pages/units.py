"""Units as people read them on a screen: degrees instead of radians, the others by their sign."""

from __future__ import annotations

import math
from typing import Final

__all__ = ["as_written", "on_screen", "quantity"]

_SHOWN: Final = {
    "rad": (180.0 / math.pi, "deg"),
    "rad/s": (180.0 / math.pi, "deg/s"),
    "m/s^2": (1.0, "m/s²"),
    "m/s2": (1.0, "m/s²"),
    "1/min": (1.0, "rpm"),
    "1": (1.0, ""),
}


def on_screen(unit: str) -> tuple[float, str]:
    """Factor to the unit that is shown, and that unit: ``on_screen("rad/s")[1] == "deg/s"``."""
    return _SHOWN.get(unit, (1.0, unit))


def as_written(words: str) -> str:
    """Words of a verdict, which MAVLink keeps to ASCII: ``as_written("2 m/s^2") == "2 m/s²"``."""
    return words.replace("m/s^2", "m/s²")


def quantity(value: float | None, unit: str | None, *, sign: bool = False) -> str:
    """A value with its unit, to three digits; a dash where it is not known.

    >>> quantity(0.0349066, "rad"), quantity(-3.0, "m/s", sign=True)
    ('2 deg', '−3 m/s')
    """
    if value is None or not math.isfinite(value):
        return "–"
    factor, shown = on_screen(unit or "")
    number = f"{value * factor:{'+' if sign else ''}.3g}".replace("-", "−")
    return f"{number} {shown}".rstrip()
