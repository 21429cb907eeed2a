"""Flights whose autopilot steers on what its sensors say, or on what someone makes of it.

The closed-loop validation of lu2016 (section 3.2, Fig. 2(a)): faults act on the readings while the
aircraft flies, whoever reconstructs the true values does so at every sample, and the autopilot
steers on the result. The reconstruction comes in as a function of one :class:`Moment`::

    def reconstruct(moment: Moment) -> Steering: ...

    flight = fly_closed(Task(...), reconstruct, faults=lu2016_table2(), seed=1)

:func:`on_truth` and :func:`on_sensors` are the two ends of what is possible: perfect sensors, and
the readings as they come. With the same seed and wind, flights differ in what is steered on alone:
noise and gusts are drawn before the flight, the gusts along the path that was planned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import pi
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import GYRO_ACC_AXES
from sim_feeds.airframe import AIRFRAMES, Airframe
from sim_feeds.closed_loop_autopilot import Autopilot, Order, Steering
from sim_feeds.closed_loop_vehicle import Vehicle
from sim_feeds.closed_loop_vehicle import Wind as Wind3
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.gusts import linear_response
from sim_feeds.papers.lu2016 import LU2016_AIR_STD, LU2016_GROUND_STD, LU2016_U_STD
from sim_feeds.papers.streams import FAULT_STREAM, NOISE_STREAM
from sim_feeds.trajectory import SEED_OF_WIND
from sim_feeds.wind import Route, Wind

__all__ = [
    "ClosedFlight",
    "Moment",
    "Order",
    "Reconstruct",
    "Steering",
    "Task",
    "fly_closed",
    "on_sensors",
    "on_truth",
]

Floats = NDArray[np.float64]

_ADDED: Final = frozenset(
    {
        FaultKind.BIAS,
        FaultKind.DRIFT,
        FaultKind.RUNAWAY,
        FaultKind.OSCILLATION,
        FaultKind.NOISE,
    }
)
LOST_RAD: Final = 80.0 / 180.0 * pi
"""Beyond this pitch or twice this bank the aircraft is out of control."""


@dataclass(frozen=True, slots=True)
class Task:
    """What is flown.

    Attributes
    ----------
    orders
        To the autopilot.
    wind
        Of the air.
    duration_s, rate_hz
        Length, and samples a second; the last sample is at ``duration_s``.
    speed_m_s, height_m, heading_rad, lat_rad
        At the start, trimmed; the airspeed is held.
    airframe
        Which aircraft.
    """

    orders: Sequence[Order] = ()
    wind: Wind = field(default_factory=Wind)
    duration_s: float = 40.0
    rate_hz: float = 100.0
    speed_m_s: float = 100.0
    height_m: float = 1000.0
    heading_rad: float = 0.0
    lat_rad: float = 52.0 / 180.0 * pi
    airframe: Airframe = AIRFRAMES["transport"]


class Moment(NamedTuple):
    """One sample of everything on board.

    Attributes
    ----------
    k, t_s : number and time of the sample
    u_m : (6,) measured [A_x A_y A_z p q r]
    y_ground : (6,) measured [U_N U_E U_D phi theta psi]
    y_air : (6,) measured [V alpha beta phi theta psi]
    env : (2,) latitude [rad] and height [m]
    x, u : (6,) the truth of y_ground and u_m
    tas_m_s : true airspeed
    """

    k: int
    t_s: float
    u_m: Floats
    y_ground: Floats
    y_air: Floats
    env: Floats
    x: Floats
    u: Floats
    tas_m_s: float


Reconstruct = Callable[[Moment], Steering]
"""Called once a sample, in order; returns what the autopilot takes for true."""


def on_truth(moment: Moment) -> Steering:
    """Perfect sensors."""
    return Steering(moment.x.tolist(), moment.u.tolist(), moment.tas_m_s)


def on_sensors(moment: Moment) -> Steering:
    """The readings as they come, faults included."""
    return Steering(moment.y_ground.tolist(), moment.u_m.tolist(), float(moment.y_air[0]))


@dataclass(frozen=True, slots=True)
class ClosedFlight:
    """A flight in closed loop, ``n + 1`` samples; as ``sim_feeds.papers.lu2016.ImuExperiment``.

    Attributes
    ----------
    t_s : (n + 1,)
    x_ground, x_air : (n + 1, 6)
        True [U_N U_E U_D phi theta psi] and [u v w phi theta psi].
    flow : (n + 1, 3)
        True [V alpha beta].
    u : (n + 1, 6)
        True [A_x A_y A_z p q r].
    u_m, y_ground, y_air : (n + 1, 6)
        Measured u, x_ground and [V alpha beta phi theta psi], faults in u_m.
    f : (n + 1, 6)
        The faults in u_m.
    env : (n + 1, 2)
        Latitude [rad] and height [m].
    wind_ned_m_s : (n + 1, 3)
    lost_s
        When control was lost; the samples from there on repeat the last one. None: it was not.
    """

    t_s: Floats
    x_ground: Floats
    x_air: Floats
    flow: Floats
    u: Floats
    u_m: Floats
    f: Floats
    y_ground: Floats
    y_air: Floats
    env: Floats
    wind_ned_m_s: Floats
    lost_s: float | None


def fly_closed(
    task: Task, reconstruct: Reconstruct, *, faults: Sequence[Fault] = (), seed: int = 0
) -> ClosedFlight:
    """Fly the task with the autopilot steering on what ``reconstruct`` makes of the readings.

    Parameters
    ----------
    task
        What is flown.
    reconstruct
        From the readings to what is steered on.
    faults
        Of ``imu0`` axes, of kinds that add to the reading whatever it is.
    seed
        Of noise (Table 1 of lu2016) and turbulence.

    Raises
    ------
    ValueError
        A fault that depends on the reading, or of another sensor.
    """
    n = round(task.duration_s * task.rate_hz)
    dt = 1.0 / task.rate_hz
    t: Floats = np.arange(n + 1, dtype=np.float64) * dt
    f = _added(faults, t, seed)
    rng = np.random.default_rng([seed, NOISE_STREAM])
    u_noise, ground_noise, air_noise = (
        std * rng.standard_normal((n + 1, 6))
        for std in (LU2016_U_STD, LU2016_GROUND_STD, LU2016_AIR_STD)
    )
    winds = _winds(task, n, seed)
    wind, felt = (_rows(w) for w in (winds, _felt(task, winds)))
    vehicle = Vehicle.trimmed(
        task.airframe, task.speed_m_s, task.height_m, task.heading_rad, felt[0], task.lat_rad
    )
    pilot = Autopilot(vehicle, task.orders, task.speed_m_s)
    truth = np.empty((n + 1, 20))
    u_m, y_ground, y_air = (np.empty((n + 1, 6)) for _ in range(3))
    lost_s = None
    for k in range(n + 1):
        m = vehicle.motion(wind[2 * k], felt[2 * k])
        truth[k] = (*m.x, *m.u, *m.air, *m.flow, *m.place)
        x, u = truth[k, :6], truth[k, 6:12]
        u_m[k] = u + f[k] + u_noise[k]
        y_ground[k] = x + ground_noise[k]
        y_air[k, :3], y_air[k, 3:] = m.flow, x[3:]
        y_air[k] += air_noise[k]
        if lost_s is None and (abs(x[4]) > LOST_RAD or abs(x[3]) > 2.0 * LOST_RAD):
            lost_s = float(t[k])
        if lost_s is not None:
            continue
        moment = Moment(
            k, float(t[k]), u_m[k], y_ground[k], y_air[k], truth[k, 18:20], x, u, m.flow[0]
        )
        command = pilot.steer(moment.t_s, reconstruct(moment), dt)
        if k < n:
            vehicle.step(command, (felt[2 * k], felt[2 * k + 1], felt[2 * k + 2]), dt)
    angles = truth[:, 3:6]
    return ClosedFlight(
        t_s=t,
        x_ground=truth[:, :6].copy(),
        x_air=np.column_stack([truth[:, 12:15], angles]),
        flow=truth[:, 15:18].copy(),
        u=truth[:, 6:12].copy(),
        u_m=u_m,
        f=f,
        y_ground=y_ground,
        y_air=y_air,
        env=truth[:, 18:20].copy(),
        wind_ned_m_s=winds[::2].copy(),
        lost_s=lost_s,
    )


def _winds(task: Task, n: int, seed: int) -> Floats:
    """Wind along the straight path, at every sample and half way between: (2 n + 1, 3)."""
    half: Floats = np.arange(2 * n + 1, dtype=np.float64) * (0.5 / task.rate_hz)
    one = np.ones_like(half)
    route = Route(half, task.height_m * one, task.speed_m_s * one, task.heading_rad * one)
    return task.wind.velocity(route, np.random.default_rng([seed, SEED_OF_WIND]))


def _felt(task: Task, winds: Floats) -> Floats:
    """The wind as wing and tail average it, a lag of their length over the airspeed."""
    follow = task.speed_m_s / task.airframe.gust_length_m * np.eye(3)
    felt, _ = linear_response(-follow, follow, winds, 0.5 / task.rate_hz, winds[0])
    return felt


def _rows(winds: Floats) -> list[Wind3]:
    return [(a, b, c) for a, b, c in winds.tolist()]


def _added(faults: Sequence[Fault], t_s: Floats, seed: int) -> Floats:
    """What the faults add to [A_x A_y A_z p q r], (n, 6)."""
    out = np.zeros((len(t_s), 6))
    draws = np.random.default_rng([seed, FAULT_STREAM]).spawn(len(faults))
    for fault, draw in zip(faults, draws, strict=True):
        imu, _, axis = fault.sensor.partition(".")
        if imu != "imu0" or axis not in GYRO_ACC_AXES:
            raise ValueError(f"{fault.sensor} is no axis of imu0")
        if fault.kind not in _ADDED:
            raise ValueError(f"{fault.kind} depends on the reading, which is not known beforehand")
        out[:, GYRO_ACC_AXES.index(axis)] += fault.apply(t_s, np.zeros_like(t_s), draw)
    return out
