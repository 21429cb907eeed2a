"""One task: a log to its outcome and its report, on whichever worker takes it."""

from __future__ import annotations

import hashlib
import json
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from monitor.fleet.outcome import Outcome, Status, failed, judged, read_outcome, unusable
from monitor.fleet.places import Place, report_folder
from monitor.fleet.reports import Reports
from monitor.fleet.sources import Source, opened
from monitor.settings import Settings

__all__ = ["Plan", "Task", "code_version", "judge", "make_plan"]

OUTCOME = "outcome.json"
SUMMARY = "summary.json"
PACKAGES = ("links", "estimators", "monitor")
CODE_SUFFIXES = frozenset({".py", ".toml", ".json", ".csv"})


class _TooSlow(Exception):
    """A log that took longer than it may."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is done with every log.

    Attributes
    ----------
    out
        Folder of the results: absolute path or URL.
    settings
        The configuration as JSON.
    key
        Digest of the configuration and the code: outcomes of another key are not taken up.
    limit_s
        Longest time that a log may take [s].
    estimates
        Write the estimates of each log beside its summary.
    reports
        Of which logs ``report.html`` is written.
    again
        Judge logs whose outcome is known, too.
    """

    out: str
    settings: str
    key: str
    limit_s: float = 3600.0
    estimates: bool = False
    reports: Reports = Reports.NONE
    again: bool = False


@dataclass(frozen=True, slots=True)
class Task:
    """One log, and what is done with it.

    Attributes
    ----------
    twin
        Another log of the run is as long: it may be a copy, which is not analyzed at the same time.
    """

    source: Source
    plan: Plan
    twin: bool = False


def make_plan(
    settings: Settings,
    out: str,
    *,
    limit_s: float = 3600.0,
    estimates: bool = False,
    reports: Reports = Reports.NONE,
    again: bool = False,
) -> Plan:
    """The plan of a fleet with these settings."""
    text = settings.model_dump_json()
    return Plan(out, text, _key(text, estimates, reports), limit_s, estimates, reports, again)


@lru_cache(maxsize=4)
def _key(settings: str, estimates: bool, reports: Reports) -> str:
    wanted = ("estimates" if estimates else "", *([reports] if reports != Reports.NONE else []))
    content = "\0".join((code_version(), settings, *wanted))
    return hashlib.sha256(content.encode()).hexdigest()[:16]


@cache
def code_version() -> str:
    """Version of mavsentry with a digest of everything in it that can change a verdict."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in CODE_SUFFIXES:
                digest.update(path.relative_to(root).as_posix().encode())
                digest.update(path.read_bytes())
    try:
        number = version("mavsentry")
    except PackageNotFoundError:
        number = "0"
    return f"{number}+{digest.hexdigest()[:8]}"


def judge(task: Task) -> Outcome:
    """Analyze one log, write its report, return its outcome.

    An outcome that stands already, for the same bytes, settings and code, is returned as it is. One
    that failed is not kept: the next run tries the log again.

    Raises
    ------
    OSError
        The log cannot be read or the report not be written: worth another try.
    """
    plan = task.plan
    if _key(plan.settings, plan.estimates, plan.reports) != plan.key:
        return failed(plan.key, f"the worker runs another mavsentry, {code_version()}")
    with opened(task.source) as (path, sha256), _alone(sha256) if task.twin else nullcontext():
        place, folder = _place(plan.out), report_folder(sha256)
        if not plan.again:
            known = read_outcome(place.read(f"{folder}/{OUTCOME}"), plan.key)
            if known is not None:
                return known
        place.clear(folder)
        outcome = _analyzed(task, path, sha256)
        if outcome["status"] != Status.FAILED:
            place.write(f"{folder}/{OUTCOME}", _json(outcome))
        return outcome


def _analyzed(task: Task, path: Path, sha256: str) -> Outcome:
    """The outcome of an analysis; its files are written."""
    from links.logs import LogError

    plan, began_s = task.plan, time.monotonic()
    try:
        summary, files = _summary(task, path, report_folder(sha256), began_s)
    except LogError as error:
        reason = str(error).replace(str(path), "the log")
        return unusable(plan.key, sha256, reason, time.monotonic() - began_s)
    except _TooSlow as error:
        return failed(plan.key, str(error), sha256)
    except MemoryError:
        return failed(plan.key, "not enough memory", sha256)
    except OSError:
        raise
    except Exception as error:  # a mistake of ours must not cost the other logs
        return failed(plan.key, _mistake(error), sha256)
    return judged(plan.key, sha256, summary, files, time.monotonic() - began_s)


def _summary(
    task: Task, path: Path, folder: str, began_s: float
) -> tuple[dict[str, Any], list[str]]:
    """``summary.json`` of a log, and the names of the files that were written."""
    from monitor.analyze import ESTIMATES, analyze_into, analyze_log

    plan, place = task.plan, _place(task.plan.out)
    settings, check = _settings(plan.settings), _deadline(began_s, plan.limit_s)
    files = [SUMMARY]
    if not plan.estimates and plan.reports == Reports.NONE:
        analysis = analyze_log(path, settings, check)
        analysis.summary["log"]["path"] = task.source.shown
    else:
        with place.staged(folder) as near, _beside(near, plan) as own:
            analysis = analyze_into(own, path, settings, check)
            if plan.estimates:
                files += [file.relative_to(near).as_posix() for file in analysis.files[1:]]
            analysis.summary["log"]["path"] = task.source.shown
            if _report_wanted(plan, analysis.summary):
                near.mkdir(parents=True, exist_ok=True)
                files.append(analysis.write_report(near, own / ESTIMATES).name)
    place.write(f"{folder}/{SUMMARY}", _json(analysis.summary))
    return analysis.summary, files


def _beside(near: Path, plan: Plan) -> AbstractContextManager[Path]:
    """Where a log's estimates go: a report needs them, if nobody else does for a while only."""
    if plan.estimates:
        return nullcontext(near)
    return _passing()


@contextmanager
def _passing() -> Iterator[Path]:
    with TemporaryDirectory(prefix="mavsentry-") as folder:
        yield Path(folder)


def _report_wanted(plan: Plan, summary: dict[str, Any]) -> bool:
    if plan.reports == Reports.FOUND:
        return bool(summary["faults"] or summary["events"])
    return plan.reports == Reports.ALL


def _mistake(error: Exception) -> str:
    """An error that nobody foresaw, in one sentence, and where it happened."""
    trace = traceback.extract_tb(error.__traceback__)
    where = f" in {Path(trace[-1].filename).name}, line {trace[-1].lineno}" if trace else ""
    said = " ".join(str(error).split())[:200]
    return f"mavsentry failed on it ({type(error).__name__}{where}: {said}); please report it"


def _alone(sha256: str) -> AbstractContextManager[None]:
    """Of a log and its copies one is analyzed at a time."""
    try:
        from monitor.fleet.cluster import alone
    except ModuleNotFoundError:  # without Dask there is one worker
        return nullcontext()
    return alone(f"mavsentry-{sha256}")


def _deadline(began_s: float, limit_s: float) -> Callable[[int, int], None]:
    """Told how far the reading is, it raises once the time is over."""

    def check(done: int, of: int) -> None:
        if time.monotonic() - began_s > limit_s:
            share = 100.0 * done / max(of, 1)
            raise _TooSlow(f"gave up after {limit_s:g} s, {share:.0f} % of it read")

    return check


@lru_cache(maxsize=4)
def _settings(text: str) -> Settings:
    return Settings.model_validate_json(text)


@lru_cache(maxsize=4)
def _place(folder: str) -> Place:
    return Place(folder)


def _json(document: Any) -> bytes:
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()
