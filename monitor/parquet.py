"""Estimates as Parquet files, one per estimator, with the unit in every column name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from links.samples import Rows

__all__ = ["write_estimates"]

_AXES = ("x", "y", "z")
_EARTH = ("north", "east", "down")


def write_estimates(estimates: Mapping[str, Rows], folder: Path) -> list[Path]:
    """Write one Parquet file per name; vector fields become one column per axis,
    or numbered ones where the vector is none of space.

    Raises
    ------
    OSError
        The folder cannot be made or written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, rows in estimates.items():
        file = folder / f"{name}.parquet"
        pq.write_table(pa.table(_columns(rows)), file)
        written.append(file)
    return written


def _columns(rows: Rows) -> dict[str, pa.Array]:
    columns: dict[str, pa.Array] = {}
    for field in rows.dtype.names or ():
        values = rows[field]
        if values.ndim == 1:
            columns[field] = pa.array(values)
            continue
        if values.shape[1] == len(_AXES):
            axes: tuple[str, ...] = _EARTH if "_ned" in field else _AXES
        else:
            axes = tuple(str(k + 1) for k in range(values.shape[1]))
        stem = field.replace("_ned", "")
        for axis, column in zip(axes, values.T, strict=True):
            columns[_with_axis(stem, axis)] = pa.array(column)
    return columns


def _with_axis(field: str, axis: str) -> str:
    """``wind_std_m_s`` and ``north`` give ``wind_north_std_m_s``."""
    head, _, tail = field.partition("_")
    return f"{head}_{axis}_{tail}"
