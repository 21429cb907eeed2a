"""The kinematic models against an independent implementation, and against rotations themselves."""

from pathlib import Path

import numpy as np
import pytest

from estimators import kinematics as km
from estimators.atmosphere import EARTH_RATE_RAD_S
from estimators.attitude import ned_from_frd, skew
from estimators.baselines import numpy_twins_imu as twins

TOLERANCE = 1e-10  # both sides are closed forms in float64; the Jacobians are complex-step


@pytest.fixture(scope="module")
def points(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    oracle: Path = request.getfixturevalue("oracle")
    with np.load(oracle / "kinematic_models.npz") as data:
        return dict(data)


@pytest.mark.parametrize(("model", "states", "name"), [(km.GS, "X", "gs"), (km.AS, "XA", "as")])
def test_rates_jacobian_and_distribution_matrix(
    points: dict[str, np.ndarray], model: int, states: str, name: str
) -> None:
    dx, F, G = np.empty(6), np.empty((6, 6)), np.empty((6, 6))
    for i, (x, um, fault, env) in enumerate(
        zip(points[states], points["U"], points["F"], points["env"], strict=True)
    ):
        earth = km.earth_terms(*env)
        km.rates(model, x, um - fault, earth, dx)
        km.linearise(model, x, um - fault, earth, F, G)
        assert np.abs(dx - points[f"{name}_f"][i]).max() < TOLERANCE
        assert np.abs(F - points[f"{name}_F"][i]).max() < TOLERANCE
        assert np.abs(G - points[f"{name}_G"][i]).max() < TOLERANCE


def test_airspeed_outputs_and_their_jacobian(points: dict[str, np.ndarray]) -> None:
    y, H, back = np.empty(6), np.empty((6, 6)), np.empty(6)
    for i, x in enumerate(points["XA"]):
        km.output(km.AS, x, y)
        km.output_jacobian(km.AS, x, H)
        km.state_from_output(km.AS, y, back)
        assert np.abs(y - points["as_h"][i]).max() < TOLERANCE
        assert np.abs(H - points["as_H"][i]).max() < TOLERANCE
        assert np.abs(back - x).max() < TOLERANCE


def test_kernels_and_numpy_twins_agree(points: dict[str, np.ndarray]) -> None:
    dx, y = np.empty(6), np.empty(6)
    F, G, H = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for model, states in ((km.GS, "X"), (km.AS, "XA")):
        for x, um, fault, env in zip(
            points[states], points["U"], points["F"], points["env"], strict=True
        ):
            earth, u = km.earth_terms(*env), um - fault
            assert np.allclose(earth, twins.earth_terms(*env), rtol=1e-15)
            km.rates(model, x, u, earth, dx)
            km.linearise(model, x, u, earth, F, G)
            km.output(model, x, y)
            km.output_jacobian(model, x, H)
            assert np.abs(dx - twins.rates(model, x, u, earth)).max() < 1e-13
            for ours, theirs in zip((F, G), twins.linearise(model, x, u, earth), strict=True):
                assert np.abs(ours - theirs).max() < 1e-13
            assert np.abs(y - twins.output(model, x)).max() < 1e-13
            assert np.abs(H - twins.output_jacobian(model, x)).max() < 1e-15


def test_ground_speed_outputs_are_the_state(points: dict[str, np.ndarray]) -> None:
    y, H = np.empty(6), np.empty((6, 6))
    km.output(km.GS, points["X"][0], y)
    km.output_jacobian(km.GS, points["X"][0], H)
    assert np.array_equal(y, points["X"][0])
    assert np.array_equal(H, np.eye(6))


def test_the_angles_turn_as_a_rotation_over_the_turning_earth_does() -> None:
    """The pointwise check of the corrected sign in the last row of lu2016 (11).

    The rotation matrix obeys ``R' = R skew(w_body) - skew(w_level) R``; its derivative through the
    Euler angles' rates must be the same. With the printed sign it misses by 2e-5 rad/s here.
    """
    lat, alt = 0.9, 3000.0
    x = np.array([80.0, -120.0, 5.0, 0.3, 0.5, 0.7])
    u = np.array([1.0, 2.0, -9.0, 0.05, -0.04, 0.03])
    earth = km.earth_terms(lat, alt)
    dx = np.empty(6)
    km.rates(km.GS, x, u, earth, dx)

    radius = earth[1]
    w_level = np.array(
        [
            x[1] / radius + EARTH_RATE_RAD_S * np.cos(lat),
            -x[0] / radius,
            -x[1] * np.tan(lat) / radius - EARTH_RATE_RAD_S * np.sin(lat),
        ]
    )
    R = ned_from_frd(*x[km.ANGLES])
    by_rotation = R @ skew(u[km.GYRO]) - skew(w_level) @ R
    step = 1e-6
    ahead, behind = x[km.ANGLES] + step * dx[km.ANGLES], x[km.ANGLES] - step * dx[km.ANGLES]
    by_angles = (ned_from_frd(*ahead) - ned_from_frd(*behind)) / (2 * step)
    assert np.abs(by_angles - by_rotation).max() < 1e-9


def test_a_vehicle_at_rest_on_the_earth_stays_at_rest() -> None:
    lat, alt = 0.8, 0.0
    earth = km.earth_terms(lat, alt)
    R = ned_from_frd(0.1, -0.2, 2.0)
    w_earth = EARTH_RATE_RAD_S * np.array([np.cos(lat), 0, -np.sin(lat)])
    u = np.concatenate([R.T @ [0, 0, -earth[0]], R.T @ w_earth])
    dx = np.empty(6)
    km.rates(km.GS, np.array([0, 0, 0, 0.1, -0.2, 2.0]), u, earth, dx)
    assert np.abs(dx).max() < 1e-14
