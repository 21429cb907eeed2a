"""Logs as they come: cut, flipped, gapped, lossy, of several boots, with clocks that jump or drift.

A healthy flight stays healthy however its log was damaged, and a fault is still found.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from links.logs import LogError
from monitor.analyze import Analysis, analyze_into, analyze_log
from monitor.commands.feed import write_log
from monitor.settings import load
from sim_feeds.scenario import load as load_scenario
from tests.impairments import retimed

from .damage import (
    Frames,
    absurd,
    bursts,
    drifting,
    flipped,
    flown,
    frames_of,
    log_of,
    lossy,
    shuffled,
    stepped,
)

MIDDLE_S = 75.0
FLIGHT = """\
title = "Take-off and two half circuits in gusts"
aircraft = "small-uav"
seed = 11

[[leg]]
do = "wait"
duration_s = 8.0
[[leg]]
do = "take-off"
[[leg]]
do = "climb"
rate_m_s = 3.0
duration_s = 20.0
[[leg]]
do = "turn"
angle_deg = 180.0
bank_deg = 30.0
[[leg]]
do = "level"
duration_s = 20.0
[[leg]]
do = "turn"
angle_deg = 180.0
bank_deg = 30.0
[[leg]]
do = "level"
duration_s = 40.0

[[wind]]
kind = "constant"
speed_m_s = 6.0
toward_deg = 60.0
[[wind]]
kind = "dryden"
wind_6m_m_s = 6.0

[imu]
count = 2
[airspeed]
count = 2
"""
FAULT = """
[[fault]]
sensor = "airspeed0"
kind = "bias"
size_m_s = -7.0
start_s = 90.0
"""


def fly(text: str, folder: Path) -> bytes:
    scenario, log = folder / "flight.toml", folder / "flight.tlog"
    scenario.write_text(text)
    write_log(load_scenario(scenario).fly(), log)
    return log.read_bytes()


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Frames:
    """Frames of a flight on which nothing broke."""
    return frames_of(fly(FLIGHT, tmp_path_factory.mktemp("healthy")))


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Frames:
    """Frames of a flight whose first pitot reads low from 90 s on."""
    return frames_of(fly(FLIGHT + FAULT, tmp_path_factory.mktemp("broken")))


@pytest.fixture
def analyzed(tmp_path: Path) -> Callable[[bytes], Analysis]:
    """Analysis of a log of these bytes."""

    def analyze(data: bytes) -> Analysis:
        file = tmp_path / "log.tlog"
        file.write_bytes(data)
        return analyze_log(file, load())

    return analyze


def seconds_judged(analysis: Analysis) -> float:
    return float(sum(m["seconds"] for m in analysis.summary["monitored"]))


def shifted(frames: Frames, by_s: float) -> list[tuple[int, bytes]]:
    """The same frames recorded at another time."""
    return [(stamp + round(by_s * 1e6), frame) for stamp, frame in frames]


def absurd_stamps(frames: Frames) -> list[tuple[int, bytes]]:
    """Stamps that are no times."""
    stamps = np.random.default_rng(1).integers(0, 1 << 62, len(frames)).tolist()
    return [(stamp, frame) for stamp, (_, frame) in zip(stamps, frames, strict=True)]


def garbage(n: int) -> bytes:
    return np.random.default_rng(5).bytes(n)


DAMAGES: dict[str, Callable[[Frames], bytes]] = {
    "cut off in a frame": lambda f: log_of(f)[: int(0.9 * len(log_of(f))) + 5],
    "its beginning missing": lambda f: log_of(f)[100_003:],
    "garbage before it": lambda f: garbage(4321) + log_of(f),
    "garbage in it": lambda f: (
        log_of(flown(f, 0, MIDDLE_S)) + garbage(50_000) + log_of(flown(f, MIDDLE_S))
    ),
    "bits flipped": lambda f: flipped(log_of(f), 1e-4),
    "many bits flipped": lambda f: flipped(log_of(f), 1e-3),
    "a gap of 1 s": lambda f: log_of(flown(f, 0, MIDDLE_S) + flown(f, MIDDLE_S + 1)),
    "a gap of 10 s": lambda f: log_of(flown(f, 0, MIDDLE_S) + flown(f, MIDDLE_S + 10)),
    "one in twenty lost": lambda f: log_of(lossy(f, 0.05)),
    "every third lost": lambda f: log_of(lossy(f, 0.33)),
    "lost in bursts": lambda f: log_of(bursts(f, 0.1, 60)),
    "out of order": lambda f: log_of(shuffled(f, 30)),
    "every message twice": lambda f: log_of([x for x in f for _ in range(2)]),
    "the clock 100 s ahead": lambda f: log_of(stepped(f, MIDDLE_S, 100.0)),
    "the clock 2 s back": lambda f: log_of(stepped(f, MIDDLE_S, -2.0)),
    "the clock 50 s back": lambda f: log_of(stepped(f, MIDDLE_S, -50.0)),
    "a fast clock": lambda f: log_of(drifting(f, 1.005)),
    "a slow clock": lambda f: log_of(drifting(f, 0.995)),
    "no stamps": lambda f: log_of([(0, frame) for _, frame in f]),
    "absurd stamps": lambda f: log_of(absurd_stamps(f)),
    "the end recorded twice": lambda f: log_of([*f, *flown(f, MIDDLE_S)]),
    "two boots": lambda f: log_of([*f, *f]),
    "two boots, the stamps overlap": lambda f: log_of([*f, *shifted(f, -60.0)]),
    "the second boot in the air": lambda f: log_of(
        [
            *flown(f, 0, MIDDLE_S),
            *(
                (s, retimed(x, lambda t: t - (MIDDLE_S - 10.0) * 1e6))
                for s, x in flown(f, MIDDLE_S)
            ),
        ]
    ),
}
LESS_JUDGED = {"lost in bursts", "its beginning missing"}
"""Here less than half of what could be judged is."""


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_healthy_flight_stays_healthy_and_is_judged(damage, healthy, analyzed) -> None:
    whole = seconds_judged(analyzed(log_of(healthy)))
    analysis = analyzed(DAMAGES[damage](healthy))
    assert [(f["sensor"], f["evidence"]) for f in analysis.faults] == []
    assert seconds_judged(analysis) > (0.2 if damage in LESS_JUDGED else 0.6) * whole
    assert 50.0 < analysis.summary["log"]["duration_s"] < 500.0


FINDABLE: Sequence[str] = [d for d in DAMAGES if d not in ("the end recorded twice",)]


@pytest.mark.parametrize("damage", FINDABLE)
def test_a_broken_pitot_is_found_in_a_damaged_log(damage, broken, analyzed) -> None:
    analysis = analyzed(DAMAGES[damage](broken))
    assert {f["sensor"] for f in analysis.faults} == {"airspeed0"}


@pytest.mark.parametrize("share", [0.001, 0.01, 0.1, 0.5, 1.0])
def test_absurd_values_with_right_check_sums_are_no_exception(
    share: float, healthy: Frames, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        frames = [(s, absurd(f, rng) if rng.random() < share else f) for s, f in healthy]
        file = tmp_path / f"{seed}.tlog"
        file.write_bytes(log_of(frames))
        try:
            analysis = analyze_into(tmp_path / "out", file, load())
        except LogError:  # nothing was left of the vehicle
            if share < 1.0:
                raise
            continue
        assert json.loads((tmp_path / "out" / "summary.json").read_text()) == analysis.summary
    assert [str(w.message) for w in recwarn] == []


def test_the_summary_tells_what_is_wrong_with_the_log(healthy, analyzed) -> None:
    gap = flown(healthy, 0, 60.0) + flown(healthy, 80.0)
    log = analyzed(garbage(1000) + log_of(gap)).summary["log"]
    assert log["bad_bytes"] == 1000
    (found,) = log["gaps"]
    assert found["at_s"] == pytest.approx(60.0, abs=0.2)
    assert found["seconds"] == pytest.approx(20.0, abs=0.2)


def test_each_boot_has_its_own_fault(broken, analyzed) -> None:
    analysis = analyzed(log_of([*broken, *broken]))
    faults = analysis.faults
    assert len(analysis.summary["log"]["boots_s"]) == 1
    assert [f["sensor"] for f in faults] == ["airspeed0", "airspeed0"]
    assert faults[0]["cleared_s"] is not None
    apart_s = faults[1]["detected_s"] - faults[0]["detected_s"]
    assert apart_s == pytest.approx((broken[-1][0] - broken[0][0]) / 1e6, abs=3.0)
