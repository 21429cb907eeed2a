"""What the panels of the whole flight share: shaded faults, derived curves, captions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.charts import LegendEntry, time_chart
from monitor.pages.html import clock
from monitor.report.wording import listed

if TYPE_CHECKING:
    from bokeh.models import Range1d

    from monitor.pages.charts import Curve, TimeChart
    from monitor.report.flight import Flight

__all__ = [
    "ONE_BAND",
    "TESTS_SAID",
    "Derived",
    "Tested",
    "banded",
    "fault_spans",
    "instances",
    "settled",
    "shade_faults",
    "shaded_words",
    "stacked",
    "tests_chart",
]

Floats = NDArray[np.floating[Any]]

APART_S = 1.0
"""Faults closer than this share a shade [s]."""
SHADES = 60
"""Shades of one chart; where there are more, neighbours are joined."""
NAMED = 3
MARKED = 6
"""Onsets that are marked with the sensor's name; more would cover each other."""
TOGETHER = 0.02
"""Onsets closer than this share of the flight have one mark."""
LEFT_PX = 70
"""Room for numbers and label on the left: signs and three digits have it too."""
WIDE = 2.0
"""A deviation so many times its usual one is of the time before anything was known."""
MOST_RATIO = 5.0
"""Where the axis of test statistics ends; a fault's may be a hundred."""
TESTS_SAID = "The tests stand below: 1 is the threshold, and a verdict takes more than a moment."
ONE_BAND = LegendEntry("2σ of each", palette.BAND, "band")


@dataclass(frozen=True, slots=True)
class Derived:
    """A curve computed from others; fields as of :class:`monitor.pages.charts.Curve`."""

    t_s: Floats
    low: Floats
    high: Floats
    unit: str

    @classmethod
    def scaled(cls, curve: Curve, factor: float, unit: str) -> Derived:
        """Another curve in another unit; the factor is positive."""
        return cls(curve.t_s, factor * curve.low, factor * curve.high, unit)


def instances(flight: Flight, quantity: str) -> list[str]:
    """Sensors of a quantity that sent something: ``instances(flight, "imu") == ["imu0", "imu1"]``.

    Those that were absent all the time are left out.
    """
    absent = {
        m["sensor"].partition(".")[0]
        for m in flight.summary["monitored"]
        if not m["seconds"] and {s["reason"] for s in m["unmonitored"]} == {str(State.ABSENT)}
    }
    sent = {
        s["sensor"]
        for s in flight.summary["streams"]
        if s["sensor"].rstrip("0123456789") == quantity and s["samples"]
    }
    return sorted(sent - absent, key=lambda s: int(s.removeprefix(quantity)))


def fault_spans(summary: Mapping[str, Any], duration_s: float) -> list[tuple[State, float, float]]:
    """When any sensor was faulty or an engine stopped: (state, from, to), joined where they meet.

    From the onset until it was cleared, or the end of the log.
    """
    found = [(State.FAULTY, f["onset_s"], f["cleared_s"]) for f in summary["faults"]]
    found += [(State.STOPPED, e["onset_s"], e["ended_s"]) for e in summary["events"]]
    out: list[tuple[State, float, float]] = []
    for state in (State.FAULTY, State.STOPPED):
        spans = sorted((a, duration_s if b is None else b) for s, a, b in found if s is state)
        apart_s = APART_S
        joined = _joined(spans, apart_s)
        while len(joined) > SHADES:
            apart_s *= 2.0
            joined = _joined(joined, apart_s)
        out += [(state, a, b) for a, b in joined]
    return out


def _joined(spans: Sequence[tuple[float, float]], apart_s: float) -> list[tuple[float, float]]:
    """Spans in order; those closer than this as one."""
    out: list[tuple[float, float]] = []
    for a, b in spans:
        if out and a <= out[-1][1] + apart_s:
            out[-1] = out[-1][0], max(b, out[-1][1])
        else:
            out.append((a, b))
    return out


def shade_faults(charts: Sequence[TimeChart], flight: Flight) -> None:
    """Shade every fault and event of the flight in all charts; the first tells whose they are."""
    summary = flight.summary
    spans = fault_spans(summary, flight.duration_s)
    for chart in charts:
        for state, from_s, to_s in spans:
            chart.shade(from_s, to_s, state)
    for onset_s, sensors in _onsets(summary, flight.duration_s) if charts else ():
        charts[0].mark(onset_s, sensors)


def _onsets(summary: Mapping[str, Any], duration_s: float) -> list[tuple[float, str]]:
    """When what set in; sensors that did so nearly together share a mark."""
    found = [(f["onset_s"], f["sensor"]) for f in summary["faults"]]
    found += [(e["onset_s"], e["what"]) for e in summary["events"]]
    groups: list[tuple[float, list[str]]] = []
    for onset_s, sensor in sorted(found):
        if not groups or onset_s > groups[-1][0] + TOGETHER * duration_s:
            groups.append((onset_s, []))
        groups[-1][1].append(sensor)
    return [(at_s, _few(list(dict.fromkeys(names)))) for at_s, names in groups[:MARKED]]


def _few(names: Sequence[str]) -> str:
    """``airspeed0``, ``airspeed0, aoa0``, ``airspeed0 + 3``."""
    return ", ".join(names) if len(names) < 3 else f"{names[0]} + {len(names) - 1}"


def shaded_words(summary: Mapping[str, Any]) -> str:
    """What the shades are, for a caption: ``Shaded: imu0.acc_x faulty from 2:19 to 3:30.``"""
    said = [
        f"{f['sensor']} faulty {_when(f['onset_s'], f['cleared_s'])}" for f in summary["faults"]
    ] + [f"{e['what']} {e['state']} {_when(e['onset_s'], e['ended_s'])}" for e in summary["events"]]
    if not said:
        return ""
    rest = len(said) - NAMED
    named = said[:NAMED] + ([f"{rest} more"] if rest > 0 else [])
    return f" Shaded: {listed(named)}."


def _when(from_s: float, to_s: float | None) -> str:
    return f"from {clock(from_s)} " + ("to the end" if to_s is None else f"to {clock(to_s)}")


def banded(
    chart: TimeChart, mean: Curve | None, std: Curve | None, name: str, tone: palette.Tone
) -> None:
    """Draw one of several lines with its 2-sigma band; one entry for all the bands."""
    if mean is None:
        return
    chart.deviation(mean, std, ONE_BAND.name, tone)
    own = LegendEntry(ONE_BAND.name, tone, "band")
    if own in chart.legend:
        chart.legend.remove(own)
        if ONE_BAND not in chart.legend:
            chart.legend.append(ONE_BAND)
    chart.line(mean, name, tone)


def settled(mean: Curve | None, std: Curve | None) -> Derived | None:
    """The curve from where it is known about as well as it is for most of the flight.

    What was assumed before anything was observed is so wide that it would flatten all the rest.
    """
    if mean is None or std is None or not np.isfinite(std.high).any():
        return None
    known = std.high <= WIDE * float(np.nanmedian(std.high))
    low, high = (np.where(known, values, np.nan) for values in (mean.low, mean.high))
    return Derived(mean.t_s, low, high, mean.unit)


class Tested(NamedTuple):
    """A sensor whose test is drawn: its name in the summary, in the chart, and its line."""

    sensor: str
    name: str
    tone: palette.Tone
    dash: str = "solid"


def tests_chart(flight: Flight, axis: Range1d, sensors: Sequence[Tested]) -> TimeChart:
    """How near each sensor came to a verdict: its test statistic over the threshold.

    What goes beyond :data:`MOST_RATIO` leaves the chart: how far, its evidence shows.
    """
    from bokeh.models import Range1d as Range

    found = [(t, flight.test(t.sensor)) for t in sensors]
    peaks = [
        float(np.nanmax(curve.high))
        for _, curve in found
        if curve is not None and np.isfinite(curve.high).any()
    ]
    top = min(max([1.3, *(1.1 * peak for peak in peaks)]), MOST_RATIO)
    chart = time_chart(axis, "test / threshold", height=150, y_range=Range(-0.05 * top, top))
    for tested, curve in found:
        chart.line(curve, tested.name, tested.tone, dash=tested.dash, width=1.2)
    if chart.legend:
        chart.threshold(1.0)
    return chart


def stacked(charts: Sequence[TimeChart]) -> list[TimeChart]:
    """Those charts in which something is drawn, as one picture.

    They share their time axis: tools stand above the first, the axis' name below the last.
    """
    shown = [chart for chart in charts if chart.legend]
    for chart in shown:
        chart.figure.min_border_left = LEFT_PX
    for chart in shown[1:]:
        chart.figure.toolbar_location = None
    for chart in shown[:-1]:
        chart.figure.xaxis[0].axis_label = None
    return shown
