"""Who judges a flight, and what each says of it, in one form."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from links.logs import open_log
from links.samples import Batch
from monitor import summary
from monitor.baselines import BaselineTap
from monitor.pipeline import Pipeline
from monitor.recording import Recording
from monitor.settings import Settings

__all__ = ["AS_FLOWN", "BY_DEFAULT", "JUDGES", "OURS", "PX4", "SAID", "Said", "judge_flight"]

OURS: Final = "mavsentry"
AS_FLOWN: Final = "ArduPilot, as set"
BY_DEFAULT: Final = "ArduPilot, defaults"
PX4: Final = "PX4"
SAID: Final = "autopilot said"
JUDGES: Final = (OURS, AS_FLOWN, BY_DEFAULT, PX4, SAID)
"""Ours; our models of ArduPilot's checks with the flight's own parameters and with ArduPilot's
defaults; our model of PX4's; what the autopilot on board announced."""

APART_S = 10.0
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


def judge_flight(
    path: Path,
    settings: Settings,
    progress: Callable[[float], None],
    without: Collection[str] = (),
) -> dict[str, list[Said]]:
    """What every judge says of a log, from which some sensors may be left out.

    What the autopilot said, it said with all of its sensors: where some are left out, it is no
    judge.

    Raises
    ------
    links.logs.LogError
        The file cannot be read as a log.
    """
    log = open_log(path, settings.links.decoder_options())
    as_flown, by_default = BaselineTap(), BaselineTap(follow_log=False)
    pipeline = Pipeline(settings, taps=[as_flown, by_default])
    recording = Recording()
    for batch in log:
        kept = {s: rows for s, rows in batch.rows.items() if s not in without}
        recording.add(pipeline.feed(Batch(kept, batch.rejected, batch.boots)))
        progress(log.info.bytes_read / max(log.info.bytes, 1))
    recording.add(pipeline.finish())
    first_us = log.info.first_t_us
    own, default = as_flown.summary(first_us), by_default.summary(first_us)
    faults = summary.faults(recording.verdicts, first_us)
    said = {
        OURS: [Said(f["sensor"], f["detected_s"], f["cleared_s"]) for f in faults],
        AS_FLOWN: _merged(own["ardupilot"]),
        BY_DEFAULT: _merged(default["ardupilot"]),
        PX4: _merged(own["px4"]),
    }
    return said if without else said | {SAID: announced(own["autopilot_said"])}


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
    return _merged(spans)


def _merged(entries: Iterable[Mapping[str, Any]]) -> list[Said]:
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
