"""Loads every kernel of the pipeline before the first real sample needs it.

A compiled kernel is loaded (or, the first time on a machine, compiled) at its first call, which
takes from milliseconds to seconds. The pipeline is therefore first shown a made-up flight: level,
with all kinds of sensors, some of which break, so that every branch of the watches is called.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from estimators.jit import is_cold
from links.logs import dataflash
from links.mavlink import Decoder, encode
from links.samples import Batch, Rows, empty_rows
from monitor.baselines import BaselineTap
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import PHASE_ROW
from monitor.watch import build_watches
from monitor.watch.air_bank import AirBankWatch

__all__ = ["COMPILING", "PARTS", "compile_part", "made_up_flight", "numbered", "warm_up"]

DURATION_S = 90.0
FAULTS_FROM_S = 60.0
COMPILING = (
    "mavsentry: compiling kernels, once on this machine, takes several minutes; "
    "`mavsentry warmup` does it ahead"
)

PARTS: Final = ("air", "imu", "engine", "wing")
"""Watches, whose kernels may be compiled beside each other; those that take longest first."""

_RATES_HZ = {"imu": 25.0, "attitude": 10.0, "gps": 5.0, "nav": 5.0, "airspeed": 5.0, "baro": 5.0}
_CRUISE_RPM = 5000.0
_SENSORS = (
    "imu0",
    "imu1",
    "attitude",
    "gps0",
    "nav",
    "airspeed0",
    "airspeed1",
    "airspeed2",
    "aoa0",
    "aoa1",
    "aoa2",
    "baro0",
    "servo",
    "spool0",
    "demand",
    "sys_status",
    "heartbeat",
)
_G0_M_S2 = 9.80665
_EARTH_M = 6.371e6
_AOA_RAD = 0.05
_ALT_M, _STATIC_PRESS_PA = 200.0, 98945.0


def warm_up(settings: Settings, say: Callable[[str], None] = lambda text: None) -> float:
    """Run the made-up flight through a pipeline of these settings; return the time taken [s].

    Parameters
    ----------
    settings
        Which watches are built.
    say
        Told in one sentence when kernels must be compiled first.

    Returns
    -------
    float
        Time taken [s].
    """
    began_s = time.monotonic()
    if is_cold():
        say(COMPILING)
    beat = encode("HEARTBEAT", type=1, autopilot=3)
    Decoder(settings.links.decoder_options()).feed(beat + encode("ATTITUDE", time_boot_ms=1))
    dataflash.warm_up()
    pipeline = Pipeline(settings, taps=[BaselineTap()])
    pipeline.feed(made_up_flight(2.0 * settings.phase.flying_speed_m_s))
    pipeline.finish()
    AirBankWatch(settings.air).step(circling(2.0 * settings.phase.flying_speed_m_s), 1 << 62)
    return time.monotonic() - began_s


def compile_part(part: str, step: Callable[[], None]) -> None:
    """Compile the kernels of one watch, of :data:`PARTS`; ``step`` is called when it is done."""
    settings = Settings()
    speed_m_s = 2.0 * settings.phase.flying_speed_m_s
    watches = [watch for watch in build_watches(settings) if watch.name == part]
    pipeline = Pipeline(settings, watches=watches)
    pipeline.feed(made_up_flight(speed_m_s))
    pipeline.finish()
    if part == "air":
        AirBankWatch(settings.air).step(circling(speed_m_s), 1 << 62)
    step()


def made_up_flight(speed_m_s: float) -> Batch:
    """Straight and level flight north in still air, in which sensors break.

    Parameters
    ----------
    speed_m_s
        Speed over ground and through the air [m/s].
    """
    random = np.random.default_rng(0)
    rows = {name: _rows(name) for name in _SENSORS}
    for name, r in rows.items():
        t_s = r["t_us"] / 1e6
        late = t_s > FAULTS_FROM_S
        noise = random.standard_normal(len(r))
        if name.startswith("imu"):
            r["acc_m_s2"] = (_G0_M_S2 * np.sin(_AOA_RAD), 0.0, -_G0_M_S2 * np.cos(_AOA_RAD))
            r["acc_m_s2"] += 0.05 * random.standard_normal((len(r), 3))
            r["gyro_rad_s"] = 0.002 * random.standard_normal((len(r), 3))
            r["acc_m_s2"][late & (name == "imu0"), 0] += 3.0
        elif name == "attitude":
            r["q_ned_from_frd"] = (np.cos(_AOA_RAD / 2), 0.0, np.sin(_AOA_RAD / 2), 0.0)
        elif name in ("gps0", "nav"):
            r["vel_ned_m_s"][:, 0] = speed_m_s + 0.05 * noise
            r["alt_m"] = _ALT_M
            r["lat_rad"], r["lon_rad"] = 0.8 + speed_m_s * t_s / _EARTH_M, 0.1
            if name == "gps0":
                r["fix_type"], r["satellites"], r["vel_std_m_s"] = 3, 12, 0.1
                r["h_std_m"], r["v_std_m"], r["stamp_us"] = 1.0, 1.5, r["t_us"]
            else:
                r["height_m"] = r["alt_m"]
        elif name.startswith("airspeed"):
            r["cas_m_s"] = speed_m_s + 0.1 * noise
            r["cas_m_s"][late & (name == "airspeed0")] *= 0.5
            r["diff_press_pa"] = r["cas_m_s"] ** 2 / 2.0
        elif name.startswith("aoa"):
            r["aoa_rad"] = _AOA_RAD + 0.002 * noise
            r["aoa_rad"][late & (name == "aoa0")] += 0.2
        elif name == "baro0":
            r["static_press_pa"], r["temperature_k"] = _STATIC_PRESS_PA + noise, 286.85
        elif name == "servo":
            r["pwm_us"][:, 2] = 1500.0 + 100.0 * np.sin(t_s)
        elif name == "spool0":
            r["speed_rpm"] = _CRUISE_RPM * (1.0 + 0.2 * np.sin(t_s)) + 5.0 * noise
            r["speed_rpm"][late] = 0.0
        elif name == "heartbeat":
            r["vehicle_type"], r["autopilot"], r["armed"], r["system_status"] = 1, 3, True, 4
    return Batch(numbered(rows))


def circling(speed_m_s: float) -> dict[str, Rows]:
    """What the pitot bank sees of circles in still air: it learns scales in turns alone.

    The long horizon beside it begins with the first scale that is learnt.

    Parameters
    ----------
    speed_m_s
        Speed over ground and through the air [m/s].
    """
    random = np.random.default_rng(0)
    rows = {s: _rows(s) for s in ("attitude", "gps0", "nav", "airspeed0", "airspeed1", "baro0")}
    rate_rad_s = np.pi / 15.0
    half_bank = 0.5 * np.arctan(speed_m_s * rate_rad_s / _G0_M_S2)
    for name, r in rows.items():
        yaw = rate_rad_s * r["t_us"] / 1e6
        if name == "attitude":
            c, s, cb, sb = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(half_bank), np.sin(half_bank)
            r["q_ned_from_frd"] = np.column_stack((c * cb, c * sb, s * sb, s * cb))
        elif name in ("gps0", "nav"):
            r["vel_ned_m_s"][:, 0] = speed_m_s * np.cos(yaw)
            r["vel_ned_m_s"][:, 1] = speed_m_s * np.sin(yaw)
            if name == "gps0":
                r["fix_type"] = 3
        elif name == "baro0":
            r["static_press_pa"] = _STATIC_PRESS_PA
        else:
            r["cas_m_s"] = speed_m_s + 0.1 * random.standard_normal(len(r))
    rows["phase"] = np.array([(0, 0, True)], PHASE_ROW)
    return numbered(rows)


def _rows(sensor: str) -> Rows:
    """Rows of the sensor's rate over the whole flight, times set."""
    rate_hz = _RATES_HZ.get(sensor.rstrip("0123456789"), 5.0)
    rows = empty_rows(sensor, round(DURATION_S * rate_hz))
    rows["t_us"] = np.round(np.arange(1, len(rows) + 1) * 1e6 / rate_hz)
    return rows


def numbered(rows: dict[str, Rows]) -> dict[str, Rows]:
    """Arrival numbers over all sensors, in time order."""
    t_us = np.concatenate([r["t_us"] for r in rows.values()])
    numbers = np.empty(len(t_us), np.int64)
    numbers[np.argsort(t_us, kind="stable")] = np.arange(len(t_us))
    at = 0
    for r in rows.values():
        r["seq"] = numbers[at : at + len(r)]
        at += len(r)
    return rows
