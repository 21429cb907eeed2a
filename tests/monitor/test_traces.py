"""Traces keep every extreme, whatever the pieces in which the rows come."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from links.samples import Rows, empty_rows
from monitor.columns import flat, unit_of
from monitor.settings.engine import EngineSettings
from monitor.throttle import Throttle
from monitor.traces import BUCKET_US, MEASURED, Traces

SENSORS = ("imu0", "attitude", "gps0", "nav", "airspeed1", "baro0", "aoa0", "spool0", "servo")


def rows_of(sensor: str, t_us: np.ndarray, seed: int) -> Rows:
    """Rows of a sensor with random values at these times, some of them zeros and NaNs."""
    rng = np.random.default_rng(seed)
    rows = empty_rows(sensor, len(t_us))
    for name in rows.dtype.names:
        shape = rows[name].shape
        if rows[name].dtype.kind == "f":
            values = rng.normal(0.0, 1.0, shape)
            values[rng.random(shape) < 0.1] = 0.0
            values[rng.random(shape) < 0.1] *= -0.0
            values[rng.random(shape) < 0.05] = np.nan
            rows[name] = values
    if sensor == "servo":
        rows["pwm_us"] = rng.uniform(900.0, 2100.0, rows["pwm_us"].shape)
    if sensor == "gps0":
        rows["fix_type"] = rng.integers(0, 5, len(t_us))
    rows["t_us"], rows["seq"] = t_us, np.arange(len(t_us))
    return rows


def traced(pieces: list[dict[str, Rows]]) -> dict[str, Rows]:
    """Tables of rows that come in these pieces."""
    traces = Traces(EngineSettings())
    parts: dict[str, list[Rows]] = {}
    for piece in pieces:
        traces.step(piece)
        for name, rows in traces.take().items():
            parts.setdefault(name, []).append(rows)
    for name, rows in traces.finish().items():
        parts.setdefault(name, []).append(rows)
    return {name: np.concatenate(p) for name, p in parts.items()}


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 1000),
    cuts=st.lists(st.integers(0, 2_000_000), max_size=12),
    jump_us=st.sampled_from([0, 1, 700_000, 90_000_000]),
)
def test_where_rows_are_cut_changes_no_bit(seed: int, cuts: list[int], jump_us: int) -> None:
    rng = np.random.default_rng(seed)
    whole = {}
    for k, sensor in enumerate(SENSORS):
        t_us = np.sort(rng.integers(0, 2_000_000, rng.integers(1, 80)))
        t_us[t_us > 1_000_000] += jump_us
        whole[sensor] = rows_of(sensor, t_us, seed + k)
    edges = [-1, *sorted(cuts), 1 << 60]
    pieces = [
        {s: part for s, r in whole.items() if len(part := r[(r["t_us"] > a) & (r["t_us"] <= b)])}
        for a, b in itertools.pairwise(edges)
    ]
    at_once, in_pieces = traced([whole]), traced(pieces)
    assert at_once.keys() == in_pieces.keys()
    for name, rows in at_once.items():
        assert rows.tobytes() == in_pieces[name].tobytes(), name


def test_every_tenth_has_its_extremes_and_the_time_of_its_first_sample() -> None:
    rows = rows_of("imu0", np.sort(np.random.default_rng(2).integers(0, 10**7, 2000)), 3)
    table = traced([{"imu0": rows}])["measured_imu0"]
    tenth = rows["t_us"] // BUCKET_US
    assert table["t_us"].tolist() == [rows["t_us"][tenth == k][0] for k in np.unique(tenth)]
    for name, end in (("acc", "m_s2"), ("gyro", "rad_s")):
        values = rows[f"{name}_{end}"].astype(np.float32)
        for j, k in enumerate(np.unique(tenth)):
            inside = values[tenth == k]
            np.testing.assert_array_equal(
                table[f"{name}_low_{end}"][j], np.fmin.reduce(inside, axis=0)
            )
            np.testing.assert_array_equal(
                table[f"{name}_high_{end}"][j], np.fmax.reduce(inside, axis=0)
            )


def test_an_attitude_is_told_in_angles_and_a_velocity_as_speed_and_course() -> None:
    from estimators.attitude import quaternion_from_euler

    attitude = empty_rows("attitude", 1)
    attitude["q_ned_from_frd"] = quaternion_from_euler(0.3, -0.2, -1.0)
    gps = empty_rows("gps0", 1)
    gps["vel_ned_m_s"], gps["fix_type"] = [3.0, -4.0, -0.5], 3
    gps["lat_rad"], gps["alt_m"] = 0.9, 120.0
    tables = traced([{"attitude": attitude, "gps0": gps}])
    (angles,) = tables["measured_attitude"]
    assert angles["roll_low_rad"] == pytest.approx(0.3)
    assert angles["pitch_high_rad"] == pytest.approx(-0.2)
    assert angles["heading_rad"] == pytest.approx(2.0 * np.pi - 1.0)
    (seen,) = tables["measured_gps0"]
    assert seen["speed_high_m_s"] == pytest.approx(5.0)
    assert seen["climb_low_m_s"] == pytest.approx(0.5)
    assert seen["course_rad"] == pytest.approx(np.arctan2(-4.0, 3.0) + 2.0 * np.pi)
    assert seen["lat_rad"] == 0.9  # to the last bit: a float of 32 bits would be off by metres


def test_a_receiver_without_a_fix_is_nowhere() -> None:
    gps = empty_rows("gps0", 1)
    (seen,) = traced([{"gps0": gps}])["measured_gps0"]
    assert np.isnan([seen["lat_rad"], seen["lon_rad"], seen["alt_low_m"]]).all()
    assert seen["speed_low_m_s"] == 0.0


def test_only_the_last_tenth_waits_and_no_batch_lives_on_in_it() -> None:
    traces = Traces(EngineSettings())
    for k in range(50):
        traces.step({"imu0": rows_of("imu0", k * 10**6 + np.arange(0, 10**6, 5000), k)})
        taken = traces.take()["measured_imu0"]
        assert len(taken) == (9 if k == 0 else 10)
    (buckets,) = traces._buckets.values()
    assert buckets._open.low.base is None
    assert buckets._open.low.shape == (6, 1)
    assert traces.take() == {}


def test_every_column_has_its_unit_in_its_name() -> None:
    for quantity, dtype in MEASURED.items():
        unknown = {c for c in flat(np.zeros(1, dtype)) if unit_of(c) == "1"}
        assert unknown == ({"throttle_low", "throttle_high"} if quantity == "throttle" else set())


def servo(t_us: int, seq: int, **pulses: float) -> Rows:
    rows = empty_rows("servo", 1)
    rows["t_us"], rows["seq"] = t_us, seq
    for output, pulse in pulses.items():
        rows["pwm_us"][0, int(output[1:]) - 1] = pulse
    return rows


def param(t_us: int, seq: int, name: bytes, value: float) -> Rows:
    rows = empty_rows("param", 1)
    rows["t_us"], rows["seq"], rows["name"], rows["value"] = t_us, seq, name, value
    return rows


def test_the_throttle_follows_the_parameters_from_when_they_are_heard() -> None:
    throttle = Throttle(EngineSettings())
    rows = [servo(k, 2 * k, s3=1250.0, s5=1600.0) for k in range(1, 6)]
    heard = [
        param(2, 5, b"SERVO5_FUNCTION", 70.0),
        param(3, 7, b"SERVO5_MIN", 1200.0),
        param(3, 8, b"SERVO5_MAX", 1700.0),
        param(4, 9, b"SERVO5_REVERSED", 1.0),
        param(4, 9, b"SERVO_RATE", 50.0),
        param(4, 9, b"SERVO17_MIN", 1.0),
    ]
    told = throttle.step({"servo": np.concatenate(rows), "param": np.concatenate(heard)})
    assert told is not None
    t_us, values = told
    assert t_us.tolist() == [1, 2, 3, 4, 5]
    np.testing.assert_allclose(values[0], [0.25, 0.25, 0.6, 0.8, 0.2])
    assert throttle.step({}) is None


def test_a_configured_throttle_is_the_throttle_and_no_pulse_is_none() -> None:
    throttle = Throttle(EngineSettings(throttle_channels=(4,)))
    told = throttle.step(
        {
            "param": param(0, 0, b"SERVO5_FUNCTION", 70.0),
            "servo": np.concatenate([servo(1, 1, s4=2000.0, s5=1500.0), servo(2, 2, s4=0.0)]),
        }
    )
    assert told is not None
    np.testing.assert_array_equal(told[1], [[1.0, np.nan]])
