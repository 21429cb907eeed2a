"""Charts that every finding has: error, test statistic, and for what scatters its range.

Each function gives a chart, or a sentence where there is nothing to draw: no chart is empty.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from monitor.pages import palette
from monitor.pages.charts import TimeChart
from monitor.pages.html import clock
from monitor.report import evidence_captions as captions
from monitor.report.evidence_data import Family, Limit, limit_of
from monitor.report.evidence_numbers import coarser, difference, smoothed, swings
from monitor.report.evidence_scene import POINTS, Scene
from monitor.report.section import Chart, Part, Text
from monitor.report.series import Series

if TYPE_CHECKING:
    from bokeh.plotting import figure as Figure

__all__ = [
    "ERROR",
    "chart_of",
    "differences",
    "draw_limits",
    "error_chart",
    "ratio_chart",
    "scatter_chart",
]

ERROR: Final = palette.MORE[3]
"""Tone of errors and of odds against a sensor."""
LOG_FROM: Final = 12.0
"""Ratios beyond this are shown on a logarithmic scale."""
LEAST_RATIO: Final = 0.02
WITHOUT_EXPECTATION: Final = (
    "Nothing told what it should have shown at this time: no error is drawn."
)


def error_chart(scene: Scene) -> Part:
    """The error, its deviation, and the size that it must exceed."""
    subject, error = scene.subject, scene.error
    if error is None:
        return Text(WITHOUT_EXPECTATION, "soft")
    limit = limit_of(scene.case, subject, scene.flight.settings)
    chart = scene.chart("error", subject.unit)
    name = "measured − expected" if subject.error is None else "reconstructed error"
    scene.line(chart, error, name, ERROR)
    scene.band(chart, error, scene.error_std, "2σ of it")
    draw_limits(scene, chart, limit)
    scene.mark(chart)
    return chart_of(scene, "error", chart, captions.error(scene, limit))


def draw_limits(scene: Scene, chart: TimeChart, limit: Limit | None) -> None:
    """The bounds of the error: across the chart, or as shares of what was expected."""
    if limit is None:
        return
    name = f"least fault ({limit.key})"
    if not limit.relative:
        bounds = [bound for bound in (limit.low, limit.high) if math.isfinite(bound)]
        chart.threshold(*bounds, name=name, unit=scene.subject.unit)
        return
    of = coarser(scene.expected, POINTS)
    if of is None:
        return
    for bound in limit.bounds(of.middle):
        chart.line(Series(of.t_s, bound, bound, of.unit), name, palette.THRESHOLD, dash="dashed")


def differences(
    scene: Scene, peers: list[tuple[str, Series]]
) -> tuple[TimeChart, list[tuple[str, Series]]]:
    """Differences among sensors of a kind, means over a second: who left whom.

    Returns
    -------
    chart, told
        The chart, and the name and series of each difference in it.
    """
    own = scene.own
    mine = scene.subject.sensor.partition(".")[0]
    named = [(name.partition(".")[0], series) for name, series in peers]
    if own is not None:
        named.insert(0, (mine, own))
    chart = scene.chart("difference", scene.subject.unit)
    told = []
    tones = iter((ERROR, palette.MORE[4], palette.MORE[1], *palette.MORE) * 4)
    for (a, first), (b, second) in combinations(named, 2):
        apart = difference(first, second)
        if apart is not None:
            middle = apart.middle
            apart = smoothed(Series(apart.t_s, middle, middle, apart.unit))
        if apart is not None:
            tone = next(tones) if a == mine else palette.REFERENCE
            scene.line(chart, apart, f"{a} − {b}, 1 s mean", tone, "" if a == mine else "dashed")
            told.append((f"{a} − {b}", apart))
    return chart, told


def scatter_chart(scene: Scene) -> Part:
    """How far the sensor and the others of its kind move within a second."""
    own = swings(scene.own)
    if own is None:
        return Text(f"Nothing of {scene.subject.sensor} was recorded at this time.", "soft")
    chart = scene.chart("range in 1 s", scene.subject.unit)
    scene.line(chart, own, scene.subject.sensor, palette.MEASURED)
    peers = []
    for (name, series), tone in zip(scene.peers(), palette.MORE[1:], strict=False):
        peer = swings(series)
        if peer is not None:
            peers.append((name, peer))
            scene.line(chart, peer, name, tone)
    scene.mark(chart)
    return chart_of(scene, "scatter", chart, captions.scatter(scene, own, peers))


def ratio_chart(scene: Scene) -> Part:
    """Test statistic over threshold, and whose fault a dispute between IMUs is."""
    sensor = scene.case.sensor
    ratio = scene.ratio(sensor)
    if ratio is None:
        return Text(f"The test statistic of {sensor} was not recorded at this time.", "soft")
    blame = None
    if scene.subject.family in (Family.ACC, Family.GYRO):
        blame = scene.column(f"{sensor.partition('.')[0]}_tests", "blame_ratio")
    caption = captions.ratio(scene, ratio, blame)
    most = max(float(np.nanmax(s.high)) for s in (ratio, blame) if s is not None)
    chart = scene.chart("statistic / threshold", "1")
    if most > LOG_FROM:
        _logarithmic(chart.figure, most)
        ratio = _floored(ratio)
        blame = _floored(blame) if blame is not None else None
    scene.line(chart, ratio, f"test of {sensor}", palette.MEASURED)
    scene.line(chart, blame, f"odds that it is {sensor.partition('.')[0]}", ERROR)
    chart.threshold(1.0, name="threshold")
    scene.mark(chart)
    return chart_of(scene, "test", chart, caption)


def _logarithmic(made: Figure, most: float) -> None:
    """A logarithmic vertical axis from :data:`LEAST_RATIO` to beyond the largest ratio."""
    from bokeh.models import LogScale, LogTicker, NumeralTickFormatter, Range1d

    ticker = LogTicker(desired_num_ticks=5)
    made.y_scale = LogScale()
    made.y_range = Range1d(LEAST_RATIO, 2.0 * most)
    made.yaxis.update(ticker=ticker, formatter=NumeralTickFormatter(format="0.[00]"))
    made.ygrid.update(ticker=ticker)


def _floored(series: Series) -> Series:
    """A logarithm has no zero: smaller ratios are drawn at the axis."""
    low, high = np.maximum(series.low, LEAST_RATIO), np.maximum(series.high, LEAST_RATIO)
    return Series(series.t_s, low, high, series.unit)


def chart_of(scene: Scene, name: str, chart: TimeChart | list[TimeChart], caption: str) -> Chart:
    """A chart with its caption, and the same in words for who cannot see it."""
    shown = f"{scene.subject.sensor} from {clock(scene.group.from_s)} to {clock(scene.group.to_s)}"
    return Chart(f"{scene.key}-{name}", chart, caption.strip(), f"{shown}. {caption}".strip())
