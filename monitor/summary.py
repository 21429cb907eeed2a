"""``summary.json``: what was watched, what was found, what was rejected (schema 1, DESIGN 6)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from links.samples import quantity_of
from links.vocabulary import State
from monitor.pipeline import Pipeline
from monitor.verdict import Verdict

__all__ = ["SCHEMA", "Ledger", "events", "faults", "monitored", "rejected", "streams"]

SCHEMA = "mavsentry/summary/1"

KEPT_VERDICTS: Final = 100_000
"""Changes of state that are kept: 60 MB; an hour of an ordinary flight has some hundred."""

LISTED: Final = 2_000
"""Faults, events, and spans of one sensor that are listed."""

_JUDGED = frozenset({State.OK, State.SUSPECT, State.FAULTY, State.STOPPED})


class Ledger:
    """Account of a stream's verdicts as they come, in bounded memory.

    Attributes
    ----------
    verdicts
        The first :data:`KEPT_VERDICTS` changes of state, in time order.
    standing
        Sensor -> its newest verdict.
    left_out
        How many of what was not listed any more: a stream on which states change without end.
    """

    def __init__(self) -> None:
        self.verdicts: list[Verdict] = []
        self.standing: dict[str, Verdict] = {}
        self.left_out = {"verdicts": 0, "faults": 0, "events": 0, "spans": 0}
        self._faults: list[_Entry] = []
        self._events: list[_Entry] = []
        self._open_faults: dict[str, _Entry] = {}
        self._open_events: dict[str, _Entry] = {}
        self._accounts: dict[str, _Account] = {}

    def add(self, verdicts: Iterable[Verdict]) -> None:
        """Use verdicts in time order."""
        for v in verdicts:
            self._keep(v, self.verdicts, "verdicts", KEPT_VERDICTS)
            if v.state is State.FAULTY and v.sensor not in self._open_faults:
                entry = self._open_faults[v.sensor] = _Entry(v)
                self._keep(entry, self._faults, "faults", LISTED)
            elif v.state is State.STOPPED and v.sensor not in self._open_events:
                entry = self._open_events[v.sensor] = _Entry(v)
                self._keep(entry, self._events, "events", LISTED)
            elif v.state is State.OK:
                for standing in (self._open_faults, self._open_events):
                    if v.sensor in standing:
                        standing.pop(v.sensor).ended_us = v.t_us
            account = self._accounts.setdefault(v.sensor, _Account())
            if v.sensor in self.standing:
                self.left_out["spans"] += account.close(self.standing[v.sensor], v.t_us)
            self.standing[v.sensor] = v

    def _keep(self, what: Any, kept: list[Any], name: str, bound: int) -> None:
        if len(kept) < bound:
            kept.append(what)
        else:
            self.left_out[name] += 1

    def faults(self, first_us: int) -> list[dict[str, Any]]:
        """``faults`` of the summary; see :func:`faults`."""
        return [_fault(entry, first_us) for entry in self._faults]

    def events(self, first_us: int) -> list[dict[str, Any]]:
        """``events`` of the summary; see :func:`events`."""
        return [_event(entry, first_us) for entry in self._events]

    def monitored(self, first_us: int, last_us: int) -> list[dict[str, Any]]:
        """``monitored`` of the summary; see :func:`monitored`."""
        out = []
        for sensor, account in sorted(self._accounts.items()):
            account = _Account(account.judged_us, [replace(span) for span in account.spans])
            account.close(self.standing[sensor], last_us)
            spans = [
                {
                    "from_s": _seconds(span.from_us, first_us),
                    "to_s": _seconds(span.to_us, first_us),
                    "reason": span.reason,
                }
                for span in account.spans
            ]
            seconds = account.judged_us / 1e6
            out.append({"sensor": sensor, "seconds": seconds, "unmonitored": spans})
        return out


@dataclass(slots=True)
class _Entry:
    """A fault or an event, and the ``ok`` that ended it."""

    verdict: Verdict
    ended_us: int | None = None


@dataclass(slots=True)
class _Span:
    """A time in which a sensor could not be judged."""

    from_us: int
    to_us: int
    reason: str


@dataclass(slots=True)
class _Account:
    """How long one sensor was judged, and when it was not."""

    judged_us: int = 0
    spans: list[_Span] = field(default_factory=list)

    def close(self, v: Verdict, until_us: int) -> int:
        """The verdict stood until then; return how many spans there was no room for."""
        if v.state in _JUDGED:
            self.judged_us += max(until_us - v.t_us, 0)
        elif until_us > v.t_us:
            reason = str(v.reason or v.state)
            last = self.spans[-1] if self.spans else None
            if last is not None and (last.reason, last.to_us) == (reason, v.t_us):
                last.to_us = until_us
            elif len(self.spans) < LISTED:
                self.spans.append(_Span(v.t_us, until_us, reason))
            else:
                return 1
        return 0


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
    return _ledger(verdicts).faults(first_us)


def events(verdicts: Iterable[Verdict], first_us: int) -> list[dict[str, Any]]:
    """What happened to the aircraft itself, no sensor being at fault: engines that stopped.

    In order of detection, each from ``stopped`` to the next ``ok``; parameters as of
    :func:`faults`.
    """
    return _ledger(verdicts).events(first_us)


def monitored(verdicts: Iterable[Verdict], first_us: int, last_us: int) -> list[dict[str, Any]]:
    """Per watched sensor: seconds judged, and the spans in which it could not be judged."""
    return _ledger(verdicts).monitored(first_us, last_us)


def _ledger(verdicts: Iterable[Verdict]) -> Ledger:
    ledger = Ledger()
    ledger.add(verdicts)
    return ledger


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


def _fault(entry: _Entry, first_us: int) -> dict[str, Any]:
    v = entry.verdict
    onset_us = v.t_us if v.onset_t_us is None else v.onset_t_us
    detected_us = v.t_us if v.detected_t_us is None else v.detected_t_us
    return {
        "sensor": v.sensor,
        "onset_s": _seconds(onset_us, first_us),
        "detected_s": _seconds(detected_us, first_us),
        "isolated_s": _seconds(v.t_us, first_us),
        "cleared_s": None if entry.ended_us is None else _seconds(entry.ended_us, first_us),
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


def _event(entry: _Entry, first_us: int) -> dict[str, Any]:
    v = entry.verdict
    onset_us = v.t_us if v.onset_t_us is None else v.onset_t_us
    return {
        "what": v.sensor,
        "state": str(v.state),
        "onset_s": _seconds(onset_us, first_us),
        "detected_s": _seconds(v.t_us, first_us),
        "ended_s": None if entry.ended_us is None else _seconds(entry.ended_us, first_us),
        "onset_t_us": onset_us,
        "detected_t_us": v.t_us,
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
