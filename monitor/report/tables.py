"""Where a report's numbers come from: the Parquet files of an analysis, or tables in memory.

Both give the columns that are asked for piece by piece, so that what is read of a flight of hours
never stands in memory together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from monitor.columns import flat
from monitor.estimate_files import ROWS_AT_ONCE

if TYPE_CHECKING:
    import pyarrow.parquet as pq

__all__ = ["MemoryTables", "ParquetTables", "Tables"]

Column = NDArray[Any]


class Tables(Protocol):
    """Estimates and traces by name, as flat columns (:func:`monitor.columns.flat`)."""

    def names(self) -> list[str]:
        """Names of the tables that there are."""
        ...

    def columns(self, name: str) -> list[str]:
        """Columns of a table, ``t_us`` first; none if there is no such table."""
        ...

    def until_us(self) -> int | None:
        """Time of the last row of all tables [us]; None if there is none."""
        ...

    def read(
        self, name: str, columns: Sequence[str], from_us: int, to_us: int
    ) -> Iterator[tuple[Column, ...]]:
        """Pieces of some columns in time order; rows outside the time may be among them.

        Raises
        ------
        KeyError
            There is no such table, or no such column in it.
        """
        ...


class MemoryTables:
    """Tables that stand in memory.

    Parameters
    ----------
    estimates
        Name -> rows in time order.
    """

    def __init__(self, estimates: Mapping[str, Rows]) -> None:
        self._columns = {name: flat(rows) for name, rows in estimates.items()}

    def names(self) -> list[str]:
        """Names of the tables that there are."""
        return sorted(self._columns)

    def columns(self, name: str) -> list[str]:
        """Columns of a table, ``t_us`` first; none if there is no such table."""
        return list(self._columns.get(name, ()))

    def until_us(self) -> int | None:
        """Time of the last row of all tables [us]; None if there is none."""
        ends = (int(c["t_us"][-1]) for c in self._columns.values() if len(c["t_us"]))
        return max(ends, default=None)

    def read(
        self, name: str, columns: Sequence[str], from_us: int, to_us: int
    ) -> Iterator[tuple[Column, ...]]:
        """Pieces of some columns (see :class:`Tables`)."""
        table = self._columns[name]
        begin, end = np.searchsorted(table["t_us"], (from_us, to_us + 1))
        wanted = [table[column] for column in columns]
        for at in range(begin, end, ROWS_AT_ONCE):
            piece = slice(at, min(at + ROWS_AT_ONCE, end))
            yield tuple(column[piece] for column in wanted)


class ParquetTables:
    """Tables that :class:`monitor.estimate_files.EstimateFiles` wrote (extra ``report``).

    Parameters
    ----------
    folder
        ``estimates`` of an analysis.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, list[str]] = {}

    def names(self) -> list[str]:
        """Names of the tables that there are."""
        return sorted(file.stem for file in self._folder.glob("*.parquet"))

    def columns(self, name: str) -> list[str]:
        """Columns of a table, ``t_us`` first; none if there is no such table."""
        if name not in self._known:
            import pyarrow.parquet as pq

            file = self._folder / f"{name}.parquet"
            self._known[name] = list(pq.read_schema(file).names) if file.is_file() else []
        return self._known[name]

    def until_us(self) -> int | None:
        """Time of the last row of all tables [us]; None if there is none."""
        ends = []
        for name in self.names():
            with self._open(name) as file:
                last = file.num_row_groups - 1
                told = _times(file, last) if last >= 0 else None
            if told is not None:
                ends.append(told[1])
        return max(ends, default=None)

    def read(
        self, name: str, columns: Sequence[str], from_us: int, to_us: int
    ) -> Iterator[tuple[Column, ...]]:
        """Pieces of some columns (see :class:`Tables`)."""
        known = self.columns(name)
        for column in columns:
            if column not in known:
                raise KeyError(column)
        with self._open(name) as file:
            for group in range(file.num_row_groups):
                told = _times(file, group)
                if told is not None and (told[1] < from_us or told[0] > to_us):
                    continue
                piece = file.read_row_group(group, columns=list(dict.fromkeys(columns)))
                yield tuple(piece[column].to_numpy() for column in columns)

    def _open(self, name: str) -> pq.ParquetFile:
        import pyarrow.parquet as pq

        return pq.ParquetFile(self._folder / f"{name}.parquet")


def _times(file: pq.ParquetFile, group: int) -> tuple[int, int] | None:
    """First and last time of a row group [us]; None if the file does not say."""
    column = file.schema_arrow.get_field_index("t_us")
    told = file.metadata.row_group(group).column(column).statistics
    return (told.min, told.max) if told is not None and told.has_min_max else None
