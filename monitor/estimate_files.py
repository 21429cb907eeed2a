"""Estimates written to files while a log is read, so that they never stand in memory together."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self

import numpy as np

from links.samples import Rows

__all__ = ["ROWS_AT_ONCE", "EstimateFiles", "EstimateSink", "have_parquet"]

ROWS_AT_ONCE: Final = 4_096
"""Rows of one table that wait to be written: 7 minutes at 10 Hz, 1 MB at most."""

_UNFINISHED = ".unfinished"


class EstimateSink(Protocol):
    """Takes estimates as a pipeline gives them."""

    def add(self, estimates: Mapping[str, Rows]) -> None:
        """Take new rows, by the estimate's name."""
        ...


class _TableFile(Protocol):
    def write(self, rows: Rows) -> None: ...

    def close(self, more: Mapping[str, str]) -> None: ...


def have_parquet() -> bool:
    """Whether the ``report`` extra is installed."""
    return importlib.util.find_spec("pyarrow") is not None


class EstimateFiles:
    """Writes ``<name>.parquet`` and, if asked, ``<name>.csv`` of every estimate into a folder.

    A file has its name only once it is whole: until :meth:`finish` it ends in ``.unfinished``, and
    leaving the context without having finished removes it. What an earlier analysis left in
    the folder is replaced then, and not before.

    Parameters
    ----------
    folder
        Made with the first file.
    about
        Goes into the files' metadata.
    csv
        Write CSV files as well.
    rows_at_once
        Rows of one estimator that wait in memory.

    Raises
    ------
    OSError
        On every call: the folder or a file cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        about: Mapping[str, str],
        *,
        csv: bool = False,
        rows_at_once: int = ROWS_AT_ONCE,
    ) -> None:
        self._folder = folder
        self._about = about
        self._kinds = _kinds(csv=csv)
        self._rows_at_once = rows_at_once
        self._waiting: dict[str, list[Rows]] = {}
        self._open: dict[Path, _TableFile] = {}
        self._of: dict[str, list[_TableFile]] = {}
        self._begun: list[Path] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.discard()

    def add(self, estimates: Mapping[str, Rows]) -> None:
        """Take new rows, by the estimate's name; each name keeps one dtype."""
        if not self._kinds:
            return
        for name, rows in estimates.items():
            waiting = self._waiting.setdefault(name, [])
            waiting.append(rows)
            if sum(map(len, waiting)) >= self._rows_at_once:
                self._write(name)

    def finish(self, more: Mapping[str, str]) -> list[Path]:
        """Write what waits and give the files their names.

        ``more`` is what only the end of the log told; it goes into the files' footers.
        """
        for name in list(self._waiting):
            self._write(name)
        finished = []
        for path, file in sorted(self._open.items()):
            file.close(more)
            finished.append(path)
        self._open.clear()
        for path in finished:
            _unfinished(path).replace(path)
        for suffix, _ in _ALL_KINDS:
            for old in self._folder.glob(f"*{suffix}"):
                if old not in finished:
                    old.unlink()
        return finished

    def discard(self) -> None:
        """Remove what is not finished."""
        for file in self._open.values():
            with contextlib.suppress(OSError):  # the disk may be full: that is why we are here
                file.close({})
        for path in self._begun:
            _unfinished(path).unlink(missing_ok=True)
        self._open.clear()
        self._waiting.clear()

    def _write(self, name: str) -> None:
        waiting = self._waiting[name]
        rows = np.concatenate(waiting) if waiting else None
        if rows is None or not len(rows):
            return
        for file in self._of.get(name) or self._start(name, rows):
            file.write(rows)
        waiting.clear()

    def _start(self, name: str, rows: Rows) -> list[_TableFile]:
        self._folder.mkdir(parents=True, exist_ok=True)
        files = self._of[name] = []
        for suffix, kind in self._kinds:
            path = self._folder / f"{name}{suffix}"
            self._begun.append(path)  # first: Ctrl-C may come while it is opened
            about = {**self._about, "mavsentry.estimate": name}
            self._open[path] = kind(_unfinished(path), rows, about)
            files.append(self._open[path])
        return files


_Kind = tuple[str, Callable[[Path, Rows, Mapping[str, str]], _TableFile]]


def _parquet(path: Path, rows: Rows, about: Mapping[str, str]) -> _TableFile:
    from monitor.parquet import ParquetFile

    return ParquetFile(path, rows, about)


def _csv(path: Path, rows: Rows, _: Mapping[str, str]) -> _TableFile:
    from monitor.csv_file import CsvFile

    return CsvFile(path, rows)


_ALL_KINDS: Final[tuple[_Kind, ...]] = ((".parquet", _parquet), (".csv", _csv))


def _kinds(*, csv: bool) -> tuple[_Kind, ...]:
    parquet, comma_separated = _ALL_KINDS
    return ((parquet,) if have_parquet() else ()) + ((comma_separated,) if csv else ())


def _unfinished(path: Path) -> Path:
    return path.with_name(path.name + _UNFINISHED)
