"""Section: the ground track, coloured by state; no map, for that would ask the network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.charts import LegendEntry, style_figure
from monitor.pages.html import clock
from monitor.pages.palette import LOOKS
from monitor.report.section import Chart, Section
from monitor.report.wording import listed, number

if TYPE_CHECKING:
    from bokeh.models import Range1d
    from bokeh.plotting import figure as Figure

    from monitor.report.flight import Flight
    from monitor.report.series import Track
    from monitor.report.spans import Span

__all__ = ["section", "states_along"]

Floats = NDArray[np.float64]

HEIGHT: Final = 440
LEAST_M: Final = 50.0
"""A track that stays within this is no picture [m]."""

ORDER: Final = (State.UNMONITORED, State.OK, State.SUSPECT, State.STOPPED, State.FAULTY)
"""What a place is drawn in: the last of these that any sensor had there."""
_STYLES: Final = {
    State.UNMONITORED: (2.0, "dotted"),
    State.OK: (2.5, "solid"),
    State.SUSPECT: (5.0, "dashed"),
    State.STOPPED: (6.0, "dotdash"),
    State.FAULTY: (6.0, "solid"),
}
"""Width and dash: states differ by more than their colour."""
_WORDS: Final = {
    State.UNMONITORED: "nothing judged",
    State.OK: "all that was judged is ok",
    State.SUSPECT: "a sensor suspect",
    State.STOPPED: "engine stopped",
    State.FAULTY: "a sensor faulty",
}
_REFERENCES: Final = ("gps", "attitude")
"""That a reference keeps coming makes no place a judged one."""


def section(flight: Flight, axis: Range1d) -> Section | None:
    """Where the aircraft flew, and where it had a fault; None without positions."""
    track = flight.track()
    if track is None or not np.isfinite(track.north_m).any():
        return None
    wide_m = max(float(np.nanmax(v) - np.nanmin(v)) for v in (track.north_m, track.east_m))
    if wide_m < LEAST_M:
        return None
    states, said = states_along(flight.spans, track.t_s)
    present = [state for state in ORDER if (states == ORDER.index(state)).any()]
    legend = [LegendEntry(_WORDS[s], LOOKS[s].tone, _legend_style(s)) for s in present]
    caption = (
        f"North is up; metres from where the log begins, drawn to the same scale both ways. "
        f"Positions from {track.source}."
    )
    return Section(
        "track",
        "Ground track",
        _lead(flight.summary),
        [
            Chart(
                "ground-track",
                _figure(track, states, said, present),
                caption,
                f"Map of the ground track, {number(wide_m / 1000.0, 2)} km across, by state: "
                f"{listed([_WORDS[s] for s in present])}.",
                more_legend=legend,
            )
        ],
    )


def _lead(summary: Mapping[str, Any]) -> str:
    found = summary["faults"]
    if not found:
        return ""
    first = found[0]
    until = "" if first["cleared_s"] is None else f" to {clock(first['cleared_s'])}"
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return (
        f"The thick line is where a sensor was called faulty: {first['sensor']} from "
        f"{clock(first['detected_s'])}{until}{more}."
    )


def _legend_style(state: State) -> str:
    return {"dotdash": "dashed"}.get(_STYLES[state][1], _STYLES[state][1])


def states_along(
    spans: Mapping[str, Sequence[Span]], t_s: Floats
) -> tuple[NDArray[np.int64], list[str]]:
    """The gravest state of any sensor at each moment, and which sensors had it.

    Parameters
    ----------
    spans
        Sensor -> its states, whole log.
    t_s : (n,) float64 [s]
        Moments, rising.

    Returns
    -------
    states : (n,) int64
        Index into :data:`ORDER`.
    said
        Per moment the sensors that are faulty, suspect or stopped; otherwise empty.
    """
    states = np.zeros(t_s.size, np.int64)
    who: list[list[str]] = [[] for _ in range(t_s.size)]
    for sensor, own in spans.items():
        reference = sensor.rstrip("0123456789") in _REFERENCES
        for span in own:
            if span.state not in ORDER or (reference and span.state is State.OK):
                continue
            rank = ORDER.index(span.state)
            first, last = np.searchsorted(t_s, [span.from_s, span.to_s])
            grave = rank > ORDER.index(State.OK)
            for i in range(first, last):
                if rank > states[i]:
                    states[i], who[i] = rank, []
                if grave and rank == states[i]:
                    who[i].append(sensor)
    return states, [", ".join(dict.fromkeys(names)) for names in who]


def _figure(
    track: Track, states: NDArray[np.int64], said: list[str], present: list[State]
) -> Figure:
    from bokeh.models import DataRange1d
    from bokeh.plotting import figure

    made = figure(
        height=HEIGHT,
        match_aspect=True,
        x_range=DataRange1d(range_padding=0.08),
        y_range=DataRange1d(range_padding=0.08),
        x_axis_label="east (m)",
        y_axis_label="north (m)",
        tools="",
    )
    style_figure(made, over_time=False)
    for state in present:
        _pieces(made, track, states, state)
    _marks(made, track)
    _hover(made, track, states, said)
    return made


def _pieces(made: Figure, track: Track, states: NDArray[np.int64], state: State) -> None:
    """The pieces of the track in one state, each joined to the point after it."""
    here = states == ORDER.index(state)
    shown = here | np.r_[False, here[:-1]]
    width, dash = _STYLES[state]
    made.line(
        np.where(shown, track.east_m, np.nan).astype(np.float32),
        np.where(shown, track.north_m, np.nan).astype(np.float32),
        line_color=LOOKS[state].tone.light,
        line_width=width,
        line_dash=dash,
        line_join="round",
        line_cap="round" if dash == "solid" else "butt",
    )


def _marks(made: Figure, track: Track) -> None:
    """Start and end, a scale and an arrow to the north."""
    from bokeh.models import Arrow, Label, NormalHead, ScaleBar

    good = np.flatnonzero(np.isfinite(track.north_m) & np.isfinite(track.east_m))
    middle = (np.nanmin(track.east_m) + np.nanmax(track.east_m)) / 2.0
    for i, marker, word in ((good[0], "circle", "start"), (good[-1], "square", "end")):
        x, y = float(track.east_m[i]), float(track.north_m[i])
        made.scatter(
            [x],
            [y],
            marker=marker,
            size=11,
            fill_color=palette.PAPER.light,
            line_color=palette.INK.light,
            line_width=2,
        )
        made.add_layout(
            Label(
                x=x,
                y=y,
                x_offset=9 if x < middle else -9,
                text_align="left" if x < middle else "right",
                y_offset=4 if word == "start" else -16,
                text=word,
                text_color=palette.INK.light,
                text_font_size="12px",
                background_fill_color=palette.PAPER.light,
                background_fill_alpha=0.7,
            )
        )
    made.add_layout(
        ScaleBar(
            range=made.x_range,
            unit="m",
            location="bottom_left",
            length_sizing="adaptive",
            bar_line_color=palette.INK.light,
            bar_line_width=2,
            label_text_color=palette.INK.light,
            label_text_font_size="12px",
            border_line_color=None,
            background_fill_color=None,
        )
    )
    head = NormalHead(size=9, fill_color=palette.INK.light, line_color=palette.INK.light)
    made.add_layout(
        Arrow(
            end=head,
            x_start=24,
            y_start=HEIGHT - 150,
            x_end=24,
            y_end=HEIGHT - 118,
            start_units="screen",
            end_units="screen",
            line_color=palette.INK.light,
            line_width=2,
        )
    )
    made.add_layout(
        Label(
            x=24,
            y=HEIGHT - 118,
            x_units="screen",
            y_units="screen",
            text="N",
            text_align="center",
            text_color=palette.INK.light,
            text_font_size="13px",
            text_font_style="bold",
        )
    )


def _hover(made: Figure, track: Track, states: NDArray[np.int64], said: list[str]) -> None:
    from bokeh.models import ColumnDataSource, HoverTool

    good = np.isfinite(track.north_m)
    source = ColumnDataSource(
        {
            "x": track.east_m[good].astype(np.float32),
            "y": track.north_m[good].astype(np.float32),
            "at": [clock(t) for t in track.t_s[good]],
            "state": [
                f"{_WORDS[ORDER[k]]}{f': {who}' if who else ''}"
                for k, who, there in zip(states, said, good, strict=True)
                if there
            ],
        }
    )
    seen = made.scatter("x", "y", source=source, size=9, color=palette.BAND.light, alpha=0.0)
    made.add_tools(
        HoverTool(
            limit=1,
            renderers=[seen],
            tooltips=[("time", "@at"), ("state", "@state")],
            attachment="vertical",
        )
    )
