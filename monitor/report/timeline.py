"""What was said of every watched sensor, over the whole flight, and what was found.

The chart has a row for each sensor; a state is told by colour, hatch and height of its bar, and by
its word. The table behind it says the same to whoever does not point at bars.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.charts import FONT, LegendEntry, style_figure
from monitor.pages.html import clock
from monitor.pages.palette import LOOKS
from monitor.pages.units import quantity
from monitor.report.evidence_cases import anchors
from monitor.report.section import (
    Chart,
    Column,
    Fold,
    Link,
    Part,
    Said,
    Section,
    Table,
    Text,
    event_key,
    fault_key,
)

if TYPE_CHECKING:
    from bokeh.models import Range1d
    from bokeh.plotting import figure as Figure

    from monitor.report.flight import Flight
    from monitor.report.spans import Span

__all__ = ["section"]

ROW: Final = 19
"""Height of a sensor's row [px]."""
TABLE_ROWS: Final = 400
"""Rows of a table, at most; all that a flight that flutters has is in ``summary.json``."""
WORDED: Final = 0.12
"""Part of the flight from which on a bar has room for its word."""

_GRAVITY: Final = (
    State.FAULTY,
    State.STOPPED,
    State.SUSPECT,
    State.STALE,
    State.OK,
    State.UNMONITORED,
    State.ABSENT,
)
_LOUD: Final = frozenset({State.FAULTY, State.STOPPED, State.SUSPECT})


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Faults and events as a table, then the timeline; None where nothing was watched."""
    if not flight.spans:
        return None
    order = sorted(flight.spans, key=lambda sensor: (_gravity(flight.spans[sensor]), sensor))
    return Section(
        key="sensors",
        title="Sensors over the flight",
        parts=[*_found(flight), _chart(flight, axis, order), _table(flight, order)],
    )


def _gravity(spans: Iterable[Span]) -> int:
    """The worst state that a sensor had: what is wrong stands on top."""
    return min(_GRAVITY.index(span.state) for span in spans)


def _found(flight: Flight) -> list[Part]:
    """Every fault and event, with a link to its evidence."""
    summary, at = flight.summary, anchors(flight.summary, flight.duration_s)
    rows: list[list[str | Link | Said]] = [
        [
            Link(fault["sensor"], f"#{at[fault_key(k)]}"),
            Said(State.FAULTY),
            fault["kind"],
            clock(fault["onset_s"]),
            clock(fault["isolated_s"]),
            clock(fault["cleared_s"]),
            quantity(fault["magnitude"], fault["unit"], sign=True),
            fault["evidence"],
        ]
        for k, fault in enumerate(summary["faults"])
    ]
    rows += [
        [
            Link(event["what"], f"#{at[event_key(k)]}"),
            Said(State(event["state"])),
            "event",
            clock(event["onset_s"]),
            clock(event["detected_s"]),
            clock(event["ended_s"]),
            "–",
            event["evidence"],
        ]
        for k, event in enumerate(summary["events"])
    ]
    if not rows:
        return []
    columns = [
        Column("sensor"),
        Column("state"),
        Column("kind"),
        Column("onset", number=True),
        Column("named", number=True),
        Column("cleared", number=True),
        Column("size", number=True),
        Column("evidence", long=True),
    ]
    return [Table("What was found", columns, rows[:TABLE_ROWS]), *_left(rows)]


def _chart(flight: Flight, axis: Range1d, order: Sequence[str]) -> Chart:
    from bokeh.models import AllLabels, CategoricalAxis, FactorRange, HoverTool
    from bokeh.plotting import figure

    rows = FactorRange(
        factors=list(reversed(order)), range_padding=0.3, range_padding_units="absolute"
    )
    made = figure(
        x_range=axis,
        y_range=rows,
        height=ROW * len(order) + 92,
        x_axis_label="time (m:ss)",
        tools="",
    )
    style_figure(made)
    made.ygrid[0].grid_line_color = None
    for names in made.select(CategoricalAxis):
        names.update(
            major_tick_line_color=None,
            major_label_text_color=palette.INK.light,
            major_label_policy=AllLabels(),
        )
    states = [state for state in LOOKS if any(_has(flight.spans[s], state) for s in order)]
    drawn = [_bars(made, flight, order, state) for state in states]
    made.add_tools(
        HoverTool(
            renderers=[_rows(made, flight, order)],
            tooltips=[("", "@sensor: @said"), ("", "@when"), ("", "@why")],
            attachment="vertical",
            visible=False,
        )
    )
    _lead_to_evidence(
        made, [bar for bar, state in zip(drawn, states, strict=True) if state in _LOUD]
    )
    legend = [LegendEntry(LOOKS[s].word, LOOKS[s].tone, f"swatch {s}") for s in states]
    return Chart(
        key="timeline",
        model=made,
        caption=_caption(states),
        alt=_in_words(flight, order),
        more_legend=legend,
    )


def _caption(states: Sequence[State]) -> str:
    rows = "One row for each watched sensor"
    if _LOUD.isdisjoint(states):
        return f"{rows}. Point at a bar for its reason."
    wrong = "what was wrong on top. Point at a bar for its reason; tap a tall one for its evidence."
    return f"{rows}, {wrong}"


def _has(spans: Iterable[Span], state: State) -> bool:
    return any(span.state is state for span in spans)


def _rows(made: Figure, flight: Flight, order: Sequence[str]) -> Any:
    """What stands under the pointer: each span as high as its row, unseen."""
    from bokeh.models import ColumnDataSource

    spans = [(sensor, span) for sensor in order for span in flight.spans[sensor]]
    source = ColumnDataSource(
        {
            "sensor": [sensor for sensor, _ in spans],
            "from": [round(span.from_s, 2) for _, span in spans],
            "to": [round(span.to_s, 2) for _, span in spans],
            "said": [_said(span) for _, span in spans],
            "when": [_when(span) for _, span in spans],
            "why": [_why(span) for _, span in spans],
        }
    )
    return made.hbar(
        "sensor",
        left="from",
        right="to",
        height=1.0,
        source=source,
        color=palette.BAND.light,
        alpha=0.0,
    )


def _bars(
    made: Figure,
    flight: Flight,
    order: Sequence[str],
    state: State,
) -> Any:
    """All bars of one state, and its word where there is room."""
    from bokeh.core.properties import value
    from bokeh.models import ColumnDataSource

    look = LOOKS[state]
    spans = [(sensor, s) for sensor in order for s in flight.spans[sensor] if s.state is state]
    columns: dict[str, list[Any]] = {
        "sensor": [sensor for sensor, _ in spans],
        "from": [round(span.from_s, 2) for _, span in spans],
        "to": [round(span.to_s, 2) for _, span in spans],
    }
    if state in _LOUD:
        at = anchors(flight.summary, flight.duration_s)
        columns["href"] = [_href(flight, sensor, span, at) for sensor, span in spans]
    bars = made.hbar(
        y="sensor",
        left="from",
        right="to",
        height=look.height * 0.86,
        source=ColumnDataSource(columns),
        fill_color=look.tone.light,
        line_color=look.tone.light,
        line_width=2 if state in _LOUD else 0.5,
    )
    # A bar that was tapped looks like the others, in the dark too.
    bars.update(selection_glyph=bars.glyph, nonselection_glyph=bars.glyph)
    if look.hatch:
        bars.glyph.update(
            hatch_pattern=look.hatch,
            hatch_color=palette.PAPER.light,
            hatch_alpha=0.55,
            hatch_scale=7,
            hatch_weight=1.5,
        )
    if state in _LOUD:
        wide = [
            i for i, (_, s) in enumerate(spans) if s.to_s - s.from_s > WORDED * flight.duration_s
        ]
        words = ColumnDataSource(
            {
                "sensor": [spans[i][0] for i in wide],
                "at": [spans[i][1].from_s for i in wide],
                "said": [look.word for _ in wide],
            }
        )
        made.text(
            x="at",
            y="sensor",
            text="said",
            source=words,
            x_offset=5,
            y_offset=1,
            text_baseline="middle",
            text_color=palette.PAPER.light if state is not State.SUSPECT else palette.INK.light,
            text_font=value(FONT),
            text_font_size="11px",
            text_font_style="bold",
        )
    return bars


def _lead_to_evidence(made: Figure, bars: Sequence[Any]) -> None:
    """A tap on a bar goes to the evidence of its fault."""
    from bokeh.models import OpenURL, TapTool

    if bars:
        made.add_tools(
            TapTool(
                renderers=list(bars), callback=OpenURL(url="@href", same_tab=True), visible=False
            )
        )


def _href(flight: Flight, sensor: str, span: Span, at: Mapping[str, str]) -> str:
    """Where the evidence of a bar stands: that of the newest fault or event at its beginning."""
    summary, at_s = flight.summary, span.from_s + 0.01
    found = "#sensors"
    for k, fault in enumerate(summary["faults"]):
        if fault["sensor"] == sensor and fault["onset_s"] <= at_s:
            found = f"#{at[fault_key(k)]}"
    for k, event in enumerate(summary["events"]):
        if event["what"] == sensor and event["onset_s"] <= at_s:
            found = f"#{at[event_key(k)]}"
    return found


def _said(span: Span) -> str:
    return f"{LOOKS[span.state].word} ({span.kind})" if span.kind else LOOKS[span.state].word


def _when(span: Span) -> str:
    seconds = span.to_s - span.from_s
    return f"{clock(span.from_s)} to {clock(span.to_s)} ({span.from_s:.1f} s, for {seconds:.1f} s)"


def _why(span: Span) -> str:
    return span.evidence or span.reason or ""


def _table(flight: Flight, order: Sequence[str]) -> Fold:
    """The chart in words."""
    rows: list[list[str | Link | Said]] = [
        [sensor, Said(span.state), clock(span.from_s), clock(span.to_s), _told(span)]
        for sensor in order
        for span in flight.spans[sensor]
    ]
    columns = [
        Column("sensor"),
        Column("state"),
        Column("from", number=True),
        Column("to", number=True),
        Column("why", long=True),
    ]
    table = Table("States of every sensor", columns, rows[:TABLE_ROWS])
    return Fold("The timeline as a table", [table, *_left(rows)])


def _left(rows: Sequence[object]) -> list[Part]:
    """How many rows there was no room for."""
    more = len(rows) - TABLE_ROWS
    return [Text(f"{more:,} more are not listed.", "soft")] if more > 0 else []


def _told(span: Span) -> str:
    return ": ".join(filter(None, (span.kind, _why(span))))


def _in_words(flight: Flight, order: Sequence[str]) -> str:
    """What the chart shows, for whoever does not see it."""
    counts = {
        state: sum(_has(flight.spans[sensor], state) for sensor in order) for state in _GRAVITY
    }
    said = ", ".join(f"{n} {LOOKS[s].word}" for s, n in counts.items() if n)
    return f"Timeline of {len(order)} sensors over {clock(flight.duration_s)}; at some time {said}."
