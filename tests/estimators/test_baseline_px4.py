"""PX4's airspeed validator and IMU selector, held to the figures of its sources."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from estimators.baselines import autopilot_events as events
from estimators.baselines import px4
from estimators.baselines.px4 import AIRSPEED_DEFAULTS, IMUS, PX4Airspeed, PX4ImuSelector
from tests.estimators.autopilot_flights import SPEED_M_S, off_by, straight

START_S = 20.0


@pytest.mark.parametrize(("error", "after_s"), [(10.0, 4.0), (-10.0, 4.0), (6.0, 12.0)])
def test_an_innovation_beyond_five_is_integrated_to_ten_metres(
    error: float, after_s: float
) -> None:
    (row,) = PX4Airspeed().step(*straight(80.0, off_by(error, START_S)))
    assert row[2] == px4.INNOVATION
    assert row[0] * 1e-6 - START_S == pytest.approx(after_s, abs=0.11)


@pytest.mark.parametrize("error", [5.0, 4.0, -5.0])
def test_five_metres_a_second_are_never_seen(error: float) -> None:
    assert len(PX4Airspeed().step(*straight(300.0, off_by(error, START_S)))) == 0


def test_an_innovation_that_dips_below_five_begins_anew() -> None:
    def shown(t: float) -> float:
        return SPEED_M_S + (10.0 if t >= START_S and t % 3.0 < 2.5 else 0.0)

    assert len(PX4Airspeed().step(*straight(120.0, shown))) == 0


def test_a_missing_and_a_constant_pitot_are_invalid_at_once() -> None:
    gone = PX4Airspeed().step(*straight(60.0, lambda t: SPEED_M_S if t < START_S else None))
    assert gone[0, 2] == px4.MISSING
    assert gone[0, 0] * 1e-6 - START_S == pytest.approx(1.0, abs=0.2)
    t, kind, value = straight(60.0, off_by(0.0, START_S))
    value[(kind == 0) & (t > START_S * 1e6), 0] = SPEED_M_S
    stuck = PX4Airspeed().step(t, kind, value)
    assert stuck[0, 2] == px4.STUCK
    assert stuck[0, 0] * 1e-6 - START_S == pytest.approx(2.1, abs=0.2)


def test_by_default_it_stays_invalid_and_a_start_delay_brings_it_back() -> None:
    events = straight(120.0, off_by(10.0, START_S, 40.0))
    assert len(PX4Airspeed().step(*events)) == 1
    again = AIRSPEED_DEFAULTS.copy()
    again[px4.START_US] = 5e6
    out = PX4Airspeed(again).step(*events)
    assert list(out[:, 2]) == [px4.INNOVATION, px4.VALID]
    assert out[1, 0] * 1e-6 - 40.0 == pytest.approx(5.0, abs=0.3)


def test_each_pitot_is_judged_for_itself() -> None:
    out = PX4Airspeed().step(*straight(80.0, off_by(10.0, START_S), pitots=2))
    assert set(out[:, 1]) == {0.0}


def test_nothing_is_judged_on_the_ground_nor_without_a_fix() -> None:
    t, kind, value = straight(80.0, off_by(10.0, START_S))
    value[0, 0] = 0.0
    assert len(PX4Airspeed().step(t, kind, value)) == 0
    blind = straight(80.0, off_by(10.0, START_S), fix=lambda t: 3.0 if t < START_S else 0.0)
    assert len(PX4Airspeed().step(*blind)) == 0


# --------------------------------------------------------------------------- IMUs


def imus(
    n: int, seconds: float = 60.0, *, acc: float = 0.0, gyro: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples of n IMUs at 200 Hz; IMU 0 is off from 20 s to 40 s."""
    count = round(200 * seconds)
    t = np.repeat(np.arange(count) * 5000, n)
    imu = np.tile(np.arange(n), count)
    sample = np.zeros((count * n, 6))
    sample[:, 5] = -9.8
    wrong = (imu == 0) & (t >= 20e6) & (t < 40e6)
    sample[wrong, 0] += gyro
    sample[wrong, 4] += acc
    return t, imu, sample


@pytest.mark.parametrize(("n", "factor"), [(2, 0.5), (3, 2.0 / 3.0)])
def test_two_off_the_mean_takes_two_seconds_and_one_is_never_seen(n: int, factor: float) -> None:
    out = PX4ImuSelector().step(*imus(n, acc=2.0 / factor))
    assert out[0, 0] * 1e-6 - 20.0 == pytest.approx(2.0, abs=0.3)
    assert out[0, 1] == px4.ACCEL
    assert out[0, 2] == (0 if n == 3 else IMUS)
    assert len(PX4ImuSelector().step(*imus(n, acc=1.0 / factor))) == 0


def test_a_gyro_is_integrated_to_fifteen_degrees_beyond_seven_a_second() -> None:
    out = PX4ImuSelector().step(*imus(3, gyro=1.5 * np.radians(12.0)))
    assert (out[0, 1], out[0, 2]) == (px4.GYRO, 0)
    assert out[0, 0] * 1e-6 - 20.0 == pytest.approx(3.0, abs=0.4)
    assert len(PX4ImuSelector().step(*imus(3, gyro=1.5 * np.radians(6.9)))) == 0


def test_one_imu_shows_nothing() -> None:
    assert len(PX4ImuSelector().step(*imus(1, acc=50.0, gyro=5.0))) == 0


def test_the_fault_is_over_when_the_integral_has_run_down() -> None:
    out = PX4ImuSelector().step(*imus(3, acc=3.0))
    assert list(out[:, 2]) == [0, -1]
    assert out[1, 0] * 1e-6 > 40.0


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_imus_that_shake_together_do_not_differ(order: tuple[int, int]) -> None:
    """At 50 Hz a sample ago is another acceleration altogether."""
    count = 50 * 30
    shaken = np.random.default_rng(1).normal(0.0, 9.0, (count, 1)) * np.array([0, 0, 0, 0, 0, 1.0])
    t_us = np.repeat(20_000 * np.arange(1, count + 1), 2)
    imu, sample = np.tile(order, count), np.repeat(shaken, 2, axis=0)
    assert len(PX4ImuSelector().step(t_us, imu, sample)) == 0
    assert len(PX4ImuSelector().step(t_us[1:], imu[1:], sample[1:])) == 0
    sample[imu == 1, 5] += 4.0
    assert len(PX4ImuSelector().step(t_us, imu, sample)) == 1


def test_any_split_of_the_stream_says_the_same() -> None:
    events = imus(3, acc=3.0)
    whole = PX4ImuSelector().step(*events)
    selector = PX4ImuSelector()
    edges = [0, 1, 7, 12_000, 12_002, 30_001, len(events[0])]
    parts = [selector.step(*(e[a:b] for e in events)) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("tas", [20.0, 120.0, 240.0])
def test_the_winds_covariance_stays_definite_at_any_speed(tas: float) -> None:
    """A fast aircraft begins with more doubt than the bound on its wind's variance allows."""
    f = events.new_wind()
    V = np.array([0.6 * tas, 0.8 * tas, 0.0])
    events.begin_along_heading(f, V, tas, np.arctan2(0.8, 0.6), 2.0, (0.3 * tas) ** 2)
    for _ in range(20):
        events.grow(f, 0.01, 0.1)
        P = np.array([[f[events.P_NN], f[events.P_NE]], [f[events.P_NE], f[events.P_EE]]])
        assert np.linalg.eigvalsh(P).min() > 0.0
        assert np.diag(P).max() <= events.VARIANCE_MAX
        nu, S, passed = events.fuse_airspeed(f, V, tas, 2.0, 0.02, 4.0, True)
        assert passed
        assert S > 0.0
        assert abs(nu) < 1.0
