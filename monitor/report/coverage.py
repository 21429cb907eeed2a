"""Section: what was checked and fine, and what could not be checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from links.vocabulary import Reason
from monitor.pages.html import clock
from monitor.report.coverage_found import fine, flown_s, missing, ordinary, unjudged, unseen
from monitor.report.remedies import NOT_FLOWN, remedy
from monitor.report.section import Column, Part, Section, Table, Text
from monitor.report.wording import grouped, lasting, listed, moments

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["section"]

Summary = dict[str, Any]


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Which sensors were judged for how long, which were not, why, and what to do about it."""
    summary = flight.summary
    parts: list[Part] = [*_fine(summary), *_unjudged(summary)]
    parts += [Text(words, "soft") for words in _usual(summary)]
    return Section("coverage", "What was checked", _lead(summary), parts)


def _lead(summary: Summary) -> str:
    in_air = flown_s(summary)
    if not in_air:
        return "The aircraft was not seen to fly in this log: sensors are judged in flight."
    return (
        f"The aircraft was in the air for {lasting(in_air)}. A sensor that is not in the first "
        "table was not cleared by this analysis."
    )


def _fine(summary: Summary) -> list[Part]:
    found = fine(summary)
    if not found:
        return [Text("No sensor was judged and found in order.", "warn")]
    columns = [
        Column("sensor"),
        Column("judged for", number=True),
        Column("of the flight", number=True),
        Column("checked for", long=True),
    ]
    rows = [
        [
            grouped(f.sensors),
            lasting(f.seconds),
            "–" if f.share is None else f"{100.0 * f.share:.0f} %",
            f.checked,
        ]
        for f in found
    ]
    return [Table("Checked and fine", columns, rows)]


def _unjudged(summary: Summary) -> list[Part]:
    rows = []
    for u in unjudged(summary):
        on_ground = u.reason == Reason.ON_GROUND
        meaning, action = NOT_FLOWN if on_ground else remedy(u.reason, u.sensors[0])
        rows.append(
            [
                grouped(u.sensors),
                u.reason,
                lasting(u.seconds),
                moments(u.times),
                meaning,
                action or "–",
            ]
        )
    rows += [
        [
            grouped([sensor]),
            "never judged",
            "all of it",
            "–",
            "It sent data, but no verdict on it was ever reached.",
            "See that it sends often enough, and that the log holds a flight.",
        ]
        for sensor in unseen(summary)
    ]
    parts: list[Part] = []
    if rows:
        columns = [
            Column("sensor"),
            Column("reason"),
            Column("for", number=True),
            Column("when"),
            Column("which means", long=True),
            Column("what to do about it", long=True),
        ]
        parts.append(Table("Could not be checked", columns, rows))
    else:
        parts.append(Text("Nothing that could be checked was left unchecked."))
    if absent := missing(summary):
        parts.append(
            Text(f"Not in this log: {listed(absent)}. What rests on it was not judged.", "warn")
        )
    return parts


def _usual(summary: Summary) -> list[str]:
    """On the ground and while learning, in two sentences."""
    found = ordinary(summary)
    ground = [u for u in found if u.reason == Reason.ON_GROUND]
    learning = [u for u in found if u.reason != Reason.ON_GROUND and u.seconds >= 0.5]
    lines = []
    if ground and (longest := max(ground, key=lambda u: u.seconds)).seconds >= 1.0:
        lines.append(f"On the ground nothing is judged: {moments(longest.times)}.")
    if learning:
        said = [
            f"{grouped(u.sensors)} "
            + (f"until {clock(u.times[0][1])}" if len(u.times) == 1 else moments(u.times))
            for u in learning
        ]
        lines.append(f"What is normal on this flight was learnt first: {'; '.join(said)}.")
    return lines
