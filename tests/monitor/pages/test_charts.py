"""What is drawn holds every peak, breaks at gaps, and says itself under the pointer."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pytest
from bokeh.core.json_encoder import serialize_json
from bokeh.document import Document
from bokeh.models import HoverTool, Line, PanTool, Patch, Range1d, Span, WheelZoomTool
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.charts import TimeChart, _outline, _through, time_chart
from monitor.pages.hover import POINTS, hover_columns

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Drawn:
    t_s: Floats
    low: Floats
    high: Floats
    unit: str = "m/s"


def curve(*values: float, unit: str = "m/s") -> Drawn:
    y = np.array(values)
    return Drawn(np.arange(y.size, dtype=float), y, y, unit)


def chart(unit: str = "m/s") -> TimeChart:
    return time_chart(Range1d(0.0, 10.0), "airspeed", unit)


def drawn(made: TimeChart, glyph: type) -> list[dict[str, Floats]]:
    return [dict(r.data_source.data) for r in made.figure.renderers if isinstance(r.glyph, glyph)]


def test_a_line_goes_through_the_least_and_the_largest_value_without_crossing() -> None:
    t = np.arange(4.0)
    x, y = _through(t, np.array([1.0, 1.0, 1.0, 5.0]), np.array([3.0, 9.0, 3.0, 5.0]))
    assert list(zip(x, y, strict=True)) == [(0, 1), (0, 3), (1, 9), (1, 1), (2, 1), (2, 3), (3, 5)]


@given(
    st.lists(st.one_of(st.none(), st.tuples(st.floats(-1e3, 1e3), st.floats(0, 1e3))), max_size=60)
)
def test_no_peak_is_lost_and_no_gap_is_bridged(buckets: list[tuple[float, float] | None]) -> None:
    low = np.array([np.nan if b is None else b[0] for b in buckets])
    high = np.array([np.nan if b is None else b[0] + b[1] for b in buckets])
    t = np.arange(len(buckets), dtype=float)
    x, y = _through(t, low, high)
    assert np.all(np.diff(x) >= 0)
    for k in range(len(buckets)):
        there = y[x == k]
        if np.isnan(low[k]):
            assert np.isnan(there).all()
            assert there.size >= 1
        else:
            assert (there.min(), there.max()) == (low[k], high[k])


def test_a_band_is_one_closed_outline_for_each_piece_without_a_gap() -> None:
    low = np.array([1.0, 2.0, np.nan, 4.0, 5.0])
    x, y = _outline(np.arange(5.0), low, low + 1)
    np.testing.assert_array_equal(x, [0, 1, 1, 0, np.nan, 3, 4, 4, 3])
    np.testing.assert_array_equal(y, [1, 2, 3, 2, np.nan, 4, 5, 6, 5])
    assert _outline(np.arange(2.0), np.full(2, np.nan), np.ones(2))[0].size == 0


def test_angles_are_drawn_in_degrees_with_their_unit_on_the_axis() -> None:
    made = chart("rad").line(curve(0.0, np.pi, unit="rad"), "measured")
    (line,) = drawn(made, Line)
    np.testing.assert_allclose(line["y"], [0.0, 180.0])
    assert made.figure.yaxis[0].axis_label == "airspeed (deg)"
    assert made.figure.xaxis[0].axis_label == "time (m:ss)"


def test_two_sigma_are_two_deviations_to_each_side() -> None:
    made = chart().deviation(curve(10.0, 10.0), curve(1.5, 0.5))
    (band,) = drawn(made, Patch)
    np.testing.assert_allclose(sorted(band["y"]), [7.0, 9.0, 11.0, 13.0])


def test_what_is_not_there_is_neither_drawn_nor_named() -> None:
    nothing = curve(np.nan, np.nan)
    made = chart().line(None, "a").line(nothing, "b").deviation(nothing, nothing).mark(None, "c")
    assert made.legend == []
    assert made.figure.renderers == []
    assert not made.model.select(HoverTool)


def test_a_threshold_stays_in_view() -> None:
    made = chart().threshold(27.0, 15.0)
    assert sorted(span.location for span in made.figure.select(Span)) == [15.0, 27.0]
    (seen,) = drawn(made, Line)
    assert list(seen["y"]) == [27.0, 15.0]


def test_numbers_take_four_bytes_each() -> None:
    made = chart().line(curve(*range(1000)), "measured")
    (line,) = drawn(made, Line)
    assert {column.dtype for column in line.values()} == {np.dtype("float32")}


def test_one_box_says_every_line_at_once_with_time_and_unit() -> None:
    t = np.arange(3.0)
    noisy = Drawn(t, np.array([1.0, 2.0, 3.0]), np.array([2.0, 4.0, 3.5]))
    made = chart().line(noisy, "measured").line(curve(1.5, 2.5, 3.5), "reconstructed")
    (tool,) = made.model.select(HoverTool)
    assert made.model.select(HoverTool)[0] is tool, "asking twice must not add a second one"
    assert [name for name, _ in tool.tooltips] == ["time", "measured", "reconstructed"]
    said = dict(tool.tooltips)
    assert said["time"] == "@t{0.0} s"
    assert said["measured"] == "@low0{0.00} to @high0{0.00} m/s"
    assert said["reconstructed"] == "@low1{0.00} m/s"


def test_what_stands_under_the_pointer_has_the_peaks_of_what_it_joins() -> None:
    n = 10 * POINTS
    t, y = np.arange(n) / 10.0, np.zeros(n)
    y[4321], y[987] = 50.0, -50.0
    columns, _ = hover_columns([("measured", t, y, y.copy())])
    assert columns["t"].size <= POINTS
    assert (columns["low0"].min(), columns["high0"].max()) == (-50.0, 50.0)
    assert columns["t"][np.argmax(columns["high0"])] <= t[4321]


def test_a_slow_line_holds_its_value_and_a_gap_has_none() -> None:
    fast, slow = np.arange(0.0, 60.0, 0.1), np.array([0.0, 1.0, 2.0, 3.0, 40.0, 41.0])
    value = np.arange(slow.size, dtype=float)
    columns, _ = hover_columns([("fast", fast, fast, fast), ("slow", slow, value, value)])
    at = {round(float(t), 1): v for t, v in zip(columns["t"], columns["low1"], strict=True)}
    assert at[2.5] == 2.0
    assert np.isnan(at[20.0])
    assert at[40.5] == 4.0


def test_the_wheel_scrolls_the_page_and_tools_move_time_alone() -> None:
    made = chart().figure
    (wheel,), (pan,) = made.select(WheelZoomTool), made.select(PanTool)
    assert wheel.modifiers == {"ctrl": True}
    assert {wheel.dimensions, pan.dimensions} == {"width"}
    assert made.toolbar.logo is None
    assert made.sizing_mode == "stretch_width"


def test_marks_beside_each_other_stand_on_different_heights() -> None:
    made = chart().mark(1.0, "onset").mark(1.1, "detected").mark(9.0, "cleared")
    labels = [item for item in made.figure.center if type(item).__name__ == "Label"]
    assert len({label.y for label in labels}) == 3
    assert [label.text_align for label in labels] == ["left", "left", "right"]


def test_a_shaded_state_is_named_once() -> None:
    made = chart().shade(1.0, 2.0, State.STALE).shade(4.0, 5.0, State.STALE)
    assert [entry.name for entry in made.legend] == ["stale"]


def test_every_colour_of_a_chart_has_its_dark_twin() -> None:
    made = chart().line(curve(1.0, 2.0), "a").deviation(curve(1.0, 2.0), curve(1.0, 1.0))
    made.threshold(3.0).mark(1.0, "onset")
    for state in State:
        made.shade(1.0, 2.0, state)
    document = Document()
    document.add_root(made.model)
    known = palette.dark_by_light()
    said = serialize_json(document.to_json(deferred=False))
    colours = set(re.findall(r'"(#[0-9a-f]{6})"', said))
    assert colours
    assert colours <= set(known), f"not exchanged in the dark: {colours - set(known)}"


@pytest.mark.parametrize("unit", ["", "1"])
def test_a_number_without_unit_has_none_in_its_label(unit: str) -> None:
    assert chart(unit).figure.yaxis[0].axis_label == "airspeed"
