"""The dataset's tables: their columns with units, and the rows that one log adds to each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any, Final

import pyarrow as pa

from monitor.fleet.outcome import Outcome
from monitor.fleet.places import report_folder
from monitor.fleet.sources import Source, printable
from monitor.started import started

__all__ = ["NO_MONTH", "SCHEMAS", "AircraftRule", "rows_of"]

NO_MONTH: Final = "unknown"
"""Month of a log that tells no date, and whose name tells none."""

_DATE = re.compile(r"(?<!\d)((?:19|20)\d\d)[-_.]?(0[1-9]|1[0-2])[-_.]?(?:0[1-9]|[12]\d|3[01])")

_TEXT, _NUMBER, _COUNT, _FLAG = pa.string(), pa.float64(), pa.int64(), pa.bool_()
_TIME = pa.timestamp("us", tz="UTC")
_WHERE = [("log", _TEXT), ("month", _TEXT), ("aircraft", _TEXT)]

SCHEMAS: Final[Mapping[str, pa.Schema]] = {
    "logs": pa.schema(
        [
            *_WHERE,
            ("status", _TEXT),
            ("reason", _TEXT),
            ("copy_of", _TEXT),
            ("start", _TIME),
            ("duration_s", _NUMBER),
            ("judged_s", _NUMBER),
            ("faults", _COUNT),
            ("doubtful", _COUNT),
            ("events", _COUNT),
            ("system_id", _COUNT),
            ("autopilot", _TEXT),
            ("type", _TEXT),
            ("format", _TEXT),
            ("bytes", _COUNT),
            ("messages", _COUNT),
            ("bad_bytes", _COUNT),
            ("learnt_from_it", _FLAG),
            ("seconds", _NUMBER),
            ("report", _TEXT),
            ("sha256", _TEXT),
            ("stamp", _TEXT),
            ("key", _TEXT),
        ]
    ),
    "faults": pa.schema(
        [
            *_WHERE,
            ("sensor", _TEXT),
            ("quantity", _TEXT),
            ("kind", _TEXT),
            ("detected", _TIME),
            ("onset_s", _NUMBER),
            ("detected_s", _NUMBER),
            ("isolated_s", _NUMBER),
            ("cleared_s", _NUMBER),
            ("magnitude", _NUMBER),
            ("unit", _TEXT),
            ("statistic", _NUMBER),
            ("threshold", _NUMBER),
            ("estimator", _TEXT),
            ("evidence", _TEXT),
            ("doubts", pa.list_(_TEXT)),
            ("autopilot_agrees", _FLAG),
            ("report", _TEXT),
        ]
    ),
    "events": pa.schema(
        [
            *_WHERE,
            ("what", _TEXT),
            ("state", _TEXT),
            ("onset_s", _NUMBER),
            ("detected_s", _NUMBER),
            ("ended_s", _NUMBER),
            ("evidence", _TEXT),
            ("report", _TEXT),
        ]
    ),
    "sensors": pa.schema(
        [
            *_WHERE,
            ("sensor", _TEXT),
            ("quantity", _TEXT),
            ("judged_s", _NUMBER),
            ("not_judged_s", _NUMBER),
            ("mainly", _TEXT),
            ("faults", _COUNT),
        ]
    ),
}
"""Table -> its columns; ``month`` is the partition. Times ending in _s count from the log's first
record; ``start`` and ``detected`` are UTC."""


class AircraftRule:
    """Tells whose log it is from where it lies.

    Parameters
    ----------
    pattern
        Regular expression, searched in the log's path; its first group, or all of the match, names
        the aircraft. None, or no match: the folder that holds the log, with the system id.

    Raises
    ------
    ValueError
        It is no regular expression.
    """

    def __init__(self, pattern: str | None = None) -> None:
        try:
            self._pattern = re.compile(pattern) if pattern is not None else None
        except re.error as error:
            raise ValueError(f"{pattern!r} is no regular expression: {error}") from None

    def of(self, source: Source, vehicle: Mapping[str, Any]) -> str:
        """Name of the aircraft."""
        if self._pattern is not None:
            match = self._pattern.search(source.shown)
            if match is not None:
                return next((g for g in match.groups() if g), match.group())
        system_id = vehicle.get("system_id")
        folder = printable(source.folder)
        return f"{folder}/{system_id}" if system_id else folder


def rows_of(
    outcome: Outcome, source: Source, aircraft: AircraftRule
) -> dict[str, list[dict[str, Any]]]:
    """The rows that one log adds, by table."""
    log, vehicle = outcome["log"], outcome["vehicle"]
    start = started(log)
    where = {
        "log": source.shown,
        "month": _month(start, source.name),
        "aircraft": aircraft.of(source, vehicle),
    }
    report = report_folder(outcome["sha256"]) + "/" if outcome["files"] else ""
    by_sensor: dict[str, int] = {}
    for fault in outcome["faults"]:
        by_sensor[fault["sensor"]] = by_sensor.get(fault["sensor"], 0) + 1
    judged_s = max((s["judged_s"] for s in outcome["sensors"]), default=0.0)
    main = next((f for f in outcome["files"] if f.endswith(".html")), None)
    report += main or (outcome["files"] or [""])[0]
    return {
        "logs": [
            where
            | {k: outcome[k] for k in ("status", "reason", "sha256", "key", "seconds")}
            | {k: log.get(k) for k in ("duration_s", "format", "messages", "bad_bytes")}
            | {k: vehicle.get(k) for k in ("system_id", "autopilot", "type")}
            | {
                "copy_of": None,
                "start": start,
                "judged_s": judged_s,
                "faults": len(outcome["faults"]),
                "doubtful": sum(_doubtful(f) for f in outcome["faults"]),
                "events": len(outcome["events"]),
                "bytes": source.bytes,
                "learnt_from_it": outcome["learnt_from_it"],
                "report": report,
                "stamp": source.stamp,
            }
        ],
        "faults": [
            where
            | {k: fault.get(k) for k in SCHEMAS["faults"].names if k in fault}
            | {
                "quantity": fault["sensor"].partition(".")[0].rstrip("0123456789"),
                "detected": start and start + timedelta(seconds=fault["detected_s"]),
                "report": report,
            }
            for fault in outcome["faults"]
        ],
        "events": [
            where | {k: e.get(k) for k in SCHEMAS["events"].names if k in e} | {"report": report}
            for e in outcome["events"]
        ],
        "sensors": [
            where
            | sensor
            | {
                "quantity": sensor["sensor"].partition(".")[0].rstrip("0123456789"),
                "faults": by_sensor.get(sensor["sensor"], 0),
            }
            for sensor in outcome["sensors"]
        ],
    }


def _doubtful(fault: Mapping[str, Any]) -> bool:
    return bool(fault["doubts"]) and not fault["autopilot_agrees"]


def _month(start: datetime | None, name: str) -> str:
    if start is not None:
        return f"{start:%Y-%m}"
    match = _DATE.search(name)
    return f"{match[1]}-{match[2]}" if match else NO_MONTH
