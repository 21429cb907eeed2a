"""Summaries of flights that did not happen, for the parts of the report that need no more."""

from __future__ import annotations

from typing import Any


def span(from_s: float, to_s: float, reason: str) -> dict[str, Any]:
    return {"from_s": from_s, "to_s": to_s, "reason": reason}


def watched(sensor: str, seconds: float, *unmonitored: dict[str, Any]) -> dict[str, Any]:
    return {"sensor": sensor, "seconds": seconds, "unmonitored": list(unmonitored)}


def stream(sensor: str, **changed: Any) -> dict[str, Any]:
    entry = {"sensor": sensor, "source": "X", "samples": 3000, "rate_hz": 10.0, "gaps": 0}
    return entry | changed


def fault(sensor: str, onset_s: float, detected_s: float, **changed: Any) -> dict[str, Any]:
    return {
        "sensor": sensor,
        "onset_s": onset_s,
        "detected_s": detected_s,
        "isolated_s": detected_s,
        "cleared_s": None,
        "kind": "bias",
        "magnitude": 1.5,
        "unit": "m/s^2",
        "statistic": 12.0,
        "threshold": 6.0,
        "estimator": "ins_bank",
        "evidence": "acc_x is high",
    } | changed


def said(
    sensor: str, from_s: float, to_s: float | None = None, check: str = "disabled"
) -> dict[str, Any]:
    return {"sensor": sensor, "check": check, "from_s": from_s, "to_s": to_s, "evidence": "so"}


def summary(**changed: Any) -> dict[str, Any]:
    """A healthy flight of 300 s with an IMU, a pitot, a receiver; 30 s on the ground at first."""
    ground = span(0.0, 30.0, "on ground")
    log = {
        "path": "flight.tlog",
        "format": "tlog",
        "bytes": 1_000_000,
        "messages": 20_000,
        "bad_bytes": 0,
        "duration_s": 300.0,
        "first_t_us": 0,
        "start_unix_us": None,
        "gaps": [],
        "boots_s": [],
        "notes": [],
    }
    baselines = {
        "settings": {},
        "ardupilot": [],
        "px4": [],
        "autopilot_said": [],
        "lanes_lost_s": 0.0,
    }
    return {
        "schema": "mavsentry/summary/1",
        "log": log | changed.pop("log", {}),
        "vehicle": {"system_id": 1, "autopilot": "ARDUPILOTMEGA", "type": "FIXED_WING"},
        "streams": [stream(s) for s in ("airspeed0", "attitude", "gps0", "imu0", "nav")],
        "monitored": [
            watched("airspeed0", 240.0, ground, span(30.0, 60.0, "learning")),
            watched("gps0", 300.0),
            watched("imu0.acc_x", 268.0, ground, span(30.0, 32.0, "learning")),
            watched("imu0.gyro_z", 268.0, ground, span(30.0, 32.0, "learning")),
        ],
        "faults": [],
        "events": [],
        "rejected": {},
        "left_out": {"verdicts": 0, "faults": 0, "events": 0, "spans": 0},
        "learnt": None,
        "baselines": baselines | changed.pop("baselines", {}),
        "made_by": {"version": "0.1", "profile": "small-uav", "changed": {}},
    } | changed
