"""One estimator's rows as a CSV file that grows while a log is read; needs no extra."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from monitor.columns import flat

__all__ = ["CsvFile"]


class CsvFile:
    """Writes a line of column names, then one line per row.

    Numbers have as many digits as it takes to read the same number again; what is not known (NaN)
    is an empty field.

    Parameters
    ----------
    path
        The file, made anew.
    first
        Rows that tell the columns; they are not written.

    Raises
    ------
    OSError
        Here and on every call: the file cannot be written.
    """

    suffix = ".csv"

    def __init__(self, path: Path, first: Rows) -> None:
        self._file = open(path, "w", newline="", encoding="utf-8")  # noqa: SIM115
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(flat(first[:0]))

    def write(self, rows: Rows) -> None:
        """Append rows."""
        columns = [_known(column) for column in flat(rows).values()]
        self._writer.writerows(zip(*columns, strict=True))

    def close(self, more: Mapping[str, str]) -> None:
        """Finish the file; what is to be said of it stands in ``summary.json``."""
        self._file.close()


def _known(column: NDArray[Any]) -> list[Any]:
    values: list[Any] = column.tolist()
    if column.dtype.kind == "f" and np.isnan(column).any():
        return [None if value != value else value for value in values]
    return values
