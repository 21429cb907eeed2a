"""Synthetic flights for the tests of the IMU watch: scenarios to the rows that the watch gets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from links.samples import QUANTITIES, Rows, quantity_of
from links.vocabulary import State
from monitor.settings.imu import ImuSettings
from monitor.verdict import PHASE_ROW, StepResult, Verdict
from monitor.watch.imu import ImuWatch
from sim_feeds.scenario import Flight, Scenario

MILLI_G = 0.00980665

LEGS: dict[str, tuple[float, float, tuple[tuple[float, float], ...]]] = {
    "small-uav": (20.0, 150.0, ((90, 30), (-90, 30), (180, 35), (-90, 25))),
    "transport": (100.0, 1500.0, ((40, 20), (-40, 20), (60, 25))),
}
"""Airspeed, height, and turns (angle, bank) with 20 s of level flight before each."""


def scenario(
    aircraft: str,
    faults: Sequence[dict[str, Any]] = (),
    imus: int = 2,
    follows: int | None = 0,
    seed: int = 1,
    wind: Sequence[dict[str, Any]] = (),
) -> Scenario:
    """A flight that is in the air from its first moment."""
    speed, agl, turns = LEGS[aircraft]
    legs: list[dict[str, Any]] = []
    for angle, bank in turns:
        legs.append({"do": "level", "duration_s": 20.0})
        legs.append({"do": "turn", "angle_deg": float(angle), "bank_deg": float(bank)})
    legs.append({"do": "level", "duration_s": 20.0})
    return Scenario.model_validate(
        {
            "title": "test flight",
            "aircraft": aircraft,
            "seed": seed,
            "start": {"speed_m_s": speed, "agl_m": agl, "heading_deg": 20.0},
            "leg": legs,
            "fault": list(faults),
            "imu": {"count": imus},
            "wind": list(wind),
            "autopilot": {} if follows is None else {"attitude_follows_imu": follows},
        }
    )


def fault(axis: str, size: float, start_s: float, end_s: float | None = None) -> dict[str, Any]:
    """A bias on one axis: m/s^2 or deg/s."""
    unit = "size_m_s2" if ".acc" in axis else "size_deg_s"
    out = {"sensor": axis, "kind": "bias", "start_s": start_s, unit: size}
    return out if end_s is None else out | {"end_s": end_s}


def rows_of(flight: Flight) -> dict[str, Rows]:
    """Rows per sensor as RAW_IMU, GPS_RAW_INT, SCALED_PRESSURE and ATTITUDE carry them."""
    rows: dict[str, Rows] = {}
    for sensor, series in flight.readings.items():
        quantity = sensor.rstrip("0123456789")
        if quantity not in ("imu", "gps", "baro"):
            continue
        values, t = series.values, series.valid_s
        out = np.zeros(len(t), QUANTITIES[quantity])
        out["t_us"] = np.round(t * 1e6)
        if quantity == "imu":
            keep = np.isfinite(values).all(axis=1)
            out["acc_m_s2"] = np.round(values[:, :3] / MILLI_G) * MILLI_G
            out["gyro_rad_s"] = np.round(values[:, 3:], 3)
            out = out[keep]
        elif quantity == "gps":
            out["fix_type"] = 3
            out["lat_rad"], out["lon_rad"], out["alt_m"] = values[:, :3].T
            out["vel_ned_m_s"] = values[:, 3:6]
            out["vel_ned_m_s"][:, 2] = np.nan
            out["vel_std_m_s"] = np.nan
        else:
            out["static_press_pa"], out["temperature_k"] = values.T
        rows[sensor] = out
    n = flight.navigation
    rows["attitude"] = np.zeros(len(n.t_s), QUANTITIES["attitude"])
    rows["attitude"]["t_us"] = np.round(n.t_s * 1e6)
    rows["attitude"]["q_ned_from_frd"] = n.q_ned_from_frd
    _number(rows)
    rows["phase"] = np.zeros(1, PHASE_ROW)
    rows["phase"]["t_us"] = min(int(r["t_us"][0]) for r in rows.values() if len(r)) + 1
    rows["phase"]["flying"] = True
    return rows


def _number(rows: dict[str, Rows]) -> None:
    """Arrival numbers in order of time."""
    times = np.concatenate([r["t_us"] for r in rows.values()])
    rank = np.argsort(np.argsort(times, kind="stable"), kind="stable")
    at = 0
    for r in rows.values():
        r["seq"] = rank[at : at + len(r)]
        at += len(r)


def judge(rows: dict[str, Rows], **settings: Any) -> StepResult:
    """All rows through a watch in one step."""
    return ImuWatch(ImuSettings(**settings)).step(rows, 1 << 60)


def pieces(rows: dict[str, Rows], cuts_us: Sequence[int], **settings: Any) -> StepResult:
    """The same rows in steps that end at the given times."""
    watch, out = ImuWatch(ImuSettings(**settings)), StepResult()
    edges = [*sorted(cuts_us), 1 << 60]
    last = -(1 << 60)
    for edge in edges:
        part = {s: r[(r["t_us"] >= last) & (r["t_us"] < edge)] for s, r in rows.items()}
        result = watch.step({s: r for s, r in part.items() if len(r)}, edge)
        out.verdicts += result.verdicts
        for name, e in result.estimates.items():
            before = out.estimates.get(name)
            out.estimates[name] = e if before is None else np.concatenate((before, e))
        last = edge
    return out


def start_us(rows: dict[str, Rows]) -> int:
    """Time of the first row that is not the phase."""
    return min(int(r["t_us"][0]) for s, r in rows.items() if s != "phase" and quantity_of(s))


def faults_of(result: StepResult) -> list[Verdict]:
    """Verdicts that call a fault."""
    return [v for v in result.verdicts if v.state is State.FAULTY]
