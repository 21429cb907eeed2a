"""Rotation kernels against closed forms, the matrix exponential, and each other."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators import attitude as at

angle = st.floats(-3.1, 3.1)
pitch = st.floats(-1.5, 1.5)


def elementary(axis: int, a: float) -> np.ndarray:
    """Active rotation about one axis, written out."""
    R = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i] = R[j, j] = math.cos(a)
    R[j, i], R[i, j] = math.sin(a), -math.sin(a)
    return R


def test_a_climbing_nose_points_up_and_a_right_wing_low_points_down() -> None:
    nose, right_wing = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    assert at.ned_from_frd(0.0, 0.3, 0.0) @ nose == pytest.approx(
        [math.cos(0.3), 0, -math.sin(0.3)]
    )
    assert at.ned_from_frd(0.3, 0.0, 0.0) @ right_wing == pytest.approx(
        [0, math.cos(0.3), math.sin(0.3)]
    )
    assert at.ned_from_frd(0.0, 0.0, math.pi / 2) @ nose == pytest.approx([0, 1, 0], abs=1e-15)


@settings(max_examples=50, deadline=None)
@given(angle, pitch, angle)
def test_every_form_of_an_attitude_is_the_same_rotation(
    phi: float, theta: float, psi: float
) -> None:
    R = elementary(2, psi) @ elementary(1, theta) @ elementary(0, phi)
    q = at.quaternion_from_euler(phi, theta, psi)
    assert np.allclose(at.ned_from_frd(phi, theta, psi), R, atol=1e-15)
    assert np.allclose(at.dcm_from_quaternion(q), R, atol=4e-15)
    assert np.allclose(at.euler_from_quaternion(q), (phi, theta, psi), atol=1e-13)
    assert np.allclose(at.euler_from_dcm(R), (phi, theta, psi), atol=1e-13)
    back = at.quaternion_from_dcm(R)
    assert back[0] >= 0
    assert np.allclose(back, q * np.sign(q[0] + 1e-300), atol=1e-14)
    assert np.allclose(
        at.dcm_from_rotation_vector(at.rotation_vector_from_quaternion(q)), R, atol=4e-15
    )


@settings(max_examples=50, deadline=None)
@given(st.tuples(angle, pitch, angle), st.tuples(angle, pitch, angle))
def test_products_compose_from_right_to_left(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> None:
    p, q = at.quaternion_from_euler(*a), at.quaternion_from_euler(*b)
    product = at.dcm_from_quaternion(at.quaternion_product(p, q))
    assert np.allclose(product, at.ned_from_frd(*a) @ at.ned_from_frd(*b), atol=1e-14)
    identity = at.quaternion_product(q, at.quaternion_conjugate(q))
    assert np.allclose(identity, [1, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 1.9e-4, 2.1e-4, 0.3, 3.0])
def test_rotation_vectors_are_the_exponential_of_the_skew_matrix(size: float) -> None:
    r = size * np.array([0.6, -0.48, 0.64])
    series, term = np.eye(3), np.eye(3)
    for n in range(1, 40):
        term = term @ at.skew(r) / n
        series = series + term
    assert np.allclose(at.dcm_from_rotation_vector(r), series, rtol=0, atol=1e-14)
    back = at.rotation_vector_from_quaternion(at.quaternion_from_rotation_vector(r))
    assert np.allclose(back, r, rtol=4e-16 * 10, atol=0)
    assert np.allclose(
        at.rotation_vector_from_quaternion(-at.quaternion_from_rotation_vector(r)), back
    )


def test_body_rates_turn_the_matrix_on_its_right_side() -> None:
    omega, dt = np.array([0.2, -0.1, 0.3]), 1e-6
    R = at.ned_from_frd(0.1, 0.2, 0.3)
    moved = R @ at.dcm_from_rotation_vector(omega * dt)
    assert np.allclose((moved - R) / dt, R @ at.skew(omega), atol=1e-6)


def test_at_the_poles_roll_is_zero_and_the_matrix_survives() -> None:
    for theta in (math.pi / 2, -math.pi / 2):
        R = at.ned_from_frd(0.4, theta, 1.0)
        phi, pole, psi = at.euler_from_dcm(R)
        assert phi == 0.0
        assert pole == pytest.approx(theta)
        assert np.allclose(at.ned_from_frd(phi, pole, psi), R, atol=1e-12)


def test_wrap_keeps_what_lies_inside_and_folds_the_rest() -> None:
    assert at.wrap(math.pi) == math.pi
    assert at.wrap(-math.pi) == math.pi
    assert at.wrap(1e-300) == 1e-300
    assert at.wrap(0.1 - 6 * math.pi) == pytest.approx(0.1)
    rows = at.wrap(np.linspace(-20, 20, 1001))
    assert np.all(rows > -math.pi)
    assert np.all(rows <= math.pi)
    assert np.allclose(np.exp(1j * rows), np.exp(1j * np.linspace(-20, 20, 1001)))


def test_rows_of_unnormalised_quaternions_and_a_zero_one() -> None:
    rows = np.array([[2.0, 0, 0, 0], 3 * at.quaternion_from_euler(0.1, 0.2, 0.3), [0, 0, 0, 0]])
    out = at.euler_rows_from_quaternion_rows(rows)
    assert np.allclose(out[:2], [[0, 0, 0], [0.1, 0.2, 0.3]])
    assert np.isnan(out[2]).all()
