"""For each fault and event of a flight, what makes one believe it, or see why not.

A finding gets its evidence sentence, a table of what was decided when and by what, and charts
zoomed to its onset (:mod:`monitor.report.evidence_charts`). Findings beyond a score stand in
a table, so that a log with hundreds of them stays a page.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from links.vocabulary import Kind
from monitor.pages.html import clock
from monitor.report.evidence_cases import FULL, MORE_KEY, Case, Group, cases_of, chosen, groups_of
from monitor.report.evidence_charts import charts_of
from monitor.report.evidence_data import subject_of
from monitor.report.evidence_scene import Scene
from monitor.report.evidence_words import (
    estimator_words,
    group_heading,
    size_words,
    statistic_words,
)
from monitor.report.section import Column, Part, Section, Table, Text
from monitor.report.wording import lasting

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]

LISTED: Final = 300
"""Rows of the table of the others, at most."""
KEY: Final = "evidence"


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Evidence of every finding; None where nothing was found.

    Parameters
    ----------
    flight
    axis
        Of the whole flight; these charts are zoomed and have axes of their own.
    """
    cases = cases_of(flight.summary)
    if not cases:
        return None
    groups = groups_of(cases, flight.duration_s)
    full = chosen(groups, FULL)
    parts: list[Part] = [_section(flight, group) for group in full]
    rest = [
        case for group in groups if not any(group is one for one in full) for case in group.cases
    ]
    if rest:
        parts.append(_table_of(rest))
    count = "One finding" if len(cases) == 1 else f"{len(cases)} findings"
    lead = (
        f"{count}. Each is shown from before its onset, when everything agreed, to after the "
        "moment at which the sensor was named; the charts of a finding move together."
    )
    if rest:
        lead += (
            f" {len(full)} are drawn, each sensor's first failure among them; the others follow "
        )
        lead += "in a table."
    return Section(KEY, "Evidence", lead, parts)


def _section(flight: Flight, group: Group) -> Section:
    first = group.cases[0]
    streams = [str(stream["sensor"]) for stream in flight.summary.get("streams", ())]
    subject = subject_of(first.sensor, streams, flight.settings)
    sentences = list(dict.fromkeys(_sentence(case) for case in group.cases))
    parts: list[Part] = [Text(words) for words in sentences[1:]]
    parts.append(_facts(flight, group))
    if subject is None:
        parts.append(Text(f"Nothing is known to draw of {first.sensor}.", "soft"))
    else:
        parts += charts_of(Scene(flight, group, subject, first.key))
    return Section(first.key, group_heading(group, subject), sentences[0], parts)


def _sentence(case: Case) -> str:
    said = str(case.found.get("evidence", "")).strip().rstrip(".")
    if not said:
        return "No evidence was recorded in words."
    named = said.startswith(case.sensor.partition(".")[0])  # a sensor's name has no capital
    return f"{said}." if named else f"{said[:1].upper()}{said[1:]}."


def _facts(flight: Flight, group: Group) -> Table:
    """What was decided, when, and by what; a row for each finding."""
    columns = [
        Column("onset", number=True),
        Column("noticed", number=True),
        Column("named", number=True),
        Column("cleared", number=True),
        Column("kind"),
        Column("size", number=True),
        Column("test statistic", long=True),
        Column("decided by", long=True),
    ]
    names = len(group.sensors) > 1
    if names:
        columns.insert(0, Column("sensor"))
    rows = []
    for case in group.cases:
        row = [
            clock(case.onset_s, 1),
            f"{lasting(case.detected_s - case.onset_s)} later",
            f"{lasting(case.isolated_s - case.onset_s)} later",
            "never" if case.cleared_s is None else clock(case.cleared_s, 1),
            "event" if case.is_event else str(case.kind),
            _size(case),
            statistic_words(case, flight.settings),
            estimator_words(case),
        ]
        rows.append([case.sensor, *row] if names else row)
    return Table(_how_often(flight, group), columns, rows)


def _size(case: Case) -> str:
    size, unit = case.found.get("magnitude"), str(case.found.get("unit", ""))
    inertial = case.sensor.startswith("imu")
    if size is None or (case.kind is Kind.NOISE and not inertial):
        return "–"  # what a noisy reading happened to be off by says nothing
    return ("+" if size >= 0.0 else "−") + size_words(size, unit)


def _how_often(flight: Flight, group: Group) -> str:
    """Caption of the facts: how often and how long this sensor failed, and was judged."""
    sensor = group.sensor
    all_cases = [case for case in cases_of(flight.summary) if case.sensor == sensor]
    lasted_s = sum(case.until(flight.duration_s) - case.isolated_s for case in all_cases)
    judged = next((m for m in flight.summary.get("monitored", ()) if m["sensor"] == sensor), None)
    times = "once" if len(all_cases) == 1 else f"{len(all_cases)} times"
    state = "stopped" if group.cases[0].is_event else "faulty"
    said = f"{sensor}: {state} {times} on this flight, for {lasting(max(lasted_s, 0.0))} in all"
    return f"{said}, of {lasting(judged['seconds'])} judged" if judged else said


def _table_of(cases: Sequence[Case]) -> Section:
    """Findings that are not drawn."""
    columns = [
        Column("sensor"),
        Column("onset", number=True),
        Column("found", number=True),
        Column("cleared", number=True),
        Column("kind"),
        Column("size", number=True),
        Column("evidence", long=True),
    ]
    rows: list[list[str]] = [
        [
            case.sensor,
            clock(case.onset_s),
            f"{lasting(case.isolated_s - case.onset_s)} later",
            "never" if case.cleared_s is None else clock(case.cleared_s),
            "event" if case.is_event else str(case.kind),
            _size(case),
            _sentence(case),
        ]
        for case in cases[:LISTED]
    ]
    lead = "Without charts; summary.json and the tables of estimates hold all of them."
    if len(cases) > LISTED:
        lead = f"The first {LISTED} of {len(cases)}. {lead}"
    table = Table(f"{len(cases)} further findings", columns, rows)
    return Section(MORE_KEY, "Further findings", lead, [table])
