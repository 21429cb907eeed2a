"""Who judges a flight, and what each says of it, in one form."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final

from links.logs import open_log
from links.samples import Batch
from monitor import summary
from monitor.announced import Said, announced, merged
from monitor.baselines import BaselineTap
from monitor.pipeline import Pipeline
from monitor.recording import Recording
from monitor.settings import Settings

__all__ = ["AS_FLOWN", "BY_DEFAULT", "JUDGES", "OURS", "PX4", "SAID", "judge_flight"]

OURS: Final = "mavsentry"
AS_FLOWN: Final = "ArduPilot, as set"
BY_DEFAULT: Final = "ArduPilot, defaults"
PX4: Final = "PX4"
SAID: Final = "autopilot said"
JUDGES: Final = (OURS, AS_FLOWN, BY_DEFAULT, PX4, SAID)
"""Ours; our models of ArduPilot's checks with the flight's own parameters and with ArduPilot's
defaults; our model of PX4's; what the autopilot on board announced."""


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
        AS_FLOWN: merged(own["ardupilot"]),
        BY_DEFAULT: merged(default["ardupilot"]),
        PX4: merged(own["px4"]),
    }
    return said if without else said | {SAID: announced(own["autopilot_said"])}
