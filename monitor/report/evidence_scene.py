"""One finding's stage: its time axis, its series, and the marks that all its charts share."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.charts import TimeChart, time_chart
from monitor.report.evidence_cases import Group
from monitor.report.evidence_data import Estimate, Subject
from monitor.report.evidence_numbers import coarser, difference, mean_over, value_at
from monitor.report.series import Series

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight

__all__ = ["Scene"]

POINTS: Final = 500
"""Points of a line: a section has a dozen of them, and a report twenty sections."""
EXACT: Final = 20_000
"""More tenths of a second than the longest window has: numbers are taken before thinning."""
WORDED: Final = 2
"""The moments of so many findings get words; of more, lines alone."""
MEAN_S: Final = 3.0
"""Over so long before an onset and after a verdict the others are compared [s]."""
CLEAR_S: Final = 0.5
SETTLED_S: Final = 0.6
"""A reconstructed error jumps with the first rows after its verdict: it is read so much later
[s]."""


class Scene:
    """What the charts of one group have in common.

    Attributes
    ----------
    flight, group, subject
    key
        Stem of the charts' keys.
    axis
        Seconds; of this group's charts alone, they are zoomed to it.
    expected, expected_std
        What the sensor should have shown, and its deviation; None where nobody can tell.
    error, error_std
        Measured less expected, or the error as its estimator reconstructed it.
    said_s
        When the numbers of the captions are taken: with the verdict, or just after it [s].
    """

    def __init__(self, flight: Flight, group: Group, subject: Subject, key: str) -> None:
        from bokeh.models import Range1d

        self.flight, self.group, self.subject, self.key = flight, group, subject, key
        self.case = group.cases[0]
        bounds = (group.from_s, group.to_s)
        self.axis: Range1d = Range1d(*bounds, bounds=bounds)
        self.expected: Series | None = None
        self.expected_std: Series | None = None
        self.from_estimate: Estimate | None = None
        for estimate in subject.expected:
            self.expected, self.expected_std = self.estimate(estimate)
            if self.expected is not None:
                self.from_estimate = estimate
                break
        self.own = self.measured(subject.measured) if subject.measured else None
        self.error, self.error_std = self._error()
        later_s = SETTLED_S if subject.error is not None else 0.0
        self.said_s = min(self.case.isolated_s + later_s, group.to_s)

    def measured(self, name: str) -> Series | None:
        """What was measured within the window, exact; None where nothing was."""
        found = self.flight.measured(name, self.group.from_s, self.group.to_s, EXACT)
        return found if found is not None and _any(found) else None

    def column(self, table: str, column: str) -> Series | None:
        """A column of an estimate within the window, exact; None where it is not known there."""
        if column not in self.flight.tables.columns(table):
            return None
        found = self.flight.estimate(table, column, self.group.from_s, self.group.to_s, EXACT)
        return found if found is not None and _any(found) else None

    def estimate(self, estimate: Estimate) -> tuple[Series | None, Series | None]:
        """A value and its deviation within the window."""
        value = self.column(estimate.table, estimate.column)
        return (None, None) if value is None else (value, self.column(estimate.table, estimate.std))

    def ratio(self, sensor: str) -> Series | None:
        """Test statistic over threshold within the window."""
        found = self.flight.test(sensor, self.group.from_s, self.group.to_s, EXACT)
        return found if found is not None and _any(found) else None

    def peers(self) -> list[tuple[str, Series]]:
        """The others of its kind that were there, as they measured."""
        spans = self.flight.spans
        there = [
            name
            for name in self.subject.peers
            if any(span.state is not State.ABSENT for span in spans.get(name, ()))
        ]
        found = [(name, self.measured(name)) for name in there]
        return [(name, series) for name, series in found if series is not None and _any(series)]

    def chart(self, label: str, unit: str, height: int = 200) -> TimeChart:
        """An empty chart on the group's axis."""
        return time_chart(self.axis, label, unit, height=height)

    def line(
        self, chart: TimeChart, series: Series | None, name: str, tone: palette.Tone, dash: str = ""
    ) -> None:
        """Draw a series, thinned."""
        chart.line(coarser(series, POINTS), name, tone, dash=dash or "solid")

    def band(self, chart: TimeChart, mean: Series | None, std: Series | None, name: str) -> None:
        """Fill two standard deviations about a series; ``std`` may be of other moments."""
        if mean is None or std is None:
            return
        wide = 2.0 * value_at(std, mean.t_s)
        middle = mean.middle
        low = Series(mean.t_s, middle - wide, middle - wide, mean.unit)
        high = Series(mean.t_s, middle + wide, middle + wide, mean.unit)
        chart.band(coarser(low, POINTS), coarser(high, POINTS), name)

    def mark(self, chart: TimeChart, *, words: bool = False) -> TimeChart:
        """Shade while faulty and draw the moments; their words stand in the first chart only."""
        words = words and len(self.group.cases) <= WORDED
        for case in self.group.cases:
            state = State.STOPPED if case.is_event else State.FAULTY
            until_s = min(case.until(self.flight.duration_s), self.group.to_s)
            if case is self.case or case.sensor == self.case.sensor:
                chart.shade(case.isolated_s, until_s, state)
        for case in self.group.cases if len(self.group.sensors) == 1 else self.group.cases[:1]:
            named = case.isolated_s if case.isolated_s - case.detected_s > 0.15 else None
            moments = (
                (case.onset_s, "onset"),
                (case.detected_s, "noticed" if named else "found"),
                (named, "named"),
                (case.cleared_s, "cleared"),
            )
            for at_s, word in moments:
                if at_s is not None and self.group.from_s <= at_s <= self.group.to_s:
                    chart.mark(at_s, word if words else "")
        return chart

    def change(self, series: Series | None) -> float:
        """By how much a series changed from before the onset to after the verdict; NaN unknown."""
        case = self.case
        before = mean_over(series, case.onset_s - MEAN_S - CLEAR_S, case.onset_s - CLEAR_S)
        return mean_over(series, case.isolated_s, case.isolated_s + MEAN_S) - before

    def _error(self) -> tuple[Series | None, Series | None]:
        if self.subject.error is not None:
            return self.estimate(self.subject.error)
        found = difference(self.own, self.expected)
        return (found, self.expected_std) if found is not None else (None, None)


def _any(series: Series) -> bool:
    return any(map(math.isfinite, series.low))
