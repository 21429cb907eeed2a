"""Measurements that are slow, late, partial, missing or impossible to use."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.attitude import ned_from_frd, wrap
from estimators.baselines.numpy_twins_imu import discretise, earth_terms, linearise, rates
from estimators.kinematics import GS
from estimators.two_stage_ekf import DelayedFilter, Settings, Status, TwoStageFilter
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.papers.lu2016 import ImuExperiment, lu2016_experiment

VELOCITY, ANGLES = slice(0, 3), slice(3, 6)
LAT, ALT = math.radians(52.0), 1000.0


@pytest.fixture(scope="module")
def healthy() -> ImuExperiment:
    """40 s at 100 m/s in turbulence, with a load factor doublet and a turn; nothing broken."""
    return lu2016_experiment("turbulence", 1, faults=[])


@pytest.fixture(scope="module")
def broken() -> ImuExperiment:
    """The same flight with two biases from 10 s on."""
    return lu2016_experiment(
        "turbulence",
        1,
        faults=[
            Fault("imu0.acc_x", FaultKind.BIAS, 10.0, size=1.0),
            Fault("imu0.gyro_y", FaultKind.BIAS, 10.0, size=0.02),
        ],
    )


def times_us(flight: ImuExperiment) -> np.ndarray:
    return np.round(flight.t_s * 1e6).astype(np.int64)


def measurements(
    flight: ImuExperiment, velocity_hz: int, angles_hz: int
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and angles as rows of their own, each stamped with the time it was valid."""
    t = times_us(flight)
    rows = []
    for part, rate in ((VELOCITY, velocity_hz), (ANGLES, angles_hz)):
        every = slice(None, None, 100 // rate)
        y = np.full((len(t[every]), 6), np.nan)
        y[:, part] = flight.y_ground[every, part]
        rows.append((t[every], y))
    return np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])


def followed(
    flight: ImuExperiment, meas_t: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    one = DelayedFilter(TwoStageFilter(Settings()), delay_s=0.3)
    return one.feed(times_us(flight), flight.u_m, meas_t, y, *flight.env[0])


@pytest.mark.parametrize(
    ("velocity_hz", "angles_hz", "acc_s", "gyro_s"),
    [
        (100, 100, 0.3, 0.3),
        (5, 20, 0.8, 0.5),
        (5, 5, 0.8, 0.8),
        (1, 10, 2.2, 0.6),
        (1, 1, 2.2, 2.2),
    ],
)
def test_biases_are_found_at_any_rate_and_nothing_else(
    broken: ImuExperiment, velocity_hz: int, angles_hz: int, acc_s: float, gyro_s: float
) -> None:
    t, track = followed(broken, *measurements(broken, velocity_hz, angles_hz))
    t_s, f = t * 1e-6, track["f"]
    found_acc = t_s[np.argmax(f[:, 0] > 0.8)] - 10.0
    found_gyro = t_s[np.argmax(f[:, 4] > 0.016)] - 10.0
    # two intervals between measurements and a little
    assert 0 < found_acc < acc_s
    assert 0 < found_gyro < gyro_s
    settled = t_s > 25.0
    assert np.allclose(f[settled].mean(axis=0), [1.0, 0, 0, 0, 0.02, 0], atol=3e-3)
    quiet = (t_s > 5.0) & (t_s < 9.9)
    assert np.all(np.sqrt(np.mean(f[quiet] ** 2, axis=0)) < [0.03] * 3 + [1.5e-3] * 3)


def test_latency_is_a_fault_unless_the_filter_lives_behind_it(healthy: ImuExperiment) -> None:
    """150 ms of GPS latency at 5 Hz: the quiet standard deviation of f_Az."""
    t, y = measurements(healthy, 5, 20)
    arrived = t + np.where(np.isfinite(y[:, 0]), 150_000, 0)
    quiet = {}
    for name, stamps in (("valid", t), ("arrived", arrived)):
        used, track = followed(healthy, stamps, y)
        quiet[name] = track["f"][used > 5_000_000, 2].std()
    assert quiet["valid"] < 0.010
    assert quiet["arrived"] > 10 * quiet["valid"]


def test_in_step_at_the_imu_rate_it_is_the_fixed_rate_filter(broken: ImuExperiment) -> None:
    t = times_us(broken)
    one = TwoStageFilter(Settings(), broken.x_ground[0])
    whole = one.run(broken.u_m[:-1], broken.y_ground[1:], np.tile([LAT, ALT], (len(t) - 1, 1)))
    live = DelayedFilter(TwoStageFilter(Settings(), broken.x_ground[0]), delay_s=0.0)
    _, track = live.feed(t, broken.u_m, t[1:], broken.y_ground[1:], LAT, ALT)
    assert len(track) == len(whole)
    assert np.allclose(track["f"], whole["f"], rtol=0, atol=1e-9)
    assert np.allclose(track["Qf"], whole["Qf"], rtol=1e-6)


@settings(max_examples=15, deadline=None)
@given(cuts=st.lists(st.integers(0, 4000), max_size=12))
def test_any_split_of_the_stream_gives_the_same_estimates(
    healthy: ImuExperiment, cuts: list[int]
) -> None:
    t, (meas_t, y) = times_us(healthy), measurements(healthy, 5, 20)
    latency = np.where(np.isfinite(y[:, 0]), 150_000, 10_000)
    order = np.argsort(meas_t + latency, kind="stable")  # as they arrive
    meas_t, y, arrival = meas_t[order], y[order], (meas_t + latency)[order]

    def fed(edges: list[int]) -> bytes:
        one = DelayedFilter(TwoStageFilter(Settings()), delay_s=0.2)
        out = []
        bounds = [0, *sorted(edges), len(t)]
        for lo, hi in itertools.pairwise(bounds):
            since = t[lo] if lo else -1
            until = t[hi] if hi < len(t) else 10**12
            new = (arrival >= since) & (arrival < until)
            if lo == hi:
                continue
            used, track = one.feed(t[lo:hi], healthy.u_m[lo:hi], meas_t[new], y[new], LAT, ALT)
            out.append((used, track))
        assert one.late == 0
        times, tracks = zip(*out, strict=True)
        return np.concatenate(times).tobytes() + np.concatenate(tracks).tobytes()

    assert fed(cuts) == fed([])


def test_between_measurements_it_is_still_the_augmented_filter(broken: ImuExperiment) -> None:
    pytest.importorskip("filterpy")
    from estimators.baselines.augmented_ekf import AugmentedEKF

    fixed = Settings(adapt=False)
    P = np.diag(fixed.tuning()["R"][0])
    ours = TwoStageFilter(fixed, broken.x_ground[0], P)
    theirs = AugmentedEKF(fixed, broken.x_ground[0], P, compiled=True)
    for k in range(1500):
        for one in (ours, theirs):
            one.predict(broken.u_m[k], *broken.env[k], 0.01)
            if k % 20 == 19:
                one.update(broken.y_ground[k + 1])
        assert np.abs(ours.fault - theirs.fault).max() < 1e-11
        assert np.abs(ours.state - theirs.state).max() < 1e-11


def test_covariance_matching_over_an_interval_written_out(broken: ImuExperiment) -> None:
    one = TwoStageFilter(Settings(window=1, detuning=2e-3), broken.x_ground[0])
    Q, R = np.diag(one.tuning["Q"][0]), one.tuning["R"][0]
    for interval in range(8):
        Gamma_T, Q_T = np.zeros((6, 6)), np.zeros((6, 6))
        for k in range(10 * interval, 10 * interval + 10):
            earth = earth_terms(*broken.env[k])
            F, G = linearise(GS, one.state, broken.u_m[k] - one.fault, earth)
            Phi, Gamma = discretise(F, G, 0.01)
            Gamma_T = Phi @ Gamma_T + Gamma
            Q_T = Phi @ Q_T @ Phi.T + Gamma @ Q @ Gamma.T
            one.predict(broken.u_m[k], *broken.env[k], 0.01)
        one.update(broken.y_ground[10 * interval + 10])
        spread = np.maximum(one.innovation**2 - np.diag(Q_T) - R, 0.0)
        inverse = np.linalg.inv(Gamma_T)
        expected = 2e-3 * np.diag(inverse @ np.diag(spread) @ inverse.T)
        assert np.allclose(one.memory["Qf"][0], np.maximum(expected, 1e-14), rtol=1e-6)


def test_the_printed_detuning_is_what_keeps_the_estimates_quiet(healthy: ImuExperiment) -> None:
    """Standard deviation of a healthy f_Ax: .013 m/s^2 with the printed dt^2, .72 without."""

    def quiet_std(detuning: float | None) -> float:
        one = TwoStageFilter(Settings(detuning=detuning), healthy.x_ground[0])
        track = one.run(healthy.u_m[:-1], healthy.y_ground[1:], healthy.env[:-1])
        return float(track["f"][500:, 0].std())

    assert quiet_std(None) == quiet_std(1e-4)
    assert 0.008 < quiet_std(None) < 0.020
    assert 0.5 < quiet_std(1.0) < 1.0


@pytest.mark.parametrize("turn_rad_s", [0.3, -0.3])
def test_headings_that_cross_north_and_south_are_no_fault(turn_rad_s: float) -> None:
    """A flat turn of 60 s, heading measured in (-pi, pi]: three crossings, unwrapped estimate."""
    rng = np.random.default_rng(7)
    n, g = 6000, earth_terms(LAT, ALT)[0]
    u = np.tile([0.0, 0.0, -g, 0.0, 0.0, turn_rad_s], (n, 1))
    x = np.zeros((n + 1, 6))
    x[0] = [20.0, 0.0, 0.0, 0.0, 0.0, 3.0]
    earth = earth_terms(LAT, ALT)
    for k in range(n):
        middle = x[k] + 0.005 * rates(GS, x[k], u[k], earth)
        x[k + 1] = x[k] + 0.01 * rates(GS, middle, u[k], earth)
    assert abs(x[-1, 5] - 3.0) > 5 * math.pi
    one = TwoStageFilter(Settings(), x[0])
    std_u, std_y = np.sqrt(one.tuning["Q"][0]), np.sqrt(one.tuning["R"][0])
    y = x + std_y * rng.standard_normal(x.shape)
    y[:, 5] = wrap(y[:, 5])
    track = one.run(u + std_u * rng.standard_normal(u.shape), y[1:], np.tile([LAT, ALT], (n, 1)))
    assert np.abs(track["f"][:, :3]).max() < 0.1
    assert np.abs(track["f"][:, 5]).max() < 3e-3
    assert one.state[5] == pytest.approx(x[-1, 5], abs=1e-3)


def looping(seconds: float, fault: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A vehicle that keeps its velocity and swings its nose up to 85 degrees and back."""
    t = np.arange(0.0, seconds, 0.01)
    top = math.radians(85.0)
    pitch = top * np.sin(math.pi * t / seconds) ** 2
    pitch_rate = top * math.pi / seconds * np.sin(2 * math.pi * t / seconds)
    g = earth_terms(LAT, ALT)[0]
    force = [ned_from_frd(0.0, p, 0.5).T @ [0, 0, -g] for p in pitch]
    middle = np.interp(t + 0.005, t, pitch_rate)
    gyro = np.column_stack([0 * t, middle, 0 * t])
    x = np.column_stack([np.tile([5.0, 1.0, 0.0], (len(t), 1)), 0 * t, pitch, 0 * t + 0.5])
    return np.column_stack([force, gyro]) + fault, x, pitch


def test_steep_pitch_freezes_the_faults_and_they_survive() -> None:
    fault = np.array([0.5, 0, 0, 0, 0, 0.03])
    um, x, pitch = looping(40.0, fault)
    rng = np.random.default_rng(3)
    one = TwoStageFilter(Settings(), x[0])
    std = np.sqrt(one.tuning["R"][0])
    history = []
    for k in range(len(um) - 1):
        one.predict(um[k], LAT, ALT, 0.01)
        status = one.update(x[k + 1] + std * rng.standard_normal(6))
        history.append((status, *one.fault))
    status = np.array([h[0] for h in history])
    f = np.array([h[1:] for h in history])
    frozen = status == Status.FROZEN
    steep = pitch[1:] > math.radians(75.5)
    assert np.all(frozen[steep])
    assert not np.any(frozen[pitch[1:] < math.radians(69.0)])
    assert np.ptp(f[frozen], axis=0).max() == 0.0
    # the earth's own rotation is in none of these inputs: 0.3 rad/h of tolerance
    for moments in (slice(800, 900), slice(3500, 3900)):
        assert np.allclose(f[moments].mean(axis=0), fault, atol=[0.03] * 3 + [4e-4] * 3)


def test_what_is_not_finite_is_reported_and_does_no_harm(broken: ImuExperiment) -> None:
    one = TwoStageFilter(Settings(), broken.x_ground[0])
    um, y = broken.u_m[0].copy(), broken.y_ground[1].copy()
    assert one.update(np.full(6, np.nan)) is Status.REJECTED
    for bad in (math.nan, math.inf, -math.inf):
        um[2] = bad
        before = one.state
        one.predict(broken.u_m[0], LAT, ALT, 0.01)
        assert one.predict(um, LAT, ALT, 0.01) is Status.REJECTED
        assert not np.array_equal(one.state, before), "the last good input stands in"
        y[5] = bad
        assert one.update(y) is Status.PARTIAL
        assert np.isfinite(one.state).all()
        assert np.isfinite(one.fault_cov).all()
        assert one.innovation[5] == 0.0


def test_without_a_state_it_waits_for_both_blocks(broken: ImuExperiment) -> None:
    one = TwoStageFilter(Settings())
    y = broken.y_ground[1]
    assert one.predict(broken.u_m[0], LAT, ALT, 0.01) is Status.WAITING
    assert one.update(np.where(np.arange(6) < 3, y, np.nan)) is Status.WAITING
    assert one.predict(broken.u_m[1], LAT, ALT, 0.01) is Status.WAITING
    assert one.update(np.where(np.arange(6) < 3, np.nan, y)) is Status.OK
    assert np.array_equal(one.state, y)
    # the velocity is 10 ms old: it may be 0.3 m/s off
    assert one.state_cov[0, 0] == pytest.approx(0.3**2 + 0.01**2)
    assert one.state_cov[4, 4] == pytest.approx(math.radians(0.01) ** 2)


def test_a_gap_is_not_bridged_and_faults_survive_it(broken: ImuExperiment) -> None:
    t, (meas_t, y) = times_us(broken), measurements(broken, 5, 20)
    keep = (t < 20_000_000) | (t > 21_500_000)
    kept = (meas_t < 20_000_000) | (meas_t > 21_500_000)
    one = DelayedFilter(TwoStageFilter(Settings()), delay_s=0.2)
    used, track = one.feed(t[keep], broken.u_m[keep], meas_t[kept], y[kept], LAT, ALT)
    after = used > 21_500_000
    assert track["status"][after][0] == Status.WAITING
    back = used[after][np.argmax(track["status"][after] <= Status.PARTIAL)]
    assert back - 21_500_000 <= 250_000
    # a bias of 1 m/s^2 stays known within 0.1 through the gap and the restart
    assert np.abs(track["f"][after, 0] - 1.0).max() < 0.1


def test_late_rows_are_counted_and_the_buffer_is_bounded(healthy: ImuExperiment) -> None:
    t, y = times_us(healthy), healthy.y_ground
    one = DelayedFilter(TwoStageFilter(Settings(), healthy.x_ground[0]), delay_s=0.1, capacity=50)
    one.feed(t[:200], healthy.u_m[:200], t[10:200], y[10:200], LAT, ALT)
    before = one.filter.fault
    _, track = one.feed(t[:0], healthy.u_m[:0], t[100:101], y[100:101] + 5.0, LAT, ALT)
    assert one.late == 1
    assert track["status"].tolist() == [Status.LATE]
    assert np.array_equal(one.filter.fault, before)
    one.feed(t[:0], healthy.u_m[:0], t[200:400], y[200:400], LAT, ALT)
    assert len(one._meas_t) == 50
    assert one.dropped == 200 + 10 - 50
