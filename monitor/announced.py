"""Verdicts of others in one form: on which sensor, from when to when.

The entries of a ``summary.json``'s baselines, and what an ArduPilot announced in flight.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

__all__ = ["Said", "announced", "merged"]

APART_S: Final = 10.0
"""Verdicts on one sensor that follow each other closer than this are one [s]."""

_DISABLED = re.compile(r"Airspeed sensor (\d) failure", re.IGNORECASE)
_ENABLED = re.compile(r"Airspeed sensor (\d)(?: now OK|, Re-enabled)", re.IGNORECASE)
_LANE = re.compile(r"EKF3 lane switch (\d)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Said:
    """One verdict on one sensor.

    Attributes
    ----------
    sensor
        ``airspeed0``, ``imu0.acc_x``, ``imu0`` when the axis is not told, ``imu`` when not even
        which IMU is.
    from_s, to_s
        From the log's first record; None when it was not taken back [s].
    """

    sensor: str
    from_s: float
    to_s: float | None = None


def announced(texts: Iterable[Mapping[str, Any]]) -> list[Said]:
    """The verdicts in an ArduPilot's STATUSTEXT: pitots disabled, lanes left."""
    spans: list[dict[str, Any]] = []
    standing: dict[str, dict[str, Any]] = {}

    def begin(sensor: str, t_s: float) -> None:
        if sensor not in standing:
            standing[sensor] = {"sensor": sensor, "from_s": t_s, "to_s": None}
            spans.append(standing[sensor])

    for line in texts:
        text, t_s = line["text"], line["t_s"]
        if found := _DISABLED.search(text):
            begin(f"airspeed{int(found[1]) - 1}", t_s)
        elif found := _ENABLED.search(text):
            if entry := standing.pop(f"airspeed{int(found[1]) - 1}", None):
                entry["to_s"] = t_s
        elif found := _LANE.search(text):
            lane = int(found[1])
            if entry := standing.pop(f"imu{lane}", None):
                entry["to_s"] = t_s
            begin(f"imu{(lane + 1) % 2}", t_s)
    return merged(spans)


def merged(entries: Iterable[Mapping[str, Any]]) -> list[Said]:
    """Verdicts in order of time, those on one sensor that nearly touch as one."""
    out: list[Said] = []
    last: dict[str, int] = {}
    for e in sorted(entries, key=lambda e: e["from_s"]):
        at = last.get(e["sensor"])
        if at is not None:
            before = out[at]
            if before.to_s is None or e["from_s"] < before.to_s + APART_S:
                open_end = before.to_s is None or e["to_s"] is None
                to_s = None if open_end else max(before.to_s or 0.0, e["to_s"])
                out[at] = Said(before.sensor, before.from_s, to_s)
                continue
        last[e["sensor"]] = len(out)
        out.append(Said(e["sensor"], e["from_s"], e["to_s"]))
    return out
