"""A vane beside the pitot bank on synthetic flights: one thing broken, everything else unmoved."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from links.samples import Batch
from links.vocabulary import Kind, Reason, State
from monitor.pipeline import Pipeline
from monitor.recording import Recording
from monitor.settings import load as load_settings
from monitor.verdict import Verdict
from monitor.watch.air import AirWatch

from .consistency import batch_of, healthy_cases

DEG = math.radians(1.0)
BOOT_S = 20.0
ONSET_S = 120.0


@cache
def flight(name: str, pitots: int = 1, seed: int = 1) -> Batch:
    """Four minutes with one vane, in the air from the first moment."""
    case = next(c for c in healthy_cases() if c.name == name)
    case = dataclasses.replace(case, pitots=pitots, vanes=1, minutes=4.0)
    return batch_of(case.scenario(seed).fly(seed))


def recorded(batch: Batch, profile: str = "light-aircraft", cuts: int = 0) -> Recording:
    settings = load_settings(profile)
    watch = AirWatch(settings.air, settings.triplex, settings.vane)
    pipeline = Pipeline(settings, watches=[watch])
    recording = Recording()
    seqs = [int(s) for s in batch.rows["aoa0"]["seq"][3::cuts]] if cuts else []
    for part in batch.split(seqs):
        recording.add(pipeline.feed(part))
    recording.add(pipeline.finish())
    return recording


def judged(batch: Batch, profile: str = "light-aircraft", cuts: int = 0) -> list[Verdict]:
    return recorded(batch, profile, cuts).verdicts


def broken(batch: Batch, change: Callable, onset_s: float = ONSET_S, end_s: float = 1e9) -> Batch:
    """The batch with ``change(angles, seconds since the onset)`` on the vane."""
    rows = dict(batch.rows)
    r = rows["aoa0"] = rows["aoa0"].copy()
    since = r["t_us"] * 1e-6 - BOOT_S - onset_s
    on = (since >= 0.0) & (since < end_s - onset_s)
    r["aoa_rad"][on] = change(r["aoa_rad"][on], since[on])
    return Batch(rows)


def faults(verdicts: list[Verdict]) -> list[Verdict]:
    return [v for v in verdicts if v.state is State.FAULTY]


@pytest.mark.parametrize("name", [c.name for c in healthy_cases() if c.vanes == 1])
@pytest.mark.parametrize("pitots", [1, 2])
def test_a_healthy_vane_is_judged_and_never_blamed(name: str, pitots: int) -> None:
    verdicts = judged(flight(name, pitots))
    assert not faults(verdicts)
    mine = [(v.state, v.reason) for v in verdicts if v.sensor == "aoa0"]
    assert mine[-2:] == [(State.UNMONITORED, Reason.LEARNING), (State.OK, None)]


def test_a_small_aircraft_in_strong_turbulence_takes_its_time() -> None:
    verdicts = judged(flight("small-uav 1+0 12 rough"), "small-uav")
    assert not faults(verdicts)


@pytest.mark.parametrize(
    ("change", "kind", "within_s"),
    [
        (lambda x, t: x + 6.0 * DEG, Kind.BIAS, 10.0),
        (lambda x, t: x - 8.0 * DEG, Kind.BIAS, 10.0),
        (lambda x, t: x + 0.5 * DEG * t, Kind.DRIFT, 45.0),
        (lambda x, t: np.full_like(x, x[0]), Kind.STUCK, 16.0),
        (lambda x, t: x + 3.0 * DEG * np.random.default_rng(3).standard_normal(len(x)),
         Kind.NOISE, 8.0),
        (lambda x, t: x + 6.0 * DEG * np.sin(2.0 * np.pi * t), Kind.OSCILLATION, 10.0),
    ],
    ids=["high", "low", "drift", "stuck", "noise", "oscillation"],
)  # fmt: skip
def test_a_broken_vane_is_found_and_it_alone(change: Callable, kind: Kind, within_s: float) -> None:
    found = faults(judged(broken(flight("light-aircraft 1+1 12 m/s"), change)))
    assert [v.sensor for v in found] == ["aoa0"]
    (v,) = found
    assert 0.0 < v.t_us * 1e-6 - BOOT_S - ONSET_S < within_s
    assert v.kind is kind
    assert v.onset_t_us is not None
    assert v.onset_t_us <= v.t_us
    assert v.unit == "rad"


def test_the_evidence_names_the_wind_that_would_explain_it() -> None:
    batch = broken(flight("light-aircraft 1+1 12 m/s"), lambda x, t: x + 6.0 * DEG)
    (v,) = faults(judged(batch))
    assert math.degrees(v.magnitude) == pytest.approx(6.0, abs=1.5)
    assert "above what attitude, ground speed and wind say" in v.evidence
    assert "it would take an updraft of 5 m/s" in v.evidence or "of 6 m/s" in v.evidence


def test_a_vane_that_recovers_is_ok_again_and_the_pitot_never_moved() -> None:
    batch = broken(
        flight("light-aircraft 1+1 12 m/s"), lambda x, t: x + 8.0 * DEG, end_s=ONSET_S + 40.0
    )
    verdicts = judged(batch)
    last = [v for v in verdicts if v.sensor == "aoa0"][-1]
    assert last.state is State.OK
    assert ONSET_S + 40.0 < last.t_us * 1e-6 - BOOT_S < ONSET_S + 75.0
    assert {v.sensor for v in faults(verdicts)} == {"aoa0"}
    assert [v for v in verdicts if v.sensor == "airspeed0"][-1].state is State.OK


@pytest.mark.parametrize("cuts", [1, 40])
def test_the_words_are_the_same_however_the_stream_is_cut(cuts: int) -> None:
    batch = broken(flight("light-aircraft 1+1 12 m/s"), lambda x, t: x + 6.0 * DEG)
    whole, cut = recorded(batch), recorded(batch, cuts=cuts)
    assert repr(cut.verdicts) == repr(whole.verdicts)
    for name, rows in whole.estimates.items():
        assert cut.estimates[name].tobytes() == rows.tobytes()


def test_a_fault_shows_in_the_ratio_beside_the_pitots() -> None:
    recording = recorded(broken(flight("light-aircraft 1+1 12 m/s"), lambda x, t: x + 6.0 * DEG))
    [found] = faults(recording.verdicts)
    tests, expected = recording.estimates["air_tests"], recording.estimates["air_expected"]
    at = tests["t_us"] == found.t_us
    [ratio] = tests["aoa0_ratio"][at]
    assert np.isclose(ratio, found.statistic / found.threshold)
    assert ratio > 1.0
    before = tests["t_us"] < (ONSET_S + BOOT_S) * 1e6
    assert np.nanmax(tests["aoa0_ratio"][before]) < 1.0
    assert np.nanmax(tests["airspeed0_ratio"]) < 1.0
    told = expected["t_us"] > found.t_us
    assert 0.0 < np.nanmax(expected["aoa0_std_rad"][told]) < 10.0 * DEG


def test_without_gps_the_vane_is_not_judged() -> None:
    batch = flight("light-aircraft 1+1 12 m/s")
    rows = dict(batch.rows)
    for sensor in [s for s in rows if s[:3] == "gps"]:
        t = rows[sensor]["t_us"] * 1e-6 - BOOT_S
        rows[sensor] = rows[sensor][(t < 100.0) | (t > 130.0)]
    said = [v for v in judged(Batch(rows)) if v.sensor == "aoa0"]
    states = [(v.state, v.reason) for v in said[-3:]]
    assert states == [
        (State.UNMONITORED, Reason.REFERENCE_MISSING),
        (State.UNMONITORED, Reason.LEARNING),
        (State.OK, None),
    ]
    assert 102.0 < said[-3].t_us * 1e-6 - BOOT_S < 107.0


@pytest.mark.parametrize("gap_s", [1.0, 3.0, 12.0])
def test_a_gap_in_the_data_is_no_vane_that_stands_still(gap_s: float) -> None:
    whole = flight("small-uav 1+0 12 rough")
    t = {s: r["t_us"] * 1e-6 - BOOT_S for s, r in whole.rows.items()}
    kept = {s: r[(t[s] < 100.0) | (t[s] % 26.0 > gap_s)] for s, r in whole.rows.items()}
    assert faults(judged(Batch(kept), "small-uav")) == []
