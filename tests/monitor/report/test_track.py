"""The ground track: the gravest state of a place, to scale, with marks."""

from __future__ import annotations

import numpy as np
import pytest

from links.vocabulary import State
from monitor.report import track
from monitor.report.section import Chart
from monitor.report.spans import Span
from monitor.verdict import Verdict
from tests.monitor.report import small_flight as small
from tests.monitor.report.summaries import fault

models = pytest.importorskip("bokeh.models")

EARTH_M = 6_371_000.0


def spans(*parts: tuple[float, float, State]) -> list[Span]:
    return [Span(a, b, state, None, None, "") for a, b, state in parts]


def test_a_place_has_the_gravest_state_of_any_sensor() -> None:
    found, who = track.states_along(
        {
            "imu0.acc_x": spans((0, 10, State.UNMONITORED), (10, 20, State.OK), (20, 40, State.OK)),
            "airspeed0": spans((0, 15, State.UNMONITORED), (15, 25, State.FAULTY)),
            "airspeed1": spans((0, 22, State.OK), (22, 40, State.SUSPECT)),
            "spool1": spans((0, 40, State.ABSENT)),
        },
        np.array([5.0, 12.0, 18.0, 23.0, 30.0]),
    )
    assert [track.ORDER[k] for k in found] == [
        State.OK,
        State.OK,
        State.FAULTY,
        State.FAULTY,
        State.SUSPECT,
    ]
    assert who == ["", "", "airspeed0", "airspeed0", "airspeed1"]


def test_a_reference_alone_judges_no_place() -> None:
    found, _ = track.states_along({"gps0": spans((0, 40, State.OK))}, np.array([5.0]))
    assert track.ORDER[found[0]] is State.UNMONITORED
    found, who = track.states_along({"gps0": spans((0, 40, State.FAULTY))}, np.array([5.0]))
    assert (track.ORDER[found[0]], who) == (State.FAULTY, ["gps0"])


def flight_over(north_m: float, east_m: float):  # type: ignore[no-untyped-def]
    """A straight flight from the equator, faulty between 100 s and 200 s."""
    share = small.T_S / small.T_S[-1]
    dtype = np.dtype([("t_us", "<i8"), ("lat_rad", "<f8"), ("lon_rad", "<f8")])
    table = small.rows(
        dtype, lat_rad=north_m / EARTH_M * share, lon_rad=0.2 + east_m / EARTH_M * share
    )
    verdicts = tuple(
        Verdict(round(t_s * 1e6), "airspeed0", state)
        for t_s, state in ((30.0, State.OK), (100.0, State.FAULTY), (200.0, State.OK))
    )
    faults = [fault("airspeed0", 99.0, 100.0, cleared_s=200.0)]
    return small.flight({"measured_gps0": table}, verdicts=verdicts, faults=faults)


def test_the_track_is_drawn_to_scale_in_a_line_for_each_state() -> None:
    flight = flight_over(3000.0, 4000.0)
    section = track.section(flight, models.Range1d(0, 300))
    assert section is not None
    assert "airspeed0 from 1:40 to 3:20" in section.lead
    (chart,) = section.parts
    assert isinstance(chart, Chart)
    (figure,) = chart.models
    assert figure.match_aspect
    assert figure.x_range is not figure.y_range
    lines = {r.glyph.line_width: r for r in figure.renderers if type(r.glyph).__name__ == "Line"}
    assert len(lines) == len(chart.legend) == 3
    faulty = lines[max(lines)]
    east_m = faulty.data_source.data["x"]
    assert np.nanmin(east_m) == pytest.approx(4000.0 / 3.0, rel=0.02)
    assert np.nanmax(east_m) == pytest.approx(8000.0 / 3.0, rel=0.02)
    assert len({r.glyph.line_width for r in lines.values()}) == 3  # colour is not alone
    words = {label.text for label in figure.select(type=models.Label)}
    assert {"start", "end", "N"} <= words
    assert figure.select(type=models.ScaleBar)


def test_pointing_tells_time_and_state() -> None:
    section = track.section(flight_over(3000.0, 0.0), models.Range1d(0, 300))
    assert section is not None
    figure = section.parts[0].models[0]  # type: ignore[union-attr]
    (hover,) = figure.select(type=models.HoverTool)
    (seen,) = hover.renderers
    data = seen.data_source.data
    at = data["at"].index("2:30")
    assert data["state"][at] == "a sensor faulty: airspeed0"


def test_an_aircraft_that_stood_has_no_track() -> None:
    assert track.section(flight_over(20.0, 10.0), models.Range1d(0, 300)) is None
    assert track.section(small.flight(), models.Range1d(0, 300)) is None
