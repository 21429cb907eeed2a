"""What is kept of one log: a JSON object that depends on the log's bytes, settings and code alone.

Where the log lies, and whose it is, stands in the dataset; a log that was moved keeps its outcome.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any

from monitor.fleet.doubts import autopilot_agrees, doubts

__all__ = ["SCHEMA", "Outcome", "Status", "failed", "judged", "read_outcome", "unusable"]

SCHEMA = "mavsentry/fleet-outcome/1"

Outcome = dict[str, Any]
"""``schema``, ``key``, ``sha256``, ``status``, ``reason``, ``log``, ``vehicle``, ``faults``,
``events``, ``sensors``, ``files``, ``seconds``: as :func:`judged` fills it."""


class Status(StrEnum):
    """What became of a log."""

    JUDGED = "judged"
    UNUSABLE = "unusable"
    """Nothing can be made of its bytes; the next run knows that."""
    FAILED = "failed"
    """It could not be read, took too long, or something broke; the next run tries it again."""
    COPY = "copy"
    """Its bytes are those of another log, which stands for both."""


def judged(
    key: str, sha256: str, summary: Mapping[str, Any], files: Sequence[str], seconds: float
) -> Outcome:
    """Outcome of a log that was analyzed.

    Parameters
    ----------
    key
        Digest of settings and code.
    sha256
        Of the log's bytes.
    summary
        Its ``summary.json``.
    files
        Names of the files written for it.
    seconds
        What it took [s].
    """
    fields = ("format", "bytes", "messages", "bad_bytes", "duration_s", "start_unix_us")
    return _outcome(key, sha256, Status.JUDGED, seconds=seconds) | {
        "log": {field: summary["log"].get(field) for field in fields},
        "vehicle": dict(summary["vehicle"]),
        "learnt_from_it": bool((summary.get("learnt") or {}).get("from_this_flight", False)),
        "faults": [
            dict(fault)
            | {
                "doubts": [str(d) for d in doubts(fault, summary)],
                "autopilot_agrees": autopilot_agrees(fault, summary),
            }
            for fault in summary["faults"]
        ],
        "events": [dict(event) for event in summary.get("events", ())],
        "sensors": [_sensor(monitored) for monitored in summary["monitored"]],
        "files": list(files),
    }


def unusable(key: str, sha256: str, reason: str, seconds: float) -> Outcome:
    """Outcome of a log of whose bytes nothing can be made."""
    return _outcome(key, sha256, Status.UNUSABLE, reason, seconds)


def failed(key: str, reason: str, sha256: str = "") -> Outcome:
    """Outcome of a log that could not be judged this time."""
    return _outcome(key, sha256, Status.FAILED, reason)


def read_outcome(text: bytes | None, key: str) -> Outcome | None:
    """A kept outcome, if it is whole and was made with these settings and this code."""
    if text is None:
        return None
    try:
        outcome: Outcome = json.loads(text)
        fits = outcome["schema"] == SCHEMA and outcome["key"] == key
    except (ValueError, KeyError, TypeError):
        return None
    return outcome if fits else None


def _outcome(
    key: str, sha256: str, status: Status, reason: str = "", seconds: float = 0.0
) -> Outcome:
    return {
        "schema": SCHEMA,
        "key": key,
        "sha256": sha256,
        "status": str(status),
        "reason": reason,
        "log": {},
        "vehicle": {},
        "learnt_from_it": False,
        "faults": [],
        "events": [],
        "sensors": [],
        "files": [],
        "seconds": round(seconds, 3),
    }


def _sensor(monitored: Mapping[str, Any]) -> dict[str, Any]:
    """A watched sensor: how long it was judged, and for how long and why it was not."""
    spans: dict[str, float] = defaultdict(float)
    for span in monitored["unmonitored"]:
        spans[str(span["reason"])] += span["to_s"] - span["from_s"]
    main = max(spans, key=lambda reason: spans[reason], default="")
    return {
        "sensor": monitored["sensor"],
        "judged_s": monitored["seconds"],
        "not_judged_s": round(sum(spans.values()), 3),
        "mainly": main,
    }
