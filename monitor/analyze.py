"""Log analysis: the pipeline over a whole log, and what it leaves in a folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from links.logs import LogInfo, open_log
from links.mavlink.dialect import enum_word
from links.samples import Rows
from monitor import summary
from monitor.baselines import BaselineTap
from monitor.estimate_files import EstimateFiles, EstimateSink
from monitor.learn.flights import vehicle_words
from monitor.learn.provenance import provenance
from monitor.pipeline import Pipeline
from monitor.readback import ReadBack
from monitor.settings import Settings, changed, load
from monitor.traces import Traces
from monitor.verdict import StepResult, Verdict

__all__ = ["MISSING_REPORT_EXTRA", "Analysis", "analyze_into", "analyze_log", "have_report"]

MISSING_REPORT_EXTRA = (
    "`pip install mavsentry[report]` adds report.html and the estimates as Parquet files"
)
REPORT_PACKAGES = ("bokeh", "jinja2", "pyarrow")
REPORT = "report.html"
ESTIMATES = "estimates"

Progress = Callable[[int, int], None]


def have_report() -> bool:
    """Whether the ``report`` extra is installed."""
    return all(find_spec(package) is not None for package in REPORT_PACKAGES)


@dataclass(frozen=True, slots=True)
class Analysis:
    """What the analysis of one log found.

    Attributes
    ----------
    path
        The log.
    summary
        ``summary.json`` as a dictionary.
    settings
        The configuration.
    verdicts
        Every change of state of every sensor, in time order; the first 100,000.
    files
        What was written: ``summary.json`` first, then the report if there is one.
    """

    path: Path
    summary: dict[str, Any]
    settings: Settings
    verdicts: list[Verdict]
    files: list[Path] = field(default_factory=list)

    @property
    def faults(self) -> list[dict[str, Any]]:
        """The faults found, in order of detection."""
        found: list[dict[str, Any]] = self.summary["faults"]
        return found

    def write(self, folder: Path, estimates: Mapping[str, Rows]) -> None:
        """Write ``summary.json`` and ``estimates/`` of a short flight that stands in memory.

        Parameters
        ----------
        folder
            Where they go; made if it is not there.
        estimates
            Name -> rows, as of :meth:`monitor.Estimates.joined`.

        Raises
        ------
        OSError
            The folder cannot be made or written.
        """
        with EstimateFiles(folder / ESTIMATES, _about(self.path, self.settings)) as files:
            files.add(estimates)
            written = files.finish(_times(self.summary))
        self.files[:] = [_write_summary(self.summary, folder), *written]

    def write_report(self, folder: Path, estimates: Path | Mapping[str, Rows]) -> Path:
        """Write ``report.html`` (needs the ``report`` extra).

        Parameters
        ----------
        folder
            Where it goes.
        estimates
            The folder of Parquet files that :func:`analyze_into` wrote, or the rows themselves.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        OSError
            It cannot be written, or an estimate not be read.
        """
        from monitor.report import write_report
        from monitor.report.flight import Flight
        from monitor.report.tables import MemoryTables, ParquetTables

        tables = (
            ParquetTables(estimates) if isinstance(estimates, Path) else MemoryTables(estimates)
        )
        file = write_report(folder, Flight(self.summary, self.settings, self.verdicts, tables))
        self.files.insert(1, file)
        return file


def analyze_log(
    path: Path | str,
    settings: Settings | None = None,
    progress: Callable[[int, int], None] | None = None,
    sink: EstimateSink | None = None,
) -> Analysis:
    """Run the pipeline over a log, in memory that does not grow with the log.

    Parameters
    ----------
    path
        A log file of a supported format.
    settings
        The configuration; None takes that of :func:`monitor.load_settings`.
    progress
        Called with (bytes read, bytes in all) after each batch.
    sink
        Takes the estimates and the traces of what was measured as they come; without it they are
        dropped.

    Returns
    -------
    Analysis
        The faults, and all else that ``summary.json`` has.

    Raises
    ------
    LogError
        The file cannot be read as a log, in one plain sentence.
    OSError
        The sink cannot write.
    """
    path, settings = Path(path), load() if settings is None else settings
    log = open_log(path, settings.links.decoder_options())
    baselines, traces = BaselineTap(), Traces(settings.engine)
    pipeline = Pipeline(settings, taps=[baselines] if sink is None else [baselines, traces])
    ledger = summary.Ledger()
    live = ReadBack(settings.links.component_id)

    def use(result: StepResult) -> None:
        ledger.add(result.verdicts)
        if sink is not None:
            sink.add(result.estimates | traces.take())

    # What a log holds may be no number at all: it is rejected, not complained about.
    with np.errstate(all="ignore"):
        for batch in log:
            use(pipeline.feed(batch))
            live.add(batch.words)
            if progress is not None:
                progress(log.info.bytes_read, log.info.bytes)
        use(pipeline.finish())
        if sink is not None:
            sink.add(traces.finish())
    found = summarize(log.info, pipeline, ledger)
    said = live.summary(
        log.info.vehicle.system_id, log.info.first_t_us, found["faults"] + found["events"]
    )
    return Analysis(
        path,
        found
        | ({} if said is None else {"live": said})
        | {"learnt": provenance(settings.learnt, path, vehicle_words(log.info.vehicle))}
        | {"baselines": baselines.summary(log.info.first_t_us)}
        | {"made_by": _made_by(settings)},
        settings,
        ledger.verdicts,
    )


def analyze_into(
    folder: Path,
    path: Path,
    settings: Settings,
    progress: Progress | None = None,
    *,
    csv: bool = False,
) -> Analysis:
    """Run the pipeline over a log and write ``summary.json`` and ``estimates/`` into a folder.

    The estimates are Parquet files where the ``report`` extra is installed, and CSV files with
    ``csv``. They are written while the log is read; a log that turns out to be unusable leaves
    nothing behind, and an earlier analysis in the folder as it was. ``summary.json`` comes last;
    the report of an earlier analysis is removed before, it would speak of another one.

    Raises
    ------
    links.logs.LogError
        The file cannot be read as a log, in one plain sentence.
    OSError
        The folder cannot be made or written.
    """
    with EstimateFiles(folder / ESTIMATES, _about(path, settings), csv=csv) as files:
        analysis = analyze_log(path, settings, progress, files)
        written = files.finish(_times(analysis.summary))
    analysis.files.extend([_write_summary(analysis.summary, folder), *written])
    return analysis


def _write_summary(content: Mapping[str, Any], folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / REPORT).unlink(missing_ok=True)
    file = folder / "summary.json"
    unfinished = folder / "summary.json.unfinished"
    try:
        unfinished.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8")
        unfinished.replace(file)
    finally:
        unfinished.unlink(missing_ok=True)
    return file


def _made_by(settings: Settings) -> dict[str, Any]:
    return {
        "version": version("mavsentry"),
        "profile": settings.profile,
        "changed": changed(settings),
    }


def _about(path: Path, settings: Settings) -> dict[str, str]:
    """Metadata of the files of estimates."""
    return {
        "mavsentry.schema": "mavsentry/estimates/1",
        "mavsentry.version": version("mavsentry"),
        "mavsentry.configuration": settings.model_dump_json(),
        "mavsentry.log": path.name,
    }


def _times(content: Mapping[str, Any]) -> dict[str, str]:
    """What of a log's times belongs into the files of estimates."""
    log = content["log"]
    return {
        f"mavsentry.{key}": str(log[key])
        for key in ("first_t_us", "start_unix_us")
        if log[key] is not None
    }


def _gaps(info: LogInfo) -> list[dict[str, float]]:
    """When nothing was recorded: Unix time in a telemetry log, vehicle time in others."""
    zero_us = (info.start_unix_us or 0) if info.format == "tlog" else info.first_t_us
    return [
        {"at_s": round((at_us - zero_us) / 1e6, 3), "seconds": round(length_us / 1e6, 3)}
        for at_us, length_us in info.gaps
    ]


def summarize(info: LogInfo, pipeline: Pipeline, ledger: summary.Ledger) -> dict[str, Any]:
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
            "gaps": _gaps(info),
            "notes": info.notes,
            "boots_s": [round((t_us - first_us) / 1e6, 3) for t_us in pipeline.boots],
        },
        "vehicle": {
            "system_id": info.vehicle.system_id,
            "autopilot": enum_word("MAV_AUTOPILOT", info.vehicle.autopilot),
            "type": enum_word("MAV_TYPE", info.vehicle.type),
        },
        "streams": summary.streams(pipeline, info.sources),
        "monitored": ledger.monitored(first_us, pipeline.now_us),
        "faults": ledger.faults(first_us),
        "events": ledger.events(first_us),
        "rejected": summary.rejected(pipeline),
        "left_out": ledger.left_out,
    }
