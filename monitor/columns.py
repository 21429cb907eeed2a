"""Estimates as flat columns, one number each, with the unit in every name."""

from __future__ import annotations

from typing import Any, Final

from numpy.typing import NDArray

from links.samples import Rows

__all__ = ["flat", "unit_of"]

_AXES = ("x", "y", "z")
_EARTH = ("north", "east", "down")

_UNITS: Final = {
    "_m_s2": "m/s^2",
    "_rad_s": "rad/s",
    "_m_s": "m/s",
    "_percent": "%",
    "_rad": "rad",
    "_rpm": "1/min",
    "_us": "us",
    "_pa": "Pa",
    "_m": "m",
    "_k": "K",
    "_s": "s",
}
"""End of a name -> its unit; the longer ends first."""


def unit_of(column: str) -> str:
    """Unit that the name of a column ends in: ``unit_of("wind_east_m_s") == "m/s"``.

    ``"1"`` for a number without a unit.
    """
    return next((unit for end, unit in _UNITS.items() if column.endswith(end)), "1")


def flat(rows: Rows) -> dict[str, NDArray[Any]]:
    """Column name -> its values.

    A vector field becomes one column per axis (north, east and down where the field says ``_ned``,
    else x, y and z), or numbered ones where the vector is none of space.
    """
    columns: dict[str, NDArray[Any]] = {}
    for field in rows.dtype.names or ():
        values = rows[field]
        if values.ndim == 1:
            columns[field] = values
            continue
        if values.shape[1] == len(_AXES):
            axes: tuple[str, ...] = _EARTH if "_ned" in field else _AXES
        else:
            axes = tuple(str(k + 1) for k in range(values.shape[1]))
        stem = field.replace("_ned", "")
        for axis, column in zip(axes, values.T, strict=True):
            columns[_with_axis(stem, axis)] = column
    return columns


def _with_axis(field: str, axis: str) -> str:
    """``wind_std_m_s`` and ``north`` give ``wind_north_std_m_s``."""
    head, _, tail = field.partition("_")
    return f"{head}_{axis}_{tail}"
