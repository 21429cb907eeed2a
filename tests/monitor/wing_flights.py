"""Flights of the six-degree-of-freedom vehicle as the rows that a MAVLink stream would give."""

from __future__ import annotations

from math import degrees, pi

import numpy as np
from numpy.typing import NDArray

from estimators.attitude import quaternion_from_euler
from links.samples import Batch, Rows, empty_rows
from monitor.warmup import numbered
from sim_feeds.sixdof import SixDofFlight

Array = NDArray[np.float64]

RATES_HZ = {"imu0": 50.0, "attitude": 20.0, "nav": 5.0, "airspeed0": 5.0, "baro0": 5.0,
            "servo": 10.0, "spool0": 5.0}  # fmt: skip
ACC_BIAS_M_S2, ACC_STD_M_S2 = 0.03, 0.05
TILT_STD_RAD, YAW_STD_RAD, SLOW_S = np.radians(0.3), np.radians(1.0), 30.0
RATE_STD_RAD_S = np.radians(0.1)
VELOCITY_STD_M_S, VELOCITY_S = 0.1, 5.0
CAS_STD_M_S, RPM_SHARE = 0.2, 0.002
TRAVEL_US, TRAVEL_DEG = 400.0, degrees(0.5)
R_AIR, T0_K, LAPSE_K_M = 287.05287, 288.15, 0.0065


def rows_of(flight: SixDofFlight, *, seed: int = 0, noise: float = 1.0) -> Batch:
    """Rows of all streams; attitude, velocity and the others have errors as of an autopilot.

    Parameters
    ----------
    flight
        On a grid of 50 ms or finer.
    seed
        Of the errors.
    noise
        Factor on them.
    """
    rng = np.random.default_rng([seed, 23])
    rows = {name: _rows(flight, name, rate) for name, rate in RATES_HZ.items()}
    times = {name: r["t_us"] * 1e-6 for name, r in rows.items()}

    def at(name: str, values: Array) -> Array:
        return np.interp(times[name], flight.t_s, values)

    def white(name: str, std: float) -> Array:
        return noise * std * rng.standard_normal(len(rows[name]))

    a = rows["attitude"]
    euler = np.column_stack(
        [
            at("attitude", np.unwrap(flight.euler_rad[:, i]))
            + noise * _slow(rng, times["attitude"], YAW_STD_RAD if i == 2 else TILT_STD_RAD, SLOW_S)
            for i in range(3)
        ]
    )
    a["q_ned_from_frd"] = [quaternion_from_euler(*row) for row in euler]
    for i in range(3):
        a["rate_rad_s"][:, i] = at("attitude", flight.rate_rad_s[:, i])
        a["rate_rad_s"][:, i] += white("attitude", RATE_STD_RAD_S)
        wander = noise * _slow(rng, times["nav"], VELOCITY_STD_M_S, VELOCITY_S)
        rows["nav"]["vel_ned_m_s"][:, i] = at("nav", flight.vel_ned_m_s[:, i]) + wander
        rows["imu0"]["acc_m_s2"][:, i] = at("imu0", flight.specific_force_m_s2[:, i])
        bias = noise * ACC_BIAS_M_S2 * rng.standard_normal()
        rows["imu0"]["acc_m_s2"][:, i] += bias + white("imu0", ACC_STD_M_S2)
    rows["nav"]["alt_m"] = at("nav", flight.height_m)
    rows["nav"]["height_m"] = rows["nav"]["alt_m"]
    cas = at("airspeed0", flight.tas_m_s * np.sqrt(flight.density_kg_m3 / 1.225))
    rows["airspeed0"]["cas_m_s"] = cas + white("airspeed0", CAS_STD_M_S)
    temperature = T0_K - LAPSE_K_M * flight.height_m
    rows["baro0"]["static_press_pa"] = at("baro0", flight.density_kg_m3 * R_AIR * temperature)
    surfaces = (flight.aileron_rad, flight.elevator_rad, None, flight.rudder_rad)
    for channel, deflection in enumerate(surfaces):
        pulse = 1000.0 + 1000.0 * flight.throttle
        if deflection is not None:
            pulse = 1500.0 + TRAVEL_US * np.degrees(deflection) / TRAVEL_DEG
        rows["servo"]["pwm_us"][:, channel] = np.round(at("servo", pulse))
    rpm = at("spool0", flight.prop_rad_s * 30.0 / pi)
    rows["spool0"]["speed_rpm"] = rpm * (1.0 + white("spool0", RPM_SHARE))
    return Batch(numbered(rows))


def _rows(flight: SixDofFlight, name: str, rate_hz: float) -> Rows:
    count = int(flight.t_s[-1] * rate_hz)
    rows = empty_rows(name, count)
    rows["t_us"] = np.round((np.arange(count) + 0.37 * (name != "attitude")) * 1e6 / rate_hz)
    return rows


def _slow(rng: np.random.Generator, t: Array, std: float, tau: float) -> Array:
    """A first-order Markov process."""
    keep = np.exp(-np.diff(t, prepend=t[0]) / tau)
    out, value = np.empty(len(t)), std * rng.standard_normal()
    for k, draw in enumerate(rng.standard_normal(len(t))):
        value = keep[k] * value + std * np.sqrt(1.0 - keep[k] ** 2) * draw
        out[k] = value
    return out
