"""Section: lift lost and drag gained by each wing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.pages import palette
from monitor.pages.charts import TimeChart, time_chart
from monitor.report.panels import (
    ONE_BAND,
    TESTS_SAID,
    Derived,
    Tested,
    banded,
    settled,
    shade_faults,
    shaded_words,
    stacked,
    tests_chart,
)
from monitor.report.section import Chart, Section
from monitor.report.series import thinned

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.report.flight import Flight
    from monitor.report.series import Series

__all__ = ["section"]

Floats = NDArray[np.float64]

EVERY_ROW: Final = 200_000
"""More points than a flight of a day has rows, so that differences are of single rows."""
SHOWN: Final = 1_200
GAP_S: Final = 5.0
"""A longer time without an estimate breaks the line [s]."""


_TESTED: Final = tuple(
    Tested(f"wing_{side}.{part}", f"{side} {part}", tone, dash)
    for side, tone in zip(("right", "left"), palette.MORE, strict=False)
    for part, dash in (("lift", "solid"), ("drag", "dotted"))
)


class _Force(NamedTuple):
    """One of the two forces, as the estimates and the charts name it."""

    column: str
    change: str
    limit_percent: float


def section(flight: Flight, axis: Range1d) -> Section | None:
    """What the wings lost and gained, and the difference that is judged; None without it."""
    settings = flight.settings.wing
    forces = (
        _Force("lift", "lift lost", settings.lift_percent),
        _Force("drag", "drag gained", settings.drag_percent),
    )
    tests = tests_chart(flight, axis, _TESTED)
    shown = [make(flight, axis, force) for force in forces for make in (_difference, _each)]
    charts = stacked([*shown, tests])
    if not charts:
        return None
    shade_faults(charts, flight)
    lead = (
        "A wing is judged by how much more it lost or gained than the other one. What both have in "
        "common is hardly observable, because wrong coefficients look the same: the wide bands of "
        "the single wings say so."
    )
    return Section(
        "wing",
        "Wings",
        lead,
        [
            Chart(
                "wing-forces",
                charts,
                "First the difference right less left, then each wing, in percent of the whole "
                "wing's lift and drag. Positive is a right wing that is worse; the dashed lines "
                "are the least difference called damage, which must exceed its deviation too: "
                f"{settings.lift_sigmas:g} times in lift, {settings.drag_sigmas:g} times in drag "
                "or as the airframe's own flights taught."
                + (f" {TESTS_SAID}" if tests.legend else ""),
                "Time charts of lift lost and drag gained: the difference between the wings with "
                "its limits, and each wing with its 2-sigma band." + shaded_words(flight.summary),
            )
        ],
    )


def _difference(flight: Flight, axis: Range1d, force: _Force) -> TimeChart:
    chart = time_chart(axis, f"{force.change}, r − l", "%")
    columns = f"right_{force.column}_percent", f"left_{force.column}_percent"
    right, left = (flight.estimate("wing", name, points=EVERY_ROW) for name in columns)
    std = flight.estimate("wing", f"{force.column}_apart_std_percent", points=EVERY_ROW)
    if right is None or left is None or std is None:
        return chart
    mean = _thinned(right, right.middle - left.middle, flight.duration_s)
    chart.deviation(mean, _thinned(right, std.high, flight.duration_s), ONE_BAND.name)
    chart.line(mean, "right less left", palette.RECONSTRUCTED)
    if chart.legend:
        limit = force.limit_percent
        chart.threshold(-limit, limit, name="least damage")
    return chart


def _thinned(like: Series, values: Floats, duration_s: float) -> Derived | None:
    """Values (n,) of single rows, at most :data:`SHOWN` points with their extremes."""
    t_us = np.round(like.t_s * 1e6).astype(np.int64)
    known = np.isfinite(like.low)
    piece = t_us[known], values[known], values[known]
    found = thinned([piece], 0, round(duration_s * 1e6), SHOWN, round(GAP_S * 1e6))
    return None if found is None else Derived(found[0] / 1e6, found[1], found[2], "%")


def _each(flight: Flight, axis: Range1d, force: _Force) -> TimeChart:
    chart = time_chart(axis, force.change, "%", height=160)
    for side, tone in zip(("right", "left"), palette.MORE, strict=False):
        mean = flight.estimate("wing", f"{side}_{force.column}_percent")
        std = flight.estimate("wing", f"{side}_{force.column}_std_percent")
        banded(chart, settled(mean, std), std, f"{side} wing", tone)
    return chart
