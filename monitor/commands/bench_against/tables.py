"""The comparison as Markdown, as rows for the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from monitor.announced import Said
from monitor.commands.bench_against.score import Score, Truth, beaten

__all__ = ["Flight", "as_json", "delay_rows", "false_rows", "judges_of", "markdown"]


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight judged.

    Attributes
    ----------
    truth
        None when nothing is known of it: then nothing is scored.
    """

    name: str
    said: dict[str, list[Said]]
    truth: Truth | None
    scores: dict[str, Score]


def judges_of(flights: Iterable[Flight]) -> list[str]:
    """Who judged the flights; all flights of a run have the same judges."""
    return list(next(iter(flights)).said)


def delay_rows(flights: Iterable[Flight]) -> list[list[str]]:
    """Flight, fault, when it shows, delay of each judge."""
    out = []
    for flight in flights:
        for i, fault in enumerate(flight.truth.faults if flight.truth else ()):
            delays = [score.delays_s[i] for score in flight.scores.values()]
            shown = ["missed" if d is None else f"{d:.1f} s" for d in delays]
            out.append([flight.name, fault.name, f"{fault.on:.0f} s", *shown])
    return out


def false_rows(flights: Iterable[Flight]) -> list[list[str]]:
    """Flight, what is broken in it, number of false verdicts of each judge."""
    out = []
    for flight in flights:
        if flight.truth is None:
            broken, shown = "not known", [_listed(said) for said in flight.said.values()]
        else:
            broken = ", ".join(f.name for f in flight.truth.faults) or "nothing"
            shown = [_counted(score.false) for score in flight.scores.values()]
        out.append([flight.name, broken, *shown])
    return out


def markdown(flights: list[Flight]) -> str:
    """Both tables, and where we are beaten."""
    judges = judges_of(flights)
    parts = [
        "Delay from when a fault shows:\n",
        _table(["flight", "fault", "shows", *judges], delay_rows(flights)),
        "\n\nFalse verdicts (of a flight of which nothing is known: all verdicts):\n",
        _table(["flight", "broken", *judges], false_rows(flights)),
    ]
    worse = [
        f"- {f.name}: {line}" for f in flights if f.truth for line in beaten(f.truth, f.scores)
    ]
    parts.append("\n\nWhere another judge did better:\n\n" + "\n".join(worse or ["- nowhere"]))
    return "\n".join(parts) + "\n"


def as_json(flights: list[Flight]) -> dict[str, Any]:
    """Everything, for a program."""
    return {
        "schema": "mavsentry/against/1",
        "flights": [
            {
                "name": f.name,
                "faults": None if f.truth is None else [x.model_dump() for x in f.truth.faults],
                "verdicts": {j: [asdict(v) for v in said] for j, said in f.said.items()},
                "delays_s": {j: f.scores[j].delays_s for j in f.scores},
                "false": {j: [asdict(v) for v in f.scores[j].false] for j in f.scores},
                "beaten": [] if f.truth is None else beaten(f.truth, f.scores),
            }
            for f in flights
        ],
    }


def _counted(false: list[Said]) -> str:
    """Their number and whom they blame."""
    if not false:
        return "0"
    return f"{len(false)} ({', '.join(sorted({v.sensor for v in false}))})"


def _listed(said: list[Said]) -> str:
    return ", ".join(f"{v.sensor} {v.from_s:.0f} s" for v in said) or "-"


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(r) + " |" for r in rows])
