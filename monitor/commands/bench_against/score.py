"""Verdicts against the faults that are known of a flight: delays, missed, false."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict

from monitor.announced import Said
from monitor.commands.bench_against.judges import OURS

__all__ = ["Fault", "Score", "Truth", "beaten", "score"]

EARLY_S, GRACE_S = 0.5, 15.0
"""A verdict belongs to a fault from this before it shows until this after its end [s]."""


class Fault(BaseModel):
    """A fault that is known: when it begins to show and ends, seconds from the first record."""

    model_config = ConfigDict(extra="ignore")
    sensors: list[str]
    on: float
    off: float | None = None
    required: bool = True

    @property
    def name(self) -> str:
        """Its sensor, or those of which one is enough."""
        return "/".join(self.sensors)


class Truth(BaseModel):
    """What is known of a flight; sensors (or beginnings of names) whose verdicts do not count."""

    model_config = ConfigDict(extra="ignore")
    faults: list[Fault]
    tolerated: list[str] = []


@dataclass(slots=True)
class Score:
    """One judge on one flight.

    Attributes
    ----------
    delays_s
        Per fault, from when it shows to the first verdict on it; None is missed [s].
    false
        Verdicts on no fault.
    """

    delays_s: list[float | None] = field(default_factory=list)
    false: list[Said] = field(default_factory=list)


def score(verdicts: Sequence[Said], truth: Truth) -> Score:
    """Delays and false verdicts of one judge."""
    out, used = Score(), set()
    for fault in truth.faults:
        end_s = float("inf") if fault.off is None else fault.off + GRACE_S
        hits = [
            i
            for i, v in enumerate(verdicts)
            if fault.on - EARLY_S <= v.from_s <= end_s and _same(v.sensor, fault.sensors)
        ]
        used.update(hits)
        first = min((verdicts[i].from_s for i in hits), default=None)
        out.delays_s.append(None if first is None else round(first - fault.on, 2))
    out.false = [
        v
        for i, v in enumerate(verdicts)
        if i not in used and not any(v.sensor.startswith(t) for t in truth.tolerated)
    ]
    return out


def beaten(truth: Truth, scores: Mapping[str, Score]) -> list[str]:
    """Where another judge was earlier than ours, or said less that is false, one line each."""
    out = []
    ours = scores[OURS]
    for judge, other in scores.items():
        if judge == OURS:
            continue
        for fault, a, b in zip(truth.faults, ours.delays_s, other.delays_s, strict=True):
            if b is not None and (a is None or b < a):
                mine = "missed" if a is None else f"{a:.1f} s"
                out.append(f"{fault.name}: {judge} {b:.1f} s, {OURS} {mine}")
        if len(other.false) < len(ours.false):
            out.append(f"false verdicts: {judge} {len(other.false)}, {OURS} {len(ours.false)}")
    return out


def _same(sensor: str, sensors: Sequence[str]) -> bool:
    """Whether a verdict is on one of the sensors; an autopilot names an IMU, not its axis."""
    return any(s == sensor or (sensor.startswith("imu") and s.startswith(sensor)) for s in sensors)
