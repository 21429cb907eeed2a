"""The flights of samar2006: an Aerosonde with damaged wings, in wind, round a list of waypoints.

Source: samar2006 section IV.

Differs: the paper's AeroSim model has a piston engine that burns fuel; ours has mavsim's electric
motor and a constant mass. Its model-predictive guidance is a simple course controller here. The
paper does not print its waypoints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, pi, sin
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from sim_feeds.sixdof.engine import FOOT_M, Engine
from sim_feeds.sixdof.flight import FAULT_COLUMNS, SixDofFlight
from sim_feeds.sixdof.pilot import AEROSONDE_GAINS, Pilot, Seen
from sim_feeds.von_karman import VonKarman, rotation_of_the_air
from sim_feeds.wind import Route

__all__ = ["CRUISE_M_S", "WAYPOINTS_M", "WingFault", "fly_aerosonde"]

Floats = NDArray[np.float64]

CRUISE_M_S: Final = 25.0
HEIGHT_M: Final = 200.0
WAYPOINTS_M: Final = (
    (0.0, 0.0),
    (1000.0, 400.0),
    (1700.0, 1400.0),
    (1300.0, 2500.0),
    (200.0, 2700.0),
    (-600.0, 1900.0),
    (-500.0, 700.0),
)
"""North and east: an almost closed path of 7.8 km, five minutes in calm air, as in Fig. 3."""
SPAN_M: Final = 2.8956
STEP_S: Final = 0.005
CONTROL_S: Final = 0.02
SETTLE_S: Final = 30.0
RUN_IN_M: Final = 450.0
"""Way to the first waypoint at the start: t = 0 is behind its turn in any wind."""
START: Final = (0.82, 0.2)
"""Latitude and longitude of the first waypoint [rad]."""
PITCH_AT_START: Final = 0.04
POUND_N: Final = 4.4482216152605
SLUG_KG: Final = 14.593902937206
DENSITY: Final = SLUG_KG / FOOT_M**3
WIND_STREAM: Final = 11

Wing = Literal["right.lift", "right.drag", "left.lift", "left.drag"]


@dataclass(frozen=True, slots=True)
class WingFault:
    """Damage of a wing: a step, then growth.

    Attributes
    ----------
    which
        One of ``FAULT_COLUMNS``.
    start_s
    size_percent
        Loss of that wing's lift, or growth of its drag, at once.
    rate_percent_s
        Added from then on.
    """

    which: Wing
    start_s: float
    size_percent: float
    rate_percent_s: float = 0.0

    def at(self, t_s: Floats) -> Floats:
        """Percent at the times."""
        since = np.asarray(t_s) - self.start_s
        return np.where(since >= 0.0, self.size_percent + self.rate_percent_s * since, 0.0)


RECORDED: Final = (
    ("lat_rad", "position/lat-geod-rad", 1.0),
    ("lon_rad", "position/long-gc-rad", 1.0),
    ("height_m", "position/geod-alt-ft", FOOT_M),
    ("roll", "attitude/phi-rad", 1.0),
    ("pitch", "attitude/theta-rad", 1.0),
    ("yaw", "attitude/psi-rad", 1.0),
    ("vel_n", "velocities/v-north-fps", FOOT_M),
    ("vel_e", "velocities/v-east-fps", FOOT_M),
    ("vel_d", "velocities/v-down-fps", FOOT_M),
    ("p", "velocities/pi-rad_sec", 1.0),
    ("q", "velocities/qi-rad_sec", 1.0),
    ("r", "velocities/ri-rad_sec", 1.0),
    ("force_x", "forces/fbx-total-lbs", POUND_N),
    ("force_y", "forces/fby-total-lbs", POUND_N),
    ("force_z", "forces/fbz-total-lbs", POUND_N),
    ("mass_kg", "inertia/mass-slugs", SLUG_KG),
    ("elevator", "fcs/elevator-pos-rad", 1.0),
    ("aileron", "fcs/aileron-pos-rad", 1.0),
    ("rudder", "fcs/rudder-pos-rad", 1.0),
    ("throttle", "propeller/throttle", 1.0),
    ("prop", "propeller/speed-rad_sec", 1.0),
    ("wind_n", "atmosphere/total-wind-north-fps", FOOT_M),
    ("wind_e", "atmosphere/total-wind-east-fps", FOOT_M),
    ("wind_d", "atmosphere/total-wind-down-fps", FOOT_M),
    ("air_p", "gust/p-rad_sec", 1.0),
    ("air_q", "gust/q-rad_sec", 1.0),
    ("air_r", "gust/r-rad_sec", 1.0),
    ("tas", "velocities/vt-fps", FOOT_M),
    ("aoa", "aero/alpha-rad", 1.0),
    ("ssa", "aero/beta-rad", 1.0),
    ("density", "atmosphere/rho-slugs_ft3", DENSITY),
    *((name, f"fault/{name.replace('.', '-')}-percent", 1.0) for name in FAULT_COLUMNS),
)
"""Our name, JSBSim's property and what turns its unit into ours."""


def fly_aerosonde(
    faults: Sequence[WingFault] = (),
    *,
    seed: int,
    wind_share: float,
    duration_s: float = 300.0,
    wind_toward_deg: float | None = None,
    turbulence: float = 1.0,
    record_s: float = 0.05,
) -> SixDofFlight:
    """Fly round ``WAYPOINTS_M`` at 25 m/s and 200 m, in wind and von Karman turbulence.

    Parameters
    ----------
    faults
        Damage; several of one kind add up.
    seed
        Of the turbulence and, unless given, the direction of the wind. The same seed gives the same
        gusts whatever the faults.
    wind_share
        Steady wind as a share of the airspeed; the paper has 0.20 to 0.25. It also sets the
        turbulence.
    duration_s
        Recorded; 30 s before it let the autopilot settle.
    wind_toward_deg
        Direction the air moves toward; None draws it.
    turbulence
        Factor on the turbulence; 0 is steady wind.
    record_s
        Spacing of the rows, a multiple of the integration's 5 ms.

    Raises
    ------
    sim_feeds.sixdof.EngineMissing
        JSBSim is not installed: show the message.
    """
    every = round(record_s / STEP_S)
    if every < 1 or abs(every * STEP_S - record_s) > 1e-9:
        raise ValueError(f"record_s is a multiple of {STEP_S} s, got {record_s}")
    engine = Engine("aerosonde", dt_s=STEP_S)
    rng = np.random.default_rng([seed, WIND_STREAM])
    drawn = rng.uniform(0.0, 2.0 * pi)
    toward = drawn if wind_toward_deg is None else np.radians(wind_toward_deg)
    speed = wind_share * CRUISE_M_S
    mean = np.array([speed * cos(toward), speed * sin(toward), 0.0])

    settle = round(SETTLE_S / STEP_S)
    steps = settle + round(duration_s / record_s) * every
    t: Floats = np.arange(-settle, steps - settle + 1, dtype=np.float64) * STEP_S
    gusts = VonKarman(wind_6m_m_s=speed).along_path(Route.still(t, CRUISE_M_S, HEIGHT_M), rng)
    gusts *= turbulence
    _start(engine, mean)
    pilot = Pilot(AEROSONDE_GAINS, WAYPOINTS_M, HEIGHT_M, CRUISE_M_S, CONTROL_S)
    rows = _fly(engine, pilot, t, gusts, faults, settle, every)
    return _flight(rows, t[settle::every], mean)


def _start(engine: Engine, wind: Floats) -> None:
    """On the last leg, before the first waypoint, at cruise through the air."""
    (n0, e0), (n1, e1) = WAYPOINTS_M[-1], WAYPOINTS_M[0]
    heading = atan2(e1 - e0, n1 - n0)
    meridian, parallel = _radii(START[0])
    through_air = CRUISE_M_S * np.array([cos(heading), sin(heading), 0.0])
    engine.start(
        lat_rad=START[0] - RUN_IN_M * cos(heading) / meridian,
        lon_rad=START[1] - RUN_IN_M * sin(heading) / parallel,
        height_m=HEIGHT_M,
        euler_rad=(0.0, PITCH_AT_START, heading),
        vel_ned_m_s=through_air + wind,
        wind_ned_m_s=wind,
    )


def _radii(lat_rad: float) -> tuple[float, float]:
    """Metres per radian of latitude and of longitude at the flight's height, WGS84."""
    a, e2 = 6_378_137.0, 6.694379990141e-3
    bend = 1.0 - e2 * sin(lat_rad) ** 2
    meridian = a * (1.0 - e2) / bend**1.5 + HEIGHT_M
    return meridian, (a / bend**0.5 + HEIGHT_M) * cos(lat_rad)


def _fly(
    engine: Engine,
    pilot: Pilot,
    t: Floats,
    gusts: Floats,
    faults: Sequence[WingFault],
    settle: int,
    every: int,
) -> Floats:
    """Step through the flight; a row of ``RECORDED`` each ``every`` steps from t = 0 on."""
    damage = np.zeros((len(t), 4))
    for fault in faults:
        damage[:, FAULT_COLUMNS.index(fault.which)] += fault.at(t)
    air = rotation_of_the_air(
        gusts[:, 1], gusts[:, 2], tas_m_s=CRUISE_M_S, span_m=SPAN_M, dt_s=STEP_S
    )
    along, across, down = (gusts / FOOT_M).T.tolist()
    q_air, r_air = air.q.tolist(), air.r.tolist()
    changed = np.flatnonzero(np.any(np.diff(damage, axis=0, prepend=0.0) != 0.0, axis=1))
    hurt = dict(zip(changed.tolist(), damage[changed].tolist(), strict=True))

    recorded = [engine.node(name) for _, name, _ in RECORDED]
    seen = _eyes(engine)
    surfaces = [
        engine.node(f"fcs/{name}-cmd-norm")
        for name in ("elevator", "aileron", "rudder", "throttle")
    ]
    broken = [engine.node(f"fault/{name.replace('.', '-')}-percent") for name in FAULT_COLUMNS]
    north, east, sink = (engine.node(f"atmosphere/gust-{a}-fps") for a in ("north", "east", "down"))
    turning = [engine.node(f"gust/{a}-rad_sec") for a in "qr"]
    yaw = engine.node("attitude/psi-rad")

    control = round(CONTROL_S / STEP_S)
    rows = []
    c = s = 0.0
    for k in range(len(t)):
        if k % control == 0:
            order = pilot.steer(seen())
            for node, value in zip(
                surfaces, (order.elevator, order.aileron, order.rudder, order.throttle), strict=True
            ):
                node.set_double_value(value)
            heading = yaw.get_double_value()
            c, s = cos(heading), sin(heading)
        if k in hurt:
            for node, value in zip(broken, hurt[k], strict=True):
                node.set_double_value(value)
        north.set_double_value(c * along[k] - s * across[k])
        east.set_double_value(s * along[k] + c * across[k])
        sink.set_double_value(down[k])
        turning[0].set_double_value(q_air[k])
        turning[1].set_double_value(r_air[k])
        engine.step()
        if k >= settle and (k - settle) % every == 0:
            rows.append([node.get_double_value() for node in recorded])
    scales = np.array([scale for *_, scale in RECORDED])
    return np.asarray(np.asarray(rows) * scales)


def _eyes(engine: Engine) -> Any:
    """A function that reads what the autopilot sees."""
    meridian, parallel = _radii(START[0])
    nodes = [
        (engine.node(name), scale, zero)
        for name, scale, zero in (
            ("position/lat-geod-rad", meridian, START[0]),
            ("position/long-gc-rad", parallel, START[1]),
            ("position/geod-alt-ft", FOOT_M, 0.0),
            ("velocities/v-north-fps", FOOT_M, 0.0),
            ("velocities/v-east-fps", FOOT_M, 0.0),
            ("velocities/v-down-fps", -FOOT_M, 0.0),
            ("attitude/phi-rad", 1.0, 0.0),
            ("attitude/theta-rad", 1.0, 0.0),
            ("velocities/p-rad_sec", 1.0, 0.0),
            ("velocities/q-rad_sec", 1.0, 0.0),
            ("velocities/r-rad_sec", 1.0, 0.0),
            ("velocities/vt-fps", FOOT_M, 0.0),
        )
    ]
    return lambda: Seen(*[scale * (n.get_double_value() - zero) for n, scale, zero in nodes])


def _flight(rows: Floats, t: Floats, mean: Floats) -> SixDofFlight:
    column = {name: i for i, (name, *_) in enumerate(RECORDED)}

    def take(*names: str) -> Floats:
        return np.ascontiguousarray(rows[:, [column[n] for n in names]])

    def one(name: str) -> Floats:
        return np.ascontiguousarray(rows[:, column[name]])

    meridian, parallel = _radii(START[0])
    lat, lon, height = one("lat_rad"), one("lon_rad"), one("height_m")
    return SixDofFlight(
        t_s=t,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        ned_m=np.column_stack(
            [(lat - START[0]) * meridian, (lon - START[1]) * parallel, HEIGHT_M - height]
        ),
        euler_rad=take("roll", "pitch", "yaw"),
        vel_ned_m_s=take("vel_n", "vel_e", "vel_d"),
        rate_rad_s=take("p", "q", "r"),
        specific_force_m_s2=take("force_x", "force_y", "force_z") / one("mass_kg")[:, None],
        elevator_rad=one("elevator"),
        aileron_rad=one("aileron"),
        rudder_rad=one("rudder"),
        throttle=one("throttle"),
        prop_rad_s=one("prop"),
        wind_ned_m_s=take("wind_n", "wind_e", "wind_d"),
        mean_wind_ned_m_s=mean,
        air_rate_rad_s=take("air_p", "air_q", "air_r"),
        tas_m_s=one("tas"),
        aoa_rad=one("aoa"),
        ssa_rad=one("ssa"),
        density_kg_m3=one("density"),
        fault_percent=take(*FAULT_COLUMNS),
    )
