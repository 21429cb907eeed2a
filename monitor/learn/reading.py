"""A log's batches, with the reader told how far it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from links.logs.base import LogReader
from links.samples import Batch

__all__ = ["Progress", "read"]

Progress = Callable[[int, int], None]
"""Takes bytes read and bytes in all."""


def read(log: LogReader, progress: Progress | None) -> Iterator[Batch]:
    """Its batches in order; ``progress`` hears of each."""
    for batch in log:
        yield batch
        if progress is not None:
            progress(log.info.bytes_read, log.info.bytes)
