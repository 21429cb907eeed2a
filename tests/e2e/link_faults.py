"""What faults of the link, the vehicle's clock and its receiver do to the verdicts, measured.

::

    python -m tests.e2e.link_faults [--recorded FOLDER] [--log WORD] [--seeds 2] [--all]

Flights, synthetic ones and recorded telemetry logs, go through every case; a row per case tells
what was wrongly called faulty, how many real faults were still found and how much later, what share
of the time sensors were monitored, and how long after the fault of the link they were so again.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from links.mavlink import Decoder
from links.vocabulary import State
from monitor.pipeline import Pipeline
from monitor.settings import load
from monitor.verdict import Verdict
from sim_feeds.player import frames
from sim_feeds.scenario import Scenario
from tests import impairments as im

__all__ = ["CASES", "Case", "Flight", "Outcome", "fly", "outcome", "through_pipeline"]

S = im.S
GPS, POSITION = (24, 124), 33
MONITORED = frozenset({State.OK, State.SUSPECT, State.FAULTY})
STEADY_S = 2.0
"""A sensor is monitored again once it has been so for as long."""
SOON_US = 300_000
"""After so long the vehicle's clock is known again, whatever it did [us]."""
GRACE_S = 15.0
"""A fault may still be called so long after it ended."""
CLASSES = {
    "small-uav": (20.0, 150.0),
    "light-aircraft": (50.0, 600.0),
    "transport": (100.0, 1500.0),
}
FAULTS: tuple[dict[str, Any], ...] = (
    {"sensor": "imu0.acc_x", "kind": "bias", "start_s": 110.0, "end_s": 135.0, "size_m_s2": 2.0},
    {"sensor": "airspeed0", "kind": "scale", "start_s": 150.0, "end_s": 185.0, "fraction": -0.3},
)


@dataclass(frozen=True, slots=True)
class Flight:
    """Frames and what breaks: (sensor, from, to), seconds from the first frame."""

    name: str
    frames: Sequence[im.Timed]
    faults: tuple[tuple[str, float, float], ...]
    profile: str

    @property
    def first_us(self) -> int:
        """When the first frame was sent [us]."""
        return self.frames[0][0]

    @property
    def seconds(self) -> float:
        """Duration."""
        return (self.frames[-1][0] - self.first_us) / S


@lru_cache(maxsize=4)
def fly(
    aircraft: str, seed: int, *, imus: int = 2, pitots: int = 2, wind: float = 7.0, breaks: bool
) -> Flight:
    """Three and a half minutes of straights and turns, in the air from the first moment."""
    speed, height = CLASSES[aircraft]
    legs: list[dict[str, Any]] = []
    for k in range(9):
        turn = (90.0 if aircraft == "small-uav" else 50.0) * (-1) ** (k // 4)
        legs += [{"do": "level", "duration_s": 15.0}, {"do": "turn", "angle_deg": turn}]
    gusts = [
        {"kind": "constant", "speed_m_s": wind, "toward_deg": 110.0},
        {"kind": "dryden", "wind_6m_m_s": 0.7 * wind},
    ]
    scenario = Scenario.model_validate(
        {
            "title": "link faults",
            "aircraft": aircraft,
            "seed": seed,
            "start": {"speed_m_s": speed, "agl_m": height, "heading_deg": 20.0},
            "leg": legs,
            "wind": gusts if wind else [],
            "imu": {"count": imus, "rate_hz": 40.0},
            "airspeed": {"count": pitots},
            "autopilot": {"attitude_follows_imu": 0},
            "fault": list(FAULTS) if breaks else [],
        }
    )
    broken = tuple((f["sensor"], f["start_s"], f["end_s"]) for f in FAULTS) if breaks else ()
    name = f"{aircraft}, {imus} IMUs, {pitots} pitots, wind {wind:g} m/s, seed {seed}"
    return Flight(name, list(frames(scenario)), broken, aircraft)


@dataclass(frozen=True, slots=True)
class Case:
    """One fault of the link.

    Attributes
    ----------
    name
    stages
        Of a flight and a seed.
    lasts_s
        It lasts so long from the flight's middle on; NaN: all the time.
    """

    name: str
    stages: Callable[[Flight, int], tuple[im.Impairment, ...]]
    lasts_s: float = math.nan

    def span_us(self, flight: Flight) -> tuple[int, int]:
        """From when to when it lasts, in times of sending [us]."""
        from_us = middle_us(flight)
        return from_us, from_us + (0 if math.isnan(self.lasts_s) else round(self.lasts_s * S))


def middle_us(flight: Flight) -> int:
    """When what happens once happens [us]."""
    return flight.first_us + round(0.5 * flight.seconds * S)


def _once(make: Callable[[int, int], im.Impairment], lasts_s: float) -> dict[str, Any]:
    def stages(flight: Flight, seed: int) -> tuple[im.Impairment, ...]:
        at_us = middle_us(flight)
        return (make(at_us, at_us + round(lasts_s * S)),)

    return {"stages": stages, "lasts_s": lasts_s}


def _every(period_s: float, lasts_s: float) -> Callable[[Flight, int], tuple[im.Impairment, ...]]:
    def stages(flight: Flight, seed: int) -> tuple[im.Impairment, ...]:
        begins = np.arange(20.0 + seed, flight.seconds, period_s)
        us = [flight.first_us + round(t * S) for t in begins.tolist()]
        return tuple(im.Outage(t, t + round(lasts_s * S)) for t in us)

    return stages


CASES: tuple[Case, ...] = (
    Case("none", lambda f, s: ()),
    Case("30 % random loss", lambda f, s: (im.Loss(0.3, s),)),
    Case("60 % random loss", lambda f, s: (im.Loss(0.6, s),)),
    Case("bursts of 0.3 s each 2.3 s", lambda f, s: (im.Bursts(2.0, 0.3, s),)),
    Case("bursts of 1 s each 6 s", lambda f, s: (im.Bursts(5.0, 1.0, s),)),
    Case("half of all twice, within 0.2 s", lambda f, s: (im.Duplicates(0.5, 0.2, s),)),
    Case("all twice, within 1.5 s", lambda f, s: (im.Duplicates(1.0, 1.5, s),)),
    Case("reordered within 0.2 s", lambda f, s: (im.Delay(0.2, s),)),
    Case("reordered within 0.6 s", lambda f, s: (im.Delay(0.6, s),)),
    Case("jitter of 0.3 s", lambda f, s: (im.Delay(0.3, s, ordered=True),)),
    Case(
        "30 % loss, 30 % twice, reordered within 0.2 s",
        lambda f, s: (im.Loss(0.3, s), im.Duplicates(0.3, 0.2, s), im.Delay(0.2, s)),
    ),
    Case("pulled for 0.2 s each 7.3 s", _every(7.3, 0.2)),
    Case("pulled for 2 s each 31 s", _every(31.0, 2.0)),
    Case("pulled for 0.2 s", **_once(im.Outage, 0.2)),
    Case("pulled for 2 s", **_once(im.Outage, 2.0)),
    Case("pulled for 60 s", **_once(im.Outage, 60.0)),
    Case("autopilot restarts, away 2 s", **_once(lambda a, b: im.Reboot(a, (b - a) / S), 2.0)),
    Case("autopilot restarts, away 8 s", **_once(lambda a, b: im.Reboot(a, (b - a) / S), 8.0)),
    Case("no fix for 60 s", **_once(im.NoFix, 60.0)),
    Case("no GPS message for 60 s", **_once(lambda a, b: im.Without(GPS, a, b), 60.0)),
    Case(
        "no GPS, no position for 60 s",
        **_once(lambda a, b: im.Without((*GPS, POSITION), a, b), 60.0),
    ),
    Case("no attitude for 20 s", **_once(lambda a, b: im.Without((30, 31), a, b), 20.0)),
    *(
        Case(
            f"vehicle's clock jumps {by:+g} s", **_once(lambda a, _, by=by: im.ClockJump(a, by), 0)
        )
        for by in (3.0, 100.0, -0.3, -3.0, -20.0)
    ),
)


@dataclass(slots=True)
class Outcome:
    """What one case did to one flight.

    Attributes
    ----------
    false
        (sensor, second) of verdicts on sensors that work.
    delays_s
        Of each real fault: from its start to the verdict, NaN where it was missed.
    monitored
        Share of the flight that the least watched IMU axis, and pitot, was monitored.
    back_s
        From the end of the link's fault until all IMUs, and all pitots, were monitored again.
    verdicts
        All changes of state.
    boots
        Restarts of the vehicle that were seen.
    """

    false: list[tuple[str, float]] = field(default_factory=list)
    delays_s: list[float] = field(default_factory=list)
    monitored: dict[str, float] = field(default_factory=dict)
    back_s: dict[str, float] = field(default_factory=dict)
    verdicts: list[Verdict] = field(default_factory=list)
    boots: int = 0


def through_pipeline(
    arrived: Sequence[im.Timed], marks_us: Sequence[int] = (), *, profile: str, turn_us: int = 5 * S
) -> tuple[list[Verdict], list[int], Pipeline]:
    """Verdicts on frames as they arrived, a batch every ``turn_us``.

    Beside them the newest vehicle time heard by each mark, in times of arrival [us].
    """
    decoder, pipeline = Decoder(), Pipeline(load(profile))
    verdicts: list[Verdict] = []
    heard_us: list[int] = []
    data: list[bytes] = []
    marks = sorted(marks_us)
    next_us = arrived[0][0] + turn_us

    def feed() -> None:
        verdicts.extend(pipeline.feed(decoder.feed(b"".join(data))).verdicts)
        data.clear()

    with np.errstate(all="ignore"):
        for at_us, frame in arrived:
            while len(heard_us) < len(marks) and at_us >= marks[len(heard_us)]:
                feed()
                heard_us.append(decoder.clock.newest_us or 0)
            if at_us >= next_us:
                feed()
                next_us = at_us + turn_us
            data.append(frame)
        feed()
        verdicts += pipeline.feed(decoder.finish()).verdicts
        verdicts += pipeline.finish().verdicts
    return verdicts, heard_us, pipeline


def outcome(case: Case, flight: Flight, seed: int = 1) -> Outcome:
    """One case on one flight."""
    arrived = im.through(flight.frames, *case.stages(flight, seed))
    over_us = case.span_us(flight)[1]
    marks = (over_us + SOON_US, *_fault_marks(flight))
    order = np.argsort(np.argsort(marks, kind="stable"), kind="stable")
    verdicts, heard, pipeline = through_pipeline(arrived, marks, profile=flight.profile)
    heard += [pipeline.now_us] * (len(marks) - len(heard))
    at_us = [heard[k] for k in order]
    out = Outcome(verdicts=verdicts, boots=len(pipeline.boots))
    _hold_against(out, flight, _called(verdicts), at_us[1:])
    for group in ("imu", "airspeed"):
        spans = list(_monitored(verdicts, group, pipeline.now_us))
        length_us = pipeline.now_us - min(v.t_us for v in verdicts)
        shares = [sum(b - a for a, b in s) / length_us for s in spans]
        out.monitored[group] = min(shares, default=math.nan)
        if not math.isnan(case.lasts_s):
            out.back_s[group] = max(
                (_back_s(s, at_us[0] - SOON_US) for s in spans), default=math.nan
            )
    return out


def _fault_marks(flight: Flight) -> list[int]:
    return [flight.first_us + round(t * S) for _, a, b in flight.faults for t in (a, b)]


def _called(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Faults as they are called; one that stands when a stream comes back is not called again."""
    out: list[Verdict] = []
    last: dict[str, tuple[int | None, float]] = {}
    for v in verdicts:
        if v.state is State.FAULTY and last.get(v.sensor) != (v.onset_t_us, v.statistic):
            last[v.sensor] = v.onset_t_us, v.statistic
            out.append(v)
    return out


def _hold_against(
    out: Outcome, flight: Flight, called: list[Verdict], marks_us: Sequence[int]
) -> None:
    """Sort verdicts into real and false."""
    real: set[int] = set()
    for k, (sensor, _, _) in enumerate(flight.faults):
        from_us, to_us = marks_us[2 * k : 2 * k + 2]
        mine = [
            i
            for i, v in enumerate(called)
            if v.sensor == sensor and -0.5 * S <= v.t_us - from_us <= to_us - from_us + GRACE_S * S
        ]
        real.update(mine)
        out.delays_s.append((called[mine[0]].t_us - from_us) / S if mine else math.nan)
    out.false += [(v.sensor, v.t_us / S) for i, v in enumerate(called) if i not in real]


def _monitored(
    verdicts: Sequence[Verdict], group: str, end_us: int
) -> Iterator[list[tuple[int, int]]]:
    """Of each sensor of a group, from when to when it was monitored, those that are there."""
    states: dict[str, list[tuple[int, State]]] = {}
    for v in verdicts:
        if v.sensor.startswith(group):
            states.setdefault(v.sensor, []).append((v.t_us, v.state))
    for changes in states.values():
        if all(state is State.ABSENT for _, state in changes):
            continue
        ends = [t for t, _ in changes[1:]] + [end_us]
        yield [(t, end) for (t, s), end in zip(changes, ends, strict=True) if s in MONITORED]


def _back_s(spans: list[tuple[int, int]], from_us: int) -> float:
    """Seconds from a time until a sensor is steadily monitored; infinite if it never is."""
    joined: list[list[int]] = []
    for a, b in spans:
        if joined and a <= joined[-1][1]:
            joined[-1][1] = b
        else:
            joined.append([a, b])
    steady = [max(a - from_us, 0) / S for a, b in joined if b - max(a, from_us) >= STEADY_S * S]
    return steady[0] if steady else math.inf


def _row(case: Case, outcomes: Sequence[Outcome], usual: Sequence[Outcome]) -> str:
    """A line of the table: medians and worst of all flights."""
    delays = [d for o in outcomes for d in o.delays_s]
    later = [
        d - u
        for o, base in zip(outcomes, usual, strict=True)
        for d, u in zip(o.delays_s, base.delays_s, strict=True)
        if not math.isnan(d - u)
    ]
    found = sum(not math.isnan(d) for d in delays)
    cells = [case.name, str(sum(len(o.false) for o in outcomes)), f"{found} of {len(delays)}"]
    cells.append(f"{statistics.median(later):+.1f}, {max(later):+.1f}" if later else "")
    for group in ("imu", "airspeed"):
        least = statistics.median(o.monitored[group] for o in outcomes)
        cells.append(f"{100 * least:.0f} %")
    for group in ("imu", "airspeed"):
        back = [o.back_s[group] for o in outcomes if group in o.back_s]
        cells.append(f"{statistics.median(back):.1f}, {max(back):.1f}" if back else "")
    return "| " + " | ".join(cells) + " |"


HEADER = (
    "| fault of the link | false faults | real faults found | later by [s] (median, worst) "
    "| IMU axes monitored | pitots monitored | IMUs back after [s] | pitots back after [s] |\n"
    "|---|---|---|---|---|---|---|---|"
)


def _flights(recorded: Path | None, name: str, seeds: int, every: bool) -> Iterator[Flight]:
    kinds = [("small-uav", 2, 2)]
    if every:
        kinds += [("small-uav", 1, 1), ("light-aircraft", 2, 2), ("transport", 3, 3)]
    for seed in range(1, seeds + 1):
        for aircraft, imus, pitots in kinds:
            wind = 7.0 if seed % 2 else 0.0
            yield fly(aircraft, seed, imus=imus, pitots=pitots, wind=wind, breaks=imus > 1)
    if recorded is not None:
        for log in sorted(recorded.glob(f"*{name}*.tlog")):
            yield Flight(log.stem, im.recorded(log), _known(recorded, log.stem), "small-uav")


def _known(folder: Path, name: str) -> tuple[tuple[str, float, float], ...]:
    """Faults of a recorded flight by its folder's ``expected.json``."""
    file = folder / "expected.json"
    told = json.loads(file.read_text())[name]["faults"] if file.exists() else []
    return tuple((s, f["on"], f["off"] or 1e6) for f in told for s in f["sensors"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--recorded", type=Path, help="folder of telemetry logs beside")
    parser.add_argument("--log", default="", help="only those whose name has this word")
    parser.add_argument("--seeds", type=int, default=2, help="of the synthetic flights")
    parser.add_argument("--all", action="store_true", help="all aircraft, one to three of each")
    parser.add_argument("--only", default="", help="cases whose name has this word")
    options = parser.parse_args()
    results: dict[str, list[Outcome]] = {}
    for flight in _flights(options.recorded, options.log, options.seeds, options.all):
        for case in CASES:
            if case.name == "none" or options.only in case.name:
                result = outcome(case, flight)
                results.setdefault(case.name, []).append(result)
                for sensor, at_s in result.false:
                    print(f"  false: {flight.name}, {case.name}: {sensor} at {at_s:.1f} s")
    print(HEADER)
    for case in CASES:
        if case.name in results:
            print(_row(case, results[case.name], results["none"]), flush=True)


if __name__ == "__main__":
    main()
