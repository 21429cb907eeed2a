"""What was checked and fine, and what could not be checked, out of a ``summary.json``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from links.vocabulary import Reason, State
from monitor.report.remedies import ORDINARY

__all__ = ["Fine", "Unjudged", "fine", "flown_s", "missing", "ordinary", "unjudged", "unseen"]

Summary = Mapping[str, Any]
Times = tuple[tuple[float, float], ...]

MERGED_S: Final = 0.25
"""Sensors whose spans begin and end this close to each other share a line [s]."""

LEAST_S: Final = 1.0
"""Shorter than this in all is no lack of judgement [s]."""

CHECKED: Final = {
    "imu": "steps and drifts of each axis, noise, values that stand still",
    "airspeed": "errors of scale and offset, blockage, noise, values that stand still",
    "aoa": "offsets, noise, values that stand still",
    "spool": "dead and stuck channels; wrong readings where there is an engine model",
    "engine": "loss of power",
    "wing": "lost lift and added drag of one wing against the other",
    "gps": "a reference: only that it kept coming",
    "attitude": "a reference: only that it kept coming",
    "": "",
}
"""Quantity -> what its sensors are checked for."""

_WATCHED: Final = ("imu", "airspeed", "aoa", "spool", "gps", "attitude")
_NEEDED: Final = (
    ("gps", "satellite velocity"),
    ("attitude", "attitude"),
    ("imu", "IMU"),
    ("airspeed", "airspeed sensor"),
)
"""Without them nothing, or not the sensor itself, can be judged."""


@dataclass(frozen=True, slots=True)
class Fine:
    """Sensors that were judged equally long and never called faulty.

    Attributes
    ----------
    sensors
    seconds
        For how long they were judged [s].
    share
        Of the time in the air; None where the aircraft did not fly.
    checked
        For what, in a few words.
    """

    sensors: tuple[str, ...]
    seconds: float
    share: float | None
    checked: str


@dataclass(frozen=True, slots=True)
class Unjudged:
    """Sensors that could not be judged at the same times for the same reason.

    Attributes
    ----------
    sensors
    reason
        A :class:`~links.vocabulary.Reason`, or ``stale`` or ``absent``.
    times
        (from, to), in order [s].
    """

    sensors: tuple[str, ...]
    reason: str
    times: Times

    @property
    def seconds(self) -> float:
        """For how long in all [s]."""
        return sum(b - a for a, b in self.times)


def flown_s(summary: Summary) -> float:
    """Time in the air, as far as the judged sensors tell [s]."""
    ground: list[float] = [
        sum(s["to_s"] - s["from_s"] for s in m["unmonitored"] if s["reason"] == Reason.ON_GROUND)
        for m in summary["monitored"]
        if m["seconds"] > 0.0 and any(s["reason"] in ORDINARY for s in m["unmonitored"])
    ]
    if not ground:
        return 0.0
    return max(0.0, float(summary["log"]["duration_s"]) - max(ground))


def fine(summary: Summary) -> list[Fine]:
    """What was judged and never faulty; references last, of a kind the longest judged first."""
    faulty = {f["sensor"] for f in summary["faults"]} | {e["what"] for e in summary["events"]}
    in_air = flown_s(summary)
    groups: dict[tuple[str, int], list[Mapping[str, Any]]] = {}
    for entry in summary["monitored"]:
        if entry["seconds"] > 0.0 and entry["sensor"] not in faulty:
            mark = _checked(entry["sensor"]), round(entry["seconds"] / MERGED_S)
            groups.setdefault(mark, []).append(entry)
    out = []
    for (checked, _), entries in groups.items():
        seconds = max(entry["seconds"] for entry in entries)
        share = min(seconds / in_air, _most(entries, in_air)) if in_air else None
        sensors = tuple(sorted(e["sensor"] for e in entries))
        out.append(Fine(sensors, seconds, share, checked))
    order = list(CHECKED.values())
    return sorted(out, key=lambda f: (order.index(f.checked), -f.seconds, f.sensors))


def _checked(sensor: str) -> str:
    quantity = sensor.partition(".")[0].partition("_")[0].rstrip("0123456789")
    return CHECKED.get(quantity, "")


def _most(entries: Iterable[Mapping[str, Any]], in_air: float) -> float:
    """Largest share of the time in the air that was judged, by the spans in which it was not.

    Sensors that are judged on the ground too would come out above it by their seconds alone.
    """
    least = min(
        sum(
            float(s["to_s"] - s["from_s"])
            for s in entry["unmonitored"]
            if s["reason"] not in (Reason.ON_GROUND, State.ABSENT)
        )
        for entry in entries
    )
    return max(0.0, 1.0 - least / in_air)


def unjudged(summary: Summary) -> list[Unjudged]:
    """What could not be judged, without the reasons of every flight; the longest first.

    Spans of one sensor and reason stand together, and so do sensors with the same spans. What
    lasted less than :data:`LEAST_S` is left out. A sensor that was never judged stands here even
    if it only stood on the ground.
    """
    judged = {m["sensor"] for m in summary["monitored"] if m["seconds"] > 0.0}
    found = [
        u
        for u in _grouped(summary)
        if u.seconds >= LEAST_S and (u.reason not in ORDINARY or judged.isdisjoint(u.sensors))
    ]
    return sorted(found, key=lambda u: (u.reason == State.ABSENT, -u.seconds, u.sensors))


def ordinary(summary: Summary) -> list[Unjudged]:
    """What was not judged on the ground and while learning, and was later; in order of time."""
    judged = {m["sensor"] for m in summary["monitored"] if m["seconds"] > 0.0}
    found = [
        u for u in _grouped(summary) if u.reason in ORDINARY and not judged.isdisjoint(u.sensors)
    ]
    return sorted(found, key=lambda u: (u.reason != Reason.ON_GROUND, u.times[0], u.sensors))


def _grouped(summary: Summary) -> list[Unjudged]:
    groups: dict[tuple[str, tuple[int, ...]], tuple[list[str], Times]] = {}
    for entry in summary["monitored"]:
        by_reason: dict[str, list[tuple[float, float]]] = {}
        for span in entry["unmonitored"]:
            by_reason.setdefault(span["reason"], []).append((span["from_s"], span["to_s"]))
        for reason, times in by_reason.items():
            marks: tuple[int, ...] = tuple(round(t / MERGED_S) for span in times for t in span)
            if reason == State.ABSENT and len(by_reason) == 1:
                marks = ()  # never there: from when on it is known, is of no interest
            sensors, _ = groups.setdefault((reason, marks), ([], tuple(times)))
            sensors.append(entry["sensor"])
    return [
        Unjudged(tuple(sorted(sensors)), reason, times)
        for (reason, _), (sensors, times) in groups.items()
    ]


def unseen(summary: Summary) -> list[str]:
    """Streams of sensors that could be watched on which no verdict was ever made."""
    known = {str(m["sensor"]).partition(".")[0] for m in summary["monitored"]}
    return sorted(
        stream["sensor"]
        for stream in summary["streams"]
        if stream["sensor"].rstrip("0123456789") in _WATCHED and stream["sensor"] not in known
    )


def missing(summary: Summary) -> list[str]:
    """What the log has none of, in plain words."""
    present = {str(stream["sensor"]).rstrip("0123456789") for stream in summary["streams"]}
    return [words for quantity, words in _NEEDED if quantity not in present]
