"""Any aircraft that JSBSim ships, flown by gains that nobody set."""

from math import cos, sin

import numpy as np
import pytest

from sim_feeds.sixdof.engine import FOOT_M, Gauge, Gauges
from sim_feeds.sixdof.loop import Gusts, Place, eyes, fly
from sim_feeds.sixdof.pilot import AEROSONDE_GAINS, Pilot
from sim_feeds.sixdof.tuning import airborne, learned_gains, response
from sim_feeds.von_karman import VonKarman
from sim_feeds.wind import Route

pytest.importorskip("jsbsim", reason="the extra sim is not installed")

STEP_S = 0.005
HEADING, CORNER = 0.3, 1.0
WATCHED = (
    Gauge("t", "simulation/sim-time-sec"),
    Gauge("height", "position/geod-alt-ft", FOOT_M),
    Gauge("tas", "velocities/vt-fps", FOOT_M),
    Gauge("bank", "attitude/phi-deg"),
    Gauge("north", "velocities/v-north-fps", FOOT_M),
    Gauge("east", "velocities/v-east-fps", FOOT_M),
)


def flown(aircraft: str, tas: float, height: float, seconds: float) -> dict[str, np.ndarray]:
    """Along a leg, round a corner and on, in wind of a tenth of the airspeed and turbulence."""
    gains = learned_gains(aircraft, tas_m_s=tas, height_m=height)
    engine = airborne(
        aircraft,
        tas_m_s=tas,
        height_m=height,
        heading_rad=HEADING,
        wind_ned_m_s=(0.0, 0.1 * tas, 0.0),
    )
    look = eyes(engine, Place(0.8, 0.1, height))
    leg = tas * 0.6 * seconds
    far = (leg * cos(HEADING), leg * sin(HEADING))
    farther = (far[0] + 4 * leg * cos(HEADING + CORNER), far[1] + 4 * leg * sin(HEADING + CORNER))
    pilot = Pilot(gains, [far, farther, (0.0, 0.0)], height, tas, 0.02)
    t = np.arange(0.0, seconds, STEP_S)
    rng = np.random.default_rng(4)
    gusts = VonKarman(wind_6m_m_s=4.0, high_std_m_s=0.5).along_path(
        Route.still(t, tas, height), rng
    )
    still = np.zeros_like(t)
    kept = Gauges(engine, WATCHED)
    rows = fly(
        engine,
        lambda: pilot.steer(look()),
        Gusts(*gusts.T, still, still),
        {},
        kept,
        control_every=4,
        keep_from=0,
        keep_every=20,
    )
    return dict(zip(kept.names, rows.T, strict=True))


@pytest.mark.parametrize(
    ("aircraft", "tas", "height", "seconds"),
    [
        ("aerosonde", 25.0, 200.0, 90.0),
        ("c172p", 52.0, 1000.0, 90.0),
        ("A320", 140.0, 3000.0, 120.0),
    ],
)
def test_learned_gains_hold_height_airspeed_and_course(aircraft, tas, height, seconds):
    f = flown(aircraft, tas, height, seconds)
    settled = f["t"] > 30.0
    assert np.abs(f["height"] - height)[settled].max() < 25.0
    assert np.abs(f["tas"] / tas - 1.0)[settled].max() < 0.1
    assert np.abs(f["bank"]).max() < 45.0
    course = np.arctan2(f["east"], f["north"])
    first = (f["t"] > 20.0) & (f["t"] < 0.4 * seconds)
    assert np.degrees(np.abs(course[first] - HEADING).max()) < 8.0
    assert np.degrees(course[-1] - HEADING - CORNER) == pytest.approx(0.0, abs=8.0)


def test_a_nudge_tells_sign_and_speed_of_a_control():
    at = {"tas_m_s": 25.0, "height_m": 200.0}
    roll = response("aerosonde", "aileron", "velocities/p-rad_sec", **at)
    pitch = response("aerosonde", "elevator", "velocities/q-rad_sec", **at)
    # By hand: p = -Clda / Clp 2 V / b per radian of aileron, half a radian per unit.
    assert roll.peak == pytest.approx(0.5 * 0.17 / 0.51 * 2 * 25.0 / 2.8956, rel=0.15)
    assert 0.05 < roll.rise_s < 0.15
    assert pitch.peak < 0.0  # positive elevator: nose down


def test_what_has_no_controls_is_told():
    with pytest.raises(ValueError, match="of ball does nothing at 60 m/s"):
        learned_gains("ball", tas_m_s=60.0, height_m=1000.0)


def test_an_engine_that_is_cut_leaves_a_glide():
    """The propeller windmills, height is given up for airspeed, and the wings stay level."""
    engine = airborne("aerosonde", tas_m_s=25.0, height_m=400.0)
    look = eyes(engine, Place(0.8, 0.1, 400.0))
    pilot = Pilot(AEROSONDE_GAINS, [(9000.0, 0.0), (9000.0, 900.0), (0.0, 0.0)], 400.0, 25.0, 0.02)
    still = np.zeros(round(80.0 / STEP_S))
    kept = Gauges(engine, [*WATCHED, Gauge("prop", "propeller/speed-rad_sec")])
    rows = fly(
        engine,
        lambda: pilot.steer(look()),
        Gusts(still, still, still, still, still),
        {round(30.0 / STEP_S): {"motor/R-ohm": 1e6, "motor/V-max": 0.0}},
        kept,
        control_every=4,
        keep_from=0,
        keep_every=20,
    )
    f = dict(zip(kept.names, rows.T, strict=True))
    running, gliding = (f["t"] > 25.0) & (f["t"] < 30.0), f["t"] > 50.0
    assert f["prop"][running].min() > 480.0
    assert 150.0 < f["prop"][gliding].min() < f["prop"][gliding].max() < 400.0
    assert f["tas"][gliding].min() > 18.0
    assert np.abs(f["bank"][gliding]).max() < 5.0
    sink = -np.diff(f["height"][gliding]) / np.diff(f["t"][gliding])
    # By hand: drag of aircraft and windmilling propeller over weight, 10 to 25 % of the airspeed.
    assert 0.1 * 19.0 < sink.mean() < 0.25 * 19.0
