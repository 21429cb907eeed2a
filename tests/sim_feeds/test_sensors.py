"""Instruments: noise, bias, lag, times; and that streams do not disturb one another."""

from math import radians

import numpy as np
import pytest

from sim_feeds.airframe import AIRFRAMES
from sim_feeds.autopilot import Autopilot
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.flightplan import FlightPlan
from sim_feeds.rotation import euler_from_matrix
from sim_feeds.sensors import Airspeed, Aoa, Baro, Gps, Imu, markov, walk
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Constant, Wind, toward


@pytest.fixture(scope="module")
def truth() -> Truth:
    plan = FlightPlan(AIRFRAMES["small-uav"], 20.0, 150.0).level(5.0)
    plan.turn(radians(180.0)).climb_at(2.0, 40.0).turn(radians(-180.0)).change_speed(16.0)
    return fly(plan.level(60.0), Wind([Constant(toward(4.0, 100.0))]))


def imu_error(truth: Truth, imu: Imu, seed: int = 0) -> np.ndarray:
    s = imu.sample(truth, 0, [], seed)
    here = truth.at(s.valid_s)
    return s.values - np.column_stack([here.specific_force_m_s2, here.rate_rad_s])


QUIET = {
    "acc_noise_m_s2": 0.0,
    "gyro_noise_deg_s": 0.0,
    "acc_bias_m_s2": 0.0,
    "gyro_bias_deg_s": 0.0,
    "acc_walk_m_s2": 0.0,
    "gyro_walk_deg_s": 0.0,
}


def test_a_perfect_imu_reads_truth(truth):
    assert np.abs(imu_error(truth, Imu(**QUIET))).max() < 1e-12


def test_imu_noise_and_bias_have_their_sizes(truth):
    noisy = Imu(**{**QUIET, "acc_noise_m_s2": 0.3, "gyro_noise_deg_s": 0.5})
    std = imu_error(truth, noisy).std(axis=0)
    np.testing.assert_allclose(std[:3], 0.3, rtol=0.05)
    np.testing.assert_allclose(std[3:], radians(0.5), rtol=0.05)
    biased = Imu(**{**QUIET, "acc_bias_m_s2": 0.1})
    biases = np.array([imu_error(truth, biased, seed)[0, :3] for seed in range(60)])
    assert biases.std() == pytest.approx(0.1, rel=0.2)


def test_bias_walk_spreads_with_the_root_of_time():
    t = np.arange(0.0, 100.0, 0.1)
    ends = [walk(np.random.default_rng(s), t, 0.02)[-1] for s in range(400)]
    assert np.std(ends) == pytest.approx(0.02 * np.sqrt(t[-1]), rel=0.1)


def test_quantisation(truth):
    coarse = Imu(**QUIET, acc_quantum_m_s2=0.5)
    s = coarse.sample(truth, 0, [], 0)
    np.testing.assert_allclose(s.values[:, :3] % 0.5 % 0.5, 0.0, atol=1e-12)
    assert np.abs(imu_error(truth, coarse)[:, :3]).max() <= 0.25 + 1e-12


def test_gauss_markov_is_stationary_and_correlated():
    t = np.arange(0.0, 20000.0, 1.0)
    x = markov(np.random.default_rng(2), t, 0.5, 10.0)
    assert x.std() == pytest.approx(0.5, rel=0.08)
    assert np.corrcoef(x[:-10], x[10:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.06)


@pytest.mark.parametrize("instrument", [Imu(rate_hz=50.0), Gps(), Airspeed(rate_hz=10.0), Baro()])
def test_rate_order_and_latency(truth, instrument):
    s = instrument.sample(truth, 0, [], 3)
    period = 1.0 / instrument.rate_hz
    assert np.median(np.diff(s.valid_s)) == pytest.approx(period, rel=0.02)
    assert (np.diff(s.valid_s) > 0.0).all()
    assert (np.diff(s.sent_s) >= 0.0).all()
    late = s.sent_s - s.valid_s
    assert late.min() >= instrument.latency_s - 1e-12
    assert np.median(late) < instrument.latency_s + 2.0 * instrument.latency_jitter_s
    np.testing.assert_allclose(s.stamp_s - s.valid_s, instrument.stamp_delay_s, atol=1e-12)


def test_gps_is_late_by_the_traps_amount():
    """Stamped 0.05 to 0.08 s after validity, sent 0.15 to 0.2 s after it."""
    gps = Gps()
    assert 0.05 <= gps.stamp_delay_s <= 0.08
    assert 0.15 <= gps.latency_s <= 0.2


def test_random_loss(truth):
    full, lossy = (Imu(loss=x).sample(truth, 0, [], 0) for x in (0.0, 0.3))
    assert len(lossy.valid_s) / len(full.valid_s) == pytest.approx(0.7, abs=0.03)


def test_gps_velocity_is_the_truth_at_validity(truth):
    s = Gps(velocity_std_m_s=0.0, slow_velocity_std_m_s=0.0).sample(truth, 0, [], 0)
    np.testing.assert_allclose(s.values[:, 3:6], truth.at(s.valid_s).vel_ned_m_s, atol=1e-12)
    at_arrival = truth.at(np.minimum(s.sent_s, truth.t_s[-1])).vel_ned_m_s
    assert np.abs(s.values[:, 3:6] - at_arrival).max() > 0.5, "the latency shows in turns"


def test_pitots_differ_and_agree_with_the_airspeed(truth):
    pitots = [Airspeed().sample(truth, i, [], 0) for i in range(3)]
    for s in pitots:
        error = s.values[:, 0] - np.interp(s.valid_s, truth.t_s, truth.cas_m_s)
        assert abs(error.mean()) < 0.8
        assert error.std() < 0.3
    means = {round(float(s.values[:, 0].mean()), 4) for s in pitots}
    assert len(means) == 3


def test_pressure_and_airspeed_say_the_same(truth):
    fault = Fault("airspeed0", FaultKind.BIAS, 20.0, size=4.0)
    s = Airspeed(ratio=1.9).sample(truth, 0, [fault], 0)
    np.testing.assert_allclose(np.sqrt(1.9 * s.values[:, 1]), s.values[:, 0], rtol=1e-12)


def test_pitot_lag(truth):
    """At a steady acceleration of 1 m/s^2 the reading is behind by the lag."""
    calm = {"noise_pa": 0.0, "offset_pa": 0.0, "scale_error": 0.0}
    quick, slow = (Airspeed(**calm, lag_s=x).sample(truth, 0, [], 0) for x in (0.0, 0.5))
    slope = np.gradient(quick.values[:, 0], quick.valid_s)
    steady = slope < 0.999 * slope.min()
    behind = (slow.values - quick.values)[:, 0]
    assert slope.min() < -0.8
    np.testing.assert_allclose(behind[steady][8:], -0.5 * slope.min(), rtol=0.05)


def test_vane_reads_the_angle_of_attack(truth):
    s = Aoa(noise_deg=0.0, bias_deg=0.0, lag_s=0.0).sample(truth, 0, [], 0)
    np.testing.assert_allclose(
        s.values[:, 0], np.interp(s.valid_s, truth.t_s, truth.aoa_rad), atol=1e-12
    )


def test_blocked_static_port_reaches_the_barometer_of_the_same_number(truth):
    fault = Fault("airspeed1", FaultKind.STATIC_BLOCKED, 20.0)
    quiet = Baro(noise_pa=0.0, offset_pa=0.0)
    first, second = (quiet.sample(truth, i, [fault], 0) for i in (0, 1))
    late = second.valid_s > 21.0
    assert np.ptp(second.values[late, 0]) < 1e-9
    assert np.ptp(first.values[first.valid_s > 21.0, 0]) > 300.0


def test_a_fault_touches_its_channel_alone(truth):
    """All other axes, sensors and times are equal to the last bit."""
    fault = Fault("imu0.acc_x", FaultKind.NOISE, 30.0, 60.0, size=2.0)
    imu = Imu()
    clean, hit = (imu.sample(truth, 0, f, 7) for f in ([], [fault]))
    np.testing.assert_array_equal(hit.values[:, 1:], clean.values[:, 1:])
    on = fault.active(clean.valid_s)
    np.testing.assert_array_equal(hit.values[~on, 0], clean.values[~on, 0])
    assert (hit.values - clean.values)[on, 0].std() == pytest.approx(2.0, rel=0.06)
    other = imu.sample(truth, 1, [fault], 7)
    np.testing.assert_array_equal(other.values, imu.sample(truth, 1, [], 7).values)


@pytest.mark.parametrize(
    ("sensor", "instrument"), [("imu0", Imu()), ("airspeed0", Airspeed()), ("gps0", Gps())]
)
def test_dropout_stops_the_data(truth, sensor, instrument):
    fault = Fault(sensor, FaultKind.DROPOUT, 30.0, 45.0)
    s = instrument.sample(truth, 0, [fault], 0)
    gap = np.diff(s.valid_s).max()
    assert gap == pytest.approx(15.0, abs=2.0 / instrument.rate_hz)
    assert not fault.active(s.valid_s).any()


def test_gps_outage_freezes_stamp_and_position_but_not_the_velocity(truth):
    fault = Fault("gps0", FaultKind.OUTAGE, 30.0, 40.0)
    s = Gps().sample(truth, 0, [fault], 0)
    healthy = Gps().sample(truth, 0, [], 0)
    on = fault.active(s.valid_s)
    assert len(s.valid_s) == len(healthy.valid_s)
    assert np.ptp(s.stamp_s[on]) == 0.0
    assert np.ptp(s.values[on, :3], axis=0).max() == 0.0
    assert np.ptp(s.values[on, 3]) > 2.0
    assert not s.values[on, 6].any()
    np.testing.assert_array_equal(s.values[~on], healthy.values[~on])


def attitude_error_deg(truth: Truth, pilot: Autopilot, faults: list[Fault]) -> tuple:
    imu = Imu().sample(truth, 0, faults, 0)
    nav = pilot.estimate(truth, imu, 0)
    error = euler_from_matrix(nav.ned_from_frd) - truth.at(nav.t_s).euler_rad
    return nav.t_s, np.degrees((error + np.pi) % (2.0 * np.pi) - np.pi), nav


BIASED = [Fault("imu0.acc_x", FaultKind.BIAS, 50.0, size=1.5)]


def test_independent_attitude_ignores_the_imu_fault(truth):
    pilot = Autopilot(tilt_std_deg=0.3, yaw_std_deg=1.0)
    t, error, nav = attitude_error_deg(truth, pilot, BIASED)
    assert np.abs(error[:, :2]).max() < 1.5
    healthy = attitude_error_deg(truth, pilot, [])[1]
    np.testing.assert_array_equal(error, healthy)
    assert np.abs(nav.vel_ned_m_s - truth.at(t).vel_ned_m_s).max() < 0.6


def test_following_attitude_shares_the_imu_fault(truth):
    """1.5 m/s^2 on x is a tilt of 8.7 degrees in the end; healthy it stays close."""
    pilot = Autopilot(attitude_follows_imu=0, tilt_std_deg=0.0, yaw_std_deg=0.0)
    t, error, _ = attitude_error_deg(truth, pilot, BIASED)
    assert np.abs(error[t < 50.0, :2]).max() < 1.0
    assert np.abs(error[t > 80.0, 1]).max() == pytest.approx(8.7, abs=3.0)
    assert np.abs(attitude_error_deg(truth, pilot, [])[1][:, :2]).max() < 1.5
