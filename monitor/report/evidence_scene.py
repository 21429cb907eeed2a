"""One finding's stage: its time axis, its series, and the marks that all its charts share."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.charts import SHADE_ALPHA, LegendEntry, TimeChart, time_chart
from monitor.report.evidence_cases import APART_S, Case, Group
from monitor.report.evidence_data import Estimate, Family, Subject
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
MARKED: Final = 2
"""The moments of so many findings are marked."""
MEAN_S: Final = 3.0
"""Over so long before an onset and after a verdict the others are compared [s]."""
CLEAR_S: Final = 0.5
SETTLED_S: Final = 3.0
"""The filters take an IMU's error into their state over about this time: it is read then [s]."""


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
    said_s, when
        When the numbers of the captions are taken: with the verdict, of an IMU soon after it [s];
        and that in words.
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
        later_s = SETTLED_S if subject.family in (Family.ACC, Family.GYRO) else 0.0
        self.said_s = min(self.case.isolated_s + later_s, group.to_s)
        self.when = f"{later_s:.0f} s after the verdict" if later_s else "With the verdict"

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
        """Shade while faulty and draw the moments; their words stand in the first chart only.

        Of many findings in one section the shading tells enough.
        """
        own = [case for case in self.group.cases if case.sensor == self.case.sensor]
        state = State.STOPPED if self.case.is_event else State.FAULTY
        ends = [min(case.until(self.flight.duration_s), self.group.to_s) for case in own]
        if len(own) > MARKED:
            _strips(chart, [case.isolated_s for case in own], ends, state)
            return chart
        for case, until_s in zip(own, ends, strict=True):
            chart.shade(case.isolated_s, until_s, state)
            for at_s, word in _moments(case):
                if self.group.from_s <= at_s <= self.group.to_s:
                    if words:
                        chart.mark(at_s, word)
                    else:
                        _rule(chart, at_s)
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


def _moments(case: Case) -> Iterator[tuple[float, str]]:
    """Moments of a finding with their words."""
    yield case.onset_s, "onset"
    if case.isolated_s - case.detected_s > APART_S:
        yield case.detected_s, "noticed"
        yield case.isolated_s, "named"
    else:
        yield case.isolated_s, "found"
    if case.cleared_s is not None:
        yield case.cleared_s, "cleared"


def _rule(chart: TimeChart, at_s: float) -> None:
    """A moment whose word stands in the first chart."""
    from bokeh.models import Span

    look = {"line_color": palette.INK.light, "line_dash": [2, 3]}
    chart.figure.add_layout(Span(location=at_s, dimension="height", **look))


def _strips(chart: TimeChart, from_s: list[float], to_s: list[float], state: State) -> None:
    """Shade many spans by one glyph: an annotation for each would cost more than all the lines."""
    look = palette.LOOKS[state]
    strips = chart.figure.vstrip(
        x0=from_s, x1=to_s, fill_color=look.tone.light, fill_alpha=SHADE_ALPHA, line_color=None
    )
    strips.level = "underlay"
    chart.legend.append(LegendEntry(look.word, look.tone, "shade"))
