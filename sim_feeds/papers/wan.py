"""The simulated experiments of wan2018 and wan2016, as arrays.

The papers' aircraft (their own simulators) are not public; these flights have their speeds,
durations, sampling and the faults of their tables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds import earth
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.faults import KNOT_M_S, Fault, FaultKind, apply_all
from sim_feeds.flightplan import FlightPlan
from sim_feeds.papers.streams import FAULT_STREAM, NOISE_STREAM
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Component, Constant, Dryden, Ramp, Wind

__all__ = [
    "WAN2016_CASES",
    "WAN2016_NOISE_STD",
    "WAN_SAMPLE_S",
    "LongitudinalExperiment",
    "wan2016_experiment",
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


WAN2016_NOISE_STD: Final = {
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
    noise_std: dict[str, float] = WAN2016_NOISE_STD,
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


@dataclass(frozen=True, slots=True)
class _Case:
    height_ft: float
    speed_kt: float
    manoeuvre: str
    vertical_wind: bool
    kind: FaultKind
    aoa: tuple[int, ...]
    airspeed: tuple[int, ...]


WAN2016_CASES: Final = {
    1: _Case(7475, 207, "load factor", False, FaultKind.NRZ, (0, 1), (0, 1)),
    2: _Case(1565, 203, "load factor", False, FaultKind.OSCILLATION, (0, 1), (0, 1)),
    3: _Case(15896, 277, "path angle", True, FaultKind.OSCILLATION, (0, 1), (0, 1)),
    4: _Case(31331, 322, "path angle", True, FaultKind.BIAS, (), (0, 1)),
    5: _Case(30666, 332, "vertical speed", True, FaultKind.JAMMING, (), (0, 1)),
    6: _Case(15658, 351, "vertical speed", True, FaultKind.RUNAWAY, (), (0, 1)),
    7: _Case(943, 162, "alpha protection", True, FaultKind.JAMMING, (0, 1), (0, 1)),
    8: _Case(968, 173, "alpha protection", True, FaultKind.NRZ, (), (0, 1)),
}
"""wan2016 Table 1: height, calibrated airspeed, manoeuvre, winds, and who fails how.

Differs: row 2 prints three failed airspeeds under a text that says two of three; two fail here.
"""

_WAN2016_SIZES: Final = {
    # vane: size [rad] or rate [rad/s]; airspeed: size [m/s] or rate [m/s^2]
    FaultKind.NRZ: (0.1, 0.1),
    FaultKind.OSCILLATION: (radians(6.0), 30.0 * KNOT_M_S),
    FaultKind.BIAS: (radians(5.0), 40.0 * KNOT_M_S),
    FaultKind.JAMMING: (radians(14.0), 100.0 * KNOT_M_S),
    FaultKind.RUNAWAY: (radians(1.0), 5.0 * KNOT_M_S),
}


def wan2016_experiment(case: int, seed: int = 0, start_s: float = 20.0) -> LongitudinalExperiment:
    """One row of wan2016 Table 1, 60 s, the faults beginning together.

    Differs: fault sizes are not printed; they are chosen inside the ranges of wan2018 Table II.
    """
    c = WAN2016_CASES[case]
    height = c.height_ft * 0.3048
    impact = earth.impact_pressure_of_cas(c.speed_kt * KNOT_M_S)
    tas = float(
        earth.true_airspeed(impact, earth.static_pressure(height), earth.temperature(height))
    )
    light = replace(AIRFRAMES["transport"], cruise_m_s=c.speed_kt * KNOT_M_S)
    plan = FlightPlan(light, speed_m_s=tas, height_m=height).level(2.0)
    match c.manoeuvre:
        case "load factor":
            plan.load_doublet(0.3).level(6.0).load_doublet(-0.3)
        case "path angle":
            plan.climb_at(0.05 * tas, 45.0)
        case "vertical speed":
            plan.climb_at(-0.03 * tas, 45.0)
        case _:
            plan.change_speed(0.75 * tas)
    aoa_size, cas_size = _WAN2016_SIZES[c.kind]
    faults = []
    for prefix, indices, size in (("aoa", c.aoa, aoa_size), ("airspeed", c.airspeed, cas_size)):
        for i in indices:
            fault = Fault(f"{prefix}{i}", c.kind, start_s, size=size)
            if c.kind is FaultKind.RUNAWAY:
                fault = replace(fault, size=0.0, rate=size)
            if c.kind is FaultKind.OSCILLATION:
                fault = replace(fault, period_s=2.0)
            faults.append(fault)
    return wan_experiment(faults, seed, plan=plan, wind=Wind(wan_wind(c.vertical_wind)))
