"""The flights of samar2006: an Aerosonde with damaged wings, in wind, round a list of waypoints.

Source: samar2006 section IV.

Differs: the paper's AeroSim model has a piston engine that burns fuel; ours has mavsim's electric
motor and a constant mass. Its model-predictive guidance is a simple course controller here. The
paper does not print its waypoints. Gusts act at one point, as there: a wing of 3 m would average
the shortest waves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, cos, pi, sin
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from links.airframes import load_airframe
from sim_feeds.sixdof.engine import FOOT_M, SLUG_KG, Engine, Gauge, Gauges
from sim_feeds.sixdof.flight import FAULT_COLUMNS, SixDofFlight
from sim_feeds.sixdof.loop import MOTION, Gusts, Place, eyes, fly
from sim_feeds.sixdof.pilot import AEROSONDE_GAINS, Pilot
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
STEP_S: Final = 0.005
CONTROL_S: Final = 0.02
SETTLE_S: Final = 30.0
RUN_IN_M: Final = 450.0
"""Way to the first waypoint at the start: t = 0 is behind its turn in any wind."""
ORIGIN: Final = Place(lat_rad=0.82, lon_rad=0.2, height_m=HEIGHT_M)
PITCH_AT_START: Final = 0.04
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
        When it happens, from the start of the record.
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


def _property(fault: str) -> str:
    return f"fault/{fault.replace('.', '-')}-percent"


KEPT: Final = (
    *MOTION,
    Gauge("elevator", "fcs/elevator-pos-rad"),
    Gauge("aileron", "fcs/aileron-pos-rad"),
    Gauge("rudder", "fcs/rudder-pos-rad"),
    Gauge("throttle", "propeller/throttle"),
    Gauge("prop", "propeller/speed-rad_sec"),
    Gauge("air_p", "gust/p-rad_sec"),
    Gauge("air_q", "gust/q-rad_sec"),
    Gauge("air_r", "gust/r-rad_sec"),
    Gauge("density", "atmosphere/rho-slugs_ft3", SLUG_KG / FOOT_M**3),
    *(Gauge(name, _property(name)) for name in FAULT_COLUMNS),
)


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
    _start(engine, mean)
    pilot = Pilot(AEROSONDE_GAINS, WAYPOINTS_M, HEIGHT_M, CRUISE_M_S, CONTROL_S)
    look = eyes(engine, ORIGIN)
    kept = Gauges(engine, KEPT)
    rows = fly(
        engine,
        lambda: pilot.steer(look()),
        _gusts(t, speed, turbulence, rng),
        _damage(faults, t),
        kept,
        control_every=round(CONTROL_S / STEP_S),
        keep_from=settle,
        keep_every=every,
    )
    return _flight(dict(zip(kept.names, rows.T, strict=True)), t[settle::every], mean)


def _start(engine: Engine, wind: Floats) -> None:
    """On the last leg, before the first waypoint, at cruise through the air."""
    (n0, e0), (n1, e1) = WAYPOINTS_M[-1], WAYPOINTS_M[0]
    heading = atan2(e1 - e0, n1 - n0)
    ahead = np.array([cos(heading), sin(heading), 0.0])
    lat, lon = ORIGIN.geodetic(n1 - RUN_IN_M * ahead[0], e1 - RUN_IN_M * ahead[1])
    engine.start(
        lat_rad=lat,
        lon_rad=lon,
        height_m=HEIGHT_M,
        euler_rad=(0.0, PITCH_AT_START, heading),
        vel_ned_m_s=CRUISE_M_S * ahead + wind,
        wind_ned_m_s=wind,
    )


def _gusts(t: Floats, wind_m_s: float, share: float, rng: np.random.Generator) -> Gusts:
    """Turbulence of this wind at cruise, and the rotation of the air that comes with it."""
    model = VonKarman(wind_6m_m_s=wind_m_s)
    along, across, down = share * model.along_path(Route.still(t, CRUISE_M_S, HEIGHT_M), rng).T
    span_m = load_airframe("aerosonde")["span_m"]
    air = rotation_of_the_air(across, down, tas_m_s=CRUISE_M_S, span_m=span_m, dt_s=STEP_S)
    return Gusts(along, across, down, air.q, air.r)


def _damage(faults: Sequence[WingFault], t: Floats) -> dict[int, dict[str, float]]:
    """Fault properties by the step before which they change."""
    events: dict[int, dict[str, float]] = {}
    for which in FAULT_COLUMNS:
        percent = sum((f.at(t) for f in faults if f.which == which), np.zeros_like(t))
        for k in np.flatnonzero(np.diff(percent, prepend=0.0)).tolist():
            events.setdefault(k, {})[_property(which)] = float(percent[k])
    return events


def _flight(kept: Mapping[str, Floats], t: Floats, mean: Floats) -> SixDofFlight:
    def take(*names: str) -> Floats:
        return np.column_stack([kept[n] for n in names])

    force = take("force_x", "force_y", "force_z")
    return SixDofFlight(
        t_s=t,
        lat_rad=kept["lat"],
        lon_rad=kept["lon"],
        height_m=kept["height"],
        ned_m=ORIGIN.ned(kept["lat"], kept["lon"], kept["height"]),
        euler_rad=take("roll", "pitch", "yaw"),
        vel_ned_m_s=take("vel_n", "vel_e", "vel_d"),
        rate_rad_s=take("p", "q", "r"),
        specific_force_m_s2=force / kept["mass"][:, None],
        elevator_rad=kept["elevator"],
        aileron_rad=kept["aileron"],
        rudder_rad=kept["rudder"],
        throttle=kept["throttle"],
        prop_rad_s=kept["prop"],
        wind_ned_m_s=take("wind_n", "wind_e", "wind_d"),
        mean_wind_ned_m_s=mean,
        air_rate_rad_s=take("air_p", "air_q", "air_r"),
        tas_m_s=kept["tas"],
        aoa_rad=kept["aoa"],
        ssa_rad=kept["ssa"],
        density_kg_m3=kept["density"],
        fault_percent=take(*FAULT_COLUMNS),
    )
