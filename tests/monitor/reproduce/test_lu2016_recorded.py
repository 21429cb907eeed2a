"""lu2016 on recordings: the forms on a flight whose truth is known, the jobs on real ones."""

import copy
from collections.abc import Callable
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from links.samples import Batch, empty_rows
from monitor.commands.reproduce.lu2016 import recorded
from monitor.commands.reproduce.lu2016.recorded_forms import (
    Inputs,
    faults_at,
    filtered,
    inputs,
    piped,
)
from monitor.commands.reproduce.lu2016.recorded_names import FORMS, OWN_TIMES, PAPER, PIPELINE
from monitor.commands.reproduce.study import Figure, Result, Results, Scope, Table
from monitor.settings import Settings, load
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.faults import Fault, FaultKind, lu2016_table2
from sim_feeds.flightplan import FlightPlan
from sim_feeds.injection import Injection, RowInjector, load_injection
from sim_feeds.papers.lu2016_validation import validation
from sim_feeds.trajectory import fly

FIRST_US = 5_000_000
LATENCY_S = 0.07
FAULTS = [
    Fault("imu0.acc_x", FaultKind.BIAS, 20.0, 40.0, size=1.0),
    Fault("imu0.gyro_z", FaultKind.BIAS, 20.0, 40.0, size=radians(2.0)),
]


@pytest.fixture(scope="module")
def settings() -> Settings:
    return load(None, None)


@pytest.fixture(scope="module")
def flight() -> Batch:
    """A small aircraft in turns, perfect sensors at 50, 10 and 5 Hz; the receiver is late."""
    plan = FlightPlan(AIRFRAMES["small-uav"], speed_m_s=20.0, height_m=300.0, heading_rad=0.4)
    plan.level(4.0)
    while plan.time_s < 62.0:
        plan.turn(radians(90.0), bank_rad=radians(25.0)).level(3.0)
    truth = fly(plan, rate_hz=100.0)
    n = int(np.searchsorted(truth.t_s, 60.0))

    def rows(sensor: str, every: int, late_s: float = 0.0) -> np.ndarray:
        out = empty_rows(sensor, len(range(0, n, every)))
        out["t_us"] = FIRST_US + np.round((truth.t_s[:n:every] + late_s) * 1e6)
        return out

    imu, attitude = rows("imu0", 2), rows("attitude", 10)
    gps, baro = rows("gps0", 20, LATENCY_S), rows("baro0", 10)
    imu["acc_m_s2"], imu["gyro_rad_s"] = truth.specific_force_m_s2[:n:2], truth.rate_rad_s[:n:2]
    attitude["q_ned_from_frd"] = truth.q_ned_from_frd[:n:10]
    gps["vel_ned_m_s"] = truth.vel_ned_m_s[:n:20]
    gps["vel_ned_m_s"][:, 2] = np.nan
    gps["lat_rad"], gps["lon_rad"] = truth.lat_rad[:n:20], truth.lon_rad[:n:20]
    gps["alt_m"], gps["fix_type"] = truth.height_m[:n:20], 4
    baro["static_press_pa"] = truth.static_pa[:n:10]
    found = {"imu0": imu, "attitude": attitude, "gps0": gps, "baro0": baro}
    order = np.argsort(np.concatenate([r["t_us"] for r in found.values()]), kind="stable")
    seq = np.empty(len(order), np.int64)
    seq[order] = np.arange(len(order))
    for r, part in zip(found.values(), np.split(seq, _edges(found)), strict=True):
        r["seq"] = part
    return Batch(found)


def _edges(found: dict[str, np.ndarray]) -> np.ndarray:
    return np.cumsum([len(r) for r in found.values()])[:-1]


def given(flight: Batch, faults: list[Fault]) -> Inputs:
    broken = RowInjector(Injection(faults), 0, FIRST_US).apply(flight)
    return inputs(broken, FIRST_US, LATENCY_S)


def test_velocity_is_that_of_the_time_of_validity(flight: Batch) -> None:
    found = given(flight, [])
    assert found.velocity_s[0] == pytest.approx(0.0, abs=1e-6)
    down = found.velocity[5:-5, 2]
    assert np.abs(down).max() < 0.3
    assert found.interval_s == pytest.approx(0.02)
    np.testing.assert_allclose(np.diff(found.angles[:, 2]), 0.0, atol=0.2)  # unwrapped


def test_a_thinned_receiver_has_every_fifth_fix(flight: Batch) -> None:
    found = given(flight, []).thinned(1.0)
    np.testing.assert_allclose(np.diff(found.velocity_s), 1.0, atol=1e-6)
    whole = given(flight, [])
    assert len(whole.thinned(50.0).velocity_s) == len(whole.velocity_s)


def test_measurements_in_order_hold_every_sample_once(flight: Batch) -> None:
    found = given(flight, [])
    t, y = found.in_order()
    assert (np.diff(t) >= 0.0).all()
    assert np.isfinite(y[:, 0]).sum() == len(found.velocity_s)
    assert np.isfinite(y[:, 3]).sum() == len(found.angles_s)
    t, y = found.interpolated()
    assert np.isfinite(y).all()
    at = np.searchsorted(t, found.angles_s[10])
    np.testing.assert_allclose(y[at, 3:], found.angles[10], atol=1e-6)


@pytest.mark.parametrize("interpolate", [True, False])
def test_the_filter_finds_what_was_injected_and_leaves_the_rest(
    flight: Batch, settings: Settings, interpolate: bool
) -> None:
    found = given(flight, FAULTS)
    std = found.input_std(settings.imu, 12.0)
    e = filtered(found, settings, std, interpolate=interpolate)
    late, before = (e.t_s > 30.0) & (e.t_s < 40.0), (e.t_s > 10.0) & (e.t_s < 20.0)
    mean = e.f[late].mean(axis=0)
    np.testing.assert_allclose(mean, [1.0, 0, 0, 0, 0, radians(2.0)], atol=0.06)
    assert mean[5] == pytest.approx(radians(2.0), rel=0.1)
    assert np.abs(e.f[before, :3]).max() < 0.1
    assert np.abs(e.f[before, 3:]).max() < radians(0.3)
    assert e.residual is not None
    assert np.nanmax(np.abs(e.residual[before])) < 0.2


def test_the_pipeline_finds_and_names_it(flight: Batch, settings: Settings) -> None:
    broken = RowInjector(Injection(FAULTS), 0, FIRST_US).apply(flight)
    e = piped(broken, FIRST_US, settings, own_attitude=True)
    late = (e.t_s > 30.0) & (e.t_s < 40.0)
    assert e.f[late, 0].mean() == pytest.approx(1.0, abs=0.15)
    named = recorded.named_after(e.verdicts, FIRST_US, 20.0, validation().recorded)
    assert named["imu0.acc_x"] is not None
    assert named["imu0.acc_x"] < 10.0
    assert named["imu1"] is None


def test_what_is_true_at_any_time() -> None:
    t = np.array([9.99, 10.0, 11.0, 29.99, 30.0])
    f = faults_at(lu2016_table2(), t)
    assert not f[[0, 4]].any()
    np.testing.assert_allclose(f[2], [3.0, 0.1, -4.0, radians(1.5), radians(1.0), radians(3.0)])


@pytest.mark.parametrize(("share", "delay_s"), [(1.0, 0.0), (0.5, 0.8), (1.2, 1.9)])
def test_the_response_to_an_oscillation(share: float, delay_s: float) -> None:
    t = np.arange(0.0, 16.0, 0.05)
    f = 4.0 * np.sin(np.pi / 2.0 * t)
    found = recorded.swing_response(t, share * 4.0 * np.sin(np.pi / 2.0 * (t - delay_s)), f)
    assert found["swing_share"] == pytest.approx(share, rel=1e-6)
    assert min(found["swing_delay_s"], 4.0 - found["swing_delay_s"]) == pytest.approx(
        delay_s, abs=1e-6
    )


def test_the_file_of_table_2_has_its_faults() -> None:
    path = Path(__file__).parents[3] / "docs" / "lu2016-table2.toml"
    if not path.is_file():
        pytest.skip("the documentation is not beside the tests")
    t = np.linspace(0.0, 40.0, 801)
    found = load_injection(path)
    np.testing.assert_allclose(
        faults_at(found.faults, t), faults_at(lu2016_table2(), t), atol=1e-12
    )


def test_onsets_end_in_the_healthy_part() -> None:
    section = validation().recorded
    for one in section.flight:
        until = one.healthy_until_s or 79.1
        onsets = section.onsets_s(one, 150.0 if one.healthy_until_s else 79.1, quick=False)
        assert one.shown_s in onsets
        assert section.onsets_s(one, 150.0, quick=True) == [one.shown_s]
        assert onsets[0] >= section.before_s
        assert onsets[-1] + section.fault_s + section.after_s <= until
    short = replace_flight(section.flight[0], 50.0)
    assert section.onsets_s(short, 50.0, quick=False)[-1] <= 20.0


def replace_flight(one: Any, until_s: float) -> Any:
    return one.model_copy(update={"healthy_until_s": until_s})


def test_without_recordings_it_says_so(tmp_path: Path) -> None:
    for scope in (Scope(), Scope(flights=tmp_path)):
        assert recorded.jobs(scope) == []
    told = recorded.claims({}, Scope())
    assert [c.outcome for c in told] == ["not run"]
    assert len(recorded.blocks({}, Scope())) == 1


# ----------------------------------------------------------------------------- real flights


@pytest.fixture(scope="module")
def results(shared_data: Path) -> Results:
    jobs = recorded.jobs(replace(Scope(quick=True), flights=shared_data))
    assert len(jobs) == len(validation().recorded.flight)
    return {job.name: recorded.work(job) for job in jobs}


def test_every_form_has_its_errors(results: Results) -> None:
    for result in results.values():
        (onset,) = result["onsets"]
        assert tuple(sorted(onset["forms"])) == tuple(sorted(FORMS))
        for form in onset["forms"].values():
            assert np.isfinite(form["rmse"]).all()


def test_biases_are_reconstructed_in_real_flight(results: Results) -> None:
    for result in results.values():
        forms = result["onsets"][0]["forms"]
        for name in (PAPER, OWN_TIMES, PIPELINE):
            assert forms[name]["share_late"][0] < 0.1  # f_Ax, 3 m/s^2
            assert forms[name]["share_late"][5] < 0.25  # f_r, 3 deg/s


def test_the_monitor_names_the_broken_imu_alone(results: Results) -> None:
    for result in results.values():
        named = result["onsets"][0]["named"]
        assert named["imu1"] is None
        assert all(named[f"imu0.acc_{a}"] is not None for a in "xyz")


def test_a_file_and_rows_give_the_same_up_to_rounding(results: Results) -> None:
    """RAW_IMU has a milli-g and a milliradian per second."""
    for result in results.values():
        for apart in result["file"]["apart"].values():
            assert max(apart[:3]) < 0.02
            assert max(apart[3:]) < 2e-3


def spoiled(results: Results, change: Callable[[Result], None]) -> Results:
    out = copy.deepcopy(dict(results))
    for result in out.values():
        change(result)
    return out


def _all_forms(key: str, value: Any) -> Callable[[Result], None]:
    def change(result: Result) -> None:
        for onset in result["onsets"]:
            for form in onset["forms"].values():
                form[key] = value

    return change


def _healthy(value: float) -> Callable[[Result], None]:
    def change(result: Result) -> None:
        for told in result["healthy"].values():
            told["mean"] = [value] * 6

    return change


def _one_flight_worse(result: Result) -> None:
    if result["flight"]["name"] == "engine":
        for onset in result["onsets"]:
            onset["forms"][PAPER]["rmse"] = [10.0] * 6


@pytest.mark.parametrize(
    ("place", "change"),
    [
        ("follow the faults", _all_forms("share_late", [0.01] * 6)),
        ("follow the faults", _all_forms("share_late", [1.0] * 6)),
        ("zero-mean", _healthy(0.0)),
        ("below 0.05 rad/s", _all_forms("largest", [0.01] * 6)),
        ("below 0.05 rad/s", _all_forms("largest", [1.0] * 6)),
        ("does not change", _one_flight_worse),
        ("Fig. 8", _all_forms("residual_during", [9.0] * 6)),
        ("higher rate", _all_forms("rmse", [1.0] * 6)),
    ],
)
def test_other_numbers_give_another_outcome(
    results: Results, place: str, change: Callable[[Result], None]
) -> None:
    before, after = (
        next(c for c in recorded.claims(r, Scope()) if place in c.statement)
        for r in (results, spoiled(results, change))
    )
    assert before.outcome != after.outcome
    assert before.because != after.because


def test_blocks_show_every_recording(results: Results) -> None:
    shown = recorded.blocks(results, Scope())
    names = [b.name for b in shown if isinstance(b, Table | Figure)]
    assert len(names) == len(set(names))
    assert sum(isinstance(b, Figure) for b in shown) == 3 + len(results)
    errors = next(b for b in shown if isinstance(b, Table) and b.name == "lu2016-recorded")
    assert len(errors.rows) == len(results) * len(FORMS)
    beside = next(b for b in shown if isinstance(b, Table) and b.name == "lu2016-recorded-beside")
    assert all(str(row[-1]).endswith(".") for row in beside.rows)
