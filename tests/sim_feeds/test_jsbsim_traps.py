"""What JSBSim does that one would not expect, and that our engine is safe from it.

Each test first shows the trap with JSBSim alone, then our way round it: should a later version of
JSBSim close one, the test says so.
"""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from sim_feeds import earth
from sim_feeds.sixdof import consistency, engine, fly_aerosonde
from sim_feeds.sixdof.engine import FOOT_M, Engine, bundled_aircraft

jsbsim = pytest.importorskip("jsbsim", reason="the extra sim is not installed")


DT_S = 0.005
VEL = np.array([18.0, 14.0, -1.0])


def raw() -> "jsbsim.FGFDMExec":
    """JSBSim with our aircraft and nothing else of ours."""
    jsbsim.FGJSBBase().debug_lvl = 0
    fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    fdm.set_debug_level(0)
    root = jsbsim.get_default_root_dir()
    assert fdm.load_model_with_paths(
        "aerosonde", str(bundled_aircraft()), f"{root}/engine", f"{root}/systems"
    )
    fdm.set_dt(DT_S)
    return fdm


def started(wind=(0.0, 0.0, 0.0), lat_rad=0.9, euler_rad=(0.1, 0.05, 0.66)) -> Engine:
    e = Engine("aerosonde", dt_s=DT_S)
    e.start(
        lat_rad=lat_rad,
        lon_rad=0.3,
        height_m=300.0,
        euler_rad=euler_rad,
        vel_ned_m_s=VEL,
        wind_ned_m_s=np.asarray(wind),
    )
    return e


def velocity(fdm) -> np.ndarray:
    return FOOT_M * np.array(
        [fdm[f"velocities/v-{axis}-fps"] for axis in ("north", "east", "down")]
    )


@pytest.mark.parametrize(
    ("speed", "later"),
    [
        ({"ic/vc-kts": 48.0}, {"ic/lat-gc-deg": 50.0}),
        ({"ic/vg-fps": 80.0}, {"ic/psi-true-deg": 40.0}),
    ],
    ids=["latitude after airspeed", "heading after ground speed"],
)
def test_what_is_set_after_the_speed_changes_it(speed, later):
    flown = []
    for order in ({**later, **speed}, {**speed, **later}):
        fdm = raw()
        for name, value in order.items():
            fdm[name] = value
        fdm.run_ic()
        flown.append(velocity(fdm))
    assert np.abs(flown[1] - flown[0]).max() > 10.0


@pytest.mark.parametrize("lat_rad", [-0.7, 0.0, 0.9])
def test_our_start_is_where_and_how_it_was_asked(lat_rad):
    fdm = started(lat_rad=lat_rad).fdm
    np.testing.assert_allclose(velocity(fdm), VEL, atol=1e-9)
    assert fdm["position/lat-geod-rad"] == pytest.approx(lat_rad, abs=1e-12)
    assert fdm["position/geod-alt-ft"] * FOOT_M == pytest.approx(300.0, abs=0.01)
    attitude = [fdm[f"attitude/{a}-rad"] for a in ("phi", "theta", "psi")]
    np.testing.assert_allclose(attitude, [0.1, 0.05, 0.66], atol=1e-12)


def test_gyros_measure_the_inertial_rate():
    """p, q, r leave out the earth's rotation: 15 degrees an hour, as much as a good gyro's bias."""
    e = started()
    for _ in range(20):
        e.step()
    surface = np.array([e.fdm[f"velocities/{a}-rad_sec"] for a in "pqr"])
    inertial = np.array([e.fdm[f"velocities/{a}i-rad_sec"] for a in "pqr"])
    spin = np.linalg.norm(inertial - surface)
    assert spin == pytest.approx(earth.EARTH_RATE_RAD_S, rel=0.05)


def test_wind_is_where_the_air_goes():
    """Wind of 6 m/s to the north behind a northbound aircraft takes 6 m/s off its airspeed."""
    vel = np.array([25.0, 0.0, 0.0])
    for wind, tas in (((6.0, 0.0, 0.0), 19.0), ((-6.0, 0.0, 0.0), 31.0)):
        e = Engine("aerosonde", dt_s=DT_S)
        e.start(
            lat_rad=0.9,
            lon_rad=0.3,
            height_m=300.0,
            euler_rad=(0.0, 0.0, 0.0),
            vel_ned_m_s=vel,
            wind_ned_m_s=np.array(wind),
        )
        e.step()
        assert e.fdm["velocities/vt-fps"] * FOOT_M == pytest.approx(tas, abs=0.1)


@dataclass(frozen=True)
class Gust:
    name: str
    seen: str
    sign: float


@pytest.mark.parametrize(
    "gust",
    [
        Gust("atmosphere/gust-down-fps", "aero/alpha-rad", -1.0),
        Gust("atmosphere/gust-east-fps", "aero/beta-rad", -1.0),
        Gust("atmosphere/gust-north-fps", "velocities/vt-fps", -1.0),
    ],
    ids=lambda g: g.name,
)
def test_gust_inputs_are_velocities_of_the_air_too(gust):
    """Northbound: sinking air lowers alpha, air to the east beta, air to the north the speed."""
    values = []
    for speed in (0.0, 1.0):
        e = Engine("aerosonde", dt_s=DT_S)
        e.start(
            lat_rad=0.9,
            lon_rad=0.3,
            height_m=300.0,
            euler_rad=(0.0, 0.05, 0.0),
            vel_ned_m_s=np.array([25.0, 0.0, 0.0]),
            wind_ned_m_s=np.zeros(3),
        )
        e.set({gust.name: speed / FOOT_M})
        e.step()
        values.append(e.fdm[gust.seen])
    assert np.sign(values[1] - values[0]) == gust.sign


def test_the_default_attitude_integrator_lags(monkeypatch):
    """Euler's: the attitude over a second is off by half a step of the change of the rates."""
    flight = {"seed": 1, "wind_share": 0.22, "duration_s": 30.0, "record_s": DT_S}
    ours = consistency(fly_aerosonde(**flight)).attitude_rad_s
    monkeypatch.setattr(engine, "INTEGRATORS", {})
    default = consistency(fly_aerosonde(**flight)).attitude_rad_s
    assert (default > 20.0 * ours).all()
    assert default.max() > 2e-4


def test_a_pilot_is_of_the_step_before():
    """Accelerations at the pilot's seat lag a step behind the forces of the same row."""
    e = started()
    e.set({"fcs/elevator-cmd-norm": -0.3})
    pilot, force = [], []
    for _ in range(40):
        e.step()
        pilot.append(e.fdm["accelerations/a-pilot-z-ft_sec2"])
        force.append(e.fdm["forces/fbz-total-lbs"] / e.fdm["inertia/mass-slugs"])
    np.testing.assert_allclose(pilot[1:], force[:-1], rtol=1e-6)
    assert np.abs(np.subtract(pilot, force)[5:]).max() > 0.01


def test_a_product_of_inertia_keeps_its_sign():
    """JSBSim takes the products of a file as negated unless told otherwise."""
    e = started()
    e.set({"fcs/aileron-cmd-norm": 0.6})
    for _ in range(30):
        e.step()
    names = [
        [f"moments/{a}-total-lbsft" for a in "lmn"],
        [f"velocities/{a}i-rad_sec" for a in "pqr"],
    ]
    moment, rate = (np.array([e.fdm[n] for n in three]) for three in names)
    J = np.array([[0.8244, 0.0, -0.1204], [0.0, 1.135, 0.0], [-0.1204, 0.0, 1.759]])
    turned = np.linalg.solve(J, 1.3558179 * moment - np.cross(rate, J @ rate))
    found = [e.fdm[f"accelerations/{a}idot-rad_sec2"] for a in "pqr"]
    np.testing.assert_allclose(found, turned, rtol=1e-3)
    assert abs(turned[2]) > 0.1


def test_aerodynamic_shorthands_are_of_the_step_before():
    """Functions outside an axis see aero/qbar-area late; the aircraft's forces must not."""
    e = started()
    probe = e.node("air/force-lbs")
    e.set({"fcs/throttle-cmd-norm": 1.0, "fcs/elevator-cmd-norm": -0.5})
    area = e.fdm["metrics/Sw-sqft"]
    for _ in range(20):
        e.step()
        now = e.fdm["aero/qbar-psf"] * area
        assert probe.get_double_value() == pytest.approx(now, rel=1e-12)


def test_air_that_turns_is_felt_as_the_opposite_rate():
    """gust/q of +0.1 rad/s moves the nose as the aircraft's own q of -0.1 would."""
    for axis, moment in zip("pqr", "lmn", strict=True):
        values = []
        for turn in (0.0, 0.1):
            e = started(euler_rad=(0.0, 0.05, 0.66))
            e.set({f"gust/{axis}-rad_sec": turn})
            e.step()
            values.append(e.fdm[f"moments/{moment}-total-lbsft"])
        # Damping derivatives are negative: a nose-up turn of the air lifts the nose.
        assert values[1] > values[0]


def sockets() -> set[str]:
    """Sockets that this process has open (Linux)."""
    found = set()
    for handle in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            found.add(str(handle.readlink()))
    return {name for name in found if name.startswith("socket:")}


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs /proc")
def test_an_aircraft_opens_no_ports(capfd):
    """JSBSim's 737 listens on two ports, its c310 reports to two, many write files."""
    text = (Path(jsbsim.get_default_root_dir()) / "aircraft" / "737" / "737.xml").read_text()
    assert "<input port=" in text
    before = sockets()
    engines = [Engine(aircraft, dt_s=DT_S) for aircraft in ("737", "c310")]
    for e in engines:
        e.start(
            lat_rad=0.9,
            lon_rad=0.3,
            height_m=2000.0,
            euler_rad=(0.0, 0.05, 0.0),
            vel_ned_m_s=np.array([90.0, 0.0, 0.0]),
            wind_ned_m_s=np.zeros(3),
        )
        for _ in range(10):
            e.step()
    assert sockets() == before
    assert capfd.readouterr().out == ""
