"""The aircraft that answers: exact kinematics, closed forms of its loops, equal draws."""

from dataclasses import replace
from math import cos, degrees, radians

import numpy as np
import pytest

from estimators.kinematics import GS, earth_terms, rates
from sim_feeds import earth
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.closed_loop import (
    ClosedFlight,
    Moment,
    Order,
    Steering,
    Task,
    fly_closed,
    on_sensors,
    on_truth,
)
from sim_feeds.closed_loop_autopilot import BANK_PER_S, CLIMB_PER_S
from sim_feeds.closed_loop_vehicle import G0, Controls, Vehicle
from sim_feeds.faults import Fault, FaultKind, lu2016_table2
from sim_feeds.wind import Constant, Dryden, Wind, toward

TURN = Task(
    orders=[Order(2.0, climb_m_s=4.0), Order(6.0, bank_rad=radians(20.0))],
    duration_s=14.0,
    heading_rad=radians(33.0),
)
CALM = (0.0, 0.0, 0.0)
ROUGH = Wind([Constant(toward(8.0, 60.0)), Dryden(fixed_std_m_s=2.0, fixed_scale_m=530.0)])


@pytest.fixture(scope="module")
def rough() -> ClosedFlight:
    return fly_closed(replace(TURN, wind=ROUGH), on_truth, seed=4)


def level(seconds: float = 60.0) -> Task:
    return Task(duration_s=seconds, rate_hz=50.0)


def test_a_trimmed_aircraft_stays_where_it_is() -> None:
    flight = fly_closed(level(20.0), on_truth)
    assert np.ptp(flight.flow[:, 0]) < 0.01
    assert abs(flight.env[-1, 1] - 1000.0) < 0.5
    assert np.abs(np.degrees(flight.x_ground[:, 3])).max() < 0.01
    lift = -flight.u[0, 2] * cos(flight.flow[0, 1]) + flight.u[0, 0] * np.sin(flight.flow[0, 1])
    assert lift == pytest.approx(G0, rel=1e-3)


@pytest.mark.parametrize("name", sorted(AIRFRAMES))
def test_every_airframe_flies_its_orders(name: str) -> None:
    airframe = AIRFRAMES[name]
    task = replace(TURN, airframe=airframe, speed_m_s=airframe.cruise_m_s, duration_s=45.0)
    flight = fly_closed(task, on_truth)
    assert flight.lost_s is None
    assert degrees(flight.x_ground[-1, 3]) == pytest.approx(20.0, abs=1.0)
    assert flight.flow[-1, 0] == pytest.approx(airframe.cruise_m_s, rel=0.05)
    assert abs(degrees(flight.flow[-1, 2])) < 1.0


def test_the_motion_satisfies_the_kinematics_of_the_paper(rough: ClosedFlight) -> None:
    """Specific force, rates, velocity and attitude against (11), written elsewhere."""
    slopes = np.empty_like(rough.x_ground)
    for k, (lat, height) in enumerate(rough.env):
        place = earth_terms(lat, height)
        rates(GS, rough.x_ground[k].copy(), rough.u[k].copy(), place, slopes[k])
    dt = rough.t_s[1]
    moved = np.diff(rough.x_ground, axis=0)
    trapezoid = 0.5 * dt * (slopes[1:] + slopes[:-1])
    drift = np.abs(np.cumsum(moved - trapezoid, axis=0)).max(axis=0)
    assert (drift[:3] < 5e-3).all()
    assert (drift[3:] < 5e-5).all()


def test_the_air_triangle_closes(rough: ClosedFlight) -> None:
    u, v, w = rough.x_air[:, :3].T
    V, alpha, beta = rough.flow.T
    np.testing.assert_allclose(np.sqrt(u * u + v * v + w * w), V, rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(w, u), alpha, atol=1e-12)
    np.testing.assert_allclose(V * np.sin(beta), v, atol=1e-9)
    relative = np.linalg.norm(rough.x_ground[:, :3] - rough.wind_ned_m_s, axis=1)
    np.testing.assert_allclose(relative, V, rtol=1e-12)


def test_a_steady_turn_is_coordinated() -> None:
    flight = fly_closed(replace(TURN, duration_s=25.0), on_truth)
    late = flight.t_s > 20.0
    turn_rate = np.gradient(np.unwrap(flight.x_ground[:, 5]), flight.t_s)[late].mean()
    V, bank = flight.flow[late, 0].mean(), flight.x_ground[late, 3].mean()
    assert turn_rate == pytest.approx(G0 * np.tan(bank) / V, rel=0.03)
    load = -flight.u[late, 2].mean() / G0
    assert load == pytest.approx(1.0 / cos(bank), rel=0.02)


@pytest.mark.parametrize(
    ("control", "column", "sign"),
    [("aileron_rad_s", 9, 1), ("elevator_rad", 10, 1), ("rudder_rad", 11, -1)],
)
def test_controls_turn_the_right_way(control: str, column: int, sign: int) -> None:
    vehicle = Vehicle.trimmed(AIRFRAMES["transport"], 100.0, 1000.0, 0.0)
    command = vehicle.controls()._replace(**{control: getattr(vehicle.controls(), control) + 0.05})
    for _ in range(30):
        vehicle.step(Controls(*command), (CALM,) * 3, 0.01)
    motion = vehicle.motion(CALM, CALM)
    rate = (*motion.x, *motion.u)[column]
    assert np.sign(rate) == sign
    assert abs(rate) > 0.005


def test_true_values_fed_back_do_not_see_the_faults() -> None:
    healthy = fly_closed(TURN, on_truth, seed=2)
    faulty = fly_closed(TURN, on_truth, faults=lu2016_table2(), seed=2)
    assert np.array_equal(healthy.x_ground, faulty.x_ground)
    np.testing.assert_allclose(faulty.u_m - healthy.u_m, faulty.f, atol=1e-12)


def test_flights_part_at_the_onset_and_not_before() -> None:
    healthy = fly_closed(TURN, on_sensors, seed=2)
    faulty = fly_closed(TURN, on_sensors, faults=lu2016_table2(), seed=2)
    before = healthy.t_s < 9.995
    assert np.array_equal(healthy.x_ground[before], faulty.x_ground[before])
    assert np.abs(healthy.x_ground[-1] - faulty.x_ground[-1]).max() > 0.1


def test_the_same_seed_gives_the_same_bits_and_another_others() -> None:
    task = replace(TURN, wind=ROUGH, duration_s=3.0)
    one, same, other = (fly_closed(task, on_sensors, seed=s) for s in (5, 5, 6))
    assert np.array_equal(one.u_m, same.u_m)
    assert not np.array_equal(one.x_ground, other.x_ground)


def steered_on(axis: str, size: float) -> ClosedFlight:
    fault = Fault(f"imu0.{axis}", FaultKind.BIAS, 5.0, size=size)
    return fly_closed(level(), on_sensors, faults=[fault], seed=1)


def test_a_false_roll_rate_ends_in_a_false_bank() -> None:
    """The PI loop holds measured p at K (0 - phi); at rest that is the bias: phi = -bias / K."""
    flight = steered_on("gyro_x", radians(1.0))
    assert degrees(flight.x_ground[-500:, 3].mean()) == pytest.approx(-1.0 / BANK_PER_S, rel=0.05)


def test_a_false_load_factor_ends_in_a_false_climb() -> None:
    """-A_z - f = g n_c and at rest -A_z = g: the ordered climb is missed by f / K."""
    flight = steered_on("acc_z", 0.3)
    climb = -flight.x_ground[-500:, 2].mean()
    assert climb == pytest.approx(0.3 / CLIMB_PER_S, rel=0.05)


def test_a_false_side_force_ends_in_a_sideslip_that_hides_it() -> None:
    flight = steered_on("acc_y", 0.3)
    assert flight.u[-500:, 1].mean() == pytest.approx(-0.3, rel=0.05)
    assert flight.flow[-500:, 2].mean() > 0.0


def test_a_false_acceleration_slows_the_aircraft_for_a_while() -> None:
    flight = steered_on("acc_x", 3.0)
    assert flight.flow[:, 0].min() < 97.0
    assert flight.flow[-1, 0] > flight.flow[:, 0].min() + 1.0


def test_only_faults_that_add_to_an_axis_of_the_imu() -> None:
    stuck = Fault("imu0.acc_x", FaultKind.STUCK, 1.0)
    with pytest.raises(ValueError, match="depends on the reading"):
        fly_closed(level(2.0), on_truth, faults=[stuck])
    with pytest.raises(ValueError, match="no axis of imu0"):
        fly_closed(level(2.0), on_truth, faults=[replace(stuck, sensor="baro0")])


def test_lost_control_is_said_and_the_rest_stands_still() -> None:
    def upside_down(moment: Moment) -> Steering:
        seen = on_truth(moment)
        return seen._replace(x=[*seen.x[:3], -3.0, *seen.x[4:]])

    flight = fly_closed(level(), upside_down)
    assert flight.lost_s is not None
    after = flight.t_s >= flight.lost_s
    assert np.ptp(flight.x_ground[after], axis=0).max() == 0.0


def test_gravity_and_density_are_those_of_the_earth() -> None:
    vehicle = Vehicle.trimmed(AIRFRAMES["transport"], 120.0, 0.0, 0.0)
    sigma = float(earth.density(3000.0) / earth.density(0.0))
    high = Vehicle.trimmed(AIRFRAMES["transport"], 120.0 / sigma**0.5, 3000.0, 0.0)
    low_alpha, high_alpha = (v.motion(CALM, CALM).flow[1] for v in (vehicle, high))
    assert low_alpha == pytest.approx(high_alpha, rel=5e-3)
