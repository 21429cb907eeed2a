"""The longitudinal models: geometry by rotation, complex-step Jacobians, warm air."""

import math

import numpy as np
import pytest

from estimators.air_data_2d import APPROXIMATE, EXACT, air_outside, linearise
from estimators.atmosphere import cas_from_tas, pressure, temperature
from estimators.baselines import numpy_twins_air as twin

RNG = np.random.default_rng(7)


def _evaluate(model, x, u, theta, t_s=0.048, warmer_k=0.0):
    F, h = np.empty(4), np.empty(4)
    A, B, C = np.empty((3, 4, 4))
    air = np.empty(2)
    air_outside(theta[5], warmer_k, air)
    linearise(model, x, u, theta, air, t_s, F, A, B, h, C)
    return F, A, B, h, C


def _points(count=30):
    for _ in range(count):
        x = RNG.normal([0.08, 120.0, 0.0, 0.0], [0.1, 30.0, 25.0, 8.0])
        u = RNG.normal(0.0, [0.02, 0.5, 3.0, 3.0])
        theta = np.array([0.0, *RNG.normal([0.06, 0.0, 1.0, -9.8], [0.15, 0.05, 2.0, 3.0]), 3000.0])
        theta[0] = x[1] + RNG.normal(0.0, 0.2)
        yield x, u, theta


@pytest.mark.parametrize("model", [APPROXIMATE, EXACT])
def test_values_and_jacobians_equal_the_complex_step_twin(model):
    for x, u, theta in _points():
        for ours, expected in zip(
            _evaluate(model, x, u, theta), twin.linearise(model, x, u, theta, 0.048), strict=True
        ):
            np.testing.assert_allclose(ours, expected, rtol=1e-11, atol=1e-11)


def test_jacobians_equal_central_differences():
    for model in (APPROXIMATE, EXACT):
        for x, u, theta in _points(5):
            _, A, B, _, C = _evaluate(model, x, u, theta)
            for j in range(4):
                d = np.zeros(4)
                d[j] = 1e-6
                up, down = _evaluate(model, x + d, u, theta), _evaluate(model, x - d, u, theta)
                np.testing.assert_allclose((up[0] - down[0]) / 2e-6, A[:, j], atol=2e-7)
                np.testing.assert_allclose((up[3] - down[3]) / 2e-6, C[:, j], rtol=2e-6, atol=2e-6)
                up, down = _evaluate(model, x, u + d, theta), _evaluate(model, x, u - d, theta)
                np.testing.assert_allclose((up[0] - down[0]) / 2e-6, B[:, j], atol=2e-7)


def test_exact_outputs_are_the_wind_triangle():
    """Airspeed vector plus wind vector, turned into the earth frame, is the inertial velocity."""
    for _ in range(20):
        V_t, alpha, pitch = RNG.uniform(60, 220), RNG.uniform(-0.1, 0.3), RNG.uniform(-0.3, 0.3)
        W_x, W_z = RNG.uniform(-40, 40), RNG.uniform(-15, 15)
        u, w = V_t * math.cos(alpha), V_t * math.sin(alpha)
        north = u * math.cos(pitch) + w * math.sin(pitch) + W_x
        down = -u * math.sin(pitch) + w * math.cos(pitch) + W_z
        V_g = math.hypot(north, down)
        theta = np.array([V_g, pitch, 0.0, 0.0, -9.8, 2000.0])
        _, _, _, h, _ = _evaluate(EXACT, np.array([alpha, V_g, W_x, W_z]), np.zeros(4), theta)
        expected_cas = cas_from_tas(V_t, pressure(2000.0), temperature(2000.0))
        np.testing.assert_allclose(h, [V_g, down, alpha, expected_cas], rtol=1e-12, atol=1e-11)


def test_downdraft_lowers_the_aircraft():
    """The sign that (15) has the other way round: with W_z > 0 at alpha = theta it descends."""
    theta = np.array([100.0, 0.05, 0.0, 0.0, -9.8, 0.0])
    for model in (APPROXIMATE, EXACT):
        h = _evaluate(model, np.array([0.05, 100.0, 0.0, 3.0]), np.zeros(4), theta)[3]
        assert h[1] == pytest.approx(3.0, abs=1e-12)


def test_exact_motion_is_newtons_law_in_a_changing_wind():
    """The airspeed vector is integrated in the earth frame; alpha and V_g follow (8)-(10)."""
    pitch, q = 0.07, 0.02
    A_x, A_z = 1.2, -8.5
    W = np.array([12.0, -4.0])
    W_rate = np.array([2.0, -1.5])
    V_a = np.array([95.0, 2.0])  # earth frame: north, down

    def state(V_a, W, pitch):
        V = V_a + W
        angle = pitch + math.atan2(V_a[1], V_a[0])
        return np.array([angle, math.hypot(*V), *W])

    dt = 1e-5
    accel = np.array(
        [
            A_x * math.cos(pitch) + A_z * math.sin(pitch),
            -A_x * math.sin(pitch) + A_z * math.cos(pitch) + 9.80665,
        ]
    )
    before = state(V_a, W, pitch)
    after = state(V_a + (accel - W_rate) * dt, W + W_rate * dt, pitch + q * dt)
    theta = np.array([before[1], pitch, q, A_x, A_z, 0.0])
    F = _evaluate(EXACT, before, np.array([0.0, 0.0, *W_rate]), theta, t_s=dt)[0]
    np.testing.assert_allclose((F - before) / dt, (after - before) / dt, atol=2e-4)


def test_warm_air_raises_the_true_airspeed_of_a_reading():
    """+10 K is 3.4 m/s of TAS at the paper's 350 kt and 5000 ft."""
    theta = np.array([194.0, 0.05, 0.0, 0.0, -9.8, 1524.0])
    x = np.array([0.05, 194.0, 0.0, 0.0])
    cold, k = (
        _evaluate(EXACT, x, np.zeros(4), theta)[3][3],
        -_evaluate(EXACT, x, np.zeros(4), theta)[4][3, 2],
    )
    warm = _evaluate(EXACT, x, np.zeros(4), theta, warmer_k=10.0)[3][3]
    assert (cold - warm) / k == pytest.approx(3.4, abs=0.1)
