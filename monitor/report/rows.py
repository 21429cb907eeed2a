"""A timeline of named rows: bars and marks over the shared seconds, each told under the pointer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from monitor.pages import palette
from monitor.pages.charts import style_figure
from monitor.pages.palette import Tone

if TYPE_CHECKING:
    from bokeh.models import Range1d
    from bokeh.plotting import figure as Figure

__all__ = ["Bar", "Mark", "rows_figure"]

ROW_PX: Final = 24
MOST_TOLD: Final = 4
"""Bars and marks under the pointer that are told at once."""
FRAME_PX: Final = 86
"""Tools above and axis below [px]."""


class Bar(NamedTuple):
    """A span in a row, with the words that the pointer shows.

    ``hatch`` is a pattern of Bokeh, or empty; ``height`` a share of the row.
    """

    row: str
    from_s: float
    to_s: float
    tone: Tone
    hatch: str
    words: str
    height: float = 0.6


class Mark(NamedTuple):
    """A moment in a row, with the words that the pointer shows; ``marker`` is one of Bokeh's."""

    row: str
    at_s: float
    tone: Tone
    marker: str
    words: str


def rows_figure(
    axis: Range1d, rows: Sequence[str], bars: Sequence[Bar], marks: Sequence[Mark]
) -> Figure:
    """Rows from the top down; short bars stay visible."""
    from bokeh.models import FactorRange, HoverTool
    from bokeh.plotting import figure

    made = figure(
        x_range=axis,
        y_range=FactorRange(factors=list(reversed(rows))),
        height=FRAME_PX + ROW_PX * len(rows),
        x_axis_label="time (m:ss)",
        tools="",
    )
    style_figure(made)
    made.ygrid[0].grid_line_color = None
    made.yaxis[0].update(major_tick_out=0, axis_line_color=None)
    seen = []
    for tone, hatch, height in dict.fromkeys((b.tone, b.hatch, b.height) for b in bars):
        own = [b for b in bars if (b.tone, b.hatch, b.height) == (tone, hatch, height)]
        seen.append(
            made.hbar(
                "row",
                left="from",
                right="to",
                height=height,
                source=_source(
                    {
                        "row": [b.row for b in own],
                        "from": [b.from_s for b in own],
                        "to": [b.to_s for b in own],
                        "words": [b.words for b in own],
                    }
                ),
                fill_color=tone.light,
                fill_alpha=0.75,
                line_color=tone.light,
                hatch_pattern=hatch or None,
                hatch_color=palette.PAPER.light,
                hatch_alpha=0.6,
            )
        )
    for tone, marker in dict.fromkeys((m.tone, m.marker) for m in marks):
        points = [m for m in marks if (m.tone, m.marker) == (tone, marker)]
        seen.append(
            made.scatter(
                "at",
                "row",
                marker=marker,
                size=9,
                source=_source(
                    {
                        "row": [m.row for m in points],
                        "at": [m.at_s for m in points],
                        "words": [m.words for m in points],
                    }
                ),
                fill_color=tone.light,
                line_color=tone.light,
                line_width=1.5,
            )
        )
    made.add_tools(
        HoverTool(limit=MOST_TOLD, renderers=seen, tooltips=[("", "@words")], attachment="vertical")
    )
    return made


def _source(columns: dict[str, list[object]]) -> object:
    from bokeh.models import ColumnDataSource

    return ColumnDataSource(columns)
