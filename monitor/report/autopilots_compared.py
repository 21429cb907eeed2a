"""Who said it first, and what they never said: our verdicts beside the autopilots' own checks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, Final

from monitor.announced import Said, announced
from monitor.pages.html import clock
from monitor.report.wording import count, instrument, lasting, listed

__all__ = [
    "ARDUPILOT",
    "CHECKED",
    "JUDGES",
    "OURS",
    "PX4",
    "SPOKEN",
    "Compared",
    "Judged",
    "compare",
    "judged",
    "sentences",
]

Summary = Mapping[str, Any]

OURS: Final = "mavsentry"
ARDUPILOT: Final = "ArduPilot's checks"
PX4: Final = "PX4's checks"
SPOKEN: Final = "said in flight"
JUDGES: Final = (OURS, ARDUPILOT, PX4, SPOKEN)
"""Ours; the models of the autopilots' logic; what the autopilot on board announced."""

CHECKED: Final = ("imu", "airspeed")
"""What the autopilots' checks look at."""

CONSIDERED: Final = 2_000
"""Verdicts that are looked at, of all judges together."""
TOLD: Final = 12
"""Faults of which a sentence says who was first."""

EARLY_S, GRACE_S = 0.5, 15.0
"""A verdict belongs to a fault from this before its onset until this after its end [s]."""
LEVEL_S = 0.05
"""Verdicts this close to each other came at once [s]."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A verdict of one judge, as it stands in the timeline and in the table.

    Attributes
    ----------
    judge
        One of :data:`JUDGES`.
    sensor
        ``imu`` where it is not told which.
    what
        ``bias``, ``lane left``, ``invalid`` ...
    from_s, to_s
        None: it stood until the log's end [s].
    evidence
        A sentence.
    """

    judge: str
    sensor: str
    what: str
    from_s: float
    to_s: float | None
    evidence: str


@dataclass(slots=True)
class Compared:
    """A fault of ours, and when the others said something of its instrument.

    Attributes
    ----------
    sensor, onset_s, said_s
        The fault, its onset, and when it was said to be one [s].
    others
        Judge -> (when [s], whether it was told which instrument).
    before
        Judges that blamed the instrument already when the fault set in -> since when [s].
    """

    sensor: str
    onset_s: float
    said_s: float
    others: dict[str, tuple[float, bool]] = field(default_factory=dict)
    before: dict[str, float] = field(default_factory=dict)


def judged(summary: Summary) -> list[Judged]:
    """Every verdict of every judge, the first :data:`CONSIDERED` in order of time."""
    out = [
        Judged(OURS, f["sensor"], f["kind"], f["detected_s"], f["cleared_s"], f["evidence"])
        for f in summary["faults"]
    ]
    out += [
        Judged(OURS, e["what"], e["state"], e["detected_s"], e["ended_s"], e["evidence"])
        for e in summary["events"]
    ]
    baselines = summary["baselines"]
    for judge, key in ((ARDUPILOT, "ardupilot"), (PX4, "px4")):
        out += [
            Judged(judge, e["sensor"], e["check"], e["from_s"], e["to_s"], e["evidence"])
            for e in baselines[key]
        ]
    texts = {line["t_s"]: line["text"] for line in reversed(baselines["autopilot_said"])}
    out += [
        Judged(SPOKEN, v.sensor, _told(v), v.from_s, v.to_s, texts.get(v.from_s, ""))
        for v in announced(baselines["autopilot_said"])
    ]
    return sorted(out, key=lambda v: (v.from_s, JUDGES.index(v.judge), v.sensor))[:CONSIDERED]


def _told(v: Said) -> str:
    return "disabled" if v.sensor.startswith("airspeed") else "lane left"


def compare(verdicts: Sequence[Judged], faults: Sequence[Mapping[str, Any]]) -> list[Compared]:
    """Per fault of ours, the first verdict of each other judge on the same instrument.

    A verdict on ``imu`` speaks of every IMU; which one, it does not tell.
    """
    out = []
    for fault in faults:
        found = Compared(fault["sensor"], fault["onset_s"], fault["detected_s"])
        end_s = inf if fault["cleared_s"] is None else fault["cleared_s"] + GRACE_S
        for v in verdicts:
            if v.judge == OURS or not _speaks_of(v.sensor, fault["sensor"]):
                continue
            if fault["onset_s"] - EARLY_S <= v.from_s <= end_s:
                found.others.setdefault(v.judge, (v.from_s, v.sensor != "imu"))
            elif v.from_s < fault["onset_s"] and (v.to_s is None or v.to_s > fault["onset_s"]):
                found.before.setdefault(v.judge, v.from_s)
        out.append(found)
    return out


def _speaks_of(theirs: str, ours: str) -> bool:
    whose = instrument(ours)
    return theirs == whose or (theirs == "imu" and whose.startswith("imu"))


def sentences(summary: Summary) -> list[str]:
    """Plain sentences: of each fault who said it first and who never, then what only they said."""
    verdicts = judged(summary)
    faults = summary["faults"]
    judges = _present(summary)
    if not verdicts and not _judged_any(summary):
        return [
            "No airspeed sensor and no IMU was judged in this log, and the autopilots' checks "
            "found nothing either."
        ]
    if not verdicts:
        return [
            "Nobody found anything: neither mavsentry nor the checks of ArduPilot and PX4"
            + (", and the autopilot announced nothing of the kind." if SPOKEN in judges else ".")
        ]
    lines = [_sentence(found, judges) for found in compare(verdicts, faults[:TOLD])]
    if len(faults) > TOLD:
        lines.append(f"{count(len(faults) - TOLD, 'more fault')} of mavsentry's: see the table.")
    lines += [
        f"mavsentry said at {clock(e['detected_s'], 1)} that {e['what']} {e['state']}; the "
        "autopilots' checks compared here are those of airspeed and IMUs."
        for e in summary["events"]
    ]
    if not faults:
        lines.append("mavsentry found no faulty sensor in this flight.")
    lines += _alone(verdicts, faults)
    if summary["log"]["gaps"] and any(v.judge != OURS for v in verdicts):
        lines.append("To these checks a gap of the recording looks like sensors that stopped.")
    lost_s = summary["baselines"]["lanes_lost_s"]
    if lost_s >= 1.0:
        lines.append(
            f"For {lasting(lost_s)} the lanes of ArduPilot's EKF3 could not be followed with the "
            "samples of this log."
        )
    return lines


def _judged_any(summary: Summary) -> bool:
    return any(
        m["seconds"] > 0.0 and m["sensor"].startswith(("imu", "airspeed"))
        for m in summary["monitored"]
    )


def _present(summary: Summary) -> tuple[str, ...]:
    """The judges that could speak; an autopilot that no text is known of is none."""
    spoke = bool(summary["baselines"]["autopilot_said"])
    return JUDGES if spoke else JUDGES[:-1]


_NAMES: Final = {
    ARDUPILOT: "ArduPilot's checks",
    PX4: "PX4's checks",
    SPOKEN: "the autopilot itself",
}


def _sentence(found: Compared, judges: Iterable[str]) -> str:
    if not found.sensor.startswith(CHECKED):
        return (
            f"{found.sensor}, off since {clock(found.onset_s, 1)}: mavsentry said so at "
            f"{clock(found.said_s, 1)}; the autopilots' checks do not look at it."
        )
    others = [j for j in judges if j != OURS]
    firm = {j: t_s for j, (t_s, told) in found.others.items() if told}
    vague = {j: t_s for j, (t_s, told) in found.others.items() if not told}
    earlier = sorted((t_s, j) for j, t_s in firm.items() if t_s < found.said_s - LEVEL_S)
    head = f"{found.sensor}, off since {clock(found.onset_s, 1)}: "
    parts = []
    if earlier:
        first_s, first = earlier[0]
        lead = lasting(found.said_s - first_s)
        parts.append(f"{_NAMES[first]} said so first, at {clock(first_s, 1)}")
        parts.append(f"mavsentry {lead} later")
    else:
        parts.append(f"mavsentry said so first, at {clock(found.said_s, 1)}")
    for t_s, judge in sorted((t_s, j) for j, t_s in firm.items()):
        if not earlier or judge != earlier[0][1]:
            parts.append(f"{_NAMES[judge]} {_apart(t_s - found.said_s, bool(earlier))}")
    for judge, t_s in sorted(vague.items(), key=lambda item: item[1]):
        if judge not in firm:
            parts.append(
                f"{_NAMES[judge]} saw at {clock(t_s, 1)} that the IMUs differ, not which is wrong"
            )
    rest = [j for j in others if j not in firm and j not in vague]
    already = [j for j in rest if j in found.before]
    for judge in already:
        parts.append(
            f"{_NAMES[judge]} had blamed {instrument(found.sensor)} since "
            f"{clock(found.before[judge], 1)} and said nothing new"
        )
    never = [_NAMES[j] for j in rest if j not in found.before]
    if never:
        parts.append(f"{listed(never)} never said it")
    return head + "; ".join(parts) + "."


def _apart(delay_s: float, absolute: bool) -> str:
    if abs(delay_s) <= LEVEL_S:
        return "at the same moment"
    word = "later" if delay_s > 0.0 else "earlier"
    than = " than mavsentry" if absolute else ""
    return f"{lasting(abs(delay_s))} {word}{than}"


def _alone(verdicts: Sequence[Judged], faults: Sequence[Mapping[str, Any]]) -> list[str]:
    """What a judge said of an instrument in which we found nothing at that time."""
    lines = []
    for judge in JUDGES[1:]:
        alone = [
            v
            for v in verdicts
            if v.judge == judge and not any(_belongs(v, fault) for fault in faults)
        ]
        if not alone:
            continue
        first = alone[0]
        more = f" ({count(len(alone), 'time')} in all)" if len(alone) > 1 else ""
        who = _NAMES[judge]
        lines.append(
            f"{who[0].upper()}{who[1:]} also spoke of "
            f"{listed(sorted({v.sensor for v in alone}))}: {first.what} at "
            f"{clock(first.from_s, 1)}{more}. mavsentry found no fault there at that time."
        )
    return lines


def _belongs(v: Judged, fault: Mapping[str, Any]) -> bool:
    end_s = inf if fault["cleared_s"] is None else fault["cleared_s"] + GRACE_S
    to_s = inf if v.to_s is None else v.to_s
    began = fault["onset_s"] - EARLY_S
    return _speaks_of(v.sensor, fault["sensor"]) and v.from_s <= end_s and to_s >= began
