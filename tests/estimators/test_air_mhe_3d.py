"""The three-dimensional horizon: Jacobians, agreement with a Kalman filter, bounds."""

import math

import numpy as np
import pytest

from estimators.air_mhe_3d import (
    M3,
    N3,
    WIND,
    WindLimits,
    air_outputs,
    new_horizon,
    shift,
    solve,
    start,
)
from estimators.atmosphere import cas_from_tas

AIR = np.array([84_000.0, 279.0])
LIMITS = WindLimits(
    walk_m_s=0.5, walk_down_m_s=0.4, down_tau_s=10.0, velocity_walk_m_s=0.3, offset_walk_rad=1e-4,
    bound_m_s=60.0, bound_down_m_s=10.0, gps_std_m_s=0.15, cas_std_m_s=0.5,
    aoa_std_rad=math.radians(0.4), sideslip_std_rad=math.radians(4.0),
    offset_std_rad=math.radians(1.0), n_kappa=2, n_qp=2,
)  # fmt: skip
FREE = np.zeros(3), np.full(3, np.inf)


def _frd_from_ned(roll, pitch, yaw):
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cp * cy, cp * sy, -sp],
            [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
            [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
        ]
    )


def _outputs(x, R_bn):
    h, C = np.empty(M3), np.empty((M3, N3))
    assert air_outputs(x, R_bn, AIR, h, C)
    return h, C


def test_outputs_by_hand_and_jacobian_by_differences():
    R_bn = _frd_from_ned(0.5, 0.1, 2.0)
    v_a = np.array([90.0, 3.0, 8.0])
    wind = np.array([10.0, -6.0, 1.0])
    x = np.array([*(R_bn.T @ v_a + wind), *wind, 0.01])
    h, C = _outputs(x, R_bn)
    speed = np.linalg.norm(v_a)
    expected = [cas_from_tas(speed, *AIR), math.atan2(8, 90) + 0.01, math.asin(3 / speed)]
    np.testing.assert_allclose(h, [*x[:3], *expected], rtol=1e-12)
    for a in range(N3):
        d = np.zeros(N3)
        d[a] = 1e-5
        difference = (_outputs(x + d, R_bn)[0] - _outputs(x - d, R_bn)[0]) / 2e-5
        np.testing.assert_allclose(C[:, a], difference, rtol=1e-3, atol=1e-6)


def _fly(horizon, seconds, wind, seed=0, bounded=True, centre=FREE, cas_error=0.0):
    """A steady 25-degree-bank turn at 90 m/s; GPS at 5 Hz, air data at 10 Hz."""
    rng = np.random.default_rng(seed)
    speed, bank, alpha, dt = 90.0, math.radians(25), math.radians(4), 0.1
    rate = 9.81 * math.tan(bank) / speed
    gamma, heading = 0.0, 0.0
    history = []
    for k in range(int(seconds / dt)):
        pitch = alpha * math.cos(bank) + gamma
        R_bn = _frd_from_ned(bank, pitch, heading)
        v_a = np.array([speed * math.cos(alpha), 0.0, speed * math.sin(alpha)])
        V = R_bn.T @ v_a + wind
        if k == 0:
            start(horizon, LIMITS, V, R_bn, AIR)
            before = V
        shift(horizon, LIMITS, dt, V - before, R_bn, AIR, False, 0.1)
        before = V
        clean = _outputs(np.array([*V, *wind, 0.0]), R_bn)[0]
        horizon.y[-1] = clean + rng.normal(size=M3) * np.sqrt(horizon.R)
        horizon.y[-1, 5] = 0.0
        horizon.y[-1, 3] += cas_error
        horizon.use[-1] = 1.0
        horizon.use[-1, :3] = k % 2 == 0
        assert solve(horizon, LIMITS, *centre, bounded) == 0
        history.append(horizon.x[-1].copy())
        heading += rate * dt
    return np.array(history)


def test_wind_is_found_in_a_turn():
    wind = np.array([12.0, -7.0, 0.0])
    history = _fly(new_horizon(3), 80.0, wind)
    np.testing.assert_allclose(history[-100:, WIND].mean(axis=0), wind, atol=0.5)


@pytest.mark.parametrize("N", [2, 3, 6])
def test_without_bounds_the_length_of_the_horizon_changes_little(N):
    """The arrival is the filter's own, so that no sample counts twice."""
    wind = np.array([12.0, -7.0, 0.5])
    reference = _fly(new_horizon(2), 30.0, wind, bounded=False)
    other = _fly(new_horizon(N), 30.0, wind, bounded=False)
    assert np.abs(other - reference)[50:].max() < 0.05


def test_the_wind_stays_in_its_band():
    centre = np.array([12.0, -7.0, 0.0]), np.array([3.0, 3.0, 2.0])
    history = _fly(
        new_horizon(3), 30.0, np.array([12.0, -7.0, 0.0]), centre=centre, cas_error=-30.0
    )
    assert (np.abs(history[:, WIND] - centre[0]) < centre[1]).all()
    assert np.abs(history[-1, 3:5] - centre[0][:2]).max() > 2.0
