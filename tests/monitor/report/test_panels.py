"""Panels of the whole flight: what they draw, on one axis, with the faults shaded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from monitor.report import air, engine, imu, panels, wing
from monitor.report.section import Chart, Section
from monitor.settings import Settings
from monitor.verdict import AIR_TESTS, ENGINE_ESTIMATE, IMU_TESTS, WING_ESTIMATE
from tests.monitor.report import small_flight as small
from tests.monitor.report.summaries import fault, stream, watched

models = pytest.importorskip("bokeh.models")

T_S = small.T_S
TIME_PANELS = (air, imu, engine, wing)


def full(**changed: Any) -> Any:
    """A flight of which every panel has something to show."""
    vector = np.tile([3.0, -4.0, 0.1], (T_S.size, 1))
    tables = {
        "measured_airspeed0": small.measured("cas", "m_s", 19.0, 21.0),
        "measured_spool0": small.measured("speed", "rpm", 5000.0),
        "air": small.air(
            aoa_rad=0.1,
            aoa_std_rad=0.02,
            ssa_rad=0.0,
            ssa_std_rad=0.02,
            wind_ned_m_s=vector,
            wind_std_ned_m_s=np.full_like(vector, 0.5),
        ),
        "imu0": small.imu(),
        "wing": small.wing(right_lift_percent=9.0, left_lift_percent=2.0),
    }
    streams = [stream(s) for s in ("airspeed0", "imu0", "gps0", "attitude", "spool0")]
    return small.flight(tables, streams=streams, **changed)


def axis_of(flight: Any) -> Any:
    return models.Range1d(0.0, flight.duration_s)


def figures(section: Section | None) -> Iterator[Any]:
    assert section is not None
    for part in section.parts:
        if isinstance(part, Chart):
            yield from part.models


def curves(section: Section | None) -> list[str]:
    assert section is not None
    charts = [part for part in section.parts if isinstance(part, Chart)]
    return [entry.name for chart in charts for entry in chart.legend]


def limits(figure: Any) -> list[float]:
    """Where lines are drawn across a figure."""
    spans = figure.select(type=models.Span)
    return sorted(s.location for s in spans if s.dimension == "width")


def test_every_panel_moves_with_the_same_axis() -> None:
    flight = full()
    axis = axis_of(flight)
    found = [f for panel in TIME_PANELS for f in figures(panel.section(flight, axis))]
    assert len(found) == 5 + 2 + 1 + 4  # air and wind, IMU, engine speed, wings
    assert all(figure.x_range is axis for figure in found)


def test_nothing_is_drawn_of_what_the_log_does_not_hold() -> None:
    flight = small.flight()
    for panel in TIME_PANELS:
        assert panel.section(flight, axis_of(flight)) is None


def test_faults_are_shaded_in_all_and_named_in_the_first() -> None:
    faults = [
        fault("imu0.acc_x", 100.0, 101.0, cleared_s=120.0),
        fault("airspeed0", 115.0, 118.0, cleared_s=130.0),
        fault("imu0.gyro_z", 200.0, 201.0),
    ]
    flight = full(faults=faults)
    for panel in TIME_PANELS:
        for chart in (p for p in panel.section(flight, axis_of(flight)).parts if p.part == "chart"):
            for k, figure in enumerate(chart.models):
                boxes = figure.select(type=models.BoxAnnotation)
                assert sorted((b.left, b.right) for b in boxes) == [(100.0, 130.0), (200.0, 300.0)]
                names = {label.text for label in figure.select(type=models.Label)}
                expected = {"imu0.acc_x", "airspeed0", "imu0.gyro_z"} if k == 0 else set()
                assert names == expected
            assert "imu0.acc_x faulty from 1:40 to 2:00" in chart.alt


def test_an_engine_that_stopped_is_shaded_too() -> None:
    event = {
        "what": "engine0",
        "state": "stopped",
        "onset_s": 50.0,
        "detected_s": 55.0,
        "ended_s": 60.0,
    }
    flight = full(events=[event])
    (figure, *_) = figures(engine.section(flight, axis_of(flight)))
    (box,) = figure.select(type=models.BoxAnnotation)
    assert (box.left, box.right) == (50.0, 60.0)
    assert box.hatch_pattern


def test_a_hundred_faults_do_not_bury_the_chart() -> None:
    faults = [fault("imu0.acc_x", 2.0 * k, 2.0 * k + 0.5, cleared_s=2.0 * k + 1.5)
              for k in range(100)]  # fmt: skip
    flight = full(faults=faults)
    (figure, *_) = figures(imu.section(flight, axis_of(flight)))
    assert len(figure.select(type=models.BoxAnnotation)) == 1
    assert len(figure.select(type=models.Label)) == 6


def test_what_broke_together_has_one_mark() -> None:
    faults = [
        *(fault(sensor, 100.0, 101.0) for sensor in ("aoa0", "airspeed0", "aoa1")),
        fault("imu0.acc_x", 102.0, 104.0),
        fault("spool0", 200.0, 201.0),
    ]
    flight = full(faults=faults)
    (figure, *_) = figures(imu.section(flight, axis_of(flight)))
    labels = figure.select(type=models.Label)
    assert {(label.x, label.text) for label in labels} == {
        (100.0, "airspeed0 + 3"),
        (200.0, "spool0"),
    }


def test_shades_of_a_wild_flight_are_joined_until_they_are_few() -> None:
    faults = [fault("imu0.acc_x", 10.0 * k, 10.0 * k + 1, cleared_s=10.0 * k + 2.0)
              for k in range(2000)]  # fmt: skip
    spans = panels.fault_spans({"faults": faults, "events": []}, 20_000.0)
    assert 1 <= len(spans) <= panels.SHADES
    assert spans[0][1] == 0.0
    assert spans[-1][2] == 19_992.0


def test_pitots_stand_beside_the_reconstruction_and_its_band() -> None:
    flight = full()
    section = air.section(flight, axis_of(flight))
    assert curves(section)[:3] == ["airspeed0", "reconstructed", "2σ of it"]
    assert len(list(figures(section))) == 5  # two of speeds, aoa, slip, wind: nothing twice


def test_a_pitot_far_off_does_not_hide_the_others() -> None:
    wrong = np.where((T_S > 100.0) & (T_S < 200.0), 113.0, 20.0)
    tables = {"measured_airspeed0": small.measured("cas", "m_s", wrong), "air": small.air()}
    flight = small.flight(tables)
    whole, near, *_ = figures(air.section(flight, axis_of(flight)))
    assert isinstance(whole.y_range, models.DataRange1d)
    assert 18.0 < near.y_range.start < 19.5
    assert 20.5 < near.y_range.end < 22.0


def test_the_wind_is_drawn_from_when_it_is_known() -> None:
    vector = np.tile([3.0, -4.0, 0.0], (T_S.size, 1))
    std = np.full_like(vector, 0.5)
    std[T_S < 50.0] = 8.0
    tables = {"air": small.air(wind_ned_m_s=vector, wind_std_ned_m_s=std)}
    flight = small.flight(tables)
    section = air.section(flight, axis_of(flight))
    assert section is not None
    (chart,) = [p for p in section.parts if isinstance(p, Chart) and p.key == "air-wind"]
    assert "it came from 127° at 5.0 m/s" in chart.caption
    assert "vertical wind cannot be observed" in chart.caption
    assert {"north", "east"} <= {e.name for e in chart.legend}
    assert "down" not in {e.name for e in chart.legend}
    drawn = [r.data_source.data for r in chart.models[0].renderers if "y" in r.data_source.data]
    known = [d["t"][np.isfinite(d["y"])] for d in drawn if np.isfinite(d["y"]).any()]
    assert min(t.min() for t in known) >= 50.0


def test_errors_of_an_imu_stand_against_what_is_a_fault() -> None:
    flight = full()
    acc, gyro = figures(imu.section(flight, axis_of(flight)))
    assert limits(acc) == pytest.approx([-0.35, 0.35])
    assert limits(gyro) == pytest.approx([-0.6875, 0.6875], abs=1e-3)  # 0.012 rad/s in deg/s
    assert curves(imu.section(flight, axis_of(flight))) == [
        "2σ of each",
        "x",
        "y",
        "z",
        "least change that is a fault",
    ]


def test_an_imu_that_was_never_there_has_no_panel() -> None:
    nothing = {"from_s": 2.0, "to_s": 300.0, "reason": "absent"}
    flight = small.flight(
        {"imu0": small.imu(), "imu2": small.imu()},
        streams=[stream("imu0"), stream("imu2")],
        monitored=[watched("imu0.acc_x", 200.0), watched("imu2", 0.0, nothing)],
    )
    section = imu.section(flight, axis_of(flight))
    assert section is not None
    assert [part.key for part in section.parts if isinstance(part, Chart)] == ["imu-imu0"]


def test_the_difference_of_the_wings_is_that_of_each_row() -> None:
    right = 5.0 + np.sin(T_S)
    left = np.cos(T_S)
    flight = small.flight(
        {"wing": small.wing(right_lift_percent=right, left_lift_percent=left)},
    )
    apart, *_ = figures(wing.section(flight, axis_of(flight)))
    lines = [r.data_source.data for r in apart.renderers if type(r.glyph).__name__ == "Line"]
    drawn = next(d["y"] for d in lines if d["y"].size == T_S.size)
    assert drawn == pytest.approx(right - left, abs=1e-5)
    assert limits(apart) == [-3.0, 3.0]


def test_no_peak_of_a_long_flights_difference_is_lost() -> None:
    t_s = np.arange(0.0, 7200.0, 0.5)
    rows = np.zeros(t_s.size, WING_ESTIMATE)
    rows["t_us"] = np.round(t_s * 1e6)
    rows["right_lift_percent"][7777] = 30.0
    rows["left_lift_percent"][12_345] = 20.0
    rows["lift_apart_std_percent"] = 1.0
    flight = small.flight({"wing": rows}, log={"duration_s": 7200.0})
    apart, *_ = figures(wing.section(flight, axis_of(flight)))
    lines = [r.data_source.data for r in apart.renderers if type(r.glyph).__name__ == "Line"]
    drawn = max(lines, key=lambda d: d["t"].size)
    assert drawn["t"].size < 2_500
    assert (drawn["y"].min(), drawn["y"].max()) == (-20.0, 30.0)
    at = drawn["t"][drawn["y"].argmax()]
    assert at == pytest.approx(7777 * 0.5, abs=6.0)


def test_what_was_assumed_before_anything_was_seen_is_not_drawn() -> None:
    std = np.where(T_S < 30.0, 300.0, 20.0)
    flight = small.flight({"wing": small.wing(right_drag_std_percent=std)})
    *_, each = figures(wing.section(flight, axis_of(flight)))
    patches = [r.data_source.data for r in each.renderers if type(r.glyph).__name__ == "Patch"]
    highest = max(float(np.nanmax(d["y"])) for d in patches)
    assert highest == pytest.approx(40.0)


def test_the_engine_says_whether_there_is_a_model() -> None:
    flight = full()
    section = engine.section(flight, axis_of(flight))
    assert section is not None
    assert section.lead.startswith("spool0 without a model")


def test_a_channel_with_a_model_stands_against_it_from_where_it_is_known() -> None:
    speed, std = np.full((T_S.size, 4), np.nan), np.full((T_S.size, 4), np.nan)
    speed[:, 0], std[:, 0] = 5000.0, np.where(T_S < 5.0, 4000.0, 30.0)
    tables = {
        "engine": small.rows(ENGINE_ESTIMATE, speed_rpm=speed, speed_std_rpm=std, throttle=0.5),
        "measured_spool0": small.measured("speed", "rpm", 5010.0),
        "measured_spool1": small.measured("speed", "rpm", 5020.0),
    }
    channel = {"range_rpm": 7000.0, "noise_rpm": 20.0}
    settings = Settings.model_validate({"engine": {"channels": {"spool0": channel}}})
    streams = [stream("spool0"), stream("spool1")]
    flight = small.flight(tables, settings=settings, streams=streams)
    section = engine.section(flight, axis_of(flight))
    assert section is not None
    assert section.lead.startswith("spool0 against the engine's model")
    assert "spool1 without a model" in section.lead
    speeds, throttle = figures(section)
    patches = [r.data_source.data for r in speeds.renderers if type(r.glyph).__name__ == "Patch"]
    assert max(float(np.nanmax(d["y"])) for d in patches) == pytest.approx(5060.0)
    assert throttle.yaxis[0].axis_label == "throttle (%)"


def test_tools_stand_once_and_the_axis_is_named_once_in_a_stack() -> None:
    flight = full()
    found = list(figures(wing.section(flight, axis_of(flight))))
    assert [figure.toolbar_location for figure in found] == ["above", None, None, None]
    assert [bool(figure.xaxis[0].axis_label) for figure in found] == [False, False, False, True]


def test_tests_stand_below_up_to_where_they_can_be_read() -> None:
    ratios = small.rows(IMU_TESTS, acc_x_ratio=np.where(T_S > 150.0, 40.0, 0.2), gyro_z_ratio=0.3)
    flight = small.flight({"imu0": small.imu(), "imu0_tests": ratios})
    section = imu.section(flight, axis_of(flight))
    *_, tests = figures(section)
    assert (tests.y_range.start, tests.y_range.end) == (-0.25, 5.0)
    assert limits(tests) == [1.0]
    drawn = [r for r in tests.renderers if type(r.glyph).__name__ == "Line" and r.glyph.line_alpha]
    assert {tuple(r.glyph.line_dash) for r in drawn} == {(), (2, 4)}
    assert {"test of acc", "of gyro", "threshold"} <= set(curves(section))


def test_quiet_tests_fill_their_chart() -> None:
    ratios = small.rows(AIR_TESTS, airspeed0_ratio=0.4)
    flight = small.flight({"air": small.air(), "air_tests": ratios})
    section = air.section(flight, axis_of(flight))
    assert section is not None
    (chart,) = [p for p in section.parts if isinstance(p, Chart) and p.key == "air-speed"]
    assert chart.models[-1].y_range.end == pytest.approx(1.3)
    assert "1 is the threshold" in chart.caption
