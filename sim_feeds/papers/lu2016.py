"""The simulated experiments of lu2016 section 3, as arrays.

The paper's aircraft (its own simulator) is not public; these flights have its speed, duration,
sampling and noise, and the faults of its Table 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import GYRO_ACC_AXES
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.faults import Fault, apply_all, lu2016_table2
from sim_feeds.flightplan import FlightPlan
from sim_feeds.papers.streams import FAULT_STREAM, NOISE_STREAM
from sim_feeds.trajectory import fly
from sim_feeds.wind import Dryden, Ramp, Wind

__all__ = [
    "Air",
    "ImuExperiment",
    "imu_faults",
    "lu2016_experiment",
    "lu2016_plan",
    "lu2016_wind",
]

Floats = NDArray[np.float64]
Air = Literal["calm", "shear", "turbulence"]


@dataclass(frozen=True, slots=True)
class ImuExperiment:
    """Arrays for a two-stage filter on the ground-speed or the airspeed model; ``n + 1`` samples.

    ``u_m[k]`` is valid at ``t_s[k]`` and drives the step to ``k + 1``.

    Attributes
    ----------
    t_s : (n + 1,)
    x_ground : (n + 1, 6)
        True [U_N U_E U_D phi theta psi], m/s and rad.
    x_air : (n + 1, 6)
        True [u v w phi theta psi].
    u_m : (n + 1, 6)
        Measured [A_x A_y A_z p q r] with noise and faults.
    f : (n + 1, 6)
        The faults.
    y_ground : (n + 1, 6)
        Measured x_ground.
    y_air : (n + 1, 6)
        Measured [V alpha beta phi theta psi].
    env : (n + 1, 2)
        Latitude [rad] and height [m].
    wind_ned_m_s : (n + 1, 3)
    """

    t_s: Floats
    x_ground: Floats
    x_air: Floats
    u_m: Floats
    f: Floats
    y_ground: Floats
    y_air: Floats
    env: Floats
    wind_ned_m_s: Floats


LU2016_U_STD: Final = np.array([0.01] * 3 + [radians(0.01)] * 3)
LU2016_GROUND_STD: Final = LU2016_U_STD
LU2016_AIR_STD: Final = np.array([0.1] + [radians(0.1)] * 2 + [radians(0.01)] * 3)


def lu2016_wind(air: Air) -> Wind:
    """The disturbances of lu2016 section 2.2.1.

    The turbulence has the printed scale and intensity. The shear's source is not public: here a
    headwind turns into a tailwind with a downdraft in between, as in a microburst.
    """
    if air == "calm":
        return Wind()
    if air == "turbulence":
        return Wind([Dryden(fixed_std_m_s=3.54, fixed_scale_m=530.0)])
    head = np.array([-8.0, 0.0, 0.0])
    down = np.array([0.0, 0.0, 6.0])
    return Wind(
        [
            Ramp(5.0, 13.0, head),
            Ramp(15.0, 25.0, -2.0 * head),
            Ramp(29.0, 37.0, head),
            Ramp(12.0, 20.0, down),
            Ramp(22.0, 30.0, -down),
        ]
    )


def lu2016_plan(speed_m_s: float = 100.0, heading_rad: float = radians(17.0)) -> FlightPlan:
    """The beginning of a flight at 1000 m."""
    transport = AIRFRAMES["transport"]
    return FlightPlan(transport, speed_m_s=speed_m_s, height_m=1000.0, heading_rad=heading_rad)


def imu_faults(faults: list[Fault], t_s: Floats, measured: Floats, seed: int) -> Floats:
    """What the faults add to the readings of ``imu0``, (n, 6) float64 [m/s^2, rad/s]."""
    f = np.zeros((len(t_s), 6))
    draws = np.random.default_rng([seed, FAULT_STREAM]).spawn(6)
    for k, axis in enumerate(GYRO_ACC_AXES):
        own = [x for x in faults if x.sensor == f"imu0.{axis}"]
        f[:, k] = apply_all(own, t_s, measured[:, k], draws[k]) - measured[:, k]
    return f


def lu2016_experiment(
    air: Air = "calm",
    seed: int = 0,
    *,
    faults: list[Fault] | None = None,
    plan: FlightPlan | None = None,
    rate_hz: float = 100.0,
    duration_s: float = 40.0,
    speed_m_s: float = 100.0,
    u_std: Floats = LU2016_U_STD,
    ground_std: Floats = LU2016_GROUND_STD,
    air_std: Floats = LU2016_AIR_STD,
) -> ImuExperiment:
    """Transport at 100 m/s with pitch and roll motion; faults of Table 2 unless others are given.

    Parameters
    ----------
    air
        Calm, shear or turbulence.
    seed
        Of noise and turbulence.
    faults
        On ``imu0`` axes; an empty list is a healthy flight.
    plan
        Another flight in place of the one above; it goes on level.
    u_std, ground_std, air_std : (6,) float64
        Noise of the inputs and of the two models' measurements; Q and R are their squares.
    """
    if plan is None:
        plan = lu2016_plan(speed_m_s)
        plan.level(2.0).load_doublet(0.15).turn(radians(20.0), bank_rad=radians(15.0))
    plan.level(max(duration_s - plan.time_s, 0.0) + 1.0)
    truth = fly(plan, lu2016_wind(air), seed=seed, rate_hz=2.0 * rate_hz).every(2)
    n = round(duration_s * rate_hz) + 1
    t = truth.t_s[:n]
    rng = np.random.default_rng([seed, NOISE_STREAM])
    imu = np.column_stack([truth.specific_force_m_s2, truth.rate_rad_s])[:n]
    measured = imu + u_std * rng.standard_normal((n, 6))
    f = imu_faults(lu2016_table2() if faults is None else faults, t, measured, seed)
    angles = truth.euler_rad[:n]
    x_ground = np.column_stack([truth.vel_ned_m_s[:n], angles])
    flow = np.column_stack([truth.tas_m_s, truth.aoa_rad, truth.ssa_rad])[:n]
    y_ground = x_ground + ground_std * rng.standard_normal((n, 6))
    y_air = np.column_stack([flow, angles]) + air_std * rng.standard_normal((n, 6))
    return ImuExperiment(
        t_s=t,
        x_ground=x_ground,
        x_air=np.column_stack([truth.air_frd_m_s[:n], angles]),
        u_m=measured + f,
        f=f,
        y_ground=y_ground,
        y_air=y_air,
        env=np.column_stack([truth.lat_rad, truth.height_m])[:n],
        wind_ned_m_s=truth.wind_ned_m_s[:n],
    )
