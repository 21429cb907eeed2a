"""Findings of a flight in groups that share charts, and the time that those show.

:func:`groups_of` puts together what can be seen on the same charts, :func:`window_of` chooses the
time: agreement before the onset, the onset, the verdict, and what followed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from links.vocabulary import Kind
from monitor.report.section import event_key, fault_key

__all__ = [
    "APART_S",
    "FULL",
    "MORE_KEY",
    "Case",
    "Group",
    "anchors",
    "cases_of",
    "chosen",
    "groups_of",
    "window_of",
]


@dataclass(frozen=True, slots=True)
class Case:
    """One fault or event of ``summary.json``, with its times in order.

    Attributes
    ----------
    sensor
        Or what an event happened to: ``"engine0"``.
    onset_s, detected_s, isolated_s
        When it began, something was said to be wrong, and this sensor was named [s].
    cleared_s
        When it was over; None if it lasted until the log's end [s].
    found
        The entry of the summary.
    key
        Its anchor in the report (:func:`monitor.report.section.fault_key`).
    is_event
        It is no sensor's fault: an engine stopped.
    """

    sensor: str
    onset_s: float
    detected_s: float
    isolated_s: float
    cleared_s: float | None
    found: Mapping[str, Any] = field(repr=False)
    key: str = ""
    is_event: bool = False

    @property
    def kind(self) -> Kind:
        """Shape of the fault; unknown of an event."""
        return Kind(self.found.get("kind", Kind.UNKNOWN))

    def until(self, end_s: float) -> float:
        """When it was over, at the latest at the flight's end [s]."""
        return end_s if self.cleared_s is None else self.cleared_s


def cases_of(summary: Mapping[str, Any]) -> list[Case]:
    """Faults and events of a flight, in order of detection."""
    cases = [
        Case(
            found["sensor"],
            found["onset_s"],
            found["detected_s"],
            found["isolated_s"],
            found["cleared_s"],
            found,
            fault_key(k),
        )
        for k, found in enumerate(summary["faults"])
    ]
    cases += [
        Case(
            found["what"],
            found["onset_s"],
            found["detected_s"],
            found["detected_s"],
            found["ended_s"],
            found,
            event_key(k),
            is_event=True,
        )
        for k, found in enumerate(summary["events"])
    ]
    return sorted(cases, key=lambda case: (case.detected_s, case.isolated_s, case.sensor))


FULL: Final = 20
"""Groups with charts, at most."""
MORE_KEY: Final = "evidence-more"
"""Anchor of the table of the others."""
APART_S: Final = 0.15
"""Detection and isolation closer than this are one moment [s]."""
LEAD_S: Final = 12.0
"""At least so much is shown before an onset, to see that measured and expected agreed [s]."""
TAIL_S: Final = 15.0
"""And so much after the sensor was named [s]."""
MOST_S: Final = 120.0
"""And no more of either, however long a slow fault took to be found [s]."""
AROUND: Final = 0.6
"""Shown before and after, as a share of the time from onset to isolation."""
NEAR: Final = 2.5
"""The clearing is shown too, if that makes the window no longer than so many times itself."""
PAST_CLEARING_S: Final = 5.0
LEAST_S: Final = 30.0
SHARED_S: Final = 240.0
"""Overlapping windows of one sensor are joined while the whole is no longer than this [s]."""


def window_of(case: Case, end_s: float) -> tuple[float, float]:
    """The time that the charts of a finding show: agreement, onset, detection and a while after.

    Parameters
    ----------
    case
    end_s
        Of the flight [s].

    Returns
    -------
    from_s, to_s
        Within the flight; they hold ``onset_s`` (or its beginning) and ``isolated_s``.
    """
    delay_s = case.isolated_s - case.onset_s
    lead_s = min(max(LEAD_S, AROUND * delay_s), MOST_S)
    tail_s = min(max(TAIL_S, AROUND * delay_s), MOST_S)
    from_s, to_s = case.onset_s - lead_s, case.isolated_s + tail_s
    if case.cleared_s is not None:
        past_s = case.cleared_s + PAST_CLEARING_S
        if past_s - from_s <= NEAR * (to_s - from_s):
            to_s = max(to_s, past_s)
    from_s, to_s = max(from_s, 0.0), min(to_s, max(end_s, case.isolated_s))
    if to_s - from_s < LEAST_S:  # an end of the log is near: more of the other side
        to_s = min(from_s + LEAST_S, max(end_s, case.isolated_s))
        from_s = max(to_s - LEAST_S, 0.0)
    return from_s, to_s


@dataclass(slots=True)
class Group:
    """Findings that share their charts: of one sensor in one window, or one IMU's axes that died.

    Attributes
    ----------
    cases
        In order of detection; the first one tells what is drawn.
    from_s, to_s
        Time that is shown [s].
    """

    cases: list[Case]
    from_s: float
    to_s: float

    @property
    def sensor(self) -> str:
        """Whose charts they are."""
        return self.cases[0].sensor

    @property
    def sensors(self) -> list[str]:
        """All sensors, each once."""
        return list(dict.fromkeys(case.sensor for case in self.cases))


def groups_of(cases: Sequence[Case], end_s: float) -> list[Group]:
    """Findings that can be seen on the same charts, in order of the first one's detection.

    A sensor that failed again while its last failure is still in view joins that; so do the axes
    of an IMU that died or froze at the same moment.
    """
    groups: list[Group] = []
    latest: dict[str, Group] = {}
    for case in cases:
        from_s, to_s = window_of(case, end_s)
        group = latest.get(_shares(case))
        if group is not None and from_s < group.to_s:
            joined_s = max(to_s, group.to_s) - min(from_s, group.from_s)
            if joined_s <= max(SHARED_S, group.to_s - group.from_s):
                group.cases.append(case)
                group.from_s = min(from_s, group.from_s)
                group.to_s = max(to_s, group.to_s)
                continue
        latest[_shares(case)] = group = Group([case], from_s, to_s)
        groups.append(group)
    return groups


def _shares(case: Case) -> str:
    """Cases with the same key may share charts."""
    if case.kind in (Kind.DROPOUT, Kind.STUCK) and case.sensor.startswith("imu"):
        return f"{case.sensor.partition('.')[0]} at {case.isolated_s:.1f}"
    return case.sensor


def chosen(groups: Sequence[Group], most: int) -> list[Group]:
    """At most so many groups: every sensor's first one before any sensor's second, in their order.

    Parameters
    ----------
    groups
        In order of detection.
    most
        How many charts are worth their place on the page.
    """
    seen: dict[str, int] = {}
    ranked = []
    for at, group in enumerate(groups):
        rank = seen[group.sensor] = seen.get(group.sensor, -1) + 1
        ranked.append((rank, at))
    return [groups[at] for _, at in sorted(sorted(ranked)[:most], key=lambda pair: pair[1])]


def anchors(summary: Mapping[str, Any], end_s: float) -> dict[str, str]:
    """Key of each finding -> the anchor where its evidence stands, its own or a shared one."""
    groups = groups_of(cases_of(summary), end_s)
    drawn = {id(group) for group in chosen(groups, FULL)}
    return {
        case.key: group.cases[0].key if id(group) in drawn else MORE_KEY
        for group in groups
        for case in group.cases
    }
