"""How near every sensor came to a verdict: faults show in their ratio, healthy flights do not."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from links.mavlink import Decoder
from links.samples import Batch
from links.vocabulary import Kind, State
from monitor.analyze import analyze_log
from monitor.pipeline import Pipeline
from monitor.recording import Estimates, Recording
from monitor.settings import load
from monitor.verdict import Verdict, ratio_column
from sim_feeds import player, scenario

SCENARIOS = [
    ("demo", "transport"),
    ("light-aircraft-vane", "light-aircraft"),
    ("small-uav-pitot-blockage", "small-uav"),
    ("small-uav-imu-bias", "small-uav"),
]
LOGS = ["f2_pitot_block_pressure", "f5_gyro_bias", "f6_accel_bias", "h2_ramp60", "h7_icing_both"]
BY_S = 3.0
"""An alarm lasts about so long before it is a verdict, at most."""


@cache
def decoded(name: str) -> Batch:
    decoder = Decoder()
    frames = player.frames_of(scenario.load(name).fly())
    return Batch.concatenate([decoder.feed(b"".join(f for _, f in frames)), decoder.finish()])


def judged(name: str, profile: str, pieces: int = 1) -> Recording:
    """A bundled scenario through the pipeline, cut into pieces."""
    batch, pipeline, recording = decoded(name), Pipeline(load(profile)), Recording()
    total = sum(len(rows) for rows in batch.rows.values())
    for piece in batch.split([total * k // pieces for k in range(1, pieces)]):
        recording.add(pipeline.feed(piece))
    recording.add(pipeline.finish())
    return recording


whole = cache(judged)


@cache
def analyzed(path: Path) -> Recording:
    """A log through the pipeline."""
    estimates, recording = Estimates(), Recording()
    recording.verdicts = analyze_log(path, load(), sink=estimates).verdicts
    recording._estimates = estimates
    return recording


def faults(recording: Recording) -> list[Verdict]:
    return [v for v in recording.verdicts if v.state is State.FAULTY]


def ratios(recording: Recording, sensor: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [us] and ratios of a sensor."""
    table, column = ratio_column(sensor)
    rows = recording.estimates[table]
    return rows["t_us"], rows[column]


def shows(recording: Recording, fault: Verdict) -> bool:
    """Whether the ratio came to 1 shortly before a verdict, or at it."""
    t_us, ratio = ratios(recording, fault.sensor)
    before = (t_us <= fault.t_us) & (t_us >= fault.t_us - BY_S * 1e6)
    return bool((ratio[before] >= 1.0).any())


@pytest.mark.parametrize(("name", "profile"), SCENARIOS)
def test_faults_show_in_their_ratio(name: str, profile: str) -> None:
    recording = whole(name, profile)
    found = faults(recording)
    assert found
    assert [v for v in found if not shows(recording, v)] == []


@pytest.mark.parametrize("name", LOGS)
def test_faults_of_recorded_flights_show_in_their_ratio(name: str, shared_data: Path) -> None:
    recording = analyzed(shared_data / "sitl" / f"{name}.tlog")
    found = faults(recording)
    assert found
    assert [v for v in found if not shows(recording, v)] == []


def test_a_healthy_flight_stays_below_one(shared_data: Path) -> None:
    estimates = analyzed(shared_data / "sitl" / "n1_calm_nominal.tlog").estimates
    assert {"imu0_tests", "imu1_tests", "air_tests"} <= set(estimates)
    for table in ("imu0_tests", "imu1_tests", "air_tests"):
        rows = estimates[table]
        assert len(rows) > 600
        for name in rows.dtype.names[1:]:
            assert not (rows[name] >= 1.0).any(), (table, name, np.nanmax(rows[name]))
    assert np.isfinite(estimates["imu0_tests"]["gyro_z_ratio"]).mean() > 0.9
    assert np.isfinite(estimates["air_tests"]["airspeed0_ratio"]).mean() > 0.9


@pytest.mark.parametrize(("name", "profile"), SCENARIOS)
def test_a_verdict_rests_on_what_its_row_says(name: str, profile: str) -> None:
    recording = whole(name, profile)
    compared = 0
    for fault in faults(recording):
        t_us, ratio = ratios(recording, fault.sensor)
        if fault.estimator == "estimators.ins_bank":
            rows = recording.estimates[ratio_column(fault.sensor)[0]]
            if np.isfinite(rows["blame_ratio"][t_us == fault.t_us]).any():
                ratio = rows["blame_ratio"]
        at = ratio[t_us == fault.t_us]
        assert len(at) == 1, fault
        assert at[0] >= 1.0
        if fault.estimator == "air_checks" and fault.kind in (Kind.SCALE, Kind.DROPOUT):
            continue  # held against the limit and three deviations of what is expected
        assert math.isclose(at[0], fault.statistic / fault.threshold, rel_tol=1e-9), fault
        compared += 1
    assert compared


@pytest.mark.parametrize(("name", "profile"), SCENARIOS[:2])
@pytest.mark.parametrize("pieces", [7, 400])
def test_where_the_stream_is_cut_changes_no_row(name: str, profile: str, pieces: int) -> None:
    one, cut = whole(name, profile), judged(name, profile, pieces)
    tables = one.estimates
    assert {"imu0_tests", "air_tests", "air_expected"} <= set(tables)
    assert set(cut.estimates) == set(tables)
    for table, rows in tables.items():
        assert cut.estimates[table].tobytes() == rows.tobytes(), table


@pytest.mark.parametrize(("name", "profile"), SCENARIOS)
def test_rows_come_five_times_a_second_at_most(name: str, profile: str) -> None:
    recording = whole(name, profile)
    changes = len({v.t_us for v in recording.verdicts})
    for table, rows in recording.estimates.items():
        if table.endswith("_tests"):
            span_s = (rows["t_us"][-1] - rows["t_us"][0]) * 1e-6
            assert (np.diff(rows["t_us"]) >= 0).all()
            assert len(rows) <= 5.05 * span_s + changes + 2


def test_what_a_sound_pitot_should_show_is_near_what_it_shows() -> None:
    batch, recording = decoded("small-uav-pitot-blockage"), whole(*SCENARIOS[2])
    first = min(v.onset_t_us or v.t_us for v in faults(recording))
    expected = recording.estimates["air_expected"]
    expected = expected[expected["t_us"] < first - 2_000_000]
    for i in range(2):
        rows = batch.rows[f"airspeed{i}"]
        shown = np.interp(expected["t_us"], rows["t_us"], rows["cas_m_s"])
        apart = shown - expected[f"airspeed{i}_m_s"]
        known = np.isfinite(apart)
        assert known.sum() > 100
        assert abs(np.median(apart[known])) < 0.2
        assert np.abs(apart[known]).mean() < 0.6
