"""What surrounds the air-data filters: reading streams at a GPS sample's time, noise levels."""

import numpy as np
import pytest

from estimators import air_data_3d_noise as noise
from estimators import air_data_3d_rows as rows
from estimators.attitude import ned_from_frd, quaternion_from_euler

LEVELS = noise.NoiseLevels(
    gust_tau_s=10.0,
    gust_prior_m_s=1.5,
    gust_min_m_s=0.3,
    gust_max_m_s=6.0,
    sideslip_rad=0.06,
    timing_s=0.08,
    pitot_common=0.01,
    pitot_own=0.006,
)


def filled(count: int, hz: float) -> rows.Rings:
    """Memories of an aircraft that rolls, turns and speeds up steadily; more samples than fit."""
    rings = rows.new_rings()
    for k in range(count):
        t = k / hz
        row = rows.push(rings.attitude, rings.pushed, 0)
        sign = 1.0 if k % 3 else -1.0  # q and -q are the same attitude
        row[0], row[1:] = t, sign * quaternion_from_euler(0.02 * t, 0.1, 0.1 * t)
        row = rows.push(rings.nav, rings.pushed, 1)
        row[0], row[1:] = t, (10.0 + t, 2.0 * t, -t)
        row = rows.push(rings.pitot[1], rings.pushed, 3)
        row[0], row[1] = t, 15.0 + t
    return rings


@pytest.mark.parametrize("t", [29.003, 29.5, 29.97])
def test_axes_and_velocity_are_interpolated_between_the_samples_around(t: float) -> None:
    rings = filled(300, 10.0)
    E = np.empty((3, 3))
    assert not rows.axes_at(rings, 29.95, E)  # the newest sample is at 29.9 s
    if t < 29.9:
        assert rows.axes_at(rings, t, E)
        np.testing.assert_allclose(E, ned_from_frd(0.02 * t, 0.1, 0.1 * t).T, atol=1e-5)
    v = np.empty(3)
    assert rows.nav_at(rings, t, v)
    held = min(t, 29.9)
    np.testing.assert_allclose(v, (10.0 + held, 2.0 * held, -held), rtol=1e-12)


def test_times_before_the_memory_or_after_a_gap_are_refused() -> None:
    rings = filled(300, 10.0)
    E, v = np.empty((3, 3)), np.empty(3)
    assert not rows.axes_at(rings, 1.0, E)
    assert not rows.nav_at(rings, 40.0, v)
    row = rows.push(rings.attitude, rings.pushed, 0)
    row[0], row[1:] = 35.0, (1.0, 0.0, 0.0, 0.0)
    assert not rows.axes_at(rings, 33.0, E)


def test_pitot_is_the_mean_nearby_else_the_nearest_else_nothing() -> None:
    rings = filled(200, 10.0)
    assert rows.mean_pitot(rings, 1, 15.05) == pytest.approx(15.0 + 15.05)
    assert rows.mean_pitot(rings, 1, 20.3) == pytest.approx(15.0 + 19.9)
    assert np.isnan(rows.mean_pitot(rings, 1, 25.0))
    assert np.isnan(rows.mean_pitot(rings, 0, 15.0))


def test_gust_level_and_pitot_noise_are_those_of_white_noise() -> None:
    rng = np.random.default_rng(0)
    state = noise.new_noise(LEVELS)
    x, e = np.zeros(10), np.empty(3)
    V, e_y = np.array([20.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    slip_std, common_std, own_std = 0.8, 0.03, 0.01
    gust, R_common, R_own = [], [], []
    for _ in range(4000):
        gusty = V + np.array([0.0, slip_std * rng.standard_normal(), 0.0])
        common = common_std * rng.standard_normal()
        y = np.log(np.hypot(20.0, gusty[1])) + common + own_std * rng.standard_normal(3)
        noise.adapt(state, LEVELS, 0.2, x, x, gusty, e_y, y, 0b011, 0.0, e)
        gust.append(state[noise.GUST_STD])
        R_common.append(state[noise.R_COMMON])
        R_own.append(state[noise.R_OWN])
    # gusts rise faster than they fall: the level stands above the rms of white noise
    whole = slip_std * np.sqrt(1.0 + LEVELS.gust_tau_s / noise.SLIP_MEAN_TAU_S)
    assert whole < np.mean(gust[1000:]) < 1.7 * whole
    # min of two levels: a little below the true variances
    want = LEVELS.pitot_common**2 + common_std**2 + own_std**2
    assert 0.7 * want < np.mean(R_common[1000:]) < 1.1 * want
    want = LEVELS.pitot_own**2 + own_std**2
    assert 0.8 * want < np.mean(R_own[1000:]) < 1.2 * want


def test_one_noisy_pitot_does_not_raise_the_common_noise() -> None:
    rng = np.random.default_rng(1)
    state = noise.new_noise(LEVELS)
    x, e = np.zeros(10), np.empty(3)
    V, e_y = np.array([20.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    for _ in range(1000):
        y = np.log(20.0) + np.array([0.2, 0.004, 0.0]) * rng.standard_normal(3)
        noise.adapt(state, LEVELS, 0.2, x, x, V, e_y, y, 0b011, 0.0, e)
    assert np.sqrt(state[noise.R_COMMON]) < 0.02


def reference(gps_noise: float, nav_noise: float, apart: float) -> np.ndarray:
    rng = np.random.default_rng(2)
    state = noise.new_noise(LEVELS)
    for k in range(300):
        flight = np.array([20.0 * np.cos(0.02 * k), 20.0 * np.sin(0.02 * k), 0.0])
        V = flight + gps_noise * rng.standard_normal(3)
        v_nav = flight + nav_noise * rng.standard_normal(3) + np.array([apart, 0.0, 0.0])
        noise.reference_noise(state, 0.2, V, v_nav, True)
    return state


def test_gps_noise_is_what_the_autopilot_does_not_show() -> None:
    state = reference(1.5, 0.05, 0.0)
    # the variance of both horizontal axes together
    assert state[noise.GPS_STD] == pytest.approx(1.5 * np.sqrt(2.0), rel=0.5)
    assert reference(0.5, 0.8, 0.0)[noise.GPS_STD] < 0.4
    assert reference(0.1, 0.05, 2.0)[noise.APART] == pytest.approx(2.0, abs=0.2)
    assert state[noise.ACC] < 30.0
