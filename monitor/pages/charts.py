"""One kind of chart for every page: values over seconds, with units, that a phone can scroll past.

A :class:`TimeChart` is made with the light colours of :mod:`monitor.pages.palette`; the page's
``theme.js`` exchanges them. Its legend is not drawn: it is a list (:attr:`TimeChart.legend`) that
the page sets above the chart, where it wraps on a phone and never covers data.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.hover import HOVERED, hover_columns
from monitor.pages.palette import LOOKS, Tone
from monitor.pages.units import on_screen

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource, Model, Range1d
    from bokeh.plotting import figure as Figure

__all__ = ["BAND_ALPHA", "Curve", "LegendEntry", "TimeChart", "style_figure", "time_chart"]

BAND_ALPHA: Final = 0.28
SHADE_ALPHA: Final = 0.16
HEIGHT: Final = 190
"""Of a chart, its axis included [px]."""
LEFT: Final = 70
"""Room for numbers and label on the left [px]: the same everywhere, so that charts align."""
SECONDS: Final = "00:00:00"
"""Format of the time axes; ``charts.js`` writes it as m:ss."""

FONT: Final = 'system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif'
"""As of ``base.css``."""

_UNSEEN: Final = {"line_alpha": 0.0, "line_color": palette.BAND.light}

Floats = NDArray[np.floating[Any]]


class Curve(Protocol):
    """What is drawn: least and largest value per moment; NaN breaks the line.

    Attributes
    ----------
    t_s : (n,) float64 [s]
        From the log's first record, rising.
    low, high : (n,) float64
        The same array where a moment has one value.
    unit
        Of both, as in :func:`monitor.columns.unit_of`.
    """

    @property
    def t_s(self) -> Floats: ...
    @property
    def low(self) -> Floats: ...
    @property
    def high(self) -> Floats: ...
    @property
    def unit(self) -> str: ...


class LegendEntry(NamedTuple):
    """One line of a legend: its name, its tone, and how it is drawn.

    ``style`` is ``"solid"``, ``"dashed"``, ``"dotted"``, ``"band"`` or ``"shade"``.
    """

    name: str
    tone: Tone
    style: str = "solid"


class TimeChart:
    """A figure over time, and what is drawn in it.

    Attributes
    ----------
    figure
        The Bokeh figure; anything may be added to it in colours of the palette.
    unit
        Unit of the vertical axis, as it is shown.
    legend
        What the page writes above the chart.
    """

    def __init__(self, figure: Figure, unit: str) -> None:
        self.figure = figure
        self.unit = unit
        self.legend: list[LegendEntry] = []
        self._lines: list[tuple[str, Floats, Floats, Floats]] = []
        self._hover_made = False

    def line(
        self,
        curve: Curve | None,
        name: str,
        tone: Tone = palette.MEASURED,
        *,
        dash: str = "solid",
        width: float = 1.5,
    ) -> TimeChart:
        """Draw a curve; where it has a least and a largest value, every peak of it.

        The line runs through both values of each moment. None draws nothing.
        """
        if curve is None or not np.isfinite(curve.low).any():
            return self
        factor, _ = on_screen(curve.unit)
        low, high = curve.low * factor, curve.high * factor
        t, y = _through(curve.t_s, low, high)
        self.figure.line(
            "t",
            "y",
            source=_source(t=t, y=y),
            line_color=tone.light,
            line_dash=dash,
            line_width=width,
        )
        self._lines.append((name, curve.t_s, low, high))
        self.legend.append(LegendEntry(name, tone, dash))
        return self

    def band(
        self, low: Curve | None, high: Curve | None, name: str, tone: Tone = palette.BAND
    ) -> TimeChart:
        """Fill what lies between two curves of the same moments; None draws nothing."""
        if low is None or high is None:
            return self
        factor, _ = on_screen(low.unit)
        return self._fill(low.t_s, low.low * factor, high.high * factor, name, tone)

    def deviation(
        self,
        mean: Curve | None,
        std: Curve | None,
        name: str = "2σ of it",
        tone: Tone = palette.BAND,
        *,
        times: float = 2.0,
    ) -> TimeChart:
        """Fill ``mean ± times * std``, two curves of the same moments; None draws nothing."""
        if mean is None or std is None:
            return self
        factor, _ = on_screen(mean.unit)
        low, high = mean.low - times * std.high, mean.high + times * std.high
        return self._fill(mean.t_s, low * factor, high * factor, name, tone)

    def threshold(self, *values: float, name: str = "threshold", unit: str = "") -> TimeChart:
        """Draw what the values are held to, across the whole chart.

        Parameters
        ----------
        *values
            One, or a lower and an upper one, in ``unit`` (by default that of the axis).
        """
        from bokeh.models import Span

        factor = on_screen(unit)[0] if unit else 1.0
        for value in values:
            line = Span(
                location=value * factor,
                dimension="width",
                line_color=palette.THRESHOLD.light,
                line_dash=[6, 4],
                line_width=1.5,
            )
            self.figure.add_layout(line)
        self._keep_in_view(value * factor for value in values)
        self.legend.append(LegendEntry(name, palette.THRESHOLD, "dashed"))
        return self

    def shade(self, from_s: float, to_s: float, state: State) -> TimeChart:
        """Shade a span in which a sensor had a state, with the state's hatch."""
        from bokeh.models import BoxAnnotation

        look = LOOKS[state]
        box = BoxAnnotation(
            left=from_s,
            right=to_s,
            fill_color=look.tone.light,
            fill_alpha=SHADE_ALPHA,
            line_color=None,
            level="underlay",
        )
        if look.hatch:
            box.update(hatch_pattern=look.hatch, hatch_color=look.tone.light, hatch_alpha=0.35)
        self.figure.add_layout(box)
        entry = LegendEntry(look.word, look.tone, "shade")
        if entry not in self.legend:
            self.legend.append(entry)
        return self

    def mark(self, at_s: float | None, word: str, tone: Tone = palette.INK) -> TimeChart:
        """Draw a moment with its word beside it: onset, detected, cleared; None draws nothing.

        Words of neighbouring moments stand on different heights.
        """
        if at_s is None:
            return self
        from bokeh.models import Label, Span

        at = Span(location=at_s, dimension="height", line_color=tone.light, line_dash=[2, 3])
        rows = sum(isinstance(item, Label) for item in self.figure.center)
        axis = self.figure.x_range
        late = at_s > 0.25 * axis.start + 0.75 * axis.end
        label = Label(
            x=at_s,
            y=2 + 15 * (rows % 3),
            y_units="screen",
            x_offset=-4 if late else 4,
            text=word,
            text_align="right" if late else "left",
            text_color=tone.light,
            text_font=FONT,
            text_font_size="11px",
            background_fill_color=palette.PAPER.light,
            background_fill_alpha=0.7,
        )
        self.figure.add_layout(at)
        self.figure.add_layout(label)
        return self

    @property
    def model(self) -> Model:
        """The figure, ready to be shown: what stands under the pointer is added now."""
        if not self._hover_made and self._lines:
            self._hover_made = True
            self._add_hover()
        return self.figure

    def _fill(self, t_s: Floats, low: Floats, high: Floats, name: str, tone: Tone) -> TimeChart:
        x, y = _outline(t_s, low, high)
        if x.size:
            patch = self.figure.patch(
                "t",
                "y",
                source=_source(t=x, y=y),
                fill_color=tone.light,
                fill_alpha=BAND_ALPHA,
                line_color=None,
            )
            patch.level = "underlay"
            self.legend.append(LegendEntry(name, tone, "band"))
        return self

    def _keep_in_view(self, values: Iterable[float]) -> None:
        """Let the automatic range hold these values: an unseen point at each."""
        y = np.array(list(values))
        t = np.full(y.size, self.figure.x_range.start)
        self.figure.line("t", "y", source=_source(t=t, y=y), **_UNSEEN)

    def _add_hover(self) -> None:
        """One box with the time and every line's value, instead of one box per line."""
        from bokeh.models import HoverTool

        columns, formats = hover_columns(self._lines)
        tooltips = [("time", "@t{0.0} s")]
        for name, shown in formats:
            tooltips.append((name, f"{shown} {self.unit}".rstrip()))
        source = _source(**columns)
        seen = self.figure.line("t", HOVERED, source=source, **_UNSEEN)
        self.figure.add_tools(
            HoverTool(
                renderers=[seen],
                tooltips=tooltips,
                mode="vline",
                attachment="horizontal",
                visible=False,
            )
        )


def time_chart(
    axis: Range1d,
    label: str,
    unit: str = "",
    *,
    height: int = HEIGHT,
    y_range: Any = None,
    y_bounds: tuple[float, float] | None = None,
) -> TimeChart:
    """An empty chart of a page: units on both axes, m:ss below, as wide as there is room.

    Parameters
    ----------
    axis
        Seconds from the log's first record; charts that share it move together.
    label
        What the vertical axis shows, without its unit.
    unit
        Unit of what will be drawn, as :func:`monitor.columns.unit_of` has it; ``rad`` is shown in
        degrees.
    height
        Of the figure, its axis included [px].
    y_range
        A Bokeh range, or None for the range of what is drawn.
    y_bounds
        What the automatic range holds at least, in the unit of the axis.
    """
    from bokeh.models import DataRange1d
    from bokeh.plotting import figure

    shown = on_screen(unit)[1]
    if y_range is None:
        y_range = DataRange1d(range_padding=0.06, only_visible=False)
    made = figure(
        x_range=axis,
        y_range=y_range,
        height=height,
        x_axis_label="time (m:ss)",
        y_axis_label=f"{label} ({shown})" if shown else label,
        tools="",
    )
    style_figure(made)
    chart = TimeChart(made, shown)
    if y_bounds is not None:
        chart._keep_in_view(y_bounds)
    return chart


def style_figure(made: Figure, *, over_time: bool = True) -> None:
    """Give a figure the look and the tools of all charts.

    Wheel and drag do not keep a page from scrolling: the wheel zooms with Ctrl held only, and
    ``charts.js`` puts dragging off where the pointer is a finger.

    Parameters
    ----------
    made
        Any Bokeh figure.
    over_time
        Its horizontal axis is seconds: ticks at m:ss, tools along time only.
    """
    from bokeh.models import (
        AdaptiveTicker,
        NoOverlap,
        NumeralTickFormatter,
        PanTool,
        ResetTool,
        WheelZoomTool,
        ZoomInTool,
        ZoomOutTool,
    )

    ways = "width" if over_time else "both"
    pan = PanTool(dimensions=ways)
    wheel = WheelZoomTool(dimensions=ways, modifiers={"ctrl": True})
    made.add_tools(
        pan, wheel, ZoomInTool(dimensions=ways), ZoomOutTool(dimensions=ways), ResetTool()
    )
    made.toolbar.update(active_drag=pan, active_scroll=wheel, logo=None, autohide=False)
    made.update(
        sizing_mode="stretch_width",
        min_border_left=LEFT,
        min_border_right=12,
        min_border_top=6,
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=palette.LINE.light,
        toolbar_location="above",
        lod_threshold=None,
    )
    for grid in made.grid:
        grid.update(grid_line_color=palette.LINE.light, grid_line_alpha=0.7)
    for axis in made.axis:
        axis.update(
            axis_label_text_color=palette.SOFT.light,
            axis_label_text_font_size="12px",
            axis_label_text_font_style="normal",
            axis_label_text_font=FONT,
            axis_label_standoff=6,
            major_label_text_color=palette.SOFT.light,
            major_label_text_font_size="12px",
            major_label_text_font=FONT,
            axis_line_color=palette.LINE.light,
            major_tick_line_color=palette.LINE.light,
            minor_tick_line_color=None,
            major_tick_in=0,
            major_tick_out=4,
            major_label_policy=NoOverlap(min_distance=8),
        )
    if over_time:
        ticks = AdaptiveTicker(
            base=60, mantissas=[1, 2, 5, 10, 15, 20, 30], min_interval=1, desired_num_ticks=8
        )
        made.xaxis[0].update(ticker=ticks, formatter=NumeralTickFormatter(format=SECONDS))
        made.xgrid[0].update(ticker=ticks)


def _source(**columns: NDArray[Any]) -> ColumnDataSource:
    """Columns as the page holds them: 4 bytes a number, times and values alike."""
    from bokeh.models import ColumnDataSource

    return ColumnDataSource({name: column.astype(np.float32) for name, column in columns.items()})


def _through(t_s: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """A line through the least and largest value of each moment, turning round at each.

    Low and high change places from moment to moment, so that the line goes straight along each
    envelope instead of crossing it; a moment of one value gives one point.

    Returns
    -------
    t, y : (m,) float64, n <= m <= 2 n
    """
    if low is high or np.array_equal(low, high, equal_nan=True):
        return t_s, low
    down = np.arange(t_s.size) % 2 == 1
    pairs = np.stack([np.where(down, high, low), np.where(down, low, high)], axis=1)
    wanted = np.stack([np.ones(t_s.size, bool), pairs[:, 0] != pairs[:, 1]], axis=1)
    wanted[:, 1] &= ~np.isnan(pairs[:, 0])
    return np.repeat(t_s, 2)[wanted.ravel()], pairs.ravel()[wanted.ravel()]


def _outline(t_s: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Closed outlines of a band, one for each piece without a gap, NaN between them."""
    good = np.isfinite(low) & np.isfinite(high)
    edges = np.flatnonzero(np.diff(np.r_[False, good, False]))
    t: list[Floats] = []
    y: list[Floats] = []
    for start, end in edges.reshape(-1, 2):
        piece = slice(start, end)
        t += [t_s[piece], t_s[piece][::-1], np.array([np.nan])]
        y += [low[piece], high[piece][::-1], np.array([np.nan])]
    if not t:
        return np.empty(0), np.empty(0)
    return np.concatenate(t[:-1]), np.concatenate(y[:-1])
