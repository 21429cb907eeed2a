"""The recorded flights of lu2016 section 5, flown synthetically: level, parabolic, turbulent.

The paper's recordings are not public. These flights have their manoeuvres and rates: air data at
100 Hz, ground speed at 1 Hz. Unlike the experiments of section 3 the instruments have biases, slow
errors and a vane on the fuselage; faults are written into the healthy recording afterwards, which
is the paper's open-loop validation.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.airframe import AIRFRAMES
from sim_feeds.faults import Fault, lu2016_table2
from sim_feeds.flightplan import FlightPlan
from sim_feeds.papers.lu2016 import ImuExperiment, imu_faults
from sim_feeds.papers.lu2016_runs import FlightSection, Recorder, runs
from sim_feeds.papers.streams import NOISE_STREAM
from sim_feeds.profile import Profile
from sim_feeds.sensors import markov
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Component, Route, Wind

__all__ = ["Recording", "record", "section_of"]

Floats = NDArray[np.float64]

SPEED_M_S: Final = 130.0
HEIGHT_M: Final = 4000.0
ONSET_S: Final = 3.0
"""Within which turbulence comes up after the calm part."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded flight with faults written in.

    Attributes
    ----------
    flight : ImuExperiment
        Its ``y_ground`` has the ground speed of the receiver interpolated linearly to the rate of
        the IMU, as the paper does: half an interval of it is the future.
    y_sparse : (n + 1, 6) float64 [m/s, rad]
        The same with the ground speed only where the receiver gave one, else NaN.
    truth
        The flight itself.
    """

    flight: ImuExperiment
    y_sparse: Floats
    truth: Truth


@dataclass(frozen=True, slots=True)
class _Entered:
    """Wind that the aircraft flies into: the component, faded in."""

    component: Component
    start_s: float

    def velocity(self, route: Route, rng: np.random.Generator) -> Floats:
        fade = Profile()
        fade.step(self.start_s, ONSET_S, 1.0)
        return fade(route.t_s)[:, None] * self.component.velocity(route, rng)


def section_of(name: str) -> FlightSection:
    """The flight of this name in the bundled file.

    Raises
    ------
    KeyError
        There is none.
    """
    for flight in runs().flight:
        if flight.name == name:
            return flight
    raise KeyError(name)


def record(
    name: str,
    seed: int = 0,
    *,
    faults: list[Fault] | None = None,
    recorder: Recorder | None = None,
) -> Recording:
    """Fly, record, break.

    Parameters
    ----------
    name
        Of a flight in ``lu2016_runs.toml``.
    seed
        Of air and instruments; they do not depend on the faults.
    faults
        On ``imu0`` axes; None: those of Table 2.
    recorder
        None: that of the file.
    """
    section, r = section_of(name), recorder or runs().recorder
    truth = _flown(section, seed, r.rate_hz)
    t, n = truth.t_s, len(truth.t_s)
    rng = np.random.default_rng([seed, NOISE_STREAM])
    degree = radians(1.0)

    imu = np.column_stack([truth.specific_force_m_s2, truth.rate_rad_s])
    white = np.repeat([r.acc_std_m_s2, r.gyro_std_deg_s * degree], 3)
    offset = np.repeat([r.acc_bias_std_m_s2, r.gyro_bias_std_deg_s * degree], 3)
    measured = imu + offset * rng.standard_normal(6) + white * rng.standard_normal((n, 6))
    f = imu_faults(lu2016_table2() if faults is None else faults, t, measured, seed)

    wander = [
        markov(rng, t, r.attitude_wander_std_deg * degree, r.attitude_wander_s) for _ in range(3)
    ]
    noise = r.attitude_std_deg * degree * rng.standard_normal((n, 3))
    angles = truth.euler_rad + np.column_stack(wander) + noise

    every = round(r.rate_hz / r.gps_hz)
    epochs = np.arange(0, n, every)
    gps = truth.vel_ned_m_s[epochs] + r.gps_std_m_s * rng.standard_normal((len(epochs), 3))
    velocity = np.column_stack([np.interp(t, t[epochs], gps[:, k]) for k in range(3)])
    sparse = np.full((n, 3), np.nan)
    sparse[epochs] = gps

    vanes = np.column_stack([truth.aoa_rad, truth.ssa_rad]) * r.vane_scale
    vanes += r.vane_offset_deg * degree + r.vane_std_deg * degree * rng.standard_normal((n, 2))
    tas = truth.tas_m_s * r.tas_scale + r.tas_std_m_s * rng.standard_normal(n)
    flight = ImuExperiment(
        t_s=t,
        x_ground=np.column_stack([truth.vel_ned_m_s, truth.euler_rad]),
        x_air=np.column_stack([truth.air_frd_m_s, truth.euler_rad]),
        u_m=measured + f,
        f=f,
        y_ground=np.column_stack([velocity, angles]),
        y_air=np.column_stack([tas, vanes, angles]),
        env=np.column_stack([truth.lat_rad, truth.height_m]),
        wind_ned_m_s=truth.wind_ned_m_s,
    )
    return Recording(flight, np.column_stack([sparse, angles]), truth)


def _flown(section: FlightSection, seed: int, rate_hz: float) -> Truth:
    """Truth of a flight, its duration rounded to whole seconds of the receiver."""
    plan = FlightPlan(
        AIRFRAMES["transport"], speed_m_s=SPEED_M_S, height_m=HEIGHT_M, heading_rad=radians(17.0)
    )
    for leg in section.leg:
        leg.fly(plan)
    plan.level(max(section.duration_s - plan.time_s, 0.0) + 1.0)
    parts: list[Component] = []
    for part in section.wind:
        component = part.component()
        gusty = part.kind == "dryden" and section.calm_s > 0.0
        parts.append(_Entered(component, section.calm_s) if gusty else component)
    truth = fly(plan, Wind(parts), seed=seed, rate_hz=2.0 * rate_hz).every(2)
    return truth.at(truth.t_s[: round(section.duration_s * rate_hz) + 1])
