"""How soon faults injected into the recorded ALFA flights are found, and who is blamed.

    python tests/e2e/alfa_injection.py [--data ../shared/data] [--only pitot|imu] [--thin N]

Real flights of a 2 kg aircraft: IMU at 10 Hz, attitude at 2.5 Hz, GPS at 5 Hz, one pitot. A fault
is injected into the decoded rows (:class:`sim_feeds.injection.RowInjector`) from an onset on, and
the pipeline goes on from its state just before: verdicts depend on the rows alone, not on where the
stream is cut, so that this gives what ``mavsentry inject`` and ``mavsentry analyze`` give.

Onsets stand in even steps wherever the sensor has been ``ok`` for a second and the whole window is
left in the healthy part of the flight. Windows overlap and flights are few: the bounds (Wilson,
95 %, two-sided) count trials as if they were independent, and are too narrow to that extent.

Attitude *of its own*: as recorded (by healthy gyros), and the monitor is told so. *Common mode*: it
follows the broken IMU through :mod:`sim_feeds.attitude_follow`, and the monitor trusts no attitude.
"""

from __future__ import annotations

import argparse
import json
import pickle
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, sqrt
from pathlib import Path
from statistics import median
from typing import Any

from links.samples import Batch
from links.vocabulary import State
from monitor.commands.bench_detect.configurations import (
    ONE_IMU,
    ONE_IMU_FOLLOWED,
    ONE_PITOT,
    TWO_IMUS,
    TWO_IMUS_FOLLOWED,
    Configuration,
    Shape,
    Target,
)
from monitor.commands.bench_detect.flights import Flight, recorded
from monitor.commands.bench_detect.search import Outcome
from monitor.commands.bench_detect.trials import AFTERMATH_S, fault_of, outcome_of
from monitor.pipeline import Pipeline
from monitor.settings import Settings, load
from sim_feeds.attitude_follow import AttitudeFollows
from sim_feeds.injection import Injection, RowInjector

US = 1_000_000
SETTLED_S = 1.0
LATER_S = 20.0
"""The logs begin in the air; faults from here on are counted once more, by themselves."""
HEALTHY = "carbonZ_2018-07-30-16-39-00_3_no_failure.tlog"
ENGINE = "carbonZ_2018-07-30-17-36-35_engine_failure_with_emr_traj.tlog"
ELEVATOR = "carbonZ_2018-09-11-14-41-51_elevator_failure.tlog"
HEALTHY_UNTIL_S = {HEALTHY: inf, ENGINE: 133.4, ELEVATOR: 117.9}
"""Flight -> end of its healthy part, from the first record."""

PITOT_FLIGHTS = (HEALTHY, ENGINE)
IMU_FLIGHTS = (HEALTHY, ENGINE, ELEVATOR)
"""The pitot of the elevator flight is dead from the start; its IMU is not."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Faults of one kind in one configuration."""

    name: str
    configuration: Configuration
    flights: tuple[str, ...]
    sizes: tuple[float, ...]
    unit: str
    window_s: float
    step_s: float
    wanted: float | None


def imu_experiments(configuration: Configuration, name: str, wanted: bool) -> Iterator[Experiment]:
    """1 m/s^2 and 3 deg/s on each axis."""
    for axis, size, unit in (("acc", 1.0, "m/s^2"), ("gyro", 3.0, "deg/s")):
        targets = tuple(t for t in configuration.targets if t.quantity == axis)
        own = replace(configuration, targets=targets)
        share = 0.95 if wanted else None
        yield Experiment(name, own, IMU_FLIGHTS, (size, -size), unit, 10.0, 4.0, share)


PITOT = [
    Experiment("one pitot", ONE_PITOT, PITOT_FLIGHTS, sizes, "%", 60.0, 2.0, wanted)
    for sizes, wanted in (((30.0, -30.0), 0.95), ((20.0, -20.0), 0.90), ((10.0, -10.0), None))
]
IMU = [
    *imu_experiments(ONE_IMU, "one IMU, attitude of its own", True),
    *imu_experiments(ONE_IMU_FOLLOWED, "one IMU, common mode", False),
    *imu_experiments(TWO_IMUS, "two IMUs, attitude of its own", False),
    *imu_experiments(TWO_IMUS_FOLLOWED, "two IMUs, common mode", False),
]


@dataclass(slots=True)
class Tally:
    """Outcomes of all trials of one size of one channel, or of several together."""

    trials: int = 0
    delays_s: list[float] = field(default_factory=list)
    announced_s: list[float] = field(default_factory=list)
    as_pair: int = 0
    wrong: Counter[str] = field(default_factory=Counter)
    blamed: int = 0
    misled: int = 0
    later: list[bool] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)

    def add(self, outcome: Outcome, window_s: float, where: str, onset_s: float) -> None:
        self.trials += 1
        if onset_s >= LATER_S:
            self.later.append(outcome.named_s <= window_s)
        if outcome.named_s <= window_s:
            self.delays_s.append(outcome.named_s)
        else:
            self.missed.append(where)
        if outcome.announced_s <= window_s:
            self.announced_s.append(outcome.announced_s)
        self.as_pair += outcome.as_pair
        wrong = {*outcome.wrong_sensor, *outcome.wrong_axis}
        self.blamed += bool(wrong)
        self.misled += outcome.misled
        self.wrong.update(wrong)

    def merge(self, other: Tally) -> None:
        self.trials += other.trials
        self.delays_s += other.delays_s
        self.announced_s += other.announced_s
        self.as_pair += other.as_pair
        self.blamed += other.blamed
        self.misled += other.misled
        self.later += other.later
        self.wrong.update(other.wrong)
        self.missed += other.missed


def wilson(found: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's interval of a share, 95 %."""
    if not trials:
        return 0.0, 1.0
    p, n = found / trials, trials
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return middle - half, middle + half


def onsets_us(
    flight: Flight, configuration: Configuration, settings: Settings, e: Experiment
) -> tuple[list[int], list[str]]:
    """Moments at which a trial may begin, and the false verdicts of the flight as it is."""
    pipeline = Pipeline(configuration.settings(settings))
    result = pipeline.feed(configuration.thinned(flight.batch))
    verdicts = [*result.verdicts, *pipeline.finish().verdicts]
    healthy_us = min(
        flight.last_us, int(flight.first_us + min(HEALTHY_UNTIL_S[flight.name], 1e6) * US)
    )
    watched = {t.sensor for t in configuration.targets}
    false = [
        f"{v.sensor} at {(v.t_us - flight.first_us) / US:.1f} s"
        for v in verdicts
        if v.state is State.FAULTY and v.sensor in watched
    ]
    ok_us: dict[str, int] = {}
    for v in verdicts:
        if v.state is State.OK and v.sensor in watched:
            ok_us.setdefault(v.sensor, v.t_us)
    if len(ok_us) < len(watched):
        return [], false
    first = max(ok_us.values()) + round(SETTLED_S * US)
    last = healthy_us - round((e.window_s + settings.streams.horizon_s + 0.1) * US)
    return list(range(first, last, round(e.step_s * US))), false


@dataclass(frozen=True, slots=True)
class Moment:
    """Where a trial begins: the pipeline just before it, pickled, and the rows of its window."""

    flight: Flight
    onset_us: int
    pipeline: bytes
    batch: Batch


def moments(
    flight: Flight,
    configuration: Configuration,
    settings: Settings,
    onsets: Sequence[int],
    e: Experiment,
) -> Iterator[Moment]:
    """The pipeline just before each onset, and the rows after it."""
    batch = configuration.thinned(flight.batch)
    span_us = round((e.window_s + AFTERMATH_S + settings.streams.horizon_s) * US)

    def seq_at(t_us: int) -> int:
        later = [r["seq"][r["t_us"] >= t_us] for r in batch.rows.values()]
        return min((int(s.min()) for s in later if len(s)), default=1 << 62)

    pipeline = Pipeline(configuration.settings(settings))
    cuts = [seq_at(onset_us) for onset_us in onsets]
    for part, cut, onset_us in zip(batch.split(cuts), cuts, onsets, strict=False):
        pipeline.feed(part)
        window = batch.split([cut, seq_at(onset_us + span_us)])[1]
        yield Moment(flight, onset_us, pickle.dumps(pipeline), window)


def trial(moment: Moment, e: Experiment, target: Target, size: float) -> Outcome:
    """One fault from one onset on."""
    first_us = moment.flight.first_us
    fault = fault_of(target, Shape.STEP, size, (moment.onset_us - first_us) / US)
    follows = AttitudeFollows() if e.configuration.attitude_follows else None
    injector = RowInjector(Injection([fault], follows), moment.onset_us, first_us)
    pipeline: Pipeline = pickle.loads(moment.pipeline)
    verdicts = pipeline.feed(injector.apply(moment.batch)).verdicts
    return outcome_of(
        verdicts,
        moment.onset_us,
        target.sensor,
        e.window_s,
        pair_counts=e.configuration.pair_counts,
    )


def run(
    e: Experiment, data: Path, settings: Settings
) -> tuple[dict[tuple[str, float], Tally], list[str]]:
    """All trials of an experiment by (sensor, signed size), and what healthy flights showed."""
    tallies: dict[tuple[str, float], Tally] = {}
    false: list[str] = []
    for name in e.flights:
        flight = recorded(data / "alfa" / name, settings)
        onsets, own = onsets_us(flight, e.configuration, settings, e)
        false += [f"{name}: {text}" for text in own]
        for moment in moments(flight, e.configuration, settings, onsets, e):
            onset_s = (moment.onset_us - flight.first_us) / US
            at = f"{name[8:27]} {onset_s:.1f} s"
            for target in e.configuration.targets:
                for size in e.sizes:
                    outcome = trial(moment, e, target, size)
                    tally = tallies.setdefault((target.sensor, size), Tally())
                    where = f"{target.sensor} {size:+g} {e.unit} {at}"
                    tally.add(outcome, e.window_s, where, onset_s)
    return tallies, false


def line(name: str, what: str, window_s: float, tally: Tally, wanted: float | None) -> str:
    """One row of the Markdown table."""
    found = len(tally.delays_s)
    low, high = wilson(found, tally.trials)
    delay = f"{median(tally.delays_s):.1f}" if found else "-"
    slow = f"{sorted(tally.delays_s)[int(0.95 * (found - 1))]:.1f}" if found else "-"
    goal = "" if wanted is None else f"{100 * wanted:.0f} %"
    wrong = ", ".join(f"{s} {n}" for s, n in tally.wrong.most_common(3))
    share = f"{100 * found / tally.trials:.1f}" if tally.trials else "-"
    return (
        f"| {name} | {what} | {window_s:g} | {found}/{tally.trials} | {share} "
        f"| {100 * low:.0f}-{100 * high:.0f} | {goal} | {delay} | {slow} | {tally.as_pair} "
        f"| {sum(tally.later)}/{len(tally.later)} | {tally.misled} "
        f"| {tally.blamed}{f' ({wrong})' if wrong else ''} |"
    )


HEAD = """\
| configuration | fault | within s | found | % | Wilson 95 % | wanted | median s | 95th s \
| by its pair alone | found, of those after 20 s | another first | another too |
|---|---|---|---|---|---|---|---|---|---|---|---|---|"""


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    root = Path(__file__).resolve().parents[2]
    parser.add_argument("--data", type=Path, default=root.parent / "shared" / "data")
    parser.add_argument("--json", type=Path, help="write all delays here")
    parser.add_argument("--only", choices=("pitot", "imu"))
    parser.add_argument("--thin", type=int, default=1, help="onsets this many times further apart")
    parser.add_argument("--missed", action="store_true", help="list the trials not found")
    asked = parser.parse_args(argv)
    settings = load(None, None)
    experiments = [
        e
        for name, group in (("pitot", PITOT), ("imu", IMU))
        if asked.only in (None, name)
        for e in group
    ]
    kept: list[dict[str, Any]] = []
    print(HEAD, flush=True)
    missed: list[str] = []
    false: dict[str, set[str]] = {}
    for e in (replace(e, step_s=e.step_s * asked.thin) for e in experiments):
        tallies, own = run(e, asked.data, settings)
        false.setdefault(e.name, set()).update(own)
        every = Tally()
        for (sensor, size), tally in sorted(tallies.items()):
            print(line(e.name, f"{sensor} {size:+g} {e.unit}", e.window_s, tally, None), flush=True)
            every.merge(tally)
            kept.append(
                {
                    "configuration": e.name,
                    "sensor": sensor,
                    "size": size,
                    "unit": e.unit,
                    "trials": tally.trials,
                    "named_s": [d for d in tally.delays_s if isfinite(d)],
                    "blamed_another": dict(tally.wrong),
                }
            )
        kind = e.configuration.targets[0].quantity
        what = f"**all {kind} {abs(e.sizes[0]):g} {e.unit}**"
        print(line(e.name, what, e.window_s, every, e.wanted), flush=True)
        missed += every.missed
    print("\nfalse verdicts on the flights as they are:")
    for name, found in false.items():
        print(f"  {name}: {'; '.join(sorted(found)) or 'none'}")
    if asked.missed:
        print("\nnot found:", *missed, sep="\n  ")
    if asked.json:
        asked.json.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
