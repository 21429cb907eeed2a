"""The whole table: groups of flights times configurations, over processes, resumable.

A *part* is one group of flights in one configuration: all its targets and shapes. Parts are
independent of each other and of the number of processes; each draws from a random stream of its own
name.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np

from monitor.commands.bench_detect.configurations import Configuration, Shape
from monitor.commands.bench_detect.flights import restore
from monitor.commands.bench_detect.search import Outcome, Search, search
from monitor.commands.bench_detect.trials import judge, moments, watch_healthy
from monitor.commands.common import Refused
from monitor.commands.processes import Step, each
from monitor.settings import Settings

__all__ = ["WINDOWS_S", "Group", "Kept", "Part", "Plan", "parts_of", "run_all", "run_part"]

WINDOWS_S: Final = (10.0, 30.0, 60.0)
"""Times within which a fault should be found."""

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Plan:
    """What is the same for all parts.

    Attributes
    ----------
    trials
        Per size.
    seed
        Of moments and senses.
    shapes
        Courses of the fault.
    quick
        Four of the six axes of an IMU.
    """

    trials: int
    seed: int
    shapes: tuple[Shape, ...] = (Shape.STEP, Shape.RAMP)
    quick: bool = False


@dataclass(frozen=True, slots=True)
class Group:
    """Flights of one airframe.

    Attributes
    ----------
    name
        Airframe class, or the folder of the logs.
    recorded
        Whether the flights are logs.
    profile
        Bundled profile that the settings start from.
    thresholds
        One sentence on where the thresholds come from.
    files
        Stored flights (:func:`~monitor.commands.bench_detect.flights.store`).
    settings
        One per flight: what it is judged with.
    configurations
        That its flights allow.
    """

    name: str
    recorded: bool
    profile: str
    thresholds: str
    files: tuple[Path, ...]
    settings: tuple[Settings, ...]
    configurations: tuple[Configuration, ...]


@dataclass(frozen=True, slots=True)
class Part:
    """A group in one configuration."""

    group: str
    files: tuple[Path, ...]
    settings: tuple[Settings, ...]
    configuration: Configuration
    plan: Plan

    @property
    def cells(self) -> int:
        """Searches to be made."""
        return len(self.configuration.targets) * len(self.plan.shapes)

    @property
    def fingerprint(self) -> str:
        """Digest of all that the result depends on, the code included."""
        digest = hashlib.sha256(repr((self.group, self.configuration, self.plan)).encode())
        for file, settings in zip(self.files, self.settings, strict=True):
            digest.update(file.read_bytes())
            digest.update(settings.model_dump_json().encode())
        digest.update(code_digest())
        return digest.hexdigest()


def code_digest() -> bytes:
    """Digest of the four packages' sources."""
    root = Path(__file__).resolve().parents[3]
    digest = hashlib.sha256()
    for package in ("estimators", "links", "monitor", "sim_feeds"):
        for file in sorted((root / package).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.digest()


def parts_of(groups: Iterable[Group], plan: Plan) -> list[Part]:
    """All parts, the shortest first: a run that is ended early has most of the table."""
    parts = [
        Part(group.name, group.files, group.settings, configuration, plan)
        for group in groups
        for configuration in group.configurations
    ]
    return sorted(parts, key=lambda part: part.cells)


def run_part(part: Part, tell: Step = lambda: None) -> Json:
    """Judge the healthy flights, make the trials, search the sizes; ``tell`` after each search."""
    name = f"{part.group}/{part.configuration.name}"
    rng = np.random.default_rng([part.plan.seed, zlib.crc32(name.encode())])
    longest_s = max(WINDOWS_S)
    flights = [restore(file) for file in part.files]
    pairs = list(zip(flights, part.settings, strict=True))
    healthy = [watch_healthy(f, part.configuration, s, longest_s) for f, s in pairs]
    drawn = moments(
        flights, healthy, part.settings, part.configuration, part.plan.trials, longest_s, rng
    )
    cells = []
    for target in part.configuration.targets if drawn else ():
        for shape in part.plan.shapes:

            def once(size: float, trial: int, target: Any = target, shape: Any = shape) -> Outcome:
                moment = drawn[trial]
                return judge(moment, part.configuration, target, shape, size, longest_s)

            sizes = target.ladder.of(shape)
            found = search(sizes, WINDOWS_S, part.plan.trials, once)
            cells.append(
                {
                    "sensor": target.sensor,
                    "shape": str(shape),
                    "unit": target.ladder.unit_of(shape),
                    "ladder": [sizes[0], sizes[-1]],
                    **cell_of(found),
                }
            )
            tell()
    return {
        "group": part.group,
        "configuration": part.configuration.name,
        "pair_counts": part.configuration.pair_counts,
        "flights": [
            {
                "name": f.name,
                "duration_s": round(h.duration_s, 1),
                "judged_s": round(h.judged_s, 1),
                "trial_time_s": round(sum(end - begin for begin, end in h.spans_us) / 1e6, 1),
                "trials": sum(m.flight == f.name for m in drawn),
                "false": [
                    {k: fault[k] for k in ("sensor", "detected_s", "kind", "evidence")}
                    for fault in h.false
                ],
            }
            for f, h in zip(flights, healthy, strict=True)
        ],
        "cells": cells,
    }


def cell_of(found: Search) -> Json:
    """A search as JSON values."""
    outcomes = found.outcomes
    return {
        "smallest": {f"{window_s:g}": size for window_s, size in sorted(found.smallest.items())},
        "trials": len(outcomes),
        "as_pair": sum(o.as_pair for o in outcomes),
        "wrong_sensor": sum(bool(o.wrong_sensor) for o in outcomes),
        "wrong_axis": sum(bool(o.wrong_axis) for o in outcomes),
        "misled": sum(o.misled for o in outcomes),
        "blamed": dict(sorted(_counted(s for o in outcomes for s in _wrong(o)).items())),
        "rungs": [
            {
                "size": rung.size,
                "named_s": [_seconds(o.named_s) for o in rung.outcomes],
                "announced_s": [_seconds(o.announced_s) for o in rung.outcomes],
            }
            for rung in found.rungs
        ],
    }


def _wrong(outcome: Outcome) -> set[str]:
    return {*outcome.wrong_sensor, *outcome.wrong_axis}


def _counted(names: Iterable[str]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for name in names:
        counts[name] = counts.get(name, 0) + 1
    return counts


def _seconds(value: float) -> float | None:
    """JSON has no infinity: what was not found is null."""
    return round(value, 3) if isfinite(value) else None


_KEPT: Final = '{"fingerprint": '
"""How every line of a file of kept parts begins."""


class Kept:
    """Results of finished parts in a file, one JSON value a line, so that a run can be resumed.

    Raises
    ------
    Refused
        The file cannot be read or written, or is another kind of file.
    """

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._results: dict[str, Json] = {}
        if file is None or not file.exists():
            return
        try:
            lines = file.read_text(encoding="utf-8").splitlines()
        except OSError as error:
            raise Refused(f"cannot read {file}: {error.strerror}") from None
        except UnicodeDecodeError:
            lines = ["no text"]
        if not all(line.startswith(_KEPT) for line in lines if line):
            raise Refused(f"{file} is no file that --keep wrote")
        for line in lines:
            try:
                entry = json.loads(line)
            except json.JSONDecodeError:  # a run was ended while it wrote this
                continue
            self._results[entry["fingerprint"]] = entry["result"]

    def get(self, part: Part) -> Json | None:
        """The result of a part, when this very part was finished before."""
        return self._results.get(part.fingerprint) if self._results else None

    def add(self, part: Part, result: Json) -> None:
        """Remember the result of a part."""
        if self._file is None:
            return
        line = json.dumps({"fingerprint": part.fingerprint, "result": result})
        try:
            with self._file.open("a", encoding="utf-8") as out:
                out.write("\n" + line)
        except OSError as error:
            raise Refused(f"cannot write {self._file}: {error.strerror}") from None


def run_all(
    parts: Sequence[Part], jobs: int, kept: Kept, tell: Callable[[float], None]
) -> list[Json]:
    """Results of all parts, in their order.

    Parameters
    ----------
    parts
        What to run.
    jobs
        Processes; 1 runs everything here.
    kept
        Results of an earlier run.
    tell
        Told the fraction done.
    """
    results: dict[int, Json] = {}
    for i, part in enumerate(parts):
        known = kept.get(part)
        if known is not None:
            results[i] = known
    left = [i for i in range(len(parts)) if i not in results]
    total, done = sum(parts[i].cells for i in left), 0

    def step() -> None:
        nonlocal done
        done += 1
        tell(done / total)

    for k, result in each(run_part, [parts[i] for i in left], jobs, step):
        results[left[k]] = result
        kept.add(parts[left[k]], result)
    return [results[i] for i in range(len(parts))]
