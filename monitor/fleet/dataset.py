"""The results of many logs as a partitioned Parquet dataset: one folder a table, one a month.

::

    dataset/logs/month=2026-03/part-0.parquet      one row a log, the failed ones with their reason
    dataset/faults/month=...                       one row a fault
    dataset/events/month=...                       engines that stopped
    dataset/sensors/month=...                      one row a watched sensor of a log

A run adds its logs to those that are there, and replaces those that it judged anew. ``logs`` is
written last: a log whose row is there has all of its other rows.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from monitor.fleet.outcome import Outcome, Status
from monitor.fleet.places import Place
from monitor.fleet.sources import Source
from monitor.fleet.tables import SCHEMAS, AircraftRule, rows_of

__all__ = ["DATASET", "DatasetError", "Results", "load", "merged", "save", "unknown"]

DATASET = "dataset"
FILE = "part-0.parquet"
TOGETHER = 500
"""Logs whose rows are turned into columns at once."""

Tables = Mapping[str, pa.Table]


class DatasetError(Exception):
    """A dataset that cannot be read, in one plain sentence."""


class Results:
    """Gathers the rows of logs as they end, in columns.

    Parameters
    ----------
    aircraft
        Tells whose log it is.
    """

    def __init__(self, aircraft: AircraftRule) -> None:
        self._aircraft = aircraft
        self._rows: dict[str, list[dict[str, Any]]] = {name: [] for name in SCHEMAS}
        self._parts: dict[str, list[pa.Table]] = {name: [] for name in SCHEMAS}
        self.logs = 0

    def add(self, source: Source, outcome: Outcome) -> None:
        """Take one log's outcome."""
        for name, rows in rows_of(outcome, source, self._aircraft).items():
            self._rows[name] += rows
        self.logs += 1
        if self.logs % TOGETHER == 0:
            self._settle()

    def tables(self) -> dict[str, pa.Table]:
        """All rows taken so far."""
        self._settle()
        return {
            name: pa.concat_tables([schema.empty_table(), *self._parts[name]])
            for name, schema in SCHEMAS.items()
        }

    def _settle(self) -> None:
        for name, schema in SCHEMAS.items():
            if self._rows[name]:
                self._parts[name].append(pa.Table.from_pylist(self._rows[name], schema))
                self._rows[name] = []


def load(place: Place) -> dict[str, pa.Table]:
    """The tables that stand there; empty ones where there are none.

    Raises
    ------
    DatasetError
        A file is damaged, or no table of ours.
    """
    return {
        name: pa.concat_tables([schema.empty_table(), *_parts(place, name, schema)])
        for name, schema in SCHEMAS.items()
    }


def _parts(place: Place, name: str, schema: pa.Schema) -> Iterator[pa.Table]:
    for file in place.list(f"{DATASET}/{name}", ".parquet"):
        month = file.split("/")[-2].partition("=")[2]
        try:
            part = pq.ParquetFile(io.BytesIO(place.read(file) or b"")).read()
            part = part.append_column("month", pa.array([month] * len(part), pa.string()))
            yield part.select(schema.names).cast(schema)
        except (pa.ArrowException, KeyError) as error:
            said = (str(error).splitlines() or [""])[0]
            raise DatasetError(
                f"{place.folder}/{file} is no part of a fleet's dataset ({said}); "
                "take another --out, or remove the dataset folder: the reports stay"
            ) from None


def unknown(tables: Tables, key: str, sources: Sequence[Source]) -> list[Source]:
    """Of these logs those whose outcome does not stand yet, or that have changed since.

    A copy is known as long as the log that stands for it is.

    Parameters
    ----------
    tables
        The dataset.
    key
        Of the settings and code in force.
    sources
        The logs.
    """
    logs = tables["logs"]
    final = pa.array([str(s) for s in (Status.JUDGED, Status.UNUSABLE, Status.COPY)])
    stands = pc.and_(pc.equal(logs["key"], key), pc.is_in(logs["status"], value_set=final))
    columns = (logs.filter(stands)[c].to_pylist() for c in ("log", "stamp", "copy_of"))
    known = {log: (stamp, copy_of) for log, stamp, copy_of in zip(*columns, strict=True)}
    changed = {s.shown for s in sources if not s.stamp or known.get(s.shown, ("",))[0] != s.stamp}
    return [s for s in sources if s.shown in changed or known[s.shown][1] in changed]


def merged(old: Tables, new: Tables) -> dict[str, pa.Table]:
    """The rows of both, those of a log in ``new`` instead of those in ``old``; copies told apart.

    Of logs with the same bytes one stands for all: the others have no fault and sensor of their
    own, so that no flight counts twice. A copy whose original is of other bytes now is dropped: it
    is to be judged anew.
    """
    anew = new["logs"]["log"]
    tables = {
        name: pa.concat_tables([_without(old[name], anew), new[name]]).sort_by(
            [(column, "ascending") for column in _ORDER[name]]
        )
        for name in SCHEMAS
    }
    copies, orphans = _copies(tables["logs"])
    if not copies and not orphans:
        return tables
    logs = _marked(_without(tables["logs"], pa.array(orphans, pa.string())), copies)
    named = pa.array(list(copies), pa.string())
    return {n: logs if n == "logs" else _without(t, named) for n, t in tables.items()}


_ORDER = {
    "logs": ("log",),
    "faults": ("log", "detected_s", "sensor"),
    "events": ("log", "detected_s", "what"),
    "sensors": ("log", "sensor"),
}


def _without(table: pa.Table, logs: pa.ChunkedArray | pa.Array) -> pa.Table:
    if isinstance(logs, pa.ChunkedArray):
        logs = logs.combine_chunks()
    return table.filter(pc.invert(pc.is_in(table["log"], value_set=logs)))


def _copies(logs: pa.Table) -> tuple[dict[str, str], list[str]]:
    """Log -> the log with the same bytes that stands for it; and copies of none."""
    standing: dict[str, str] = {}
    copies: dict[str, str] = {}
    orphans = []
    columns = (logs[c].to_pylist() for c in ("status", "log", "sha256"))
    rows = [r for r in zip(*columns, strict=True) if r[0] in (Status.JUDGED, Status.COPY)]
    rows.sort(key=lambda r: r[0] == Status.COPY)  # of two, the one that was judged stands
    for status, log, sha256 in rows:
        if sha256 in standing:
            copies[log] = standing[sha256]
        elif status == Status.JUDGED:
            standing[sha256] = log
        else:
            orphans.append(log)
    return copies, orphans


def _marked(logs: pa.Table, copies: Mapping[str, str]) -> pa.Table:
    rows = logs.to_pylist()
    for row in rows:
        if row["log"] in copies:
            row |= {"status": str(Status.COPY), "copy_of": copies[row["log"]]}
            row |= {"faults": 0, "doubtful": 0, "events": 0}
    return pa.Table.from_pylist(rows, logs.schema)


def save(place: Place, tables: Tables) -> None:
    """Write all tables, one file a month, and remove the months that are no more.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    for name in sorted(SCHEMAS, key=lambda n: n == "logs"):
        written = set()
        for month, part in _by_month(tables[name]):
            file = f"{DATASET}/{name}/month={month}/{FILE}"
            buffer = io.BytesIO()
            pq.write_table(part, buffer, compression="zstd")
            place.write(file, buffer.getvalue())
            written.add(file)
        for file in place.list(f"{DATASET}/{name}", ".parquet"):
            if file not in written:
                place.remove(file)


def _by_month(table: pa.Table) -> Iterable[tuple[str, pa.Table]]:
    for month in sorted(pc.unique(table["month"]).to_pylist()):
        yield month, table.filter(pc.equal(table["month"], month)).drop_columns(["month"])
