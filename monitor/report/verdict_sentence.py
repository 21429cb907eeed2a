"""The verdict in one sentence, what belongs beside it, and the facts of the flight.

The sentence says no more than what was judged. That nothing was found is said of the sensors that
could be judged; what could not be, and what was doubted without being named, follows at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Final

from links.vocabulary import Kind, Reason, State
from monitor.pages.html import clock
from monitor.pages.palette import LOOKS, Look
from monitor.pages.units import quantity
from monitor.report.wording import count, lasting, listed
from monitor.started import started

if TYPE_CHECKING:
    from monitor.report.flight import Flight
    from monitor.report.spans import Span

__all__ = ["Fact", "Top", "top", "what_it_did"]

NAMED: Final = 4
"""Faults, or sensors, that a sentence names; the rest it counts."""

_DID: Final = {
    Kind.STUCK: "always read the same",
    Kind.DROPOUT: "was dead",
    Kind.NOISE: "was noisy",
    Kind.OSCILLATION: "oscillated",
    Kind.RUNAWAY: "ran away",
    Kind.DRIFT: "drifted",
}
_AUTOPILOTS: Final = {"ARDUPILOTMEGA": "ArduPilot", "PX4": "PX4", "GENERIC": "generic autopilot"}


@dataclass(frozen=True, slots=True)
class Fact:
    """One fact of the flight: a term, its value, and what is said below it in small letters."""

    term: str
    value: str
    small: str = ""


@dataclass(frozen=True, slots=True)
class Top:
    """What stands above the sections.

    Attributes
    ----------
    title
        Of the document.
    log
        Name of the log.
    state
        The worst that was found: how the sentence looks.
    verdict
        One sentence.
    besides
        What must be known with it, a sentence each.
    facts
        Of the flight.
    """

    title: str
    log: str
    state: State
    verdict: str
    besides: Sequence[str]
    facts: Sequence[Fact]

    @property
    def look(self) -> Look:
        """Of the state."""
        return LOOKS[self.state]


def top(flight: Flight) -> Top:
    """The head of a flight's report."""
    summary = flight.summary
    judged = [m["sensor"] for m in summary["monitored"] if m["seconds"] > 0]
    state, verdict = _verdict(flight, judged)
    name = PurePath(str(summary["log"]["path"])).name
    return Top(
        title=f"{name}: {verdict}",
        log=name,
        state=state,
        verdict=verdict,
        besides=list(_besides(flight, judged)),
        facts=_facts(flight),
    )


def what_it_did(fault: Mapping[str, Any]) -> str:
    """What a faulty sensor did, in a few words: ``"read 3.1 m/s too low"``."""
    did = _DID.get(Kind(fault["kind"]))
    if did is not None or fault["magnitude"] is None:
        return did or "did not agree with the others"
    size = quantity(abs(fault["magnitude"]), fault["unit"])
    if fault["sensor"].startswith("wing_"):
        what = fault["sensor"].partition(".")[2]
        return f"{'lost' if what == 'lift' else 'gained'} {size} more {what} than the other"
    return f"read {size} too {'high' if fault['magnitude'] > 0 else 'low'}"


def _verdict(flight: Flight, judged: Sequence[str]) -> tuple[State, str]:
    faults, events = flight.summary["faults"], flight.summary["events"]
    left_out = flight.summary["left_out"]
    found = [_faults_found(faults, left_out["faults"])] if faults else []
    found += [_events_found(events, left_out["events"], alone=not faults)] if events else []
    if found:
        return State.FAULTY if faults else State.STOPPED, _sentence("; ".join(found))
    if not judged:
        return State.UNMONITORED, _sentence("no sensor could be judged" + _why_none(flight))
    doubts = _doubted(flight)
    if doubts:
        return State.SUSPECT, _sentence(f"no fault was named, but {_listed(doubts)}")
    return State.OK, _sentence(f"no fault was found in the {_sensors(len(judged))} judged")


def _faults_found(faults: Sequence[Mapping[str, Any]], more: int) -> str:
    if len(faults) + more == 1:
        (fault,) = faults
        return f"{fault['sensor']} was faulty {_when(fault, 'cleared_s')}: it {what_it_did(fault)}"
    sensors = dict.fromkeys(fault["sensor"] for fault in faults)
    if len(sensors) == 1:
        times = _listed([_when(fault, "cleared_s") for fault in faults], more)
        return f"{next(iter(sensors))} was faulty {len(faults) + more} times, {times}"
    named = [f"{fault['sensor']} {_when(fault, 'cleared_s')}" for fault in faults]
    return f"{len(faults) + more} faults: {_listed(named, more)}"


def _events_found(events: Sequence[Mapping[str, Any]], more: int, *, alone: bool) -> str:
    named = [f"{event['what']} {event['state']} {_when(event, 'ended_s')}" for event in events]
    said = _listed(named, more)
    return f"{said}; no sensor was at fault" if alone else said


def _when(entry: Mapping[str, Any], end: str) -> str:
    """``"from 2:19 to 3:55"``, by the estimated onset."""
    until = "the end of the log" if entry[end] is None else clock(entry[end])
    return f"from {clock(entry['onset_s'])} to {until}"


def _why_none(flight: Flight) -> str:
    """The reason that lasted longest, where there is one."""
    lasted: dict[str, float] = {}
    for entry in flight.summary["monitored"]:
        for span in entry["unmonitored"]:
            if span["reason"] != str(State.ABSENT):
                seconds = lasted.get(span["reason"], 0.0) + span["to_s"] - span["from_s"]
                lasted[span["reason"]] = seconds
    return f" ({max(lasted, key=lambda reason: lasted[reason])})" if lasted else ""


def _doubted(flight: Flight) -> list[str]:
    """Sensors that were doubted although none was named: suspect ones, and those that disagree."""
    out = []
    for sensor, spans in flight.spans.items():
        for state, reason, word in (
            (State.SUSPECT, None, "was suspect"),
            (State.UNMONITORED, Reason.SENSORS_DISAGREE, "disagreed with its like"),
        ):
            seconds = _lasting(spans, state, reason)
            if seconds >= 1.0:
                out.append(f"{sensor} {word} for {clock(seconds)}")
    return out


def _besides(flight: Flight, judged: Sequence[str]) -> Iterable[str]:
    summary = flight.summary
    faulty = {fault["sensor"] for fault in summary["faults"]}
    found = [*summary["faults"], *summary["events"]]
    if len(found) == 1:
        yield _sentence(found[0]["evidence"])
    healthy = [sensor for sensor in judged if sensor not in faulty]
    if (faulty or summary["events"]) and healthy:
        yield _sentence(f"no fault was found in the other {_sensors(len(healthy))} judged")
    if faulty or summary["events"]:
        doubts = [d for d in _doubted(flight) if d.split()[0] not in faulty]
        if doubts:
            yield _sentence(f"doubted without being named: {_listed(doubts)}")
    silent = [
        f"{sensor} for {clock(seconds)}"
        for sensor, spans in flight.spans.items()
        if (seconds := _lasting(spans, State.STALE)) >= 1.0
    ]
    if silent:
        yield _sentence(f"sent nothing for a while: {_listed(silent)}")
    unjudged = _never_judged(summary["monitored"])
    if unjudged and judged:
        yield _sentence(f"could not be judged: {'; '.join(unjudged)}")
    yield from _of_the_log(summary)


def _of_the_log(summary: Mapping[str, Any]) -> Iterable[str]:
    """What was wrong with the recording, the settings or the lists."""
    log, learnt = summary["log"], summary["learnt"]
    if log["gaps"]:
        seconds = sum(gap["seconds"] for gap in log["gaps"])
        gaps = "a gap" if len(log["gaps"]) == 1 else f"{len(log['gaps'])} gaps"
        yield f"The recording has {gaps}, {lasting(seconds)} in all."
    if log["boots_s"]:
        yield f"The vehicle booted anew at {_listed([clock(at) for at in log['boots_s']])}."
    yield from (_sentence(note) for note in log["notes"])
    if learnt is not None and learnt["note"] is not None:
        yield _sentence(learnt["note"])
    more = [f"{count:,} {what}" for what, count in summary["left_out"].items() if count]
    if more:
        yield f"Too many to list: {_listed(more)} more."


def _never_judged(monitored: Iterable[Mapping[str, Any]]) -> list[str]:
    """Sensors that were there and never judged, those of one kind and reason together."""
    groups: dict[tuple[str, str], list[str]] = {}
    for entry in monitored:
        reasons = [s["reason"] for s in entry["unmonitored"] if s["reason"] != str(State.ABSENT)]
        if entry["seconds"] > 0 or not reasons:
            continue
        kind = entry["sensor"].partition(".")[0].partition("_")[0].rstrip("0123456789")
        groups.setdefault((kind, reasons[-1]), []).append(entry["sensor"])
    return [
        f"{sensors[0] if len(sensors) == 1 else f'{len(sensors)} {kind} channels'}, {reason}"
        for (kind, reason), sensors in groups.items()
    ]


def _lasting(spans: Iterable[Span], state: State, reason: Reason | None = None) -> float:
    """For how long a sensor was in a state [s]."""
    return sum(
        span.to_s - span.from_s
        for span in spans
        if span.state is state and (reason is None or span.reason == str(reason))
    )


def _facts(flight: Flight) -> list[Fact]:
    log, vehicle, made = (flight.summary[key] for key in ("log", "vehicle", "made_by"))
    judged = max((m["seconds"] for m in flight.summary["monitored"]), default=0.0)
    in_flight = _flown(flight)
    kind = str(vehicle["type"] or "unknown").replace("_", " ").lower()
    autopilot = str(vehicle["autopilot"] or "unknown autopilot")
    date, time = "not known", ""
    if (began := started(log)) is not None:
        date, time = began.strftime("%Y-%m-%d"), began.strftime("%H:%M:%S UTC")
    changed = len(made["changed"])
    return [
        Fact(
            "Duration",
            clock(flight.duration_s),
            f"judged in flight for {clock(in_flight)}"
            if in_flight
            else f"judged for {clock(judged)}",
        ),
        Fact("Start", date, time),
        Fact(
            "Vehicle",
            kind,
            f"{_AUTOPILOTS.get(autopilot, autopilot)}, system {vehicle['system_id']}",
        ),
        Fact("Log", f"{log['format']}, {_bytes(log['bytes'])}", _messages(log)),
        Fact(
            "Profile",
            str(made["profile"]),
            f"mavsentry {made['version']}"
            + (f", {count(changed, 'setting')} changed" if changed else ""),
        ),
    ]


def _flown(flight: Flight) -> float:
    """Longest time for which an instrument was judged that is judged in flight only [s]."""
    return max(
        (
            entry["seconds"]
            for entry in flight.summary["monitored"]
            if any(span["reason"] == str(Reason.ON_GROUND) for span in entry["unmonitored"])
        ),
        default=0.0,
    )


def _messages(log: Mapping[str, Any]) -> str:
    bad = f", {log['bad_bytes']:,} bytes not readable" if log["bad_bytes"] else ""
    return f"{log['messages']:,} messages{bad}"


def _bytes(count: float) -> str:
    """A size to three digits: ``_bytes(3_604_158) == "3.6 MB"``."""
    units = ("B", "kB", "MB", "GB")
    power = min(sum(count >= 999.5 * 1000**k for k in range(3)), 3)
    return f"{count / 1000**power:.3g} {units[power]}"


def _sensors(count: int) -> str:
    return "one sensor" if count == 1 else f"{count} sensors"


def _listed(words: Sequence[str], more: int = 0) -> str:
    """``"a, b and c"``; after :data:`NAMED` the rest is counted."""
    shown = list(words[:NAMED]) if len(words) > NAMED + 1 or more else list(words)
    rest = len(words) - len(shown) + more
    if rest:
        shown.append(f"{rest:,} more")
    return listed(shown)


def _sentence(words: str) -> str:
    """With a full stop; the first letter large unless it begins the name of a sensor."""
    first = words.partition(" ")[0].rstrip(":,;")
    named = any(letter.isdigit() or letter in "._" for letter in first)
    begun = words if named else words[:1].upper() + words[1:]
    return begun if begun.endswith((".", "!", "?")) else begun + "."
