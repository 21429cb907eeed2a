"""``summary.json``: what was watched, what was found, what was rejected (schema 1, DESIGN 6)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from links.samples import quantity_of
from links.vocabulary import State
from monitor.pipeline import Pipeline
from monitor.verdict import Verdict

__all__ = ["SCHEMA", "events", "faults", "monitored", "rejected", "streams"]

SCHEMA = "mavsentry/summary/1"

_JUDGED = frozenset({State.OK, State.SUSPECT, State.FAULTY, State.STOPPED})


def faults(verdicts: Iterable[Verdict], first_us: int) -> list[dict[str, Any]]:
    """Faults in order of detection, each from ``faulty`` to the next ``ok``.

    A sensor that goes stale or cannot be judged while it is faulty stays so: its fault is cleared
    by an ``ok`` alone. It is *detected* when something was said to be wrong and *isolated* when
    this sensor was named; most faults are both at once.

    Parameters
    ----------
    verdicts
        All verdicts in time order.
    first_us
        Vehicle time of the log's first record [us].
    """
    out: list[dict[str, Any]] = []
    standing: dict[str, dict[str, Any]] = {}
    for v in verdicts:
        if v.state is State.FAULTY and v.sensor not in standing:
            standing[v.sensor] = _fault(v, first_us)
            out.append(standing[v.sensor])
        elif v.state is State.OK and v.sensor in standing:
            standing.pop(v.sensor)["cleared_s"] = _seconds(v.t_us, first_us)
    return out


def events(verdicts: Iterable[Verdict], first_us: int) -> list[dict[str, Any]]:
    """What happened to the aircraft itself, no sensor being at fault: engines that stopped.

    In order of detection, each from ``stopped`` to the next ``ok``; parameters as of
    :func:`faults`.
    """
    out: list[dict[str, Any]] = []
    standing: dict[str, dict[str, Any]] = {}
    for v in verdicts:
        if v.state is State.STOPPED and v.sensor not in standing:
            onset_us = v.t_us if v.onset_t_us is None else v.onset_t_us
            standing[v.sensor] = {
                "what": v.sensor,
                "state": str(v.state),
                "onset_s": _seconds(onset_us, first_us),
                "detected_s": _seconds(v.t_us, first_us),
                "ended_s": None,
                "onset_t_us": onset_us,
                "detected_t_us": v.t_us,
                "statistic": _finite(v.statistic),
                "threshold": _finite(v.threshold),
                "estimator": v.estimator,
                "evidence": v.evidence,
            }
            out.append(standing[v.sensor])
        elif v.state is State.OK and v.sensor in standing:
            standing.pop(v.sensor)["ended_s"] = _seconds(v.t_us, first_us)
    return out


def monitored(verdicts: Iterable[Verdict], first_us: int, last_us: int) -> list[dict[str, Any]]:
    """Per watched sensor: seconds judged, and the spans in which it could not be judged."""
    by_sensor: dict[str, list[Verdict]] = {}
    for v in verdicts:
        by_sensor.setdefault(v.sensor, []).append(v)
    out = []
    for sensor, changes in sorted(by_sensor.items()):
        judged_us = 0
        spans: list[dict[str, Any]] = []
        for v, until_us in zip(changes, [*(c.t_us for c in changes[1:]), last_us], strict=True):
            if v.state in _JUDGED:
                judged_us += max(until_us - v.t_us, 0)
            else:
                reason = str(v.reason or v.state)
                if spans and spans[-1]["reason"] == reason and until_us > v.t_us:
                    spans[-1]["to_s"] = _seconds(until_us, first_us)
                elif until_us > v.t_us:
                    spans.append(
                        {
                            "from_s": _seconds(v.t_us, first_us),
                            "to_s": _seconds(until_us, first_us),
                            "reason": reason,
                        }
                    )
        out.append({"sensor": sensor, "seconds": judged_us / 1e6, "unmonitored": spans})
    return out


def streams(pipeline: Pipeline, sources: Mapping[str, str]) -> list[dict[str, Any]]:
    """Samples, mean rate and gaps of every sensor stream, with the messages it came from."""
    return [
        {
            "sensor": sensor,
            "source": sources.get(sensor, ""),
            "samples": stream.samples,
            "rate_hz": round(stream.rate_hz, 3),
            "gaps": stream.gaps,
        }
        for sensor, stream in sorted(pipeline.streams.items())
        if stream.timeout_us is not None or quantity_of(sensor) in ("nav", "baro", "servo")
    ]


def rejected(pipeline: Pipeline) -> dict[str, dict[str, int]]:
    """Sensor or ``frame`` -> reason -> count."""
    out: dict[str, dict[str, int]] = {}
    for (where, reason), count in sorted(pipeline.rejected.items()):
        out.setdefault(where, {})[str(reason)] = count
    return out


def _fault(v: Verdict, first_us: int) -> dict[str, Any]:
    onset_us = v.t_us if v.onset_t_us is None else v.onset_t_us
    detected_us = v.t_us if v.detected_t_us is None else v.detected_t_us
    return {
        "sensor": v.sensor,
        "onset_s": _seconds(onset_us, first_us),
        "detected_s": _seconds(detected_us, first_us),
        "isolated_s": _seconds(v.t_us, first_us),
        "cleared_s": None,
        "onset_t_us": onset_us,
        "detected_t_us": detected_us,
        "isolated_t_us": v.t_us,
        "kind": str(v.kind),
        "magnitude": _finite(v.magnitude),
        "unit": v.unit,
        "statistic": _finite(v.statistic),
        "threshold": _finite(v.threshold),
        "estimator": v.estimator,
        "evidence": v.evidence,
    }


def _seconds(t_us: int, first_us: int) -> float:
    return round((t_us - first_us) / 1e6, 3)


def _finite(value: float) -> float | None:
    """JSON has no NaN: what is not known is null."""
    return float(value) if math.isfinite(value) else None
