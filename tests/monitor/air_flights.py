"""Rows of a small aircraft in circuits, made directly as arrays: truth known, one thing broken."""

from collections.abc import Callable

import numpy as np

from links.samples import Rows, empty_rows
from monitor.verdict import PHASE_ROW, Verdict
from monitor.watch.air_bank import AirBankWatch

Flight = dict[str, Rows]
TAKE_OFF_S = 5.0
PRESSURE_PA = 95000.0
SIGMA = (PRESSURE_PA / 101325.0) ** (0.5 * 0.8097)
GRID_S = 0.05


def circuits(
    seconds: float,
    *,
    wind: tuple[float, float] | Callable[[np.ndarray], np.ndarray] = (4.0, -3.0),
    tas: float = 18.0,
    gust: float = 0.3,
    pitots: int = 2,
    straight_s: float = 20.0,
    weathercock: bool = False,
    seed: int = 0,
) -> Flight:
    """Rectangular circuits: straights of ``straight_s``, 90 degree turns at 30 degrees of bank.

    ``wind`` is constant (N, E) or a function of time giving (n, 2); ``gust`` is the rms of a first
    order gust of 3 s in each horizontal direction. With ``weathercock`` the nose follows it, as an
    aircraft's does; without, the gust is felt by the pitots alone.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, GRID_S)
    rate = 9.81 * np.tan(np.radians(30.0)) / tas
    turn_s = 0.5 * np.pi / rate
    turning = (t % (straight_s + turn_s)) > straight_s
    yaw = np.cumsum(np.where(turning, rate, 0.0)) * GRID_S
    roll = np.convolve(np.where(turning, np.radians(30.0), 0.0), np.ones(20) / 20, "same")
    W = np.zeros((len(t), 3))
    W[:, :2] = wind(t) if callable(wind) else wind
    mean_air = tas * np.column_stack((np.cos(yaw), np.sin(yaw), np.zeros(len(t))))
    g = np.zeros((len(t), 3))
    keep = np.exp(-GRID_S / 3.0)
    for k in range(1, len(t)):
        g[k] = keep * g[k - 1] + gust * np.sqrt(1 - keep**2) * rng.standard_normal(3)
    g[:, 2] *= 0.5
    V = mean_air + W
    eas = SIGMA * np.linalg.norm(V - W - g, axis=1)

    def at(hz: float, offset_s: float = 0.0) -> np.ndarray:
        return np.arange(round(offset_s / GRID_S), len(t), round(1 / (hz * GRID_S)))

    i = at(10)
    out: Flight = {"attitude": empty_rows("attitude", len(i))}
    if weathercock:
        air = mean_air - g
        yaw = yaw + np.angle((air[:, 0] + 1j * air[:, 1]) * np.exp(-1j * yaw))
    half = 0.5 * np.column_stack((roll[i], np.zeros(len(i)), yaw[i]))
    c, s = np.cos(half), np.sin(half)
    out["attitude"]["q_ned_from_frd"] = np.column_stack(
        (c[:, 0] * c[:, 2], s[:, 0] * c[:, 2], s[:, 0] * s[:, 2], c[:, 0] * s[:, 2])
    )
    out["nav"], out["baro0"] = empty_rows("nav", len(i)), empty_rows("baro0", len(i))
    out["nav"]["vel_ned_m_s"] = V[i] + 0.02 * rng.standard_normal((len(i), 3))
    out["baro0"]["static_press_pa"] = PRESSURE_PA
    for k in range(pitots):
        out[f"airspeed{k}"] = empty_rows(f"airspeed{k}", len(i))
        noise = 1.0 + 0.004 * rng.standard_normal(len(i))
        out[f"airspeed{k}"]["cas_m_s"] = 0.97 * eas[i] * noise
    for rows in out.values():
        rows["t_us"] = t[i] * 1e6
    i = at(5, 0.05)
    gps = out["gps0"] = empty_rows("gps0", len(i))
    gps["t_us"], gps["fix_type"] = t[i] * 1e6, 3
    gps["vel_ned_m_s"] = V[i] + 0.1 * rng.standard_normal((len(i), 3))
    gps["vel_ned_m_s"][:, 2] = np.nan
    out["sys_status"] = empty_rows("sys_status", 1)
    out["sys_status"]["present"] = 16
    phase = np.zeros(1, PHASE_ROW)
    phase["t_us"], phase["flying"] = TAKE_OFF_S * 1e6, True
    out["phase"] = phase
    return numbered(out)


def numbered(flight: Flight) -> Flight:
    """Give every row its arrival number."""
    t = np.concatenate([r["t_us"] for r in flight.values()])
    rank = np.empty(len(t), np.int64)
    rank[np.argsort(t, kind="stable")] = np.arange(len(t))
    start = 0
    for rows in flight.values():
        rows["seq"] = rank[start : start + len(rows)]
        start += len(rows)
    return flight


def during(flight: Flight, sensor: str, start_s: float, end_s: float = np.inf) -> np.ndarray:
    """Which rows of a sensor lie between two times."""
    t = flight[sensor]["t_us"] * 1e-6
    return (t >= start_s) & (t < end_s)


def scaled(
    flight: Flight, sensor: str, factor: float, start_s: float, end_s: float = np.inf
) -> Flight:
    """The flight with a pitot that reads ``factor`` times the truth for a while."""
    rows = flight[sensor] = flight[sensor].copy()
    rows["cas_m_s"][during(flight, sensor, start_s, end_s)] *= factor
    return flight


def judged(flight: Flight, watch: AirBankWatch) -> list[Verdict]:
    """Verdicts of the whole flight in one step."""
    return watch.step(flight, 1 << 60).verdicts


def said(verdicts: list[Verdict], sensor: str) -> list[tuple[str, float]]:
    """(state, time [s]) of every verdict on a sensor."""
    return [(str(v.state), v.t_us * 1e-6) for v in verdicts if v.sensor == sensor]
