"""Truth is exact: an independent strapdown integration, the paper's model, and closed forms."""

from math import radians

import numpy as np
import pytest

from sim_feeds import earth
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.flightplan import FlightPlan
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Constant, Dryden, Ramp, Wind, toward

SPEEDS_M_S = {"transport": 120.0, "light-aircraft": 52.0, "small-uav": 20.0}
WEIGHTLESS_S = {"transport": 3.0, "light-aircraft": 1.5, "small-uav": 0.5}
ROUGH = Wind([Constant(toward(8.0, 60.0)), Dryden(), Ramp(60.0, 70.0, toward(5.0, 0.0, -2.0))])


def whole_flight(name: str, wind: Wind, seed: int = 3) -> Truth:
    """Every manoeuvre from the parking position to the stop after landing."""
    V = SPEEDS_M_S[name]
    plan = FlightPlan(AIRFRAMES[name], heading_rad=radians(33.0)).level(3.0).take_off()
    plan.change_speed(V).climb_at(0.07 * V, 26.0).turn(radians(100.0)).load_doublet(0.4)
    plan.turn(radians(-60.0), radians(35.0)).push_over(WEIGHTLESS_S[name])
    plan.change_speed(0.8 * V).land().level(3.0)
    return fly(plan, wind, seed=seed)


def strapdown(truth: Truth, start: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and attitude error of a fourth-order integration of specific force and rates.

    Written from rigid-body kinematics, not from the trajectory's code: the body rate against NED is
    the gyro's less earth and transport rate; gravity, Coriolis and transport terms act in NED.
    """
    step = 2.0 * truth.dt_s
    count = round(seconds / step)

    def slope(state, i):
        C, v, lat, h = state
        spin = 7.2921e-5 * np.array([np.cos(lat), 0.0, -np.sin(lat)])
        R = 6_367_000.0 + h
        carry = np.array([v[1] / R, -v[0] / R, -v[1] * np.tan(lat) / R])
        p, q, r = truth.rate_rad_s[i] - C.T @ (spin + carry)
        cross = np.array([[0.0, -r, q], [r, 0.0, -p], [-q, p, 0.0]])
        g = np.array([0.0, 0.0, float(earth.gravity(lat, h))])
        acc = C @ truth.specific_force_m_s2[i] + g - np.cross(2.0 * spin + carry, v)
        return C @ cross, acc, v[0] / R, -v[2]

    def moved(state, rate, h):
        return tuple(s + h * d for s, d in zip(state, rate, strict=True))

    state = (
        truth.ned_from_frd[start],
        truth.vel_ned_m_s[start],
        truth.lat_rad[start],
        truth.height_m[start],
    )
    for i in range(start, start + 2 * count, 2):
        k1 = slope(state, i)
        k2 = slope(moved(state, k1, step / 2), i + 1)
        k3 = slope(moved(state, k2, step / 2), i + 1)
        k4 = slope(moved(state, k3, step), i + 2)
        mean = tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        state = moved(state, mean, step)
    end = start + 2 * count
    turn = state[0].T @ truth.ned_from_frd[end]
    return state[1] - truth.vel_ned_m_s[end], np.array([turn[2, 1], turn[0, 2], turn[1, 0]])


@pytest.mark.parametrize("name", SPEEDS_M_S)
@pytest.mark.parametrize(
    ("wind", "velocity_tol", "angle_tol"),
    [(Wind(), 1e-6, 1e-7), (ROUGH, 5e-4, 1e-5)],
    ids=["calm", "rough"],
)
def test_strapdown_integration_returns_the_flight(name, wind, velocity_tol, angle_tol):
    """Over each second; in calm the rest is the integration's h^4, in turbulence its roughness."""
    truth = whole_flight(name, wind)
    starts = range(0, len(truth.t_s) - 202, 1300)
    errors = [strapdown(truth, k, 1.0) for k in starts]
    velocity, angle = (np.abs([e[i] for e in errors]).max() for i in (0, 1))
    assert velocity < velocity_tol
    assert angle < angle_tol


def test_position_is_the_integral_of_velocity():
    truth = whole_flight("light-aircraft", ROUGH)
    north = np.gradient(truth.lat_rad, truth.t_s) * (earth.EARTH_RADIUS_M + truth.height_m)
    east = np.gradient(truth.lon_rad, truth.t_s) * np.cos(truth.lat_rad)
    east *= earth.EARTH_RADIUS_M + truth.height_m
    up = np.gradient(truth.height_m, truth.t_s)
    moved = np.column_stack([north, east, -up])[5:-5]
    assert np.abs(moved - truth.vel_ned_m_s[5:-5]).max() < 1e-3


def test_rates_of_the_ground_speed_model_match(oracle):
    """The earth and rotation code here against lu2016's model as corrected, 25 points, 1e-10."""
    data = np.load(oracle / "kinematic_models.npz")
    from sim_feeds.rotation import matrix_from_euler, rotate, rotate_back

    X, lat, h = data["X"], data["env"][:, 0], data["env"][:, 1]
    u = data["U"] - data["F"]
    C = matrix_from_euler(*X[:, 3:].T)
    spin, carry = earth.earth_rate_ned(lat), earth.transport_rate_ned(lat, h, X[:, :3])
    acc = rotate(C, u[:, :3]) - np.cross(2.0 * spin + carry, X[:, :3])
    acc[:, 2] += earth.gravity(lat, h)
    np.testing.assert_allclose(acc, data["gs_f"][:, :3], rtol=0, atol=1e-10)
    p, q, r = (u[:, 3:] - rotate_back(C, spin + carry)).T
    phi, theta = X[:, 3], X[:, 4]
    turn = q * np.sin(phi) + r * np.cos(phi)
    euler = [p + turn * np.tan(theta), q * np.cos(phi) - r * np.sin(phi), turn / np.cos(theta)]
    np.testing.assert_allclose(np.stack(euler, 1), data["gs_f"][:, 3:], rtol=0, atol=1e-10)


def test_air_triangle_closes():
    """Ground velocity is air velocity plus wind, and the flow angles describe the air velocity."""
    truth = whole_flight("small-uav", ROUGH)
    V, a, b = truth.tas_m_s, truth.aoa_rad, truth.ssa_rad
    flow = np.column_stack([V * np.cos(a) * np.cos(b), V * np.sin(b), V * np.sin(a) * np.cos(b)])
    air = np.einsum("nij,nj->ni", truth.ned_from_frd, flow)
    np.testing.assert_allclose(air + truth.wind_ned_m_s, truth.vel_ned_m_s, atol=1e-9)


@pytest.mark.parametrize("bank_deg", [-40.0, -15.0, 25.0, 45.0])
def test_coordinated_turn(bank_deg):
    """Bank, rate of turn and load factor of a steady turn; no side force."""
    bank, V = radians(bank_deg), 100.0
    plan = FlightPlan(AIRFRAMES["transport"], V, 1000.0).orbit(60.0, bank)
    truth = fly(plan)
    steady = (truth.t_s > 25.0) & (truth.t_s < 35.0)
    heading = np.unwrap(np.arctan2(truth.vel_ned_m_s[:, 1], truth.vel_ned_m_s[:, 0]))
    rate = np.gradient(heading, truth.t_s)[steady]
    np.testing.assert_allclose(rate, 9.80665 * np.tan(bank) / V, rtol=1e-6)
    force = truth.specific_force_m_s2[steady]
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), 9.807 / np.cos(bank), rtol=2e-3)
    assert np.abs(force[:, 1]).max() < 0.03
    assert np.abs(truth.ssa_rad[steady]).max() < 1e-12


def test_angle_of_attack_follows_the_lift_curve():
    """In calm air it is a + k n / V_e^2: higher with load factor, higher when slow."""
    airframe = AIRFRAMES["transport"]
    plan = FlightPlan(airframe, 120.0, 500.0).level(2.0).load_doublet(0.4).change_speed(85.0)
    truth = fly(plan.level(5.0))
    a, f = truth.aoa_rad, truth.specific_force_m_s2
    load = (-f[:, 2] * np.cos(a) + f[:, 0] * np.sin(a)) / 9.80665
    equivalent2 = truth.tas_m_s**2 * earth.density(truth.height_m) / earth.density(0.0)
    expected = airframe.zero_lift_aoa_rad + airframe.lift_constant * load / equivalent2
    assert np.abs(a - expected).max() < radians(0.02)
    assert np.degrees(a.max() - a.min()) > 5.0


def test_lift_still_explains_the_load_factor_in_turbulence():
    """Gust angle of attack and acceleration belong together, to the order of the linear model."""
    airframe = AIRFRAMES["light-aircraft"]
    plan = FlightPlan(airframe, 52.0, 900.0).level(120.0)
    truth = fly(plan, Wind([Dryden(high_std_m_s=1.5)]), seed=5)
    a, f = truth.aoa_rad, truth.specific_force_m_s2
    load = (-f[:, 2] * np.cos(a) + f[:, 0] * np.sin(a)) / 9.80665
    equivalent2 = truth.tas_m_s**2 * earth.density(truth.height_m) / earth.density(0.0)
    expected = airframe.zero_lift_aoa_rad + airframe.lift_constant * load / equivalent2
    assert np.std(a) > radians(0.4)
    # The wing averages gusts over its length and the vane does not: the rest is that lag.
    assert np.std(a - expected) < 0.5 * np.std(a)


def test_push_over_is_weightless():
    plan = FlightPlan(AIRFRAMES["transport"], 120.0, 3000.0).push_over(4.0).level(5.0)
    truth = fly(plan)
    load = -truth.specific_force_m_s2[:, 2] / 9.80665
    floating = np.abs(load) < 0.08
    assert 4.0 < floating.sum() * truth.dt_s < 7.0
    assert load.max() > 1.4
    assert abs(np.degrees(np.arcsin(-truth.vel_ned_m_s[-1, 2] / 120.0))) < 1e-6


@pytest.mark.parametrize("name", SPEEDS_M_S)
def test_on_the_wheels_nothing_moves_with_the_wind(name):
    truth = whole_flight(name, ROUGH)
    parked = truth.t_s < 2.9
    assert np.abs(truth.vel_ned_m_s[parked]).max() == 0.0
    assert np.abs(truth.agl_m[parked]).max() == 0.0
    assert np.ptp(truth.euler_rad[parked], axis=0).max() < 1e-12
    np.testing.assert_allclose(
        np.linalg.norm(truth.specific_force_m_s2[parked], axis=1), 9.812, atol=0.01
    )
    assert np.abs(truth.vel_ned_m_s[-1]).max() < 1e-6
    assert abs(truth.agl_m[-1]) < 1e-6, "the landing ends on the field"


def test_crab_angle_follows_the_wind():
    """A steady crosswind drifts the aircraft; it feels no sideslip."""
    plan = FlightPlan(AIRFRAMES["small-uav"], 20.0, 100.0).level(10.0)
    truth = fly(plan, Wind([Constant(toward(6.0, 90.0))]))
    np.testing.assert_allclose(truth.vel_ned_m_s[:, 1], 6.0, atol=1e-9)
    assert np.abs(truth.ssa_rad).max() < 1e-9
    np.testing.assert_allclose(truth.tas_m_s, 20.0, atol=1e-9)


def test_steady_downdraft_is_flown_level_with_more_pitch():
    """The height hold pitches up by W_z / V; the angle of attack stays."""
    plan = FlightPlan(AIRFRAMES["transport"], 100.0, 1000.0).level(60.0)
    calm, sinking = fly(plan), fly(plan, Wind([Constant(np.array([0.0, 0.0, 5.0]))]))
    assert abs(sinking.vel_ned_m_s[-1, 2]) < 0.01
    more_pitch = sinking.euler_rad[-1, 1] - calm.euler_rad[-1, 1]
    assert more_pitch == pytest.approx(5.0 / 100.0, abs=2e-3)
    assert sinking.aoa_rad[-1] == pytest.approx(calm.aoa_rad[-1], abs=2e-3)


def test_interpolation_between_grid_points():
    plan = FlightPlan(AIRFRAMES["small-uav"], 20.0, 100.0).turn(radians(270.0)).load_doublet(0.5)
    fine, coarse = fly(plan, rate_hz=800.0), fly(plan, rate_hz=200.0)
    here = coarse.at(fine.t_s)
    inner = slice(4, -4)
    assert np.abs(here.vel_ned_m_s - fine.vel_ned_m_s)[inner].max() < 1e-6
    assert np.abs(here.specific_force_m_s2 - fine.specific_force_m_s2)[inner].max() < 1e-3
    assert np.abs(here.euler_rad - fine.euler_rad)[inner].max() < 1e-4


def test_impossible_manoeuvres_are_refused():
    plane = FlightPlan(AIRFRAMES["small-uav"], 20.0, 100.0)
    with pytest.raises(ValueError, match="already flying"):
        plane.take_off()
    with pytest.raises(ValueError, match="push-over can last"):
        plane.push_over(5.0)
    with pytest.raises(ValueError, match="at least"):
        plane.climb_at(4.0, 1.0)
    with pytest.raises(ValueError, match="too steep"):
        plane.climb_at(25.0, 30.0)
    with pytest.raises(ValueError, match="on the ground"):
        FlightPlan(AIRFRAMES["small-uav"]).land()


def test_the_same_seed_gives_the_same_flight():
    plan = FlightPlan(AIRFRAMES["transport"], 100.0, 1000.0).level(5.0)
    one, two, other = (fly(plan, ROUGH, seed=s) for s in (1, 1, 2))
    assert one.specific_force_m_s2.tobytes() == two.specific_force_m_s2.tobytes()
    assert one.specific_force_m_s2.tobytes() != other.specific_force_m_s2.tobytes()
