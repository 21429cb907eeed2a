"""A fleet of logs that nobody flew: outcomes as :func:`monitor.fleet.outcome.judged` makes them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import pyarrow as pa

from monitor.fleet.dataset import Results, merged
from monitor.fleet.outcome import Outcome, failed, judged, unusable
from monitor.fleet.sources import Source
from monitor.fleet.tables import SCHEMAS, AircraftRule

KEY = "settings-and-code"
SENSORS = ("airspeed0", "gps0", "imu0.acc_x", "imu0.acc_y")

Entry = tuple[str, Outcome]
"""A log's path and what became of it."""


def span(from_s: float, to_s: float, reason: str) -> dict[str, Any]:
    return {"from_s": from_s, "to_s": to_s, "reason": reason}


def fault(sensor: str = "airspeed0", onset_s: float = 600.0, **more: Any) -> dict[str, Any]:
    given = {
        "sensor": sensor,
        "onset_s": onset_s,
        "detected_s": onset_s + 2.0,
        "isolated_s": onset_s + 3.0,
        "cleared_s": None,
        "kind": "bias",
        "magnitude": 1.5,
        "unit": "m/s",
        "statistic": 9.0,
        "threshold": 6.0,
        "estimator": "bank",
        "evidence": "reads 1.5 m/s high",
    }
    return given | more


def summary(
    faults: Sequence[dict[str, Any]] = (), month: int = 3, hours: float = 0.5, **more: Any
) -> dict[str, Any]:
    """A flight that was on the ground for a minute, and then judged for so many hours."""
    ground = [span(0.0, 60.0, "on ground")]
    start = datetime(2026, month, 5, 12, tzinfo=UTC)
    given = {
        "log": {
            "format": "tlog",
            "bytes": 9,
            "messages": 90,
            "bad_bytes": 0,
            "duration_s": 60.0 + 3600.0 * hours,
            "start_unix_us": round(start.timestamp() * 1e6),
        },
        "vehicle": {"system_id": 1, "autopilot": "ARDUPILOTMEGA", "type": "FIXED_WING"},
        "monitored": [
            {"sensor": sensor, "seconds": 3600.0 * hours, "unmonitored": ground}
            for sensor in SENSORS
        ],
        "faults": list(faults),
        "events": [],
        "baselines": {"ardupilot": [], "px4": []},
    }
    return given | more


def flight(
    path: str, faults: Sequence[dict[str, Any]] = (), digest: str = "", **more: Any
) -> Entry:
    sha256 = (digest or f"{abs(hash(path)):x}").ljust(64, "0")
    return path, judged(KEY, sha256, summary(faults, **more), ["summary.json"], 1.0)


def lost(path: str, reason: str, *, again: bool = False) -> Entry:
    if again:
        return path, failed(KEY, reason)
    return path, unusable(KEY, f"{abs(hash(path)):x}".ljust(64, "0"), reason, 0.1)


def dataset(*entries: Entry) -> dict[str, pa.Table]:
    """The tables of a fleet of these logs."""
    results = Results(AircraftRule(r"/(plane-[^/]*)/"))
    for path, outcome in entries:
        results.add(Source(path, 9, "stamp"), outcome)
    empty = {name: schema.empty_table() for name, schema in SCHEMAS.items()}
    return merged(empty, results.tables())
