"""One task: a log to its outcome and its report, on whichever worker takes it."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from monitor.fleet.outcome import Outcome, judged, read_outcome, unusable
from monitor.fleet.places import Place, report_folder
from monitor.fleet.sources import Source, opened
from monitor.settings import Settings

__all__ = ["Plan", "Task", "TooSlow", "code_version", "judge", "make_plan"]

OUTCOME = "outcome.json"
SUMMARY = "summary.json"
PACKAGES = ("links", "estimators", "monitor")
CODE_SUFFIXES = frozenset({".py", ".toml", ".json", ".csv"})


class TooSlow(Exception):
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
    again
        Judge logs whose outcome is known, too.
    """

    out: str
    settings: str
    key: str
    limit_s: float = 3600.0
    again: bool = False


@dataclass(frozen=True, slots=True)
class Task:
    """One log, and what is done with it."""

    source: Source
    plan: Plan


def make_plan(
    settings: Settings, out: str, *, limit_s: float = 3600.0, again: bool = False
) -> Plan:
    """The plan of a fleet with these settings."""
    text = settings.model_dump_json()
    key = hashlib.sha256(f"{code_version()}\0{text}".encode()).hexdigest()[:16]
    return Plan(out, text, key, limit_s, again)


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

    An outcome that stands already, for the same bytes, settings and code, is returned as it is.

    Raises
    ------
    OSError
        The log cannot be read or the report not be written: worth another try.
    TooSlow
        It took longer than the plan allows.
    """
    from links.logs import LogError

    plan, began_s = task.plan, time.monotonic()
    place = _place(plan.out)
    with opened(task.source) as (path, sha256):
        folder = report_folder(sha256)
        if not plan.again:
            known = read_outcome(place.read(f"{folder}/{OUTCOME}"), plan.key)
            if known is not None:
                return known
        place.remove(f"{folder}/{OUTCOME}")
        try:
            summary = _summary(path, plan, began_s)
        except LogError as error:
            reason = str(error).replace(str(path), "the log")
            outcome = unusable(plan.key, sha256, reason, time.monotonic() - began_s)
        else:
            summary["log"]["path"] = task.source.log
            place.write(f"{folder}/{SUMMARY}", _json(summary))
            seconds = time.monotonic() - began_s
            outcome = judged(plan.key, sha256, summary, [SUMMARY], seconds)
    place.write(f"{folder}/{OUTCOME}", _json(outcome))
    return outcome


def _summary(path: Path, plan: Plan, began_s: float) -> dict[str, Any]:
    from monitor.analyze import analyze_log

    return analyze_log(path, _settings(plan.settings), _deadline(began_s, plan.limit_s)).summary


def _deadline(began_s: float, limit_s: float) -> Callable[[int, int], None]:
    """Told how far the reading is, it raises once the time is over."""

    def check(done: int, of: int) -> None:
        if time.monotonic() - began_s > limit_s:
            share = 100.0 * done / max(of, 1)
            raise TooSlow(f"gave up after {limit_s:g} s, {share:.0f} % of it read")

    return check


@lru_cache(maxsize=4)
def _settings(text: str) -> Settings:
    return Settings.model_validate_json(text)


@lru_cache(maxsize=4)
def _place(folder: str) -> Place:
    return Place(folder)


def _json(document: Any) -> bytes:
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()
