"""The IMU watch on synthetic flights: one thing broken, found, and nothing else blamed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.attitude import quaternion_from_rotation_vector, quaternion_product
from links.vocabulary import GYRO_ACC_AXES, Kind, Reason, State
from monitor.settings.imu import ImuSettings
from monitor.watch.imu import ImuWatch
from sim_feeds.scenario import load
from tests.monitor.imu_flights import (
    fault,
    faults_of,
    judge,
    pieces,
    rows_of,
    scenario,
    start_us,
)

TURBULENCE = ({"kind": "dryden", "wind_6m_m_s": 12.0},)


def seconds(rows, verdict):
    return (verdict.t_us - start_us(rows)) * 1e-6


@pytest.mark.parametrize("aircraft", ["small-uav", "transport"])
@pytest.mark.parametrize("imus", [1, 2, 3])
def test_a_healthy_flight_has_no_fault_and_is_monitored_after_two_seconds(aircraft, imus) -> None:
    rows = rows_of(scenario(aircraft, imus=imus).fly())
    result = judge(rows)
    assert faults_of(result) == []
    ok = {v.sensor: seconds(rows, v) for v in result.verdicts if v.state is State.OK}
    assert len(ok) == 6 * imus
    assert max(ok.values()) < 2.5


@pytest.mark.parametrize(
    ("axis", "size", "limit_s"),
    [
        ("acc_x", 1.0, 2.0),
        ("acc_y", -1.0, 2.0),
        ("acc_z", 1.0, 4.0),
        ("gyro_x", 2.0, 4.0),
        ("gyro_y", -2.0, 4.0),
        ("gyro_z", 2.0, 8.0),
    ],
)
@pytest.mark.parametrize("broken", [0, 1])
def test_of_two_imus_the_faulty_one_is_found_although_the_attitude_follows_it(
    axis, size, limit_s, broken
) -> None:
    name = f"imu{broken}.{axis}"
    rows = rows_of(scenario("small-uav", [fault(name, size, 60.0, 85.0)], follows=broken).fly())
    result = judge(rows)
    [found] = faults_of(result)
    assert found.sensor == name
    assert found.kind is Kind.BIAS
    assert 60.0 < seconds(rows, found) < 60.0 + limit_s
    assert (found.onset_t_us - start_us(rows)) * 1e-6 == pytest.approx(60.0, abs=1.0)
    want = size if axis.startswith("acc") else np.radians(size)
    assert found.magnitude == pytest.approx(want, rel=0.3)
    assert f"agree with imu{1 - broken} and not with imu{broken}" in found.evidence
    cleared = [v for v in result.verdicts if v.sensor == name and v.t_us > found.t_us]
    if found.detected_t_us is not None:
        assert found.onset_t_us <= found.detected_t_us < found.t_us
        told = [v for v in result.verdicts if v.state is State.SUSPECT]
        assert {v.sensor for v in told} == {f"imu0.{axis}", f"imu1.{axis}"}
        assert {v.t_us for v in told} == {found.detected_t_us}
        assert {v.reason for v in told} == {Reason.SENSORS_DISAGREE}
        assert seconds(rows, told[0]) < 61.0
        [freed] = [v for v in result.verdicts if v.sensor == f"imu{1 - broken}.{axis}"][-1:]
        assert (freed.state, freed.t_us) == (State.OK, found.t_us)
    else:
        assert seconds(rows, found) < 61.0
    assert [v.state for v in cleared] == [State.OK]
    assert seconds(rows, cleared[0]) < 105.0


@pytest.mark.parametrize(
    ("axis", "size", "limit_s"),
    [("acc_x", 1.0, 5.0), ("acc_z", 1.0, 5.0), ("gyro_x", 2.0, 6.0), ("gyro_z", 3.0, 12.0)],
)
def test_a_lone_imu_is_judged_without_the_attitude_that_follows_it(axis, size, limit_s) -> None:
    name = f"imu0.{axis}"
    rows = rows_of(scenario("small-uav", [fault(name, size, 60.0)], imus=1).fly())
    [found] = faults_of(judge(rows))
    assert found.sensor == name
    assert 60.0 < seconds(rows, found) < 60.0 + limit_s
    assert "contradict imu0" in found.evidence


@pytest.mark.parametrize("axis", ["acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z"])
def test_an_independent_attitude_isolates_the_axis_of_a_lone_imu(axis) -> None:
    """The papers' own situation: transport, GPS velocity, attitude with its own gyros."""
    name = f"imu0.{axis}"
    flight = scenario("transport", [fault(name, 1.5, 60.0)], imus=1, follows=None).fly()
    rows = rows_of(flight)
    [found] = faults_of(judge(rows, attitude_independent=True))
    assert found.sensor == name
    assert 60.0 < seconds(rows, found) < 65.0
    assert "attitude" in found.evidence


def test_six_axes_that_fail_at_once_are_put_on_the_right_imu() -> None:
    """lu2016 Table 2 on one of two IMUs of a transport in turbulence."""
    found = faults_of(judge(rows_of(load("lu2016-table2").fly())))
    assert {v.sensor for v in found} == {f"imu0.{axis}" for axis in GYRO_ACC_AXES}


def test_three_imus_vote() -> None:
    rows = rows_of(scenario("small-uav", [fault("imu1.gyro_z", 2.0, 60.0)], imus=3).fly())
    [found] = faults_of(judge(rows))
    assert found.sensor == "imu1.gyro_z"
    assert seconds(rows, found) < 62.0
    assert "other IMUs agree" in found.evidence


def test_without_a_reference_two_imus_disagree_and_neither_is_blamed() -> None:
    rows = rows_of(scenario("small-uav", [fault("imu0.acc_x", 1.0, 60.0)]).fly())
    gps = rows["gps0"]
    rows["gps0"] = gps[gps["t_us"] < start_us(rows) + 50_000_000]
    result = judge(rows)
    assert faults_of(result) == []
    told = [v for v in result.verdicts if v.reason is Reason.SENSORS_DISAGREE]
    assert [(v.sensor, v.state) for v in told] == [
        ("imu0.acc_x", State.SUSPECT),
        ("imu1.acc_x", State.SUSPECT),
        ("imu0.acc_x", State.UNMONITORED),
        ("imu1.acc_x", State.UNMONITORED),
    ]
    assert seconds(rows, told[0]) < 61.0
    assert 75.0 < seconds(rows, told[2]) < 77.0
    assert told[2].evidence == "imu0 and imu1 disagree on acc_x; no reference tells which is wrong"
    missing = {v.sensor for v in result.verdicts if v.reason is Reason.REFERENCE_MISSING}
    assert len(missing) == 12


@pytest.mark.parametrize("imus", [1, 2])
def test_a_noisy_receiver_is_no_imu_fault(imus) -> None:
    rows = rows_of(scenario("small-uav", imus=imus).fly())
    rng = np.random.default_rng(1)
    late = rows["gps0"]["t_us"] > start_us(rows) + 60_000_000
    noise = 4.0 * rng.standard_normal((int(late.sum()), 3))
    rows["gps0"]["vel_ned_m_s"][late] += noise
    result = judge(rows)
    assert faults_of(result) == []
    reasons = {v.reason for v in result.verdicts if seconds(rows, v) > 60.0}
    assert Reason.REFERENCE_NOT_TRUSTED in reasons


def test_turbulence_is_no_fault() -> None:
    rows = rows_of(scenario("small-uav", imus=1, wind=TURBULENCE).fly())
    assert faults_of(judge(rows)) == []


@pytest.mark.parametrize("imus", [1, 2])
def test_a_stuck_axis_is_called_stuck(imus) -> None:
    rows = rows_of(scenario("small-uav", imus=imus).fly())
    imu = rows["imu0"]
    late = np.flatnonzero(imu["t_us"] > start_us(rows) + 60_000_000)
    imu["gyro_rad_s"][late, 1] = imu["gyro_rad_s"][late[0], 1]
    found = faults_of(judge(rows))
    assert [v.sensor for v in found] == ["imu0.gyro_y"]
    assert found[0].kind in (Kind.STUCK, Kind.BIAS)
    assert seconds(rows, found[0]) < 63.0


def test_an_imu_that_reads_zero_has_dropped_out_and_the_other_is_judged_alone() -> None:
    faults = [fault("imu1.acc_z", 1.5, 80.0)]
    rows = rows_of(scenario("small-uav", faults).fly())
    imu = rows["imu0"]
    late = imu["t_us"] > start_us(rows) + 60_000_000
    imu["acc_m_s2"][late] = 0.0
    imu["gyro_rad_s"][late] = 0.0
    found = faults_of(judge(rows))
    first = [v for v in found if v.sensor.startswith("imu0.")]
    assert {v.kind for v in first} == {Kind.DROPOUT}
    assert len(first) == 6
    assert max(seconds(rows, v) for v in first) < 61.0
    assert [v.sensor for v in found if v not in first] == ["imu1.acc_z"]


@pytest.mark.parametrize(
    ("gone_s", "imus"),
    [(1.0, ("imu0", "imu1")), (10.0, ("imu0", "imu1")), (0.48, ("imu1",)), (3.0, ("imu1",))],
)
def test_lost_samples_are_no_dead_imu(gone_s, imus) -> None:
    rows = rows_of(scenario("small-uav", imus=2).fly())
    # imu0's samples come first of an instant: imu1 is then still silent as the decision is taken.
    rows["imu1"]["t_us"] += 5_000
    for start_s in (50.0, 58.07, 65.3, 72.63):
        first = start_us(rows) + round(start_s * 1e6)
        for sensor in imus:
            t_us = rows[sensor]["t_us"]
            rows[sensor] = rows[sensor][(t_us < first) | (t_us >= first + gone_s * 1e6)]
    assert faults_of(judge(rows)) == []


@pytest.mark.parametrize(("later_us", "cut"), [(90_000, None), (310_000, None), (310_000, 700)])
def test_fixes_that_are_sent_again_are_no_measurements(later_us, cut) -> None:
    rows = rows_of(scenario("small-uav", imus=2).fly())
    fixes = rows["gps0"]
    fixes["stamp_us"] = fixes["t_us"]
    again = fixes.copy()
    again["t_us"] += later_us
    again["seq"] = fixes["seq"] + 1
    both = np.concatenate([fixes, again])
    rows["gps0"] = both[np.argsort(both["t_us"], kind="stable")]
    if cut is None:
        result = judge(rows)
        verdicts = result.verdicts
    else:
        watch, at = ImuWatch(ImuSettings()), int(rows["gps0"]["t_us"][cut]) + 1
        verdicts = []
        for until, part in (
            (at, {s: r[r["t_us"] < at] for s, r in rows.items()}),
            (1 << 60, {s: r[r["t_us"] >= at] for s, r in rows.items()}),
        ):
            verdicts += watch.step(part, until).verdicts
    assert {v.state for v in verdicts if v.sensor == "imu0.acc_x"} >= {State.OK}
    assert not any(v.reason is Reason.REFERENCE_NOT_TRUSTED for v in verdicts)


def test_an_instance_that_never_leaves_zero_is_not_judged() -> None:
    rows = rows_of(scenario("small-uav", imus=2).fly())
    rows["imu1"]["acc_m_s2"] = 0.0
    rows["imu1"]["gyro_rad_s"] = 0.0
    result = judge(rows)
    assert {v.sensor.partition(".")[0] for v in result.verdicts} == {"imu0"}
    assert set(result.estimates) == {"imu0", "imu0_tests"}


def test_a_noisy_axis_is_called_noise() -> None:
    noisy = {"sensor": "imu0.gyro_y", "kind": "noise", "start_s": 60.0, "size_deg_s": 5.0}
    rows = rows_of(scenario("small-uav", [noisy]).fly())
    [found] = faults_of(judge(rows))
    assert (found.sensor, found.kind) == ("imu0.gyro_y", Kind.NOISE)
    assert seconds(rows, found) < 64.0


def test_nothing_is_judged_before_flight_nor_after() -> None:
    rows = rows_of(scenario("small-uav", [fault("imu0.acc_x", 3.0, 5.0)]).fly())
    rows["phase"] = np.zeros(2, rows["phase"].dtype)
    rows["phase"]["t_us"] = start_us(rows) + np.array([0, 2_000_000])
    rows["phase"]["flying"] = [True, False]
    result = judge(rows)
    assert faults_of(result) == []
    last = {v.sensor: v for v in result.verdicts}
    assert {v.reason for v in last.values()} == {Reason.ON_GROUND}


def test_the_estimate_reconstructs_the_fault_and_the_true_reading() -> None:
    rows = rows_of(scenario("small-uav", [fault("imu0.acc_x", 1.0, 60.0)]).fly())
    estimate = judge(rows).estimates["imu0"]
    t_s = (estimate["t_us"] - start_us(rows)) * 1e-6
    late, early = t_s > 65.0, (t_s > 20.0) & (t_s < 60.0)
    change = estimate["acc_fault_m_s2"][late, 0] - estimate["acc_fault_m_s2"][early, 0].mean()
    np.testing.assert_allclose(change, 1.0, atol=0.2)
    assert np.diff(estimate["t_us"]).min() >= 100_000


SHORT = rows_of(scenario("small-uav", [fault("imu0.acc_x", 1.0, 30.0, 45.0)]).fly())
WHOLE = judge(SHORT)


@settings(max_examples=8, deadline=None)
@given(st.lists(st.floats(0.0, 120.0), max_size=60))
def test_any_split_gives_the_same_verdicts_and_estimates(cuts) -> None:
    split = pieces(SHORT, [start_us(SHORT) + round(c * 1e6) for c in cuts])
    assert repr(split.verdicts) == repr(WHOLE.verdicts)
    for name, e in WHOLE.estimates.items():
        assert split.estimates[name].tobytes() == e.tobytes()


def test_a_row_at_a_time_gives_the_same_verdicts() -> None:
    """Forty steps a second, as live."""
    edges = start_us(SHORT) + np.arange(0, 60_000_000, 25_000)
    early = {s: r[r["t_us"] < edges[-1]] for s, r in SHORT.items()}
    assert repr(pieces(early, edges.tolist()).verdicts) == repr(judge(early).verdicts)


ATTITUDE_UNHEARD = 1e6
"""Odds that satellite velocity never reaches: the attitude is no evidence then."""


def test_an_attitude_that_contradicts_a_lone_gyro_is_heard_with_gps() -> None:
    broken = [fault("imu0.gyro_z", -2.0, 60.0)]
    rows = rows_of(scenario("small-uav", broken, imus=1, follows=None).fly())
    [alone] = faults_of(judge(rows, arbitration_nats=ATTITUDE_UNHEARD))
    [heard] = faults_of(judge(rows))
    assert heard.sensor == alone.sensor == "imu0.gyro_z"
    assert heard.t_us < alone.t_us
    assert "attitude" in heard.evidence
    assert "attitude" not in alone.evidence


def test_an_oscillating_gyro_is_named_and_not_its_pair() -> None:
    rows = rows_of(scenario("small-uav", imus=1, follows=None, wind=TURBULENCE).fly())
    imu = rows["imu0"]
    t = (imu["t_us"] - start_us(rows)) * 1e-6 - 60.0
    swing = np.radians(2.0) * np.sin(2.0 * np.pi * t / 5.0)
    imu["gyro_rad_s"][:, 1] += np.where((t > 0.0) & (t < 30.0), swing, 0.0)
    assert {v.sensor for v in faults_of(judge(rows))} == {"imu0.gyro_y"}


@pytest.mark.parametrize(("axis", "rate_deg_s"), [(0, -6.0), (1, 4.0), (2, 3.0)])
def test_an_attitude_that_turns_by_itself_is_no_gyro_fault(axis, rate_deg_s) -> None:
    """An autopilot that corrects its attitude turns it otherwise than the gyro says."""
    rows = rows_of(scenario("small-uav", imus=1).fly())
    t = (rows["attitude"]["t_us"] - start_us(rows)) * 1e-6 - 60.0
    for row, angle in zip(
        rows["attitude"], np.radians(rate_deg_s) * np.clip(t, 0.0, 8.0), strict=True
    ):
        turn = quaternion_from_rotation_vector(angle * np.eye(3)[axis])
        row["q_ned_from_frd"] = quaternion_product(turn, row["q_ned_from_frd"].copy())
    assert faults_of(judge(rows)) == []


def heading_moved(rows, angle_deg, over_s):
    """The attitude's heading goes over to another one a minute after the start."""
    t = (rows["attitude"]["t_us"] - start_us(rows)) * 1e-6 - 60.0
    share = np.clip(t / over_s, 0.0, 1.0)
    for row, angle in zip(rows["attitude"], np.radians(angle_deg) * share, strict=True):
        turn = quaternion_from_rotation_vector(np.array([0.0, 0.0, angle]))
        row["q_ned_from_frd"] = quaternion_product(turn, row["q_ned_from_frd"].copy())
    return rows


@pytest.mark.parametrize(
    ("angle_deg", "over_s", "independent"),
    [
        (20, 0.01, False),
        (-90, 0.01, False),
        (180, 0.01, False),
        (-40, 4.0, False),
        (5, 0.01, True),
        (-90, 0.01, True),
    ],
)
def test_a_heading_that_is_reset_is_no_gyro_fault(angle_deg, over_s, independent) -> None:
    rows = heading_moved(rows_of(scenario("small-uav", imus=1).fly()), angle_deg, over_s)
    assert faults_of(judge(rows, attitude_independent=independent)) == []


def test_after_a_reset_of_the_heading_faults_are_still_found() -> None:
    broken = [fault("imu0.gyro_x", 3.0, 80.0)]
    rows = heading_moved(rows_of(scenario("small-uav", broken, imus=1).fly()), 90, 0.01)
    assert [v.sensor for v in faults_of(judge(rows))] == ["imu0.gyro_x"]


@pytest.mark.parametrize(("size_deg_s", "found"), [(1.2, True), (0.3, False)])
def test_a_small_swing_of_a_rate_is_found_against_an_independent_attitude(
    size_deg_s, found
) -> None:
    rows = rows_of(scenario("transport", imus=1, follows=None).fly())
    imu = rows["imu0"]
    t = (imu["t_us"] - start_us(rows)) * 1e-6 - 40.0
    swing = np.radians(size_deg_s) * np.sin(2.0 * np.pi * t / 4.0)
    imu["gyro_rad_s"][:, 1] += np.where((t > 0.0) & (t < 40.0), swing, 0.0)
    verdicts = judge(rows, attitude_independent=True)
    called = [(v.sensor, v.kind) for v in faults_of(verdicts)]
    assert called == ([("imu0.gyro_y", Kind.OSCILLATION)] if found else [])
    if found:
        assert seconds(rows, faults_of(verdicts)[0]) < 65.0
        assert "swings" in faults_of(verdicts)[0].evidence
        last = [v for v in verdicts.verdicts if v.sensor == "imu0.gyro_y"][-1]
        assert last.state is State.OK


@pytest.mark.parametrize(("axis", "size"), [("acc_x", 1.0), ("gyro_y", 2.0)])
def test_what_looks_alike_is_named_with_its_pair(axis, size) -> None:
    rows = rows_of(scenario("small-uav", [fault(f"imu0.{axis}", size, 60.0)], imus=1).fly())
    found = faults_of(judge(rows))
    assert found[0].sensor in ("imu0.acc_x", "imu0.gyro_y")
    if found[0].sensor != f"imu0.{axis}":
        assert "acc_x or gyro_y" in found[0].evidence


def test_a_force_too_small_to_be_a_fault_is_not_put_on_the_rate_that_looks_like_it() -> None:
    rows = rows_of(scenario("small-uav", [fault("imu0.acc_y", 0.4, 60.0)], imus=1).fly())
    assert faults_of(judge(rows, acc_size_m_s2=0.6)) == []


def peaks_of(rows, **settings):
    watch = ImuWatch(ImuSettings(**settings))
    result = watch.step(rows, 1 << 60)
    return watch.peaks(), result


@pytest.mark.parametrize("imus", [1, 2])
def test_peaks_of_a_healthy_flight_stay_below_the_thresholds(imus) -> None:
    peaks, result = peaks_of(rows_of(scenario("small-uav", imus=imus, wind=TURBULENCE).fly()))
    assert faults_of(result) == []
    assert max(peaks["imu.difference_sigma"], peaks["imu.single_sigma"]) < 6.0
    assert 1.0 < peaks["imu.noise_ratio"] < 16.0


def test_a_threshold_above_the_peak_is_silent_and_one_below_is_not() -> None:
    rows = rows_of(scenario("small-uav", [fault("imu0.acc_z", 0.3, 60.0)]).fly())
    peaks, result = peaks_of(rows)
    assert faults_of(result) == []
    assert peaks["imu.difference_sigma"] > 6.0
    size = peaks["imu.acc_size_m_s2"]
    assert size == pytest.approx(0.3, abs=0.1)
    assert faults_of(judge(rows, acc_size_m_s2=1.1 * size)) == []
    assert [v.sensor for v in faults_of(judge(rows, acc_size_m_s2=0.8 * size))] == ["imu0.acc_z"]


def test_a_called_fault_makes_no_peak() -> None:
    rows = rows_of(scenario("small-uav", [fault("imu0.acc_x", 3.0, 60.0)]).fly())
    late, result = peaks_of(rows)
    [found] = faults_of(result)
    early = {s: r[r["t_us"] <= found.t_us + 1] for s, r in rows.items()}
    assert peaks_of(early)[0] == late
    assert late["imu.acc_size_m_s2"] < 1.0
