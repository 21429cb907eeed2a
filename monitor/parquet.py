"""One estimator's rows as a Parquet file that grows while a log is read (extra ``report``)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from links.samples import Rows
from monitor.columns import flat, unit_of

__all__ = ["ParquetFile"]


class ParquetFile:
    """Writes row groups; every column's unit stands in its metadata under ``unit``.

    Parameters
    ----------
    path
        The file, made anew.
    first
        Rows that tell the columns; they are not written.
    about
        Metadata of the table.

    Raises
    ------
    OSError
        Here and on every call: the file cannot be written.
    """

    suffix = ".parquet"

    def __init__(self, path: Path, first: Rows, about: Mapping[str, str]) -> None:
        self._schema = pa.schema(
            [
                pa.field(name, pa.from_numpy_dtype(column.dtype), metadata={"unit": unit_of(name)})
                for name, column in flat(first[:0]).items()
            ],
            metadata=dict(about),
        )
        # Floating-point columns of a filter repeat no value: a dictionary would only cost time.
        self._file = pq.ParquetWriter(path, self._schema, compression="zstd", use_dictionary=False)

    def write(self, rows: Rows) -> None:
        """Append rows as one row group."""
        columns = [pa.array(np.ascontiguousarray(column)) for column in flat(rows).values()]
        self._file.write_table(pa.table(columns, schema=self._schema))

    def close(self, more: Mapping[str, str]) -> None:
        """Finish the file; ``more`` is what only the end of the log told, for its footer."""
        if more:
            self._file.add_key_value_metadata(dict(more))
        self._file.close()
