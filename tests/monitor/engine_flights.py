"""Flights of the six-degree-of-freedom Aerosonde as rows, with engine speeds and an engine cut.

The airframe, its propeller and the wind are JSBSim's and sim_feeds'; what the engine watch is told
comes from there: nothing here knows the watch's models.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from links.samples import Batch, Rows, empty_rows

Floats = NDArray[np.float64]

BOOT_S = 20.0
RUNNING_S = 10.0
"""Rows begin so long before takeoff is seen: the stream starts in the air."""
RPM = 60.0 / (2.0 * np.pi)


@cache
def aerosonde(
    seed: int, wind_share: float = 0.22, duration_s: float = 150.0, cut_s: float | None = None
) -> dict[str, Floats]:
    """Truth at 20 Hz: t, throttle command, prop speed [rpm], height, airspeed, ground velocity."""
    pytest.importorskip("jsbsim")
    from sim_feeds.sixdof import aerosonde as a
    from sim_feeds.sixdof.engine import Engine, Gauge, Gauges
    from sim_feeds.sixdof.loop import eyes, fly
    from sim_feeds.sixdof.pilot import AEROSONDE_GAINS, Pilot

    engine = Engine("aerosonde", dt_s=a.STEP_S)
    rng = np.random.default_rng([seed, 5])
    toward, speed = rng.uniform(0.0, 2.0 * np.pi), wind_share * a.CRUISE_M_S
    mean = np.array([speed * np.cos(toward), speed * np.sin(toward), 0.0])
    settle = round(a.SETTLE_S / a.STEP_S)
    t = np.arange(-settle, round(duration_s / a.STEP_S) + 1) * a.STEP_S
    a._start(engine, mean)
    pilot = Pilot(AEROSONDE_GAINS, a.WAYPOINTS_M, a.HEIGHT_M, a.CRUISE_M_S, a.CONTROL_S)
    look = eyes(engine, a.ORIGIN)
    events = {}
    if cut_s is not None:
        events[settle + round(cut_s / a.STEP_S)] = {"motor/R-ohm": 1e6, "motor/V-max": 0.0}
    gauges = Gauges(engine, [*a.KEPT, Gauge("order", "fcs/throttle-cmd-norm")])
    rows = fly(
        engine,
        lambda: pilot.steer(look()),
        a._gusts(t, speed, 1.0, rng),
        events,
        gauges,
        control_every=round(a.CONTROL_S / a.STEP_S),
        keep_from=settle,
        keep_every=10,
    )
    f = dict(zip(gauges.names, rows.T, strict=True))
    return {
        "t": np.arange(len(rows)) * 0.05,
        "throttle": f["order"],
        "rpm": f["prop"] * RPM,
        "height": f["height"],
        "tas": f["tas"],
        "vel": np.column_stack([f["vel_n"], f["vel_e"], f["vel_d"]]),
    }


def batch_of(
    f: dict[str, Floats], channels: int = 1, noise_rpm: float = 20.0, seed: int = 0
) -> Batch:
    """Rows as an autopilot sends them; `channels` engine speeds of the one shaft at 10 Hz."""
    rng = np.random.default_rng([seed, 9])
    t = f["t"]
    rows: dict[str, Rows] = {}

    def of(sensor: str, rate_hz: float, offset_s: float) -> tuple[Rows, Floats]:
        at = np.arange(offset_s, t[-1], 1.0 / rate_hz)
        rows[sensor] = empty_rows(sensor, len(at))
        rows[sensor]["t_us"] = np.round((at + BOOT_S) * 1e6)
        return rows[sensor], at

    def put(name: str, at: Floats) -> Floats:
        return np.interp(at, t, f[name])

    r, at = of("servo", 10.0, 0.013)
    r["pwm_us"][:, :4] = 1500.0
    r["pwm_us"][:, 2] = np.round(1000.0 + 1000.0 * put("throttle", at))
    for i in range(channels):
        r, at = of(f"spool{i}", 10.0, 0.021 + 0.002 * i)
        r["speed_rpm"] = put("rpm", at) + noise_rpm * rng.standard_normal(len(at))
    r, at = of("airspeed0", 10.0, 0.034)
    r["cas_m_s"] = put("tas", at) * 0.99 + 0.2 * rng.standard_normal(len(at))
    r, at = of("baro0", 10.0, 0.035)
    r["static_press_pa"] = 101325.0 * (1.0 - put("height", at) / 44330.8) ** (1.0 / 0.190263)
    r["static_press_pa"] += 2.0 * rng.standard_normal(len(at))
    for sensor, rate_hz in (("gps0", 5.0), ("nav", 5.0)):
        r, at = of(sensor, rate_hz, 0.041)
        for axis in range(3):
            r["vel_ned_m_s"][:, axis] = np.interp(at, t, f["vel"][:, axis])
        r["vel_ned_m_s"] += 0.05 * rng.standard_normal((len(at), 3))
        r["alt_m"] = put("height", at) + 0.3 * rng.standard_normal(len(at))
        if sensor == "gps0":
            r["fix_type"], r["satellites"] = 3, 12
    when = np.concatenate([r["t_us"] for r in rows.values()])
    numbers = np.empty(len(when), np.int64)
    numbers[np.argsort(when, kind="stable")] = np.arange(len(when))
    first = 0
    for r in rows.values():
        r["seq"] = numbers[first : first + len(r)]
        first += len(r)
    return Batch(rows)
