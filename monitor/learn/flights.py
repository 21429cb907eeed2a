"""One healthy flight through the pipeline: what it says about thresholds, and whose it is."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from links.logs import open_log
from links.mavlink.dialect import enum_word
from links.mavlink.options import Vehicle
from links.samples import Batch
from links.vocabulary import Reason, State
from monitor import summary
from monitor.learn.levels import LevelMeter
from monitor.learn.reading import Progress, read
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import Verdict

__all__ = ["Alarm", "Flight", "digest", "measure", "measure_log", "same_flight", "vehicle_words"]

WATCHED = frozenset({"imu", "airspeed", "aoa"})
"""Quantities that are judged; the others are references."""
MOVING_M_S = 3.0
"""A parked simulator shows the same fixes on every flight."""
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""Multiplier of the hash: 2^64 over the golden ratio."""
SHARED = 0.5
"""Two logs that share this part of their satellite fixes are the same flight."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """A verdict of faulty, or that two sensors disagree: what no healthy flight should have.

    Attributes
    ----------
    sensor, evidence
        As of the verdict.
    detected_s
        From the log's first record [s].
    state
        ``faulty`` or ``suspect``.
    """

    sensor: str
    detected_s: float
    evidence: str
    state: State = State.FAULTY


@dataclass(frozen=True, slots=True)
class Flight:
    """What one flight contributes to learnt thresholds.

    Attributes
    ----------
    name
        Of the log.
    settings
        With which it was measured: peaks of other settings cannot be compared.
    seconds
        Duration [s].
    judged_s
        Watched sensor -> time for which it was judged [s].
    peaks
        Settings key -> largest value that the quantity held to it reached (Pipeline.peaks).
    levels
        Measured noise levels by name (:mod:`monitor.learn.levels`).
    alarms
        In time order; empty for a flight on which all went well.
    sha256
        Digest of the log's bytes; empty for a flight that is no file.
    vehicle
        Whose flight it is; None where it is not known.
    fixes : (n,) uint64
        A hash of each satellite fix taken while moving, sorted: two logs of one flight share them.
    """

    name: str
    settings: Settings
    seconds: float
    judged_s: Mapping[str, float]
    peaks: Mapping[str, float]
    levels: Mapping[str, float] = field(default_factory=dict)
    alarms: tuple[Alarm, ...] = ()
    sha256: str = ""
    vehicle: Vehicle | None = None
    fixes: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(0, np.uint64))

    def judged(self, quantity: str) -> dict[str, float]:
        """Time for which each sensor of a quantity was judged [s]; those never judged left out."""
        return {
            s: seconds
            for s, seconds in self.judged_s.items()
            if s.partition(".")[0].rstrip("0123456789") == quantity
        }

    def count(self, quantity: str) -> int:
        """How many sensors of a quantity were judged."""
        return len({s.partition(".")[0] for s in self.judged(quantity)})


def vehicle_words(vehicle: Vehicle) -> str:
    """Whose flight it is: system id, autopilot, type."""
    autopilot = enum_word("MAV_AUTOPILOT", vehicle.autopilot)
    return f"system {vehicle.system_id}, {autopilot}, {enum_word('MAV_TYPE', vehicle.type)}"


def measure(batches: Iterable[Batch], settings: Settings, name: str = "") -> Flight:
    """Run the pipeline over a decoded flight.

    Parameters
    ----------
    batches
        The flight, in order.
    settings
        Configuration; the peaks hold for it alone.
    """
    return _measured(batches, settings, name)[0]


def measure_log(path: Path, settings: Settings, progress: Progress | None = None) -> Flight:
    """Run the pipeline over a log file.

    Parameters
    ----------
    progress
        Called with (bytes read, bytes in all) after each batch.

    Raises
    ------
    links.logs.LogError
        The file cannot be read as a log.
    """
    log = open_log(path, settings.links.decoder_options())
    flight, first_us = _measured(read(log, progress), settings, path.name)
    before_s = (first_us - log.info.first_t_us) / 1e6
    return replace(
        flight,
        seconds=log.info.duration_s,
        alarms=tuple(replace(a, detected_s=a.detected_s + before_s) for a in flight.alarms),
        sha256=digest(path),
        vehicle=log.info.vehicle,
    )


def digest(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def same_flight(a: Flight, b: Flight) -> bool:
    """Whether two logs are of one flight: the same bytes, or the same satellite fixes."""
    if a.sha256 and a.sha256 == b.sha256:
        return True
    fewer = min(len(a.fixes), len(b.fixes))
    return fewer > 0 and len(np.intersect1d(a.fixes, b.fixes)) > SHARED * fewer


def _measured(batches: Iterable[Batch], settings: Settings, name: str) -> tuple[Flight, int]:
    """The flight, and the vehicle time from which its seconds count [us]."""
    pipeline, meter = Pipeline(settings), LevelMeter()
    verdicts: list[Verdict] = []
    fixes = [np.zeros(0, np.uint64)]
    first_us: int | None = None
    for batch in batches:
        for rows in batch.rows.values():
            if len(rows):
                t_us = int(rows["t_us"].min())
                first_us = t_us if first_us is None else min(first_us, t_us)
        fixes.append(_fixes(batch))
        meter.feed(batch.rows)
        verdicts += pipeline.feed(batch).verdicts
    verdicts += pipeline.finish().verdicts
    start_us = pipeline.now_us if first_us is None else first_us
    watched = [v for v in verdicts if v.sensor.partition(".")[0].rstrip("0123456789") in WATCHED]
    monitored = summary.monitored(watched, start_us, pipeline.now_us)
    flight = Flight(
        name=name,
        settings=settings,
        seconds=(pipeline.now_us - start_us) / 1e6,
        judged_s={m["sensor"]: m["seconds"] for m in monitored if m["seconds"] > 0.0},
        peaks=pipeline.peaks(),
        levels=meter.levels(_judged_spans(watched, pipeline.now_us)),
        alarms=tuple(
            Alarm(v.sensor, (v.t_us - start_us) / 1e6, v.evidence, v.state)
            for v in watched
            if v.state is State.FAULTY or v.reason is Reason.SENSORS_DISAGREE
        ),
        fixes=np.unique(np.concatenate(fixes)),
    )
    return flight, start_us


def _fixes(batch: Batch) -> NDArray[np.uint64]:
    """A hash of time, place and speed of every fix of the first receiver taken while moving."""
    rows = batch.rows.get("gps0")
    if rows is None or not len(rows):
        return np.zeros(0, np.uint64)
    speed = np.hypot(rows["vel_ned_m_s"][:, 0], rows["vel_ned_m_s"][:, 1])
    rows = rows[(speed > MOVING_M_S) & (rows["lat_rad"] != 0.0)]
    hashed = rows["t_us"].astype(np.uint64)
    for column in (rows["lat_rad"], rows["lon_rad"], rows["vel_ned_m_s"][:, 0]):
        hashed = hashed * GOLDEN ^ np.ascontiguousarray(column).view(np.uint64)
    return np.asarray(hashed)


def _judged_spans(verdicts: list[Verdict], last_us: int) -> list[tuple[int, int]]:
    """Spans in which at least one sensor is judged [us], in order."""
    judged: set[str] = set()
    spans: list[tuple[int, int]] = []
    since_us = 0
    for v in verdicts:
        before = bool(judged)
        if v.state in (State.OK, State.SUSPECT):
            judged.add(v.sensor)
        else:
            judged.discard(v.sensor)
        if judged and not before:
            since_us = v.t_us
        elif before and not judged:
            spans.append((since_us, v.t_us))
    return [*spans, (since_us, last_us)] if judged else spans
