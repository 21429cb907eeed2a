"""What a chart says under the pointer: every line's value at one moment, in one box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["HOVERED", "hover_columns"]

POINTS: Final = 600
"""Moments at which a chart can be asked, at most."""
HELD: Final = 3.0
"""A value stands for so many times the usual distance of its line's points."""
HOVERED: Final = "at"
"""Column at whose height the pointer finds the moment."""

Floats = NDArray[np.floating[Any]]
Line = tuple[str, Floats, Floats, Floats]


def hover_columns(lines: Sequence[Line]) -> tuple[dict[str, Floats], list[tuple[str, str]]]:
    """Columns of the moments, and what the box says of each line.

    The moments are those of the first line, joined until there are :data:`POINTS`; a joined
    moment has the least and the largest value of what it covers, so no peak is lost.

    Parameters
    ----------
    lines
        Name, seconds, least and largest values of each; the first is followed by the pointer.

    Returns
    -------
    columns
        ``t``, :data:`HOVERED`, and per line ``low0`` ... and ``high0`` ... where they differ.
    formats
        Per line its name and Bokeh's format of the value.
    """
    moments = _starts(lines)
    columns: dict[str, Floats] = {"t": moments}
    formats: list[tuple[str, str]] = []
    for k, (name, t_s, low, high) in enumerate(lines):
        least = _over(moments, t_s, low, np.fmin)
        most = least if low is high else _over(moments, t_s, high, np.fmax)
        digits = _digits(least, most)
        columns[f"low{k}"] = least
        shown = f"@low{k}{{{digits}}}"
        if not np.array_equal(least, most, equal_nan=True):
            columns[f"high{k}"] = most
            shown += f" to @high{k}{{{digits}}}"
        formats.append((name, shown))
    columns[HOVERED] = columns.pop("low0") if len(lines) == 0 else columns["low0"]
    return columns, formats


def _starts(lines: Sequence[Line]) -> Floats:
    """Moments of the line with the most of them, joined where there are too many."""
    t_s = max((line[1] for line in lines), key=len)
    t_s = t_s[np.isfinite(t_s)]
    return t_s[:: max(1, -(-t_s.size // POINTS))]


def _over(moments: Floats, t_s: Floats, y: Floats, join: np.ufunc) -> Floats:
    """Values joined from each moment to the next; where there is none, the one before it."""
    ends = np.append(moments[1:], np.inf)
    first, last = np.searchsorted(t_s, moments), np.searchsorted(t_s, ends)
    padded = np.append(y, np.nan)
    pairs = np.stack([first, np.maximum(last, first)], axis=1).ravel()
    joined = np.asarray(join.reduceat(padded, pairs)[::2], dtype=float)
    before = np.maximum(first - 1, 0)
    usual = float(np.median(np.diff(t_s))) if t_s.size > 1 else 0.0
    held = (first > 0) & (moments - t_s[before] <= HELD * usual)
    return np.where(last > first, joined, np.where(held, padded[before], np.nan))


def _digits(*values: Floats) -> str:
    """Bokeh's format with so many decimals that three digits of the largest value are seen."""
    largest = max(
        (float(np.nanmax(np.abs(v))) for v in values if np.isfinite(v).any()), default=1.0
    )
    decimals = 3 if largest < 0.1 else 2 if largest < 10.0 else 1 if largest < 1000.0 else 0
    return "0." + "0" * decimals if decimals else "0"
