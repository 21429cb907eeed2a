"""Gains for an aircraft that nobody tuned, from what small nudges of its controls do.

Each control is nudged in a short flight and compared with the same flight without: peak of the rate
that follows, per unit of command, and the time it takes. Loops are then closed at bandwidths that
these times allow, so that one autopilot flies a model of 11 kg and an airliner.

========  =========================================================  =================
symbol    meaning                                                    unit
========  =========================================================  =================
P, Q, R   peak of roll, pitch, yaw rate per unit of command          rad/s
tau       time to 63 % of the peak                                   s
A         acceleration per unit of throttle                          m/s^2
w         bandwidth of a loop                                        rad/s
========  =========================================================  =================
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, cos, radians, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.sixdof.engine import FOOT_M, Engine
from sim_feeds.sixdof.pilot import Gains

__all__ = ["Response", "airborne", "learned_gains", "response"]

Floats = NDArray[np.float64]

STEP_S: Final = 0.005
WATCHED_S: Final = 1.0
SURGE_S: Final = 4.0
NUDGE: Final = 0.1
START_THROTTLE: Final = 0.6
PITCH_AT_START: Final = 0.04
ROLL_SHARE: Final = 0.3
PITCH_SHARE: Final = 0.35
"""Bandwidth times tau."""
FASTEST: Final = 1.5
"""Bandwidth that is enough for any aircraft [rad/s]."""


@dataclass(frozen=True, slots=True)
class Response:
    """What a control does.

    Attributes
    ----------
    peak
        Of the rate, per unit of command, with its sign.
    rise_s
        Time to 63 % of it.
    """

    peak: float
    rise_s: float


def airborne(
    aircraft: str,
    *,
    tas_m_s: float,
    height_m: float,
    heading_rad: float = 0.0,
    lat_rad: float = 0.8,
    lon_rad: float = 0.1,
    wind_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
    dt_s: float = STEP_S,
) -> Engine:
    """An aircraft in level flight through the air, engines running, gear up.

    Raises
    ------
    EngineMissing, AircraftMissing
        As of :class:`sim_feeds.sixdof.engine.Engine`.
    """
    engine = Engine(aircraft, dt_s=dt_s)
    ahead = np.array([cos(heading_rad), sin(heading_rad), 0.0])
    engine.start(
        lat_rad=lat_rad,
        lon_rad=lon_rad,
        height_m=height_m,
        euler_rad=(0.0, PITCH_AT_START, heading_rad),
        vel_ned_m_s=tas_m_s * ahead + wind_ned_m_s,
        wind_ned_m_s=np.asarray(wind_ned_m_s),
    )
    engine.run_engines()
    engine.set_throttle(START_THROTTLE)
    return engine


def response(
    aircraft: str, control: str, rate: str, *, tas_m_s: float, height_m: float
) -> Response:
    """Nudge one control and see how a rate follows.

    Parameters
    ----------
    aircraft
    control
        "elevator", "aileron" or "rudder".
    rate
        JSBSim's property.
    tas_m_s, height_m
        Where it flies.
    """
    runs = []
    for command in (0.0, NUDGE):
        engine = airborne(aircraft, tas_m_s=tas_m_s, height_m=height_m)
        engine.set({f"fcs/{control}-cmd-norm": command})
        node = engine.node(rate)
        seen = []
        for _ in range(round(WATCHED_S / STEP_S)):
            engine.step()
            seen.append(node.get_double_value())
        runs.append(np.array(seen))
    follows = (runs[1] - runs[0]) / NUDGE
    top = int(np.abs(follows).argmax())
    rise = int(np.argmax(np.abs(follows) > 0.63 * abs(follows[top]))) + 1
    return Response(float(follows[top]), rise * STEP_S)


def _acceleration(aircraft: str, tas_m_s: float, height_m: float) -> float:
    """Gained per unit of throttle [m/s^2]."""
    ends = []
    for throttle in (START_THROTTLE, START_THROTTLE + 2.0 * NUDGE):
        engine = airborne(aircraft, tas_m_s=tas_m_s, height_m=height_m)
        engine.set_throttle(throttle)
        for _ in range(round(SURGE_S / STEP_S)):
            engine.step()
        ends.append(engine.fdm["velocities/vt-fps"] * FOOT_M)
    return (ends[1] - ends[0]) / (2.0 * NUDGE) / SURGE_S


def learned_gains(aircraft: str, *, tas_m_s: float, height_m: float) -> Gains:
    """Gains for :class:`sim_feeds.sixdof.pilot.Pilot` at one airspeed and height.

    Raises
    ------
    ValueError
        A control has no effect there: the message names it.
    """
    at = {"tas_m_s": tas_m_s, "height_m": height_m}
    P = response(aircraft, "aileron", "velocities/p-rad_sec", **at)
    Q = response(aircraft, "elevator", "velocities/q-rad_sec", **at)
    R = response(aircraft, "rudder", "velocities/r-rad_sec", **at)
    A = _acceleration(aircraft, tas_m_s, height_m)
    for control, effect in (
        ("aileron", P.peak), ("elevator", Q.peak), ("rudder", R.peak), ("throttle", A)
    ):  # fmt: skip
        if abs(effect) < 1e-3:
            raise ValueError(f"the {control} of {aircraft} does nothing at {tas_m_s:g} m/s")
    w_bank = min(FASTEST, ROLL_SHARE / P.rise_s)
    w_pitch = min(FASTEST, PITCH_SHARE / Q.rise_s)
    w_climb = 0.4 * w_pitch
    w_course = 0.25 * w_bank
    w_speed = 0.25
    return Gains(
        course_rad_m=0.25 * w_course / tas_m_s,
        course_1_s=w_course,
        bank_limit_rad=radians(30.0),
        bank_rate_rad_s=radians(15.0) * w_bank,
        pitch_limit_rad=radians(12.0),
        aileron_per_rad=w_bank / P.peak,
        aileron_per_rad_s=0.15 / P.peak,
        aileron_per_rad_integral=0.2 * w_bank / P.peak,
        climb_1_s=0.25 * w_climb,
        pitch_per_m_s=w_climb / tas_m_s,
        pitch_per_m=0.25 * w_climb / tas_m_s,
        elevator_per_rad=-w_pitch / Q.peak,
        elevator_per_rad_s=copysign(0.5, -Q.peak) / abs(Q.peak),
        elevator_per_rad_integral=-0.5 * w_pitch / Q.peak,
        throttle_trim=START_THROTTLE,
        throttle_per_m_s=w_speed / A,
        throttle_per_m=0.15 * w_speed / A,
        rudder_per_rad_s=-0.4 / R.peak,
    )
