"""Any aircraft of JSBSim round a circuit: where it flew, what its autopilot asked, how fast its
engines turned.

The autopilot holds height and airspeed and flies a closed list of waypoints. Its gains are those
set for the Aerosonde, or learnt from nudges of the controls (:mod:`sim_feeds.sixdof.tuning`). The
flight begins and ends in the air; before its first moment the autopilot has settled. It steers on
the truth: what breaks in a sensor changes no flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.faults import Fault, FaultKind
from sim_feeds.rotation import matrix_from_euler
from sim_feeds.sixdof.aerosonde import WAYPOINTS_M
from sim_feeds.sixdof.engine import FOOT_M, Engine, Gauge, Gauges
from sim_feeds.sixdof.loop import MOTION, Gusts, Place, eyes, fly
from sim_feeds.sixdof.pilot import AEROSONDE_GAINS, Pilot
from sim_feeds.sixdof.tuning import airborne, learned_gains
from sim_feeds.trajectory import SEED_OF_WIND
from sim_feeds.von_karman import VonKarman, rotation_of_the_air
from sim_feeds.wind import Component, Dryden, Route

__all__ = ["CRUISE", "STEP_S", "Cruise", "VehicleFlight", "fly_circuit"]

Floats = NDArray[np.float64]

STEP_S: Final = 0.005
CONTROL_S: Final = 0.02
SETTLE_S: Final = 40.0
RUN_IN_S: Final = 18.0
"""From the start, before the settling, to the first waypoint in calm air."""
LOW_PRESSURE_RPM: Final = 50.0
HIGH_PRESSURE_RPM: Final = 144.6
"""Of one percent of N1 and N2: a CFM56 has 5000 and 14460 rpm at 100 %. JSBSim knows percent."""


@dataclass(frozen=True, slots=True)
class Cruise:
    """Where an aircraft flies when nothing else is asked.

    Attributes
    ----------
    tas_m_s, agl_m
        True airspeed, height above the field.
    """

    tas_m_s: float
    agl_m: float


CRUISE: Final = {
    "aerosonde": Cruise(25.0, 200.0),
    "J3Cub": Cruise(32.0, 500.0),
    "c172p": Cruise(52.0, 1000.0),
    "c310": Cruise(80.0, 1500.0),
    "OV10": Cruise(90.0, 1500.0),
    "T37": Cruise(120.0, 2000.0),
    "737": Cruise(140.0, 3000.0),
    "A320": Cruise(140.0, 3000.0),
}
"""Aircraft that hold height and airspeed here with the gains they learn."""

KEPT: Final = (
    *MOTION,
    Gauge("elevator", "fcs/elevator-cmd-norm"),
    Gauge("aileron", "fcs/aileron-cmd-norm"),
    Gauge("rudder", "fcs/rudder-cmd-norm"),
)


@dataclass(frozen=True, slots=True)
class VehicleFlight:
    """One flight, a row each step; ``n`` rows, NED earth axes, FRD body axes.

    Attributes
    ----------
    t_s : (n,)
        From 0.
    lat_rad, lon_rad, height_m : (n,)
        Geodetic, WGS84.
    euler_rad, vel_ned_m_s, rate_rad_s, specific_force_m_s2, wind_ned_m_s : (n, 3)
        As of :class:`sim_feeds.sixdof.flight.SixDofFlight`.
    tas_m_s, aoa_rad, ssa_rad : (n,)
    elevator, aileron, rudder : (n,)
        What the autopilot asks, -1 to 1; positive: nose down, right wing down, nose left.
    throttle : (n,)
        What it asks, 0 to 1.
    shaft_rpm : (n, k)
        Propellers, or N1 and N2 of each jet.
    damage_percent : (n, 4)
        Columns :data:`sim_feeds.sixdof.flight.FAULT_COLUMNS`.
    """

    t_s: Floats
    lat_rad: Floats
    lon_rad: Floats
    height_m: Floats
    euler_rad: Floats
    vel_ned_m_s: Floats
    rate_rad_s: Floats
    specific_force_m_s2: Floats
    wind_ned_m_s: Floats
    tas_m_s: Floats
    aoa_rad: Floats
    ssa_rad: Floats
    elevator: Floats
    aileron: Floats
    rudder: Floats
    throttle: Floats
    shaft_rpm: Floats
    damage_percent: Floats

    @property
    def dt_s(self) -> float:
        """Grid spacing."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def ned_from_frd(self) -> Floats:
        """(n, 3, 3)"""
        return matrix_from_euler(*self.euler_rad.T)


def circuit(tas_m_s: float) -> tuple[tuple[float, float], ...]:
    """The Aerosonde's waypoints, farther apart for a faster aircraft: north and east [m].

    Turns grow with the square of the airspeed, the way flown in five minutes with the airspeed;
    this is between them.
    """
    scale = (tas_m_s / CRUISE["aerosonde"].tas_m_s) ** 1.5
    return tuple((scale * north, scale * east) for north, east in WAYPOINTS_M)


def fly_circuit(
    aircraft: str,
    *,
    tas_m_s: float,
    height_m: float,
    duration_s: float,
    seed: int,
    lat_rad: float = 0.82,
    lon_rad: float = 0.2,
    field_m: float = 0.0,
    waypoints_m: Sequence[tuple[float, float]] = (),
    wind: Sequence[Component] = (),
    faults: Sequence[Fault] = (),
) -> VehicleFlight:
    """Fly round the waypoints.

    Parameters
    ----------
    aircraft
        "aerosonde", or the name of one that JSBSim ships.
    tas_m_s, height_m
        To hold; the height is against the ellipsoid.
    duration_s
        Recorded.
    seed
        Of the turbulence.
    lat_rad, lon_rad
        Origin of the waypoints.
    field_m
        Height of the ground, for wind that depends on it.
    waypoints_m
        North and east, closed; none: :func:`circuit`.
    wind
        Its times are the flight's. What depends on height is that of ``height_m``.
    faults
        Those of ``wing_left.lift`` and its like, in percent, and of ``engine0`` and its like; what
        breaks in a sensor does not concern the aircraft.

    Raises
    ------
    EngineMissing, AircraftMissing
        As of :class:`sim_feeds.sixdof.engine.Engine`.
    ValueError
        A control does nothing, or the aircraft cannot break like that: the message says which.
    """
    points = tuple(waypoints_m) or circuit(tas_m_s)
    settle = round(SETTLE_S / STEP_S)
    steps = settle + round(duration_s / STEP_S)
    t: Floats = np.arange(-settle, steps - settle + 1, dtype=np.float64) * STEP_S
    steady, turbulence = _air(wind, t, tas_m_s, height_m - field_m, seed)

    place = Place(lat_rad, lon_rad, height_m)
    (n0, e0), (n1, e1) = points[-1], points[0]
    heading, way = atan2(e1 - e0, n1 - n0), min(RUN_IN_S * tas_m_s, hypot(e1 - e0, n1 - n0))
    lat, lon = place.geodetic(n1 - way * cos(heading), e1 - way * sin(heading))
    engine = airborne(
        aircraft,
        tas_m_s=tas_m_s,
        height_m=height_m,
        heading_rad=heading,
        lat_rad=lat,
        lon_rad=lon,
        wind_ned_m_s=(float(steady[0, 0]), float(steady[0, 1]), float(steady[0, 2])),
        dt_s=STEP_S,
    )
    if aircraft == "aerosonde":
        gains = AEROSONDE_GAINS
    else:
        gains = learned_gains(aircraft, tas_m_s=tas_m_s, height_m=height_m)
    pilot = Pilot(gains, points, height_m, tas_m_s, CONTROL_S)
    look = eyes(engine, place)
    shafts = _shafts(engine)
    kept = Gauges(engine, [*KEPT, _throttle(engine), *shafts])
    damage = np.column_stack([_percent(faults, which, t) for which in _WINGS])
    rows = fly(
        engine,
        lambda: pilot.steer(look()),
        _gusts(engine, turbulence, tas_m_s),
        _events(engine, t, steady, damage, faults),
        kept,
        control_every=round(CONTROL_S / STEP_S),
        keep_from=settle,
        keep_every=1,
    )
    return _flight(dict(zip(kept.names, rows.T, strict=True)), t, settle, damage, len(shafts))


def _air(
    wind: Sequence[Component], t: Floats, tas_m_s: float, agl_m: float, seed: int
) -> tuple[Floats, Floats]:
    """Wind in NED axes, and turbulence in axes of the path (ahead, right, down), (n, 3) each.

    On a northbound route the two are the same; only turbulence turns with the aircraft. The streams
    are those of :meth:`sim_feeds.wind.Wind.velocity`.
    """
    route = Route.still(t, tas_m_s, agl_m)
    rng = np.random.default_rng([seed, SEED_OF_WIND])
    steady, turbulence = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    for component, child in zip(wind, rng.spawn(len(wind)), strict=True):
        into = turbulence if isinstance(component, Dryden | VonKarman) else steady
        into += component.velocity(route, child)
    return steady, turbulence


def _gusts(engine: Engine, turbulence: Floats, tas_m_s: float) -> Gusts:
    """The turbulence, and for an aircraft that feels it the rotation of the air."""
    along, across, down = turbulence.T
    still = np.zeros_like(along)
    if not (_has(engine, "gust/q-rad_sec") and turbulence.any()):
        return Gusts(along, across, down, still, still)
    air = rotation_of_the_air(
        across,
        down,
        tas_m_s=tas_m_s,
        span_m=engine.node("metrics/bw-ft").get_double_value() * FOOT_M,
        dt_s=STEP_S,
    )
    return Gusts(along, across, down, air.q, air.r)


_WINGS: Final = ("wing_right.lift", "wing_right.drag", "wing_left.lift", "wing_left.drag")
"""In the order of :data:`sim_feeds.sixdof.flight.FAULT_COLUMNS`."""


def _percent(faults: Sequence[Fault], which: str, t: Floats) -> Floats:
    out = np.zeros_like(t)
    for fault in faults:
        if fault.sensor == which:
            out = fault.disturb(t, out, 0.0)
    return out


def _events(
    engine: Engine, t: Floats, steady: Floats, damage: Floats, faults: Sequence[Fault]
) -> Mapping[int, Mapping[str, float]]:
    """Properties that change, by the step before which they do."""
    events: dict[int, dict[str, float]] = {}

    def schedule(name: str, values: Floats) -> None:
        for k in (np.flatnonzero(np.diff(values)) + 1).tolist():
            events.setdefault(k, {})[name] = float(values[k])

    for axis, column in zip(("north", "east", "down"), steady.T, strict=True):
        schedule(f"atmosphere/wind-{axis}-fps", column / FOOT_M)
    for which, column in zip(_WINGS, damage.T, strict=True):
        if not column.any():
            continue
        wing, force = which.removeprefix("wing_").split(".")
        name = f"fault/{wing}-{force}-percent"
        if not _has(engine, name):
            raise ValueError(f"the wings of {engine.aircraft} cannot be damaged: {which}")
        schedule(name, column)
    for fault in faults:
        if fault.kind is FaultKind.STOP:
            k = int(np.searchsorted(t, fault.start_s - 1e-9))
            events.setdefault(k, {}).update(_stop(engine, int(fault.sensor[len("engine") :])))
    return events


def _stop(engine: Engine, number: int) -> dict[str, float]:
    """Properties that cut an engine."""
    if number == 0 and _has(engine, "motor/R-ohm"):
        return {"motor/R-ohm": 1e6, "motor/V-max": 0.0}
    if not _has(engine, f"propulsion/engine[{number}]/thrust-lbs"):
        raise ValueError(f"{engine.aircraft} has no engine{number}")
    # Fuel of a turbine, ignition of a piston engine; the levers act on the engine chosen first.
    levers = {"propulsion/cutoff_cmd": 1.0, "propulsion/magneto_cmd": 0.0}
    chosen = {"propulsion/active_engine": float(number)}
    return chosen | {name: value for name, value in levers.items() if _has(engine, name)}


def _throttle(engine: Engine) -> Gauge:
    levers = ("fcs/throttle-cmd-norm[0]", "fcs/throttle-cmd-norm")
    return Gauge("throttle", next(name for name in levers if _has(engine, name)))


def _shafts(engine: Engine) -> list[Gauge]:
    """Speeds of all shafts [rpm], engine by engine."""
    if _has(engine, "propeller/speed-rad_sec"):
        return [Gauge("shaft0", "propeller/speed-rad_sec", 30.0 / pi)]
    parts = (
        ("propeller-rpm", 1.0),
        ("n1", LOW_PRESSURE_RPM),
        ("n2", HIGH_PRESSURE_RPM),
    )
    found: list[Gauge] = []
    number = 0
    while _has(engine, f"propulsion/engine[{number}]/thrust-lbs"):
        for part, scale in parts:
            name = f"propulsion/engine[{number}]/{part}"
            if _has(engine, name):
                found.append(Gauge(f"shaft{len(found)}", name, scale))
        number += 1
    return found


def _has(engine: Engine, name: str) -> bool:
    try:
        engine.node(name)
    except KeyError:
        return False
    return True


def _flight(
    kept: Mapping[str, Floats], t: Floats, settle: int, damage: Floats, shafts: int
) -> VehicleFlight:
    def take(*names: str) -> Floats:
        return np.column_stack([kept[n] for n in names])

    speeds = [kept[f"shaft{i}"] for i in range(shafts)]
    return VehicleFlight(
        t_s=t[settle:],
        lat_rad=kept["lat"],
        lon_rad=kept["lon"],
        height_m=kept["height"],
        euler_rad=take("roll", "pitch", "yaw"),
        vel_ned_m_s=take("vel_n", "vel_e", "vel_d"),
        rate_rad_s=take("p", "q", "r"),
        specific_force_m_s2=take("force_x", "force_y", "force_z") / kept["mass"][:, None],
        wind_ned_m_s=take("wind_n", "wind_e", "wind_d"),
        tas_m_s=kept["tas"],
        aoa_rad=kept["aoa"],
        ssa_rad=kept["ssa"],
        elevator=kept["elevator"],
        aileron=kept["aileron"],
        rudder=kept["rudder"],
        throttle=kept["throttle"],
        shaft_rpm=np.column_stack(speeds) if speeds else np.zeros((len(t) - settle, 0)),
        damage_percent=damage[settle:],
    )
