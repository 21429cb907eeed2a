"""The fleet page's figures: faults by sensor, aircraft and month, doubts, worst offenders."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from monitor.fleet.dataset import Tables
from monitor.fleet.doubts import Doubt
from monitor.fleet.outcome import Status
from monitor.fleet.places import Place
from monitor.fleet.task import code_version

__all__ = ["PAGE", "Group", "lower_bound", "write_page"]

PAGE: Final = "index.html"
SHOWN: Final = 200
"""Longest table on the page; the dataset has the rest."""
MATRIX_AIRCRAFT: Final = 30
CLEAN_FLIGHTS: Final = 5
"""A fault stands alone when at least this many other flights judged the same sensor."""
Z90: Final = 1.2816
"""Normal quantile: one-sided 90 %."""


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
    faults
        Found.
    by
        What the faults are of: sensor or kind -> count.
    report
        Of the latest flight with a fault; empty without one.
    """

    name: str
    flights: int = 0
    faulty: int = 0
    hours: float = 0.0
    faults: int = 0
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


def lower_bound(hits: int, of: int) -> float:
    """Wilson's lower bound of a share, one-sided 90 %; 0 of nothing."""
    if of == 0 or hits == 0:
        return 0.0
    share, zz = hits / of, Z90**2
    spread = Z90 * math.sqrt((share * (1.0 - share) + zz / (4 * of)) / of)
    return (share + zz / (2 * of) - spread) / (1.0 + zz / of)


def write_page(place: Place, tables: Tables, key: str) -> None:
    """Write ``index.html``: one file that loads nothing.

    Parameters
    ----------
    place
        The folder of the results.
    tables
        The whole dataset.
    key
        Of the settings and code in force; logs judged with others are counted.

    Raises
    ------
    OSError
        The page cannot be written.
    """
    place.write(PAGE, _rendered(_figures(tables, key), "page.html.jinja").encode())


def _rendered(figures: Mapping[str, Any], template: str) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["number"] = _number
    environment.filters["size"] = _size
    environment.filters["percent"] = lambda share: f"{100.0 * share:.0f} %"
    return environment.get_template(template).render(figures)


def _figures(tables: Tables, key: str) -> dict[str, Any]:
    logs = tables["logs"].to_pylist()
    flights = [log for log in logs if log["status"] == Status.JUDGED]
    faults = tables["faults"].to_pylist()
    pairs = _pairs(tables["sensors"], faults)
    for fault in faults:
        pair = pairs.get((fault["aircraft"], fault["sensor"]))
        if pair is not None and pair.faulty == 1 and pair.flights > CLEAN_FLIGHTS:
            fault["alone"] = str(Doubt.ALONE)
    doubted = [f for f in faults if f["doubts"] and not f["autopilot_agrees"]]
    doubted.sort(key=lambda f: -len(f["doubts"]) - ("alone" in f))
    faults.sort(key=_when, reverse=True)
    offenders = sorted(
        (p for p in pairs.values() if p.faulty), key=lambda p: (-p.surely, -p.faults, p.name)
    )
    return {
        "written": datetime.now(UTC),
        "version": code_version(),
        "logs": len(logs),
        "flights": len(flights),
        "hours": sum(log["judged_s"] for log in flights) / 3600.0,
        "faults": faults[:SHOWN],
        "n_faults": len(faults),
        "n_faulty": sum(log["faults"] > 0 for log in flights),
        "n_aircraft": len({log["aircraft"] for log in flights}),
        "n_copies": sum(log["status"] == Status.COPY for log in logs),
        "n_other_key": sum(log["key"] != key for log in flights),
        "n_learnt": sum(log["learnt_from_it"] for log in flights),
        "by_sensor": _by_sensor(tables["sensors"], faults),
        "by_aircraft": _by_flights(flights, faults, "aircraft", "sensor"),
        "by_month": sorted(
            _by_flights(flights, faults, "month", "sensor"), key=lambda g: g.name, reverse=True
        ),
        "matrix": _matrix(pairs, flights),
        "offenders": offenders[:SHOWN],
        "n_offenders": len(offenders),
        "doubted": doubted[:SHOWN],
        "n_doubted": len(doubted),
        "events": sorted(tables["events"].to_pylist(), key=lambda e: e["log"])[:SHOWN],
        "n_events": len(tables["events"]),
        "not_judged": _not_judged(logs),
        "shown": SHOWN,
    }


def _when(fault: Mapping[str, Any]) -> tuple[str, str, str]:
    detected = fault["detected"]
    return (fault["month"], detected.isoformat() if detected else "", fault["log"])


def _pairs(sensors: pa.Table, faults: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], Group]:
    """(aircraft, sensor) -> its flights."""
    pairs: dict[tuple[str, str], Group] = {}
    for row in _sums(sensors, ["aircraft", "sensor"]):
        name = f"{row['sensor']} of {row['aircraft']}"
        pairs[row["aircraft"], row["sensor"]] = _group(name, row)
    for fault in faults:
        pair = pairs.get((fault["aircraft"], fault["sensor"]))
        if pair is not None:
            pair.by[fault["kind"]] += 1
            pair.report = max(pair.report, fault["report"]) if not pair.report else pair.report
    return pairs


def _by_sensor(sensors: pa.Table, faults: Iterable[Mapping[str, Any]]) -> list[Group]:
    kinds: dict[str, Counter[str]] = defaultdict(Counter)
    for fault in faults:
        kinds[fault["sensor"]][fault["kind"]] += 1
    groups = [_group(row["sensor"], row) for row in _sums(sensors, ["sensor"])]
    for group in groups:
        group.by = kinds[group.name]
    return sorted((g for g in groups if g.flights), key=lambda g: (-g.faulty, -g.share, g.name))


def _sums(sensors: pa.Table, keys: list[str]) -> list[dict[str, Any]]:
    """Flights, faulty flights, seconds and faults of the judged rows by these columns."""
    judged = sensors.filter(pc.greater(sensors["judged_s"], 0.0))
    faulty = pc.cast(pc.greater(judged["faults"], 0), pa.int64())
    rows: list[dict[str, Any]] = (
        judged.append_column("faulty", faulty)
        .group_by(keys)
        .aggregate([("judged_s", "sum"), ("log", "count"), ("faults", "sum"), ("faulty", "sum")])
        .to_pylist()
    )
    return rows


def _group(name: str, row: Mapping[str, Any]) -> Group:
    return Group(
        name, row["log_count"], row["faulty_sum"], row["judged_s_sum"] / 3600.0, row["faults_sum"]
    )


def _by_flights(
    flights: Iterable[Mapping[str, Any]], faults: Iterable[Mapping[str, Any]], key: str, by: str
) -> list[Group]:
    groups: dict[str, Group] = {}
    for log in flights:
        group = groups.setdefault(log[key], Group(log[key]))
        group.flights += log["judged_s"] > 0.0
        group.faulty += log["faults"] > 0
        group.hours += log["judged_s"] / 3600.0
        group.faults += log["faults"]
    for fault in faults:
        groups[fault[key]].by[fault[by]] += 1
    return sorted(groups.values(), key=lambda g: (-g.faulty, -g.share, g.name))


def _matrix(
    pairs: Mapping[tuple[str, str], Group], flights: Iterable[Mapping[str, Any]]
) -> dict[str, Any]:
    """Aircraft by instrument: part of the flights with a fault of it."""
    cells: dict[tuple[str, str], Group] = {}
    worst: Counter[str] = Counter()
    for (aircraft, sensor), pair in pairs.items():
        instrument = sensor.partition(".")[0]
        cell = cells.setdefault((aircraft, instrument), Group(instrument))
        cell.flights = max(cell.flights, pair.flights)
        cell.faulty = max(cell.faulty, pair.faulty)
        worst[aircraft] += pair.faulty
    instruments = sorted({i for (_, i), c in cells.items() if c.flights})
    names = [name for name, _ in worst.most_common(MATRIX_AIRCRAFT)]
    return {
        "instruments": instruments,
        "rows": [(a, [cells.get((a, i)) for i in instruments]) for a in names],
        "left_out": len(worst) - len(names),
    }


def _not_judged(logs: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Logs without verdicts by reason, the most frequent first, with some of each."""
    by_reason: dict[tuple[str, str], list[str]] = defaultdict(list)
    for log in logs:
        if log["status"] in (Status.UNUSABLE, Status.FAILED):
            by_reason[log["status"], log["reason"]].append(log["log"])
    return [
        {"status": status, "reason": reason, "count": len(names), "some": names[:5]}
        for (status, reason), names in sorted(by_reason.items(), key=lambda item: -len(item[1]))
    ][:SHOWN]


def _number(value: float | None, digits: int = 3) -> str:
    """A number for people; a dash where there is none."""
    if value is None:
        return "–"
    if float(value).is_integer() and abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def _size(fault: Mapping[str, Any]) -> str:
    if fault["magnitude"] is None:
        return "–"
    value, unit = float(fault["magnitude"]), str(fault["unit"])
    if unit.startswith("rad"):
        value, unit = math.degrees(value), unit.replace("rad", "deg")
    return f"{value:+.3g} {unit}".strip()
