"""Why a fault that was found may be a false alarm: reasons to look at it first, never a verdict.

All but the last are seen in one flight alone; whether a sensor's fault stands alone among the
aircraft's flights is seen in the dataset (:mod:`monitor.fleet.figures`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any

from links.vocabulary import Reason, State

__all__ = ["WHY", "Doubt", "autopilot_agrees", "doubts"]

SOON_S = 20.0
"""A fault that was over after this time had no lasting cause [s]."""
AT_FIRST_S = 10.0
"""A fault named so soon after judging began may be of the take-off, or of what was learnt [s]."""
AT_ONCE_S = 5.0
"""Faults named within this time of each other came at once [s]."""
MANY = 3
"""This many instruments do not break at once; what they are all held against may."""
AROUND_S = 10.0
"""A reference that was lost this long before the onset or after the detection is near [s]."""
AGREES_S = 30.0
"""The autopilot's own check that fires within this time after the onset agrees [s]."""

_LOST = frozenset({Reason.REFERENCE_MISSING, Reason.REFERENCE_NOT_TRUSTED, State.STALE})
_BEFORE = frozenset({Reason.ON_GROUND, Reason.LEARNING})


class Doubt(StrEnum):
    """What speaks against a fault, in a few words."""

    SOON_OVER = "came and went"
    AT_FIRST = "as soon as it was judged"
    MANY_AT_ONCE = "many instruments at once"
    REFERENCE_LOST = "a reference was lost near it"
    ALONE = "the aircraft's other flights are clean"


WHY = {
    Doubt.SOON_OVER: f"The sensor was ok again within {SOON_S:.0f} s of being named: what breaks "
    "seldom mends itself. A gust, a manoeuvre or a loose plug does.",
    Doubt.AT_FIRST: f"It was named within {AT_FIRST_S:.0f} s of the first judgement after take-off "
    "or learning: either it was broken on the ground already, or what was learnt is wrong.",
    Doubt.MANY_AT_ONCE: f"{MANY} or more instruments were named within {AT_ONCE_S:.0f} s: "
    "what they are all held against may be wrong instead.",
    Doubt.REFERENCE_LOST: "The satellite receiver, the attitude or the sensor's own reference was "
    f"lost or not trusted within {AROUND_S:.0f} s.",
    Doubt.ALONE: "This sensor of this aircraft has a fault in this flight alone. That is said of a "
    "candidate only, and makes none: most sensors break once.",
}
"""What each doubt rests on, in a sentence for people."""


def doubts(fault: Mapping[str, Any], summary: Mapping[str, Any]) -> list[Doubt]:
    """What speaks against one fault of a ``summary.json``, as far as that flight tells.

    Parameters
    ----------
    fault
        One of ``summary["faults"]``.
    summary
        The document that holds it.
    """
    found = []
    named_s = float(fault.get("isolated_s", fault["detected_s"]))
    if fault["cleared_s"] is not None and fault["cleared_s"] - named_s < SOON_S:
        found.append(Doubt.SOON_OVER)
    if any(
        span["reason"] in _BEFORE and 0.0 <= named_s - span["to_s"] <= AT_FIRST_S
        for sensor in summary["monitored"]
        if sensor["sensor"] == fault["sensor"]
        for span in sensor["unmonitored"]
    ):
        found.append(Doubt.AT_FIRST)
    at_once = {
        str(other["sensor"]).partition(".")[0]
        for other in summary["faults"]
        if abs(float(other.get("isolated_s", other["detected_s"])) - named_s) <= AT_ONCE_S
    }
    if len(at_once) >= MANY:
        found.append(Doubt.MANY_AT_ONCE)
    from_s, to_s = float(fault["onset_s"]) - AROUND_S, float(fault["detected_s"]) + AROUND_S
    if any(
        span["reason"] in _LOST and span["from_s"] <= to_s and span["to_s"] >= from_s
        for sensor in summary["monitored"]
        for span in _spans(sensor, str(fault["sensor"]))
    ):
        found.append(Doubt.REFERENCE_LOST)
    return found


def _spans(sensor: Mapping[str, Any], faulty: str) -> Sequence[Mapping[str, Any]]:
    """Spans in which a sensor was not judged, if they tell of the faulty one's references."""
    quantity = str(sensor["sensor"]).rstrip("0123456789")
    if sensor["sensor"] == faulty or quantity in ("gps", "attitude"):
        spans: Sequence[Mapping[str, Any]] = sensor["unmonitored"]
        return spans
    return ()


def autopilot_agrees(fault: Mapping[str, Any], summary: Mapping[str, Any]) -> bool:
    """Whether ArduPilot's or PX4's own logic, run beside ours, blamed the same instrument."""
    baselines = summary.get("baselines") or {}
    instrument = str(fault["sensor"]).partition(".")[0]
    since_s = float(fault["onset_s"])
    until_s = fault["cleared_s"]
    return any(
        said["sensor"] == instrument
        and said["from_s"] >= since_s - AROUND_S
        and (until_s is None or said["from_s"] <= until_s + AGREES_S)
        for system in ("ardupilot", "px4")
        for said in baselines.get(system) or ()
    )
