"""The fleet page's figures: faults by sensor, aircraft and month, doubts, worst offenders.

Sums are made in columns; only rows that are shown become objects, so that a hundred thousand logs
take seconds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from monitor.fleet.dataset import Tables
from monitor.fleet.doubts import Doubt
from monitor.fleet.outcome import Status
from monitor.fleet.tables import NO_MONTH

__all__ = ["Group", "Listed", "Matrix", "figures", "lower_bound"]

SHOWN: Final = 100
"""Longest list of faults, candidates, aircraft, months and reasons; the dataset has the rest."""
WORST: Final = 25
"""Longest list of offenders."""
NAMED: Final = 5
"""Logs that are named for each reason of having no verdict."""
MATRIX_AIRCRAFT: Final = 30
CLEAN_FLIGHTS: Final = 5
"""A fault stands alone when at least this many other flights judged the same sensor."""
Z90: Final = 1.2816
"""Normal quantile: one-sided 90 %."""

_APART = "\x1f"
"""Joins two names to one key."""
_NEWEST = [("month", "descending"), ("detected", "descending"), ("log", "ascending")]


@dataclass(slots=True)
class Group:
    """Flights that share a sensor, an aircraft, a month, or two of them.

    Attributes
    ----------
    name
        What they share.
    flights, faulty
        In which it was judged; of these, with a fault.
    hours
        Judged [h].
    faults, doubtful
        Found; of these, false-alarm candidates.
    by
        What the faults are of: sensor or kind -> count.
    report
        Of the newest flight with a fault; empty without one.
    """

    name: str
    flights: int = 0
    faulty: int = 0
    hours: float = 0.0
    faults: int = 0
    doubtful: int = 0
    by: Counter[str] = field(default_factory=Counter)
    report: str = ""

    @property
    def share(self) -> float:
        """Part of the flights with a fault."""
        return self.faulty / self.flights if self.flights else 0.0

    @property
    def surely(self) -> float:
        """At least this part of all its flights, as far as so few tell (one-sided 90 %)."""
        return lower_bound(self.faulty, self.flights)


@dataclass(frozen=True, slots=True)
class Listed:
    """The first rows of a list, and how many there are in all."""

    rows: Sequence[Any]
    of: int

    @property
    def more(self) -> int:
        """Rows that are not shown."""
        return self.of - len(self.rows)


@dataclass(frozen=True, slots=True)
class Matrix:
    """Aircraft by instrument: the flights that judged it, and those with a fault of it.

    Attributes
    ----------
    instruments
        Columns.
    rows
        Aircraft with a cell for each instrument, None where it never was judged.
    more
        Aircraft with faults that are not shown.
    """

    instruments: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Group | None]]]
    more: int


def lower_bound(hits: int, of: int) -> float:
    """Wilson's lower bound of a share, one-sided 90 %; 0 of nothing."""
    if of == 0 or hits == 0:
        return 0.0
    share, zz = hits / of, Z90**2
    spread = Z90 * math.sqrt((share * (1.0 - share) + zz / (4 * of)) / of)
    return (share + zz / (2 * of) - spread) / (1.0 + zz / of)


def figures(tables: Tables, key: str) -> dict[str, Any]:
    """Everything that the page shows, by the names that its template uses.

    Parameters
    ----------
    tables
        The whole dataset.
    key
        Of the settings and code in force; logs judged with others are counted.
    """
    logs = tables["logs"]
    flights = logs.filter(pc.equal(logs["status"], str(Status.JUDGED)))
    flown = flights.filter(pc.greater(flights["judged_s"], 0.0))
    sensors = _judged(tables["sensors"])
    pairs = _groups(sensors, ["aircraft", "sensor"])
    faults = _marked(tables["faults"], pairs).sort_by(_NEWEST)
    doubted = faults.filter(faults["doubtful"])
    hours = _sum(flights, "judged_s") / 3600.0
    return {
        "n_logs": len(logs),
        "n_flights": len(flights),
        "n_flown": len(flown),
        "n_faulty": _sum(flights, "faulty"),
        "n_aircraft": pc.count_distinct(flights["aircraft"]).as_py(),
        "n_copies": _count(logs, "status", str(Status.COPY)),
        "n_other_key": len(flights) - _count(flights, "key", key),
        "n_learnt": _count(flights, "learnt_from_it", True),
        "n_faults": len(faults),
        "n_doubted": len(doubted),
        "hours": hours,
        "doubted_per_hour": len(doubted) / hours if hours else None,
        "by_sensor": _listed(_by(sensors, faults, "sensor", "kind")),
        "by_aircraft": _listed(_by(flights, faults, "aircraft", "sensor")),
        "by_month": _listed(_by_month(flights, faults)),
        "matrix": _matrix(sensors),
        "offenders": _offenders(pairs, faults),
        "worst": _worst(flights),
        "doubted": _rows(doubted.sort_by([("reasons", "descending"), *_NEWEST])),
        "faults": _rows(faults),
        "newest": _rows(
            flights.sort_by(
                [("month", "descending"), ("start", "descending"), ("log", "ascending")]
            )
        ),
        "events": _rows(tables["events"].sort_by([("month", "descending"), ("log", "ascending")])),
        "not_judged": _not_judged(logs),
    }


def _judged(sensors: pa.Table) -> pa.Table:
    """Rows of sensors that were judged, with ``faulty`` and the instrument that they belong to."""
    judged = sensors.filter(pc.greater(sensors["judged_s"], 0.0))
    instrument = pc.replace_substring_regex(judged["sensor"], r"\..*", "")
    return judged.append_column("instrument", instrument)


def _marked(faults: pa.Table, pairs: Sequence[Mapping[str, Any]]) -> pa.Table:
    """The faults with ``alone``, ``doubtful`` and how many ``reasons`` there are to doubt them.

    That a fault stands alone speaks against it only beside another reason: most sensors break once.
    """
    alone = [
        _APART.join((p["aircraft"], p["sensor"]))
        for p in pairs
        if p["faulty"] == 1 and p["flights"] > CLEAN_FLIGHTS
    ]
    keys = pc.binary_join_element_wise(faults["aircraft"], faults["sensor"], _APART)
    stands_alone = pc.is_in(keys, value_set=pa.array(alone, pa.string()))
    reasons = pc.list_value_length(faults["doubts"])
    doubtful = pc.and_(pc.greater(reasons, 0), pc.invert(faults["autopilot_agrees"]))
    return (
        faults.append_column("alone", stands_alone)
        .append_column("doubtful", doubtful)
        .append_column("reasons", pc.add(reasons, pc.cast(stands_alone, pa.int32())))
    )


def _groups(rows: pa.Table, keys: list[str]) -> list[dict[str, Any]]:
    """Flights, faulty flights, seconds and faults of the rows that share these columns."""
    faulty = pc.cast(pc.greater(rows["faults"], 0), pa.int64())
    judged = pc.cast(pc.greater(rows["judged_s"], 0.0), pa.int64())
    sums = [("judged_s", "sum"), ("faults", "sum"), ("faulty", "sum"), ("judged", "sum")]
    table = (
        rows.select([*keys, "judged_s", "faults"])
        .append_column("faulty", faulty)
        .append_column("judged", judged)
        .group_by(keys)
        .aggregate(sums)
    )
    names = {f"{column}_sum": column for column, _ in sums} | {"judged_sum": "flights"}
    named: list[dict[str, Any]] = table.rename_columns(
        [names.get(column, column) for column in table.column_names]
    ).to_pylist()
    return named


def _group(name: str, row: Mapping[str, Any]) -> Group:
    hours = row["judged_s"] / 3600.0
    return Group(name, row["flights"], row["faulty"], hours, row["faults"])


def _by(rows: pa.Table, faults: pa.Table, key: str, of: str) -> list[Group]:
    """Groups by one column, those with the most faulty flights first."""
    groups = [_group(row[key], row) for row in _groups(rows, [key])]
    groups.sort(key=lambda g: (-g.faulty, -g.share, g.name))
    _fill({g.name: g for g in groups}, faults.append_column("key", faults[key]), of)
    return groups


def _fill(groups: Mapping[str, Group], faults: pa.Table, of: str) -> None:
    """What the faults of each group are of, how many are doubtful, and the newest report.

    Parameters
    ----------
    faults
        Newest first; its column ``key`` names the group.
    of
        Column that is counted.
    """
    found = faults.select(["key", of, "doubtful", "report"])
    found = found.set_column(2, "doubtful", pc.cast(found["doubtful"], pa.int64()))
    counted = found.group_by(["key", of], use_threads=False).aggregate(
        [("doubtful", "count"), ("doubtful", "sum"), ("report", "first")]
    )
    for row in counted.to_pylist():
        group = groups.get(row["key"])
        if group is not None:
            group.by[row[of]] = row["doubtful_count"]
            group.doubtful += row["doubtful_sum"]
            group.report = group.report or row["report_first"]


def _by_month(flights: pa.Table, faults: pa.Table) -> list[Group]:
    """The newest month first, logs without a date last."""
    months = _by(flights, faults, "month", "sensor")
    dated = sorted((g for g in months if g.name != NO_MONTH), key=lambda g: g.name, reverse=True)
    return dated + [g for g in months if g.name == NO_MONTH]


def _offenders(pairs: Sequence[Mapping[str, Any]], faults: pa.Table) -> Listed:
    """Sensors of aircraft that are faulty in the largest part of their flights, surely."""
    groups = {
        _APART.join((p["aircraft"], p["sensor"])): _group(p["sensor"], p)
        for p in pairs
        if p["faulty"]
    }
    keys = pc.binary_join_element_wise(faults["aircraft"], faults["sensor"], _APART)
    _fill(groups, faults.append_column("key", keys), "kind")
    ranked = sorted(groups.items(), key=lambda item: (-item[1].surely, -item[1].faults, item[0]))
    return _listed([(key.partition(_APART)[0], group) for key, group in ranked], WORST)


def _worst(flights: pa.Table) -> Listed:
    """Flights with more faults than one."""
    several = flights.filter(pc.greater(flights["faults"], 1))
    return _rows(several.sort_by([("faults", "descending"), ("log", "ascending")]), WORST)


def _matrix(sensors: pa.Table) -> Matrix:
    """An instrument is faulty in a flight when any of its axes is."""
    once = (
        sensors.group_by(["aircraft", "instrument", "log"])
        .aggregate([("judged_s", "max"), ("faults", "sum")])
        .rename_columns(["aircraft", "instrument", "log", "judged_s", "faults"])
    )
    cells: dict[str, dict[str, Group]] = {}
    worst: Counter[str] = Counter()
    for row in _groups(once, ["aircraft", "instrument"]):
        cells.setdefault(row["aircraft"], {})[row["instrument"]] = _group(row["instrument"], row)
        worst[row["aircraft"]] += row["faulty"]
    ranked = sorted((a for a, n in worst.items() if n), key=lambda a: (-worst[a], a))
    shown = ranked[:MATRIX_AIRCRAFT]
    instruments = sorted({i for a in shown for i in cells[a]})
    rows = [(a, [cells[a].get(i) for i in instruments]) for a in shown]
    return Matrix(instruments, rows, len(ranked) - len(rows))


def _not_judged(logs: pa.Table) -> Listed:
    """Logs without verdicts by reason, the most frequent first, with some of each."""
    bad = pa.array([str(Status.UNUSABLE), str(Status.FAILED)])
    lost = logs.filter(pc.is_in(logs["status"], value_set=bad)).select(["status", "reason", "log"])
    counted = lost.group_by(["status", "reason"]).aggregate([("log", "list")]).to_pylist()
    groups = [
        {
            "status": row["status"],
            "reason": row["reason"],
            "count": len(row["log_list"]),
            "some": sorted(row["log_list"])[:NAMED],
        }
        for row in counted
    ]
    groups.sort(key=lambda g: (-g["count"], g["reason"]))
    return Listed(groups[:SHOWN], len(groups))


def _rows(table: pa.Table, shown: int = SHOWN) -> Listed:
    return Listed(table.slice(0, shown).to_pylist(), len(table))


def _listed(rows: Sequence[Any], shown: int = SHOWN) -> Listed:
    return Listed(rows[:shown], len(rows))


def _sum(table: pa.Table, column: str) -> Any:
    if column == "faulty":
        return pc.sum(pc.cast(pc.greater(table["faults"], 0), pa.int64())).as_py() or 0
    return pc.sum(table[column]).as_py() or 0


def _count(table: pa.Table, column: str, value: object) -> int:
    counted: int = pc.sum(pc.cast(pc.equal(table[column], value), pa.int64())).as_py() or 0
    return counted


def doubts_of(fault: Mapping[str, Any]) -> list[str]:
    """All that speaks against a fault, that it stands alone among them."""
    return [*fault["doubts"], *([str(Doubt.ALONE)] if fault["alone"] else [])]
