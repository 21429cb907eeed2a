"""The simulated longitudinal experiments of wan2018 and wan2016, as arrays.

The papers' aircraft (their own simulators) are not public; these flights have their speeds,
durations, sampling and the faults of their tables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.airframe import AIRFRAMES
from sim_feeds.faults import Fault, apply_all
from sim_feeds.flightplan import FlightPlan
from sim_feeds.papers.streams import FAULT_STREAM, NOISE_STREAM
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Component, Constant, Dryden, Ramp, Wind

__all__ = [
    "WAN_NOISE_STD",
    "WAN_SAMPLE_S",
    "LongitudinalExperiment",
    "wan_experiment",
    "wan_wind",
]

Floats = NDArray[np.float64]

WAN_SAMPLE_S: Final = 0.048
"""Sampling of wan2018: 370 samples in 17.76 s."""


@dataclass(frozen=True, slots=True)
class LongitudinalExperiment:
    """Arrays for the longitudinal air data estimator, one row every 0.048 s, ``n`` rows.

    Wind signs are wan2018's as the algorithm takes them: W_x along the direction of flight, W_z > 0
    is a downdraft; V_z > 0 descends.

    Attributes
    ----------
    t_s : (n,)
    theta : (n, 6)
        Measured [V_g theta q A_x A_z z], V_g inertial speed in the vertical plane, z height.
    v_z_m_s : (n,)
        Measured vertical speed, positive down.
    aoa_rad, cas_m_s : (n, 3)
        The three vanes and the three airspeeds with noise and faults.
    x : (n, 4)
        True [alpha V_g W_x W_z].
    cas_true_m_s : (n,)
    faulty : (n, 6) bool
        Which of aoa0..2, airspeed0..2 is broken.
    truth
        The whole flight at the same times.
    """

    t_s: Floats
    theta: Floats
    v_z_m_s: Floats
    aoa_rad: Floats
    cas_m_s: Floats
    x: Floats
    cas_true_m_s: Floats
    faulty: NDArray[np.bool_]
    truth: Truth


WAN_NOISE_STD: Final = {
    "v_g": 0.1,
    "theta": radians(0.02),
    "q": radians(0.05),
    "acc": 0.02,
    "height": 0.5,
    "v_z": 0.1,
    "aoa": radians(0.2),
    "cas": 0.4,
}
"""Assumed, SI: the papers give no noise levels. Below the R of the tuning that worked."""


def wan_experiment(
    faults: list[Fault],
    seed: int = 0,
    *,
    plan: FlightPlan | None = None,
    wind: Wind | None = None,
    duration_s: float = 60.0,
    noise_std: dict[str, float] = WAN_NOISE_STD,
) -> LongitudinalExperiment:
    """A straight flight with three vanes and three airspeeds.

    Parameters
    ----------
    faults
        On ``aoa0..2`` and ``airspeed0..2``; see also :func:`sim_feeds.faults.draw_wan2018`.
    seed
        Of noise, turbulence and noise faults.
    plan
        Northbound straight flight; by default a climb, load factor doublets and a speed change at
        190 m/s, 1500 m. A longer flight goes on level.
    wind
        By default 10 m/s along the flight that ramps by 15 m/s, a downdraft of 3 m/s, light
        turbulence.
    """
    if plan is None:
        fast = replace(AIRFRAMES["transport"], cruise_m_s=170.0)
        plan = FlightPlan(fast, speed_m_s=190.0, height_m=1500.0)
        plan.level(4.0).load_doublet(0.3).level(4.0).change_speed(180.0)
    plan.level(max(duration_s - plan.time_s, 0.0) + 1.0)
    if wind is None:
        wind = Wind(wan_wind())
    truth = fly(plan, wind, seed=seed, rate_hz=4.0 / WAN_SAMPLE_S).every(4)
    n = int(duration_s / WAN_SAMPLE_S)
    truth = truth.at(truth.t_s[:n])
    t = truth.t_s
    noise, broken = (np.random.default_rng([seed, k]) for k in (NOISE_STREAM, FAULT_STREAM))
    std = noise_std
    v = truth.vel_ned_m_s
    speed = np.hypot(v[:, 0], v[:, 2])
    clean = np.column_stack(
        [
            speed,
            truth.euler_rad[:, 1],
            truth.rate_rad_s[:, 1],
            truth.specific_force_m_s2[:, 0],
            truth.specific_force_m_s2[:, 2],
            truth.height_m,
        ]
    )
    scale = np.array([std[k] for k in ("v_g", "theta", "q", "acc", "acc", "height")])
    theta = clean + scale * noise.standard_normal((n, 6))
    v_z = v[:, 2] + std["v_z"] * noise.standard_normal(n)
    names = [f"aoa{i}" for i in range(3)] + [f"airspeed{i}" for i in range(3)]
    readings = np.empty((n, 6))
    faulty = np.zeros((n, 6), dtype=bool)
    for k, (name, draw) in enumerate(zip(names, broken.spawn(6), strict=True)):
        true, level = (truth.aoa_rad, std["aoa"]) if k < 3 else (truth.cas_m_s, std["cas"])
        own = [f for f in faults if f.sensor == name]
        readings[:, k] = apply_all(own, t, true + level * noise.standard_normal(n), draw)
        for f in own:
            faulty[:, k] |= f.active(t)
    readings[:, 3:] = np.maximum(readings[:, 3:], 0.0)
    return LongitudinalExperiment(
        t_s=t,
        theta=theta,
        v_z_m_s=v_z,
        aoa_rad=readings[:, :3],
        cas_m_s=readings[:, 3:],
        x=np.column_stack(
            [truth.aoa_rad, speed, truth.wind_ned_m_s[:, 0], truth.wind_ned_m_s[:, 2]]
        ),
        cas_true_m_s=truth.cas_m_s,
        faulty=faulty,
        truth=truth,
    )


def wan_wind(vertical: bool = True) -> list[Component]:
    """Winds well within the papers' bounds: 120 kt, 15 kt/s."""
    down = np.array([0.0, 0.0, 3.0])
    parts: list[Component] = [
        Constant(np.array([10.0, 0.0, 0.0])),
        Ramp(15.0, 25.0, np.array([15.0, 0.0, 0.0])),
        Dryden(fixed_std_m_s=0.5, fixed_scale_m=530.0),
    ]
    return [*parts, Ramp(10.0, 16.0, down), Ramp(30.0, 38.0, -down)] if vertical else parts
