"""Profiles, rotations, atmosphere, linear responses: closed forms."""

import numpy as np
import pytest

from sim_feeds import earth
from sim_feeds.gusts import linear_response
from sim_feeds.profile import Profile
from sim_feeds.rotation import (
    axis_matrix,
    chain,
    euler_from_matrix,
    matrix_from_euler,
    matrix_from_quaternion,
    quaternion_from_matrix,
)

T = np.linspace(-1.0, 9.0, 20001)


def a_profile() -> Profile:
    p = Profile(2.0)
    p.step(1.0, 2.0, 3.0)
    p.trapezoid(4.0, 8.0, 1.0, -2.0)
    return p


def test_profile_values():
    p = a_profile()
    assert p(np.array([0.0]))[0] == 2.0
    assert p(np.array([3.5]))[0] == pytest.approx(5.0, abs=1e-12)
    assert p(np.array([9.0]))[0] == pytest.approx(5.0 - 2.0 * 3.0, abs=1e-12)


@pytest.mark.parametrize(("order", "tol"), [(1, 1e-5), (2, 1e-4), (3, 0.03)])
def test_profile_derivatives_are_continuous_and_right(order, tol):
    p = a_profile()
    slope = np.gradient(p(T, order - 1), T)[2:-2]
    assert np.abs(slope - p(T, order)[2:-2]).max() < tol
    if order < 3:
        assert np.abs(np.diff(p(T, order))).max() < 0.02


def test_chain_gives_the_rate_of_its_matrix():
    """dC/dt = C [w x], against finite differences."""
    t = np.linspace(0.0, 4.0, 4001)
    turns = [
        (2, np.sin(t), np.cos(t)),
        (1, 0.3 * t**2, 0.6 * t),
        (0, np.cos(2 * t), -2 * np.sin(2 * t)),
    ]
    C, w = chain(turns)
    rate = np.einsum("nji,njk->nik", C, np.gradient(C, t, axis=0))
    found = np.stack([rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], axis=1)
    np.testing.assert_allclose(found[2:-2], w[2:-2], atol=3e-5)


def test_euler_and_quaternion_round_trips():
    angles = np.random.default_rng(0).uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (200, 3))
    C = matrix_from_euler(*angles.T)
    np.testing.assert_allclose(euler_from_matrix(C), angles, atol=1e-12)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion_from_matrix(C)), C, atol=1e-12)


def test_quaternion_is_continuous_through_two_turns():
    angle = np.linspace(0.0, 4.0 * np.pi, 500)
    q = quaternion_from_matrix(axis_matrix(2, angle))
    assert np.abs(np.diff(q, axis=0)).max() < 0.02
    np.testing.assert_allclose(q[:, 0], np.cos(angle / 2.0), atol=1e-12)


def test_axis_matrix_turns_the_frame():
    """Yawed 90 degrees right, the nose points east; pitched up, it points up."""
    np.testing.assert_allclose(axis_matrix(2, np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(axis_matrix(1, np.pi / 2) @ [1, 0, 0], [0, 0, -1], atol=1e-15)


@pytest.mark.parametrize(
    ("height", "pressure", "kelvin"),
    [(0.0, 101325.0, 288.15), (1000.0, 89874.6, 281.65), (5000.0, 54019.9, 255.65)],
)
def test_standard_atmosphere(height, pressure, kelvin):
    """Against the printed ICAO table."""
    assert float(earth.static_pressure(height)) == pytest.approx(pressure, rel=1e-5)
    assert float(earth.temperature(height)) == pytest.approx(kelvin)


def test_calibrated_airspeed():
    cas = np.array([0.0, 15.0, 80.0, 180.0])
    np.testing.assert_allclose(
        earth.calibrated_airspeed(earth.impact_pressure_of_cas(cas)), cas, atol=1e-7
    )
    at_sea_level = earth.impact_pressure(100.0, 101325.0, 288.15)
    assert float(earth.calibrated_airspeed(at_sea_level)) == pytest.approx(100.0, abs=1e-9)
    slow = float(earth.impact_pressure(15.0, 101325.0, 288.15))
    assert slow == pytest.approx(0.5 * 1.225 * 15.0**2, rel=1e-3)
    # 250 kt CAS at 5000 m is about 319 kt TAS by the compressible formula.
    kt = 0.514444
    impact = earth.impact_pressure(
        319.0 * kt, earth.static_pressure(5000.0), earth.temperature(5000.0)
    )
    assert float(earth.calibrated_airspeed(impact)) / kt == pytest.approx(250.0, abs=1.0)


def test_gravity_of_the_paper():
    assert float(earth.gravity(0.0, 0.0)) == pytest.approx(9.780318)
    assert float(earth.gravity(np.pi / 2, 0.0)) == pytest.approx(9.832177, abs=1e-5)


def test_linear_response_to_a_ramp_is_exact():
    """First-order lag driven by u = t: x = t - tau + tau exp(-t / tau)."""
    t = np.arange(0.0, 5.0, 0.1)
    x, dx = linear_response(np.array([[-2.0]]), np.array([[2.0]]), t[:, None], 0.1, np.zeros(1))
    expected = t - 0.5 + 0.5 * np.exp(-2.0 * t)
    np.testing.assert_allclose(x[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(dx[:, 0], 1.0 - np.exp(-2.0 * t), atol=1e-12)
