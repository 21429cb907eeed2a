"""Log analysis: the pipeline over a whole log, and what it leaves in a folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from links.logs import LogInfo, open_log
from links.mavlink.dialect import enum_word
from links.samples import Rows
from monitor import summary
from monitor.baselines import BaselineTap
from monitor.learn.flights import vehicle_words
from monitor.learn.provenance import provenance
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import StepResult, Verdict

__all__ = ["Analysis", "Recording", "analyze_log"]

MISSING_REPORT_EXTRA = (
    "summary.json only: `pip install mavsentry[report]` adds the estimates as Parquet files"
)


@dataclass(slots=True)
class Recording:
    """Gathers what a pipeline says over a stream: verdicts in time order, estimates per name."""

    verdicts: list[Verdict] = field(default_factory=list)
    _estimates: dict[str, list[Rows]] = field(default_factory=dict)

    def add(self, result: StepResult) -> None:
        """Append one step's verdicts and estimates."""
        self.verdicts += result.verdicts
        for name, rows in result.estimates.items():
            self._estimates.setdefault(name, []).append(rows)

    @property
    def estimates(self) -> dict[str, Rows]:
        """Name -> all estimate rows in time order."""
        return {name: np.concatenate(parts) for name, parts in self._estimates.items()}


@dataclass(frozen=True, slots=True)
class Analysis:
    """What the analysis of one log found.

    Attributes
    ----------
    path
        The log.
    summary
        ``summary.json`` as a dictionary (DESIGN section 6).
    verdicts
        Every change of state of every sensor, in time order.
    estimates
        Name (``air``, ``imu0`` ...) -> structured array.
    """

    path: Path
    summary: dict[str, Any]
    verdicts: list[Verdict]
    estimates: dict[str, Rows]

    @property
    def faults(self) -> list[dict[str, Any]]:
        """The faults found, in order of detection."""
        found: list[dict[str, Any]] = self.summary["faults"]
        return found

    def final_states(self) -> dict[str, Verdict]:
        """Each sensor's last verdict."""
        return {v.sensor: v for v in self.verdicts}

    def write(self, out: Path) -> list[Path]:
        """Write ``summary.json`` and, with the ``report`` extra, ``estimates/*.parquet``.

        Parameters
        ----------
        out
            Folder; the files go to ``out/<log stem>/``.

        Returns
        -------
        list of Path
            The files written.

        Raises
        ------
        OSError
            The folder cannot be made or written.
        """
        folder = out / self.path.stem
        folder.mkdir(parents=True, exist_ok=True)
        written = [folder / "summary.json"]
        text = json.dumps(self.summary, indent=1, allow_nan=False)
        written[0].write_text(text + "\n", encoding="utf-8")
        try:
            import pyarrow  # noqa: F401
        except ModuleNotFoundError:
            return written
        from monitor.parquet import write_estimates

        return written + write_estimates(self.estimates, folder / "estimates")


def analyze_log(
    path: Path, settings: Settings, progress: Callable[[int, int], None] | None = None
) -> Analysis:
    """Run the pipeline over a log.

    Parameters
    ----------
    path
        A ``.tlog`` file.
    settings
        Configuration.
    progress
        Called with (bytes read, bytes in all) after each batch.

    Raises
    ------
    links.logs.LogError
        The file cannot be read as a log, in one plain sentence.
    """
    log = open_log(path, settings.links.decoder_options())
    baselines = BaselineTap()
    pipeline = Pipeline(settings, taps=[baselines])
    recording = Recording()
    for batch in log:
        recording.add(pipeline.feed(batch))
        if progress is not None:
            progress(log.info.bytes_read, log.info.bytes)
    recording.add(pipeline.finish())
    return Analysis(
        path,
        summarize(log.info, pipeline, recording.verdicts)
        | {"learnt": provenance(settings.learnt, path, vehicle_words(log.info.vehicle))}
        | {"baselines": baselines.summary(log.info.first_t_us)},
        recording.verdicts,
        recording.estimates,
    )


def summarize(info: LogInfo, pipeline: Pipeline, verdicts: list[Verdict]) -> dict[str, Any]:
    """``summary.json`` of a finished pipeline over a log."""
    first_us = info.first_t_us
    return {
        "schema": summary.SCHEMA,
        "log": {
            "path": str(info.path),
            "format": info.format,
            "bytes": info.bytes,
            "messages": info.messages,
            "bad_bytes": info.bad_bytes,
            "duration_s": info.duration_s,
            "first_t_us": first_us,
            "start_unix_us": info.start_unix_us,
        },
        "vehicle": {
            "system_id": info.vehicle.system_id,
            "autopilot": enum_word("MAV_AUTOPILOT", info.vehicle.autopilot),
            "type": enum_word("MAV_TYPE", info.vehicle.type),
        },
        "streams": summary.streams(pipeline, info.sources),
        "monitored": summary.monitored(verdicts, first_us, pipeline.now_us),
        "faults": summary.faults(verdicts, first_us),
        "events": summary.events(verdicts, first_us),
        "rejected": summary.rejected(pipeline),
    }
