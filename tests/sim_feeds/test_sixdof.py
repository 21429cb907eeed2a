"""The Aerosonde in JSBSim: a possible flight, the table's aircraft, faults as computed by hand."""

import sys
from dataclasses import fields
from importlib.resources import files

import numpy as np
import pytest

from links.airframes import load_airframe
from sim_feeds.sixdof import (
    FAULT_COLUMNS,
    AircraftMissing,
    Engine,
    EngineMissing,
    SixDofFlight,
    WingFault,
    consistency,
    fly_aerosonde,
)
from sim_feeds.sixdof.aerosonde import CRUISE_M_S, HEIGHT_M, STEP_S, WAYPOINTS_M

pytest.importorskip("jsbsim", reason="the extra sim is not installed")

KG, S, B, C = 11.0, 0.55, 2.8956, 0.18994
J = np.array([[0.8244, 0.0, -0.1204], [0.0, 1.135, 0.0], [-0.1204, 0.0, 1.759]])


@pytest.fixture(scope="module")
def windy() -> SixDofFlight:
    """A minute at every step of the integration, with all four faults of the paper."""
    faults = [
        WingFault("right.lift", 20.0, 10.0),
        WingFault("left.lift", 30.0, 5.0),
        WingFault("right.drag", 20.0, 2.0, 0.2),
        WingFault("left.drag", 40.0, 15.0),
    ]
    return fly_aerosonde(faults, seed=3, wind_share=0.25, duration_s=60.0, record_s=STEP_S)


@pytest.fixture(scope="module")
def circuit() -> SixDofFlight:
    """The paper's five minutes, healthy."""
    return fly_aerosonde(seed=1, wind_share=0.22)


def test_forces_and_rates_give_velocity_and_attitude(windy):
    """Issue's bound: 2e-3 m/s^2 rms over one second; gyros, over one second, 1e-4 rad/s."""
    found = consistency(windy)
    assert found.velocity_m_s2.max() < 2e-3
    assert found.attitude_rad_s.max() < 1e-4


def test_a_wrong_force_or_rate_is_noticed(windy):
    """The check can fail: 0.1 % of gravity, and 0.02 degrees per second, are seen."""
    columns = {f.name: getattr(windy, f.name) for f in fields(windy)}
    force = windy.specific_force_m_s2 * [1.0, 1.0, 1.001]
    assert (
        consistency(SixDofFlight(**columns | {"specific_force_m_s2": force})).velocity_m_s2.max()
        > 2e-3
    )
    rate = windy.rate_rad_s + np.radians(0.02)
    assert consistency(SixDofFlight(**columns | {"rate_rad_s": rate})).attitude_rad_s.max() > 1e-4


def by_hand(f: SixDofFlight) -> tuple[np.ndarray, np.ndarray]:
    """Specific force and angular acceleration from the note's table, at every row."""
    V, a, beta, de = f.tas_m_s, f.aoa_rad, f.ssa_rad, f.elevator_rad
    da, dr = f.aileron_rad, f.rudder_rad
    p, q, r = (f.rate_rad_s - f.air_rate_rad_s).T
    qS = 0.5 * f.density_kg_m3 * V**2 * S
    CL = 0.23 + 5.61 * a + 7.95 * q * C / (2 * V) + 0.13 * de
    CD = 0.043 + (0.23 + 5.61 * a) ** 2 / (np.pi * 0.9 * B**2 / S) + 0.0135 * de
    right_lift, right_drag, left_lift, left_drag = (f.fault_percent / 100.0).T
    lift = 0.5 * qS * CL * np.array([1.0 - right_lift, 1.0 - left_lift])
    drag = 0.5 * qS * CD * np.array([1.0 + right_drag, 1.0 + left_drag])
    X = lift * np.sin(a) - drag * np.cos(a)
    Z = -lift * np.cos(a) - drag * np.sin(a)
    n, D = f.prop_rad_s / (2 * np.pi), 0.508
    advance = V / (n * D)
    disc = f.density_kg_m3 * n**2 * D**4
    thrust = disc * (0.09357 - 0.06044 * advance - 0.1079 * advance**2)
    torque = disc * D * (0.00523 + 0.00497 * advance - 0.01664 * advance**2)
    Y = qS * (-0.98 * beta + 0.075 * da + 0.19 * dr)
    force = np.stack([X.sum(0) + thrust, Y, Z.sum(0)], axis=1) / KG
    ph, rh, qh = p * B / (2 * V), r * B / (2 * V), q * C / (2 * V)
    arm = B / 4
    roll = qS * B * (-0.13 * beta - 0.51 * ph + 0.25 * rh + 0.17 * da + 0.0024 * dr)
    roll += arm * (Z[0] - Z[1]) - torque
    pitch = qS * C * (0.0135 - 2.74 * a - 38.21 * qh - 0.99 * de)
    yaw = qS * B * (0.073 * beta - 0.069 * ph - 0.095 * rh - 0.011 * da - 0.069 * dr)
    yaw -= arm * (X[0] - X[1])
    w = f.rate_rad_s
    moment = np.stack([roll, pitch, yaw], axis=1) - np.cross(w, w @ J.T)
    return force, np.linalg.solve(J, moment.T).T


def test_the_aircraft_is_the_tables(windy):
    """Forces and moments of the note's table, faults included, against what JSBSim flew."""
    force, acceleration = by_hand(windy)
    np.testing.assert_allclose(windy.specific_force_m_s2, force, atol=1e-4)
    flown = np.gradient(windy.rate_rad_s, STEP_S, axis=0)
    # A central difference of 10 ms against gusts that act within it: compare 0.1 s means.
    miss = (flown - acceleration)[1:-1]
    mean = np.cumsum(miss, axis=0)
    mean = (mean[20:] - mean[:-20]) / 20.0
    spread = acceleration.std(axis=0)
    assert (mean.std(axis=0) < 0.01 * spread).all(), (mean.std(axis=0), spread)
    assert (np.abs(mean.mean(axis=0)) < 2e-3).all()


@pytest.mark.parametrize(
    ("which", "sign_of_roll", "sign_of_yaw"),
    [("right.lift", 1, 1), ("left.lift", -1, -1), ("right.drag", -1, 1), ("left.drag", 1, -1)],
)
def test_a_fault_gives_the_moment_of_its_wing(which, sign_of_roll, sign_of_yaw):
    """At one instant, with and without 10 %: force times b/4, in newtons by hand."""

    def one_step(percent: float) -> dict[str, float]:
        engine = Engine("aerosonde", dt_s=STEP_S)
        engine.start(
            lat_rad=0.8,
            lon_rad=0.1,
            height_m=200.0,
            euler_rad=(0.0, 0.08, 0.3),
            vel_ned_m_s=25.0 * np.array([np.cos(0.3), np.sin(0.3), 0.0]),
            wind_ned_m_s=np.zeros(3),
        )
        engine.set({f"fault/{which.replace('.', '-')}-percent": percent})
        engine.step()
        names = ["aero/alpha-rad", "aero/qbar-psf"]
        names += [f"forces/fb{a}-total-lbs" for a in "xyz"]
        names += [f"moments/{a}-total-lbsft" for a in "lmn"]
        return {name: engine.fdm[name] for name in names}

    well, hurt = one_step(0.0), one_step(10.0)
    a = well["aero/alpha-rad"]
    qS = well["aero/qbar-psf"] * 47.880259 * S
    CL, CD = 0.23 + 5.61 * a, 0.043 + (0.23 + 5.61 * a) ** 2 / (np.pi * 0.9 * B**2 / S)
    change = 0.1 * 0.5 * qS * (CL if which.endswith("lift") else CD)
    if which.endswith("lift"):
        x, z = -change * np.sin(a), change * np.cos(a)
    else:
        x, z = -change * np.cos(a), -change * np.sin(a)
    y = B / 4 if which.startswith("right") else -B / 4
    newton, newton_m = 4.4482216, 1.3558179

    def difference(name: str, unit: float) -> float:
        return (hurt[name] - well[name]) * unit

    # A step of the servos and rates of 1e-3 rad/s are in both runs alike.
    assert difference("forces/fbx-total-lbs", newton) == pytest.approx(x, rel=2e-3)
    assert difference("forces/fbz-total-lbs", newton) == pytest.approx(z, rel=2e-3)
    assert difference("moments/l-total-lbsft", newton_m) == pytest.approx(y * z, rel=2e-3)
    assert difference("moments/n-total-lbsft", newton_m) == pytest.approx(-y * x, rel=2e-3)
    assert abs(difference("moments/m-total-lbsft", newton_m)) < 1e-6
    assert np.sign([y * z, -y * x]).tolist() == [sign_of_roll, sign_of_yaw]


def test_the_ailerons_carry_a_lost_lift():
    """Calm air: the trim change balances b/4 of the lost lift, sideslip and rudder counted."""
    loss = 10.0
    well = fly_aerosonde(seed=1, wind_share=0.0, turbulence=0.0, duration_s=20.0)
    hurt = fly_aerosonde(
        [WingFault("right.lift", 0.0, loss)],
        seed=1,
        wind_share=0.0,
        turbulence=0.0,
        duration_s=20.0,
    )
    straight = (well.t_s > 12.0) & (well.t_s < 20.0)

    def mean(name: str) -> float:
        return float((getattr(hurt, name) - getattr(well, name))[straight].mean())

    qS = 0.5 * hurt.density_kg_m3 * hurt.tas_m_s**2 * S
    CL = 0.23 + 5.61 * hurt.aoa_rad + 0.13 * hurt.elevator_rad
    moment = float((B / 4 * loss / 100.0 * 0.5 * qS * CL)[straight].mean())
    restoring = 0.17 * mean("aileron_rad") - 0.13 * mean("ssa_rad") + 0.0024 * mean("rudder_rad")
    assert restoring * float(qS[straight].mean()) * B == pytest.approx(-moment, rel=0.02)


def test_waypoints_height_and_airspeed_are_held(circuit):
    assert np.abs(circuit.height_m - HEIGHT_M).max() < 8.0
    assert np.abs(circuit.tas_m_s - CRUISE_M_S).max() < 3.0
    assert np.abs(circuit.tas_m_s.mean() - CRUISE_M_S) < 0.1
    assert np.degrees(np.abs(circuit.euler_rad[:, 0]).max()) < 40.0
    for north, east in WAYPOINTS_M[1:]:
        miss = np.hypot(circuit.ned_m[:, 0] - north, circuit.ned_m[:, 1] - east)
        assert miss.min() < 60.0
    corners = np.array([*WAYPOINTS_M, WAYPOINTS_M[0]])
    start, leg = corners[:-1], np.diff(corners, axis=0)
    along = leg / np.linalg.norm(leg, axis=1)[:, None]
    offset = circuit.ned_m[:, None, :2] - start
    ahead = np.clip(np.sum(offset * along, axis=2), 0.0, np.linalg.norm(leg, axis=1))
    beside = np.linalg.norm(offset - ahead[:, :, None] * along, axis=2).min(axis=1)
    assert np.quantile(beside, 0.95) < 40.0
    assert np.hypot(*(circuit.ned_m[-1] - circuit.ned_m[0])[:2]) < 1000.0


@pytest.mark.parametrize("wind_toward_deg", [30.0, 210.0])
def test_it_comes_round_in_any_wind(wind_toward_deg):
    f = fly_aerosonde(seed=2, wind_share=0.25, wind_toward_deg=wind_toward_deg)
    gone = np.hypot(f.ned_m[:, 0], f.ned_m[:, 1])
    assert gone.max() > 2500.0
    assert gone[f.t_s > 200.0].min() < 600.0
    assert np.abs(f.height_m - HEIGHT_M).max() < 10.0
    np.testing.assert_allclose(np.linalg.norm(f.mean_wind_ned_m_s), 0.25 * CRUISE_M_S)
    np.testing.assert_allclose(f.wind_ned_m_s.mean(axis=0), f.mean_wind_ned_m_s, atol=1.0)


def test_heavy_damage_is_flown():
    """30 % of one wing's lift and twice the drag of the other: the autopilot holds on."""
    f = fly_aerosonde(
        [WingFault("right.lift", 20.0, 30.0), WingFault("left.drag", 40.0, 100.0)],
        seed=4,
        wind_share=0.25,
        duration_s=100.0,
    )
    assert np.abs(f.height_m - HEIGHT_M).max() < 25.0
    assert np.degrees(np.abs(f.euler_rad[:, 0]).max()) < 60.0


def test_faults_are_what_was_asked():
    f = fly_aerosonde(
        [
            WingFault("right.lift", 5.0, 10.0),
            WingFault("left.drag", 6.0, 3.0, 0.5),
            WingFault("left.drag", 10.0, 4.0),
        ],
        seed=1,
        wind_share=0.2,
        duration_s=20.0,
    )
    assert FAULT_COLUMNS == ("right.lift", "right.drag", "left.lift", "left.drag")
    t = f.t_s
    np.testing.assert_allclose(f.fault_percent[:, 0], np.where(t >= 5.0 - 1e-9, 10.0, 0.0))
    ramp = np.where(t >= 6.0 - 1e-9, 3.0 + 0.5 * (t - 6.0), 0.0) + 4.0 * (t >= 10.0 - 1e-9)
    np.testing.assert_allclose(f.fault_percent[:, 3], ramp, atol=1e-9)
    assert not f.fault_percent[:, 1:3].any()


def same(a: SixDofFlight, b: SixDofFlight, rows: slice = slice(None)) -> bool:
    return all(
        np.array_equal(getattr(a, f.name)[rows], getattr(b, f.name)[rows]) for f in fields(a)
    )


def test_the_same_seed_gives_the_same_bits():
    one, again = (fly_aerosonde(seed=7, wind_share=0.2, duration_s=20.0) for _ in range(2))
    other = fly_aerosonde(seed=8, wind_share=0.2, duration_s=20.0)
    hurt = fly_aerosonde(
        [WingFault("left.lift", 10.0, 8.0)], seed=7, wind_share=0.2, duration_s=20.0
    )
    assert same(one, again)
    assert not np.array_equal(one.wind_ned_m_s, other.wind_ned_m_s)
    before = slice(0, 200)  # 10 s: the flights part at the fault, not before
    assert all(
        np.array_equal(getattr(one, f.name)[before], getattr(hurt, f.name)[before])
        for f in fields(one)
        if f.name != "mean_wind_ned_m_s"
    )
    assert not np.array_equal(one.euler_rad, hurt.euler_rad)


def test_rows_are_samples_of_the_finest_grid():
    coarse = fly_aerosonde(seed=5, wind_share=0.2, duration_s=5.0)
    fine = fly_aerosonde(seed=5, wind_share=0.2, duration_s=5.0, record_s=STEP_S)
    assert len(coarse.t_s) == 101
    np.testing.assert_array_equal(coarse.euler_rad, fine.euler_rad[::10])
    np.testing.assert_allclose(np.diff(coarse.t_s), 0.05)
    assert coarse.t_s[0] == 0.0


@pytest.mark.parametrize("record_s", [0.0, 0.003, 0.0125])
def test_a_grid_between_the_steps_is_refused(record_s):
    with pytest.raises(ValueError, match="multiple"):
        fly_aerosonde(seed=1, wind_share=0.2, duration_s=1.0, record_s=record_s)


def test_without_jsbsim_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    with pytest.raises(EngineMissing, match=r"pip install 'mavsentry\[sim\]'") as told:
        fly_aerosonde(seed=1, wind_share=0.2)
    assert "\n" not in str(told.value)
    assert told.value.__cause__ is None
    assert told.value.__suppress_context__


def test_an_aircraft_nobody_has():
    with pytest.raises(AircraftMissing, match="aerosonde"):
        Engine("no-such-aircraft", dt_s=STEP_S)


def test_the_aircraft_file_is_package_data():
    """Files below a package are in the wheel; the file must be found there without a checkout."""
    xml = files("sim_feeds.sixdof") / "aircraft" / "aerosonde" / "aerosonde.xml"
    assert "fault/right-lift-percent" in xml.read_text(encoding="utf-8")


def full_travel_deg():
    """Where the servos of all three surfaces end when they are told to go all the way."""
    fdm = Engine("aerosonde", dt_s=STEP_S).fdm
    fdm.run_ic()
    surfaces = ("elevator", "aileron", "rudder")
    for name in surfaces:
        fdm[f"fcs/{name}-cmd-norm"] = 1.0
    for _ in range(round(0.6 / STEP_S)):
        fdm.run()
    ends = np.degrees([fdm[f"fcs/{name}-pos-rad"] for name in surfaces])
    assert np.ptp(ends) == 0.0
    return ends[0]


def test_the_aircraft_file_and_the_airframe_table_agree():
    """Two files on purpose, two models: JSBSim's aircraft and the table that estimators read."""
    numbers = load_airframe("aerosonde")
    fdm = Engine("aerosonde", dt_s=STEP_S).fdm
    fdm.run_ic()  # inertias are known from here on
    feet, kg_m2 = 0.3048, 1.3558179
    own = {
        "mass_kg": fdm["inertia/mass-slugs"] * 14.593903,
        "Jx_kg_m2": fdm["inertia/ixx-slugs_ft2"] * kg_m2,
        "Jy_kg_m2": fdm["inertia/iyy-slugs_ft2"] * kg_m2,
        "Jz_kg_m2": fdm["inertia/izz-slugs_ft2"] * kg_m2,
        "Jxz_kg_m2": -fdm["inertia/ixz-slugs_ft2"] * kg_m2,  # element of the matrix
        "area_m2": fdm["metrics/Sw-sqft"] * feet**2,
        "span_m": fdm["metrics/bw-ft"] * feet,
        "chord_m": fdm["metrics/cbarw-ft"] * feet,
        "stall_M": fdm["aero/coefficient/stall-M"],
        "stall_alpha_rad": fdm["aero/coefficient/stall-alpha0"],
        "diameter_m": fdm["propeller/diameter-m"],
        "travel_us": 400.0,  # of the servo outputs that the feed sends
        "travel_deg": full_travel_deg(),
    }
    for key in numbers.keys() - own.keys():
        where = "propeller" if key.startswith(("CT", "CQ")) else "aero/coefficient"
        assert fdm[f"{where}/{key}"] != 0.0, key
        own[key] = fdm[f"{where}/{key}"]
    for key, value in numbers.items():
        assert own[key] == pytest.approx(value, rel=2e-4), key


def test_jsbsim_prints_nothing(capfd):
    fly_aerosonde(seed=1, wind_share=0.2, duration_s=0.1)
    Engine("c172p", dt_s=STEP_S)
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")
