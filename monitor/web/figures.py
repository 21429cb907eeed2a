"""The live page's figures: made here by Bokeh, without data; the page's script fills them.

Each is a JSON item of its own, so that the page makes only those whose sensors exist. There is no
tool in them: a finger that drags scrolls the page, and what stands under the pointer is written
beside the chart, where new data do not sweep it away.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import groupby
from typing import Any, Final

from links.vocabulary import State
from monitor.pages.charts import BAND_ALPHA, style_figure
from monitor.pages.palette import LOOKS, MORE, PAPER, RECONSTRUCTED, THRESHOLD
from monitor.web.catalogue import IMUS, Chart, Curve, charts

__all__ = ["TONES", "WINDOWS_S", "catalogue"]

WINDOWS_S: Final = (60, 120, 300)
"""Lengths of the window that the page offers [s]."""
TONES: Final = (*MORE, RECONSTRUCTED)
"""Colours of lines; the page's keys name them by their place here."""

HEIGHT: Final = 170
ROW_PX: Final = 16
AXIS_PX: Final = 30
FLOOR: Final = 0.01
"""Test ratios below this are drawn as this: the axis is logarithmic."""
TOP: Final = 10_000
LEFT: Final = 50
TIMELINE_LEFT: Final = 100


def catalogue() -> dict[str, Any]:
    """All that the page's script is given: charts, timeline, and how states look.

    Returns
    -------
    dict
        ``charts``: key, title, unit, about, least, log, floor, ``series`` (column, std, label,
        look) and Bokeh's ``item`` of each. ``timeline``: its item and measures. ``looks``: mark
        and word by state.
    """
    return {
        "charts": list(_entries()),
        "timeline": {
            "key": "timeline",
            "about": "State of every sensor over the last minutes; the table says the same of now.",
            "states": [str(state) for state in LOOKS if state is not State.ABSENT],
            "words": {str(state): look.word for state, look in LOOKS.items()},
            "row_px": ROW_PX,
            "axis_px": AXIS_PX,
            "item": _item(_timeline()),
        },
        "looks": {str(s): {"mark": look.mark, "word": look.word} for s, look in LOOKS.items()},
    }


def _entry(chart: Chart) -> dict[str, Any]:
    return {
        "key": chart.key,
        "title": chart.title,
        "unit": chart.unit,
        "about": chart.about,
        "least": chart.least,
        "log": chart.ratio,
        "floor": FLOOR,
        "series": [
            {
                "column": line.column,
                "std": line.std,
                "label": line.label,
                "look": line.dash,
                "tone": f"tone-{TONES.index(line.tone)}",
            }
            for line in chart.lines
        ],
        "item": _item(_lines(chart)),
    }


def _entries() -> Iterator[dict[str, Any]]:
    """The charts' entries; those of the first IMU once more for each other one, by its name."""
    for imu, some in groupby(charts(), key=lambda chart: chart.key.startswith("imu0")):
        entries = [_entry(chart) for chart in some]
        if not imu:
            yield from entries
            continue
        text = json.dumps(entries)
        for i in range(IMUS):
            yield from json.loads(text.replace("imu0", f"imu{i}"))


def _item(figure: Any) -> dict[str, Any]:
    from bokeh.embed import json_item

    item: dict[str, Any] = json_item(figure)
    return item


def _empty(y_range: Any, height: int, left: int, **options: Any) -> Any:
    """A figure without tools whose time axis is seconds before now, named as ``-m:ss``."""
    from bokeh.models import FixedTicker, Range1d
    from bokeh.plotting import figure

    made = figure(
        x_range=Range1d(-WINDOWS_S[1], 0), y_range=y_range, height=height, tools="", **options
    )
    style_figure(made, over_time=False)
    made.toolbar.tools = []
    made.update(toolbar_location=None, min_border_left=left, min_border_right=14)
    ticker = FixedTicker(ticks=[])
    made.xaxis[0].update(ticker=ticker, major_label_overrides=_before_now(max(WINDOWS_S)))
    made.xgrid[0].update(ticker=ticker)
    return made


def _before_now(longest_s: int) -> dict[int, str]:
    """Labels of the time axis by its ticks."""
    labels = {-s: f"−{s // 60}:{s % 60:02d}" for s in range(10, longest_s + 1, 10)}
    return {0: "now", **labels}


def _lines(chart: Chart) -> Any:
    """The figure of a chart; its one source is named ``rows``, each renderer after its column."""
    from bokeh.models import ColumnDataSource, FixedTicker, Line, Range1d, Span, VArea

    options: dict[str, Any] = {"y_axis_type": "log"} if chart.ratio else {}
    bounds = (FLOOR, 10.0) if chart.ratio else (0.0, chart.least)
    made = _empty(Range1d(*bounds), HEIGHT, LEFT, **options)
    names = ["x", *(name for line in chart.lines for name in _columns(line))]
    source = ColumnDataSource({name: [] for name in names}, name="rows")
    alone: dict[str, Any] = {
        "selection_glyph": None,
        "nonselection_glyph": None,
        "muted_glyph": None,
        "visible": False,
    }
    for line in chart.lines:
        if line.std is not None:
            _, low, high = _columns(line)
            tone = {"fill_color": line.tone.light, "fill_alpha": 0.6 * BAND_ALPHA}
            band = VArea(x="x", y1=low, y2=high, **tone)
            made.add_glyph(source, band, name=line.column, level="underlay", **alone)
    for line in chart.lines:
        tone = {"line_color": line.tone.light, "line_dash": line.dash, "line_width": line.width}
        made.add_glyph(source, Line(x="x", y=line.column, **tone), name=line.column, **alone)
    if chart.ratio:
        one = Span(location=1.0, dimension="width", line_dash=[6, 4], line_width=1.5)
        one.line_color = THRESHOLD.light
        made.add_layout(one)
        ticker = FixedTicker(ticks=[FLOOR, 0.1, 1, 10, 100, 1000, TOP])
        made.yaxis[0].update(
            ticker=ticker, major_label_overrides={t: f"{t:g}" for t in ticker.ticks}
        )
        made.ygrid[0].update(ticker=ticker)
    return made


def _columns(line: Curve) -> list[str]:
    """Of the source, for one line."""
    band = [] if line.std is None else [f"{line.column}.low", f"{line.column}.high"]
    return [line.column, *band]


def _timeline() -> Any:
    """The timeline: a source of bars for each state, so that each has one colour and one hatch."""
    from bokeh.models import AllLabels, ColumnDataSource, FactorRange

    made = _empty(FactorRange(factors=["–"]), ROW_PX + AXIS_PX, TIMELINE_LEFT)
    made.ygrid[0].grid_line_color = None
    made.yaxis[0].update(major_label_policy=AllLabels(), major_label_text_font_size="11px")
    for state, look in LOOKS.items():
        if state is State.ABSENT:
            continue
        bars = made.hbar(
            "sensor",
            left="left",
            right="right",
            height=look.height,
            source=ColumnDataSource({"sensor": [], "left": [], "right": []}, name=f"state-{state}"),
            fill_color=look.tone.light,
            line_color=None,
        )
        bars.update(selection_glyph=None, nonselection_glyph=None, muted_glyph=None)
        if look.hatch:
            bars.glyph.update(
                hatch_pattern=look.hatch, hatch_color=PAPER.light, hatch_scale=8, hatch_alpha=0.8
            )
    return made
