"""What is drawn of each watched sensor, the sizes errors are held to, and the numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from links.vocabulary import GYRO_ACC_AXES
from monitor.columns import flat, unit_of
from monitor.report.evidence_cases import Case
from monitor.report.evidence_data import Subject, limit_of, subject_of
from monitor.report.evidence_numbers import (
    coarser,
    difference,
    energy_height,
    mean_over,
    smoothed,
    swings,
    value_at,
)
from monitor.report.series import Series
from monitor.settings import Settings
from monitor.settings.engine import ChannelSettings, EngineSettings
from monitor.verdict import (
    AIR_ESTIMATE,
    AIR_EXPECTED,
    ENGINE_ESTIMATE,
    IMU_ESTIMATE,
    WING_ESTIMATE,
)

STREAMS = ("airspeed0", "airspeed1", "aoa0", "aoa1", "imu0", "imu1", "imu2", "spool0", "spool1",
           "gps0")  # fmt: skip
WATCHED = (
    *(f"imu0.{axis}" for axis in GYRO_ACC_AXES),
    "airspeed1", "aoa0", "spool0", "engine0",
    "wing_left.lift", "wing_left.drag", "wing_right.lift", "wing_right.drag",
)  # fmt: skip
TABLES = {
    "air": AIR_ESTIMATE,
    "air_expected": AIR_EXPECTED,
    "imu0": IMU_ESTIMATE,
    "engine": ENGINE_ESTIMATE,
    "wing": WING_ESTIMATE,
}


def settings() -> Settings:
    channel = ChannelSettings(shaft=1, range_rpm=8000.0, noise_rpm=20.0)
    return Settings(engine=EngineSettings(channels={"spool0": channel}))


def subject(sensor: str) -> Subject:
    found = subject_of(sensor, STREAMS, settings())
    assert found is not None
    return found


def series(t_s: Any, values: Any, unit: str = "m/s") -> Series:
    y = np.asarray(values, float)
    return Series(np.asarray(t_s, float), y, y, unit)


@pytest.mark.parametrize("sensor", WATCHED)
def test_every_column_that_is_drawn_exists_in_its_unit(sensor: str) -> None:
    one = subject(sensor)
    assert one.sensor == sensor
    estimates = [*one.expected, *([one.error] if one.error is not None else [])]
    for table, value, std in estimates:
        columns = flat(np.zeros(1, TABLES[table]))
        assert {value, std} <= set(columns)
        shown = {"1/min": "rpm"}.get(unit_of(value), unit_of(value))
        assert shown == one.unit
        assert unit_of(std) == unit_of(value)


def test_peers_are_the_others_of_its_kind() -> None:
    assert subject("airspeed1").peers == ("airspeed0",)
    assert subject("imu0.gyro_y").peers == ("imu1.gyro_y", "imu2.gyro_y")
    assert subject("engine0").peers == ("spool0", "spool1")
    assert subject("wing_left.lift").peers == ("right_lift_percent",)


def test_a_channel_shows_the_speed_of_its_shaft() -> None:
    assert subject("spool0").expected[0].column == "speed_2_rpm"
    assert subject("spool1").expected == ()  # without a model nothing is expected


@pytest.mark.parametrize("name", ["gps0", "imu0", "imu0.mag_x", "wing_middle.lift", ""])
def test_other_names_have_nothing_to_draw(name: str) -> None:
    assert subject_of(name, STREAMS, settings()) is None


def finding(sensor: str, estimator: str, kind: str = "bias", threshold: float = 5.0) -> Case:
    found = {"estimator": estimator, "kind": kind, "threshold": threshold}
    return Case(sensor, 0.0, 1.0, 1.0, None, found)


@pytest.mark.parametrize(
    ("case", "expected", "low", "high"),
    [
        (finding("airspeed1", "air_data_3d"), 20.0, -1.4451, 1.5577),
        (finding("airspeed1", "air_checks", "scale", 0.5), 20.0, -7.8694, 12.9744),
        (finding("airspeed1", "air_vote", "runaway", 2.8), 90.0, -2.8, 2.8),
        (finding("aoa0", "air_vane", "drift"), 0.1, -math.radians(2.0), math.radians(2.0)),
        (finding("imu0.acc_z", "estimators.ins_bank"), 9.8, -0.35, 0.35),
        (finding("imu0.gyro_z", "estimators.ins_bank"), 0.0, -0.012, 0.012),
        (finding("wing_left.drag", "wing_stream", threshold=7.3), 0.0, -math.inf, 7.3),
    ],
    ids=lambda value: value.sensor if isinstance(value, Case) else "",
)  # fmt: skip
def test_the_size_that_an_error_is_held_to(
    case: Case, expected: float, low: float, high: float
) -> None:
    limit = limit_of(case, subject(case.sensor), settings())
    assert limit is not None
    bounds = [float(bound) for bound in limit.bounds(expected)]
    assert bounds == pytest.approx([low, high], rel=1e-4)
    section, _, key = limit.key.partition(".")
    assert key in type(getattr(settings(), section)).model_fields


@pytest.mark.parametrize("kind", ["stuck", "dropout", "noise"])
def test_what_stands_still_or_scatters_is_held_to_no_size(kind: str) -> None:
    assert (
        limit_of(finding("airspeed1", "air_checks", kind), subject("airspeed1"), settings()) is None
    )


def test_a_difference_keeps_the_extremes_and_knows_where_nothing_was_expected() -> None:
    measured = Series(np.arange(5.0), np.full(5, 9.0), np.full(5, 12.0), "m/s")
    expected = series([0.0, 1.0, 4.0], [10.0, 11.0, 14.0])  # a gap of three seconds
    apart = difference(measured, expected)
    assert apart is not None
    assert apart.low[:2].tolist() == [-1.0, -2.0]
    assert apart.high[:2].tolist() == [2.0, 1.0]
    assert np.isnan(apart.low[2:4]).all()
    assert difference(measured, None) is None
    assert difference(measured, series([90.0], [1.0])) is None


def test_values_between_points_and_beyond_them() -> None:
    line = series([0.0, 1.0, 10.0], [0.0, 2.0, 20.0])
    assert value_at(line, 0.25) == pytest.approx(0.5)
    assert math.isnan(value_at(line, 5.0))
    assert math.isnan(value_at(None, 5.0))
    assert value_at(line, 10.4) == pytest.approx(20.0)
    assert mean_over(line, 0.0, 1.0) == 1.0
    assert math.isnan(mean_over(line, 3.0, 4.0))


def test_a_mean_shows_nothing_before_it_happened() -> None:
    t = np.arange(100) * 0.1
    mean = smoothed(series(t, t >= 5.0 - 1e-9))
    assert mean is not None
    assert (mean.low[t < 4.95] == 0.0).all()
    assert mean.low[t > 5.95] == pytest.approx(1.0)


def test_swings_are_those_of_the_last_second() -> None:
    t = np.linspace(0.0, 9.9, 100)
    y = np.where(t < 5.0 - 1e-9, 0.0, np.where(np.arange(100) % 2, 1.0, -1.0)).astype(np.float64)
    moved = swings(Series(t, y - 0.1, y + 0.1, "m/s"))
    assert moved is not None
    assert moved.low[t < 4.95] == pytest.approx(0.2)
    assert moved.low[t > 5.15] == pytest.approx(2.2)


def test_joined_points_keep_every_peak() -> None:
    rng = np.random.default_rng(2)
    fine = series(np.arange(5003), rng.standard_normal(5003))
    thin = coarser(fine, 500)
    assert thin is not None
    assert len(thin) <= 500
    assert (thin.low.min(), thin.high.max()) == (fine.low.min(), fine.high.max())
    assert coarser(fine, 10_000) is fine


def test_speed_counts_as_height() -> None:
    height = energy_height(series([0.0, 1.0], [100.0, 100.0], "m"), series([0.0, 1.0], [0.0, 20.0]))
    assert height is not None
    assert height.low == pytest.approx([100.0, 100.0 + 400.0 / 19.6133])
