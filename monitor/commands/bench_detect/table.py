"""The outcome as rows of numbers: shared by the terminal, Markdown and the picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from statistics import median
from typing import Any

from monitor.commands.bench_detect.bounds import rate_upper
from monitor.commands.bench_detect.search import misses_allowed

__all__ = ["AlarmRow", "Row", "alarm_rows", "curve", "rows"]

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Row:
    """One broken channel in one configuration.

    Attributes
    ----------
    configuration, sensor, unit
        What was broken; the unit of a step.
    step, ramp
        Smallest sizes as text, one per window; empty where that shape was not tried.
    trials
        Of all sizes and both shapes.
    by_pair
        Trials in which the axis that cannot be told apart was named instead; None where that is no
        answer.
    announced_s, named_s
        Medians over the steps that were found: until the disagreement of two sensors was announced,
        and until the broken one was named.
    wrong_axis, wrong_instrument, misled
        Trials in which another axis of the same IMU or another instrument was called faulty; and in
        which that came first, or alone.
    """

    configuration: str
    sensor: str
    unit: str
    step: tuple[str, ...]
    ramp: tuple[str, ...]
    trials: int
    by_pair: int | None
    announced_s: float
    named_s: float
    wrong_axis: int
    wrong_instrument: int
    misled: int


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """Healthy flights in one configuration: what was judged, what was wrongly found."""

    group: str
    configuration: str
    flights: int
    judged_h: float
    false: int
    upper_per_h: float


def rows(group: Json) -> Iterator[Row]:
    """Rows of one group's table, in the order of the configurations."""
    for part in group["configurations"]:
        sensors = dict.fromkeys(cell["sensor"] for cell in part["cells"])
        for sensor in sensors:
            cells = {c["shape"]: c for c in part["cells"] if c["sensor"] == sensor}
            total = {
                key: sum(cell[key] for cell in cells.values())
                for key in ("trials", "as_pair", "wrong_axis", "wrong_sensor", "misled")
            }
            yield Row(
                part["configuration"],
                sensor.partition(".")[2] or sensor,
                next(iter(cells.values()))["unit"].removesuffix(" a minute"),
                _sizes(cells.get("step")),
                _sizes(cells.get("ramp")),
                total["trials"],
                total["as_pair"] if part["pair_counts"] else None,
                _median(cells.get("step"), "announced_s"),
                _median(cells.get("step"), "named_s"),
                total["wrong_axis"],
                total["wrong_sensor"],
                total["misled"],
            )


def _sizes(cell: Json | None) -> tuple[str, ...]:
    """Smallest size per window; the ladder's ends are said to be ends."""
    if cell is None:
        return ()
    least, most = cell["ladder"]
    return tuple(
        f"> {most:g}" if size is None else f"<= {size:g}" if size == least else f"{size:g}"
        for size in cell["smallest"].values()
    )


def _median(cell: Json | None, key: str) -> float:
    """Of the delays of all trials that were found."""
    rungs = [] if cell is None else cell["rungs"]
    delays = [s for rung in rungs for s in rung[key] if s is not None]
    return median(delays) if delays else inf


def alarm_rows(document: Json) -> Iterator[AlarmRow]:
    """Healthy time and false alarms per group and configuration."""
    for group in document["groups"]:
        for part in group["configurations"]:
            hours = sum(flight["judged_s"] for flight in part["flights"]) / 3600.0
            false = sum(len(flight["false"]) for flight in part["flights"])
            yield AlarmRow(
                group["name"],
                part["configuration"],
                len(part["flights"]),
                hours,
                false,
                rate_upper(false, hours),
            )


def curve(cell: Json, trials: int) -> list[tuple[float, float]]:
    """(size, time within which 95 % of the trials were found), of the sizes where they were."""
    points = []
    for rung in cell["rungs"]:
        delays = sorted(inf if s is None else s for s in rung["named_s"])
        delays += [inf] * (trials - len(delays))
        within_s = delays[trials - 1 - misses_allowed(trials)]
        if within_s < inf:
            points.append((float(rung["size"]), float(within_s)))
    return points
