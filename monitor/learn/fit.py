"""Whether flights can be learnt from: healthy, enough of them, of one vehicle, each once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from monitor.learn.flights import Flight, same_flight, vehicle_words
from monitor.learn.rules import RULES

__all__ = [
    "LEAST_FLIGHTS",
    "LEAST_S",
    "TooLittle",
    "Unfit",
    "alarm_words",
    "check_alike",
    "check_enough",
    "check_healthy",
    "least_seconds",
]

LEAST_FLIGHTS, LEAST_S = 3, 600.0
"""Nothing is learnt from fewer flights, or from less judged time of each sensor [s]: a flight has
few turns and one weather, and three show at least that their maxima resemble each other."""
NAMED = 5
"""Flights that are not healthy are named up to this many."""


class Unfit(ValueError):
    """Flights that nothing can be learnt from, in one plain sentence."""


class TooLittle(Unfit):
    """Too few flights, or too little of them judged."""


def check_alike(flights: Sequence[Flight]) -> None:
    """All flights are of one vehicle, and each is there once.

    Raises
    ------
    Unfit
        Naming two logs that are of different vehicles, or of the same flight.
    """
    for i, j in _suspects(flights):
        if same_flight(flights[i], flights[j]):
            raise Unfit(
                f"{flights[i].name} and {flights[j].name} are the same flight: give it once"
            )
    known = [f for f in flights if f.vehicle is not None]
    for f in known[1:]:
        a, b = known[0].vehicle, f.vehicle
        if a is not None and b is not None and a != b:
            raise Unfit(
                f"{known[0].name} ({vehicle_words(a)}) and {f.name} ({vehicle_words(b)}) are of "
                "different vehicles: thresholds belong to one airframe"
            )


def _suspects(flights: Sequence[Flight]) -> list[tuple[int, int]]:
    """Pairs of flights that share a satellite fix or their bytes, in the order of the second."""
    of = np.repeat(np.arange(len(flights)), [len(f.fixes) for f in flights])
    fixes = np.concatenate([np.zeros(0, np.uint64), *(f.fixes for f in flights)])
    order = np.argsort(fixes, kind="stable")
    fixes, of = fixes[order], of[order]
    again = np.flatnonzero(fixes[1:] == fixes[:-1])
    pairs = {(int(i), int(j)) for i, j in zip(of[again], of[again + 1], strict=True)}
    first: dict[str, int] = {}
    for j, f in enumerate(flights):
        if f.sha256 and first.setdefault(f.sha256, j) != j:
            pairs.add((first[f.sha256], j))
    return sorted(pairs, key=lambda pair: (pair[1], pair[0]))


def check_enough(flights: Sequence[Flight]) -> None:
    """There is enough to learn anything from.

    Raises
    ------
    TooLittle
        Fewer than :data:`LEAST_FLIGHTS`, or no kind of sensor was judged for :data:`LEAST_S`.
    """
    quantities = dict.fromkeys(r.quantity for r in RULES)
    if len(flights) >= LEAST_FLIGHTS and any(
        least_seconds(flights, q) >= LEAST_S for q in quantities
    ):
        return
    need = (
        f"thresholds need {LEAST_FLIGHTS} healthy flights and {LEAST_S / 60.0:.0f} judged minutes "
        "of each sensor"
    )
    judged = []
    for quantity in quantities:
        total = _per_sensor(flights, quantity)
        if total:
            sensor = min(total, key=lambda s: total[s])
            judged.append(f"{total[sensor] / 60.0:.1f} min of {sensor}")
    said = " and ".join(judged) if judged else "no sensor"
    many = "this flight" if len(flights) == 1 else f"these {len(flights)} flights"
    raise TooLittle(f"{need}; {many} judged {said}")


def check_healthy(flights: Iterable[Flight], hint: str = "") -> None:
    """No flight has a verdict of faulty, nor do sensors disagree in one.

    Raises
    ------
    Unfit
        Naming sensor, time and log of the first one, and the other logs; ``hint`` follows.
    """
    sick = [f for f in flights if f.alarms]
    if not sick:
        return
    others = ", ".join(f.name for f in sick[1:NAMED])
    if len(sick) > NAMED:
        others += f" and {len(sick) - NAMED} more"
    nor = f"; nor is {others}" if len(sick) == 2 else f"; nor are {others}" if others else ""
    raise Unfit(f"{sick[0].name} is not a healthy flight: {alarm_words(sick[0])}{nor}{hint}")


def alarm_words(flight: Flight) -> str:
    """What was said first in a flight that is not healthy, and how much more."""
    a = flight.alarms[0]
    more = f" (and {len(flight.alarms) - 1} more)" if len(flight.alarms) > 1 else ""
    return f"{a.sensor} {a.state} at {a.detected_s:.1f} s{more}: {a.evidence}"


def least_seconds(flights: Sequence[Flight], quantity: str) -> float:
    """The least time for which any sensor of a quantity was judged in all flights together [s]."""
    return min(_per_sensor(flights, quantity).values(), default=0.0)


def _per_sensor(flights: Sequence[Flight], quantity: str) -> dict[str, float]:
    total: dict[str, float] = {}
    for f in flights:
        for sensor, seconds in f.judged(quantity).items():
            total[sensor] = total.get(sensor, 0.0) + seconds
    return total
