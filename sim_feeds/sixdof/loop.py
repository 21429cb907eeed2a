"""The loop of a flight: the pilot steers, the air moves, things break, rows are kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import cos, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.sixdof.engine import FOOT_M, POUND_N, SLUG_KG, Engine, Gauge, Gauges
from sim_feeds.sixdof.pilot import Commands, Seen

__all__ = ["MOTION", "Gusts", "Place", "eyes", "fly"]

Floats = NDArray[np.float64]

WGS84_AXIS_M: Final = 6_378_137.0
WGS84_E2: Final = 6.694379990141e-3

MOTION: Final = (
    Gauge("lat", "position/lat-geod-rad"),
    Gauge("lon", "position/long-gc-rad"),
    Gauge("height", "position/geod-alt-ft", FOOT_M),
    Gauge("roll", "attitude/phi-rad"),
    Gauge("pitch", "attitude/theta-rad"),
    Gauge("yaw", "attitude/psi-rad"),
    Gauge("vel_n", "velocities/v-north-fps", FOOT_M),
    Gauge("vel_e", "velocities/v-east-fps", FOOT_M),
    Gauge("vel_d", "velocities/v-down-fps", FOOT_M),
    Gauge("p", "velocities/pi-rad_sec"),
    Gauge("q", "velocities/qi-rad_sec"),
    Gauge("r", "velocities/ri-rad_sec"),
    Gauge("force_x", "forces/fbx-total-lbs", POUND_N),
    Gauge("force_y", "forces/fby-total-lbs", POUND_N),
    Gauge("force_z", "forces/fbz-total-lbs", POUND_N),
    Gauge("mass", "inertia/mass-slugs", SLUG_KG),
    Gauge("wind_n", "atmosphere/total-wind-north-fps", FOOT_M),
    Gauge("wind_e", "atmosphere/total-wind-east-fps", FOOT_M),
    Gauge("wind_d", "atmosphere/total-wind-down-fps", FOOT_M),
    Gauge("tas", "velocities/vt-fps", FOOT_M),
    Gauge("aoa", "aero/alpha-rad"),
    Gauge("ssa", "aero/beta-rad"),
)
"""How any aircraft moves, and the air around it; rates are inertial."""


@dataclass(frozen=True, slots=True)
class Gusts:
    """Gusts at every step, in axes of the path.

    Attributes
    ----------
    along_m_s, across_m_s, down_m_s : (n,)
        Ahead, to the right, down; they turn with the aircraft's heading.
    pitch_rad_s, yaw_rad_s : (n,)
        Rotation of the air, for an aircraft that has the properties gust/q-rad_sec and r.
    """

    along_m_s: Floats
    across_m_s: Floats
    down_m_s: Floats
    pitch_rad_s: Floats
    yaw_rad_s: Floats


@dataclass(frozen=True, slots=True)
class Place:
    """The origin of waypoints: a small piece of the ellipsoid taken as flat."""

    lat_rad: float
    lon_rad: float
    height_m: float

    @property
    def metres_per_rad(self) -> tuple[float, float]:
        """Of latitude and of longitude."""
        bend = 1.0 - WGS84_E2 * sin(self.lat_rad) ** 2
        meridian = WGS84_AXIS_M * (1.0 - WGS84_E2) / bend**1.5 + self.height_m
        return meridian, (WGS84_AXIS_M / bend**0.5 + self.height_m) * cos(self.lat_rad)

    def geodetic(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Latitude and longitude [rad]."""
        meridian, parallel = self.metres_per_rad
        return self.lat_rad + north_m / meridian, self.lon_rad + east_m / parallel

    def ned(self, lat_rad: Floats, lon_rad: Floats, height_m: Floats) -> Floats:
        """North, east, down, (n, 3) [m]."""
        meridian, parallel = self.metres_per_rad
        north, east = (lat_rad - self.lat_rad) * meridian, (lon_rad - self.lon_rad) * parallel
        return np.column_stack([north, east, self.height_m - height_m])


def eyes(engine: Engine, origin: Place) -> Callable[[], Seen]:
    """What reads the state that a pilot steers by."""
    meridian, parallel = origin.metres_per_rad
    gauges = Gauges(
        engine,
        [
            Gauge("north_m", "position/lat-geod-rad", meridian, origin.lat_rad),
            Gauge("east_m", "position/long-gc-rad", parallel, origin.lon_rad),
            Gauge("height_m", "position/geod-alt-ft", FOOT_M),
            Gauge("vel_n_m_s", "velocities/v-north-fps", FOOT_M),
            Gauge("vel_e_m_s", "velocities/v-east-fps", FOOT_M),
            Gauge("climb_m_s", "velocities/v-down-fps", -FOOT_M),
            Gauge("roll", "attitude/phi-rad"),
            Gauge("pitch", "attitude/theta-rad"),
            Gauge("p", "velocities/p-rad_sec"),
            Gauge("q", "velocities/q-rad_sec"),
            Gauge("r", "velocities/r-rad_sec"),
            Gauge("tas_m_s", "velocities/vt-fps", FOOT_M),
        ],
    )
    return lambda: Seen(**dict(zip(gauges.names, gauges.read(), strict=True)))


def fly(
    engine: Engine,
    steer: Callable[[], Commands],
    gusts: Gusts,
    events: Mapping[int, Mapping[str, float]],
    kept: Gauges,
    *,
    control_every: int,
    keep_from: int,
    keep_every: int,
) -> Floats:
    """Step through all of ``gusts``.

    Parameters
    ----------
    engine
        Started.
    steer
        Asked every ``control_every`` steps; the commands hold until the next.
    gusts
        One value a step.
    events
        Properties to set before a step, by its number: what breaks.
    kept
        What a row holds.
    control_every, keep_from, keep_every
        Steps.

    Returns
    -------
    rows : (m, len(kept.names)) float64
        After the steps keep_from, keep_from + keep_every, ...
    """
    surfaces = [engine.node(f"fcs/{name}-cmd-norm") for name in ("elevator", "aileron", "rudder")]
    north, east, down = (engine.node(f"atmosphere/gust-{a}-fps") for a in ("north", "east", "down"))
    turns = gusts.pitch_rad_s.any() or gusts.yaw_rad_s.any()
    turn = [engine.node(f"gust/{axis}-rad_sec") for axis in "qr"] if turns else []
    yaw = engine.node("attitude/psi-rad")
    air = np.stack([gusts.along_m_s, gusts.across_m_s, gusts.down_m_s], axis=1) / FOOT_M
    rotation = np.stack([gusts.pitch_rad_s, gusts.yaw_rad_s], axis=1)
    rows = []
    for k, ((ahead, right, sink), turned) in enumerate(
        zip(air.tolist(), rotation.tolist(), strict=True)
    ):
        if k % control_every == 0:
            order = steer()
            moved = zip(surfaces, (order.elevator, order.aileron, order.rudder), strict=True)
            for node, value in moved:
                node.set_double_value(value)
            engine.set_throttle(order.throttle)
            heading = yaw.get_double_value()
            c, s = cos(heading), sin(heading)
        if k in events:
            engine.set(events[k])
        north.set_double_value(c * ahead - s * right)
        east.set_double_value(s * ahead + c * right)
        down.set_double_value(sink)
        for node, rate in zip(turn, turned, strict=False):
            node.set_double_value(rate)
        engine.step()
        if k >= keep_from and (k - keep_from) % keep_every == 0:
            rows.append(kept.read())
    return np.asarray(rows, dtype=np.float64)
