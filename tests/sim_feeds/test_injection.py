"""Faults on decoded rows: each acts as the fault model says, between its times only."""

from math import pi, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from links.samples import Batch, empty_rows
from links.vocabulary import GYRO_ACC_AXES, Rejection
from sim_feeds.attitude_follow import AttitudeFollows
from sim_feeds.faults import PLUMBING, Fault, FaultKind, lu2016_table2, plumbing
from sim_feeds.injection import (
    EXAMPLE,
    Injection,
    RowInjector,
    load_injection,
    parse_injection,
)
from sim_feeds.injection_core import keyed_normal
from sim_feeds.section import ScenarioError

FIRST_US = 5_000_000
RATIO = 1.8
ON, OFF = 4.0, 7.0

CHANNELS = {
    **{
        f"imu0.{a}": ("imu0", "acc_m_s2" if k < 3 else "gyro_rad_s", k % 3)
        for k, a in enumerate(GYRO_ACC_AXES)
    },
    "imu1.gyro_y": ("imu1", "gyro_rad_s", 1),
    "airspeed0": ("airspeed0", "cas_m_s", None),
    "airspeed1": ("airspeed1", "cas_m_s", None),
    "aoa0": ("aoa0", "aoa_rad", None),
    "spool0": ("spool0", "speed_rpm", None),
    "baro0": ("baro0", "static_press_pa", None),
    "gps0.vel_e": ("gps0", "vel_ned_m_s", 1),
}
SPECIAL_KINDS = PLUMBING | {
    FaultKind.OUTAGE,
    FaultKind.DROPOUT,
    FaultKind.INTERMITTENT,
    FaultKind.STOP,
}
READING_KINDS = [kind for kind in FaultKind if kind not in SPECIAL_KINDS]


def flight(seconds: float = 10.0) -> Batch:
    """Rows of every breakable sensor at their own rates, numbered by time."""
    rng = np.random.default_rng(1)
    rates = {"imu0": 50, "imu1": 50, "attitude": 10, "gps0": 5, "baro0": 10, "airspeed0": 10}
    rates |= {"airspeed1": 7, "aoa0": 20, "spool0": 4}
    rows = {}
    for sensor, rate in rates.items():
        r = empty_rows(sensor, round(seconds * rate))
        r["t_us"] = FIRST_US + (np.arange(len(r)) * 1_000_000) // rate
        rows[sensor] = r
    for sensor in ("imu0", "imu1"):
        n = len(rows[sensor])
        rows[sensor]["acc_m_s2"] = [0.1, 0.2, -9.8] + 0.1 * rng.standard_normal((n, 3))
        rows[sensor]["gyro_rad_s"] = 0.02 * rng.standard_normal((n, 3))
    rows["attitude"]["q_ned_from_frd"][:, 0] = 1.0
    wander = rng.standard_normal((len(rows["gps0"]), 3))
    rows["gps0"]["vel_ned_m_s"] = wander + np.array((15.0, 3.0, np.nan))
    rows["gps0"]["fix_type"] = 3
    rows["gps0"]["lat_rad"] = np.linspace(0.9, 0.91, len(rows["gps0"]))
    rows["gps0"]["stamp_us"] = rows["gps0"]["t_us"] - 70_000
    rows["baro0"]["static_press_pa"] = 95_000.0 - 5.0 * np.arange(len(rows["baro0"]))
    rows["baro0"]["temperature_k"] = 290.0
    for sensor in ("airspeed0", "airspeed1"):
        cas = 20.0 + rng.standard_normal(len(rows[sensor]))
        rows[sensor]["cas_m_s"], rows[sensor]["diff_press_pa"] = cas, cas**2 / RATIO
    rows["aoa0"]["aoa_rad"] = 0.05 + 0.01 * rng.standard_normal(len(rows["aoa0"]))
    rows["spool0"]["speed_rpm"] = 5000.0 + 10.0 * rng.standard_normal(len(rows["spool0"]))
    order = np.argsort(np.concatenate([r["t_us"] for r in rows.values()]), kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    at = 0
    for r in rows.values():
        r["seq"] = place[at : at + len(r)]
        at += len(r)
    return Batch(rows)


FLIGHT = flight()


def inject(*faults: Fault, follows: AttitudeFollows | None = None, seed: int = 3) -> Batch:
    return RowInjector(Injection(faults, follows), seed, FIRST_US).apply(FLIGHT)


def t_s(rows):
    return (rows["t_us"] - FIRST_US) * 1e-6


def reading(batch: Batch, channel: str):
    sensor, field, column = CHANNELS[channel]
    values = batch.rows[sensor][field]
    return values if column is None else values[:, column]


@pytest.mark.parametrize(
    ("channel", "kind"),
    [(c, k) for c in CHANNELS for k in READING_KINDS if (c, k) != ("baro0", FaultKind.DEAD)],
)
def test_a_fault_changes_its_channel_between_its_times_and_nothing_else(channel, kind):
    size = {"aoa0": 0.4, "baro0": 90_000.0}.get(channel, 20.0)  # within what a decoder lets pass
    if kind is not FaultKind.JAMMING:
        size = 0.2
    fault = Fault(channel, kind, ON, OFF, size=size, rate=0.05, period_s=0.7)
    out = inject(fault)
    sensor, field, column = CHANNELS[channel]
    for name, rows in FLIGHT.rows.items():
        if name != sensor:
            assert out.rows[name] is rows
    before, after = reading(FLIGHT, channel), reading(out, channel)
    t = t_s(FLIGHT.rows[sensor])
    on = (t >= ON) & (t < OFF)
    assert_array_equal(after[~on], before[~on])
    assert np.mean(after[on] != before[on]) > 0.8  # an oscillation passes through zero
    for other in FLIGHT.rows[sensor].dtype.names:
        if other == "diff_press_pa":
            continue
        a, b = FLIGHT.rows[sensor][other].copy(), out.rows[sensor][other].copy()
        if other == field and column is not None:
            a[:, column] = b[:, column] = 0.0
        if other != field or column is not None:
            assert_array_equal(a, b)


def test_sizes_are_those_of_the_fault_models():
    t = t_s(FLIGHT.rows["imu0"])
    on = (t >= ON) & (t < OFF)
    x = reading(FLIGHT, "imu0.acc_y")
    drift = reading(inject(Fault("imu0.acc_y", FaultKind.DRIFT, ON, OFF, rate=0.5)), "imu0.acc_y")
    assert_allclose((drift - x)[on], 0.5 * (t[on] - ON))
    stuck = reading(inject(Fault("imu0.acc_y", FaultKind.STUCK, ON, OFF)), "imu0.acc_y")
    assert_array_equal(stuck[on], x[t < ON][-1])
    nrz = reading(inject(Fault("imu0.acc_y", FaultKind.NRZ, ON, OFF, size=0.5)), "imu0.acc_y")
    assert_allclose((nrz - x)[on], 0.5 * x[t < ON][-1])


def test_an_intermittent_tachometer_loses_pulses_in_its_share_of_readings():
    out = inject(Fault("spool0", FaultKind.INTERMITTENT, ON, OFF, size=0.4))
    before, after = reading(FLIGHT, "spool0"), reading(out, "spool0")
    t = t_s(FLIGHT.rows["spool0"])
    on = (t >= ON) & (t < OFF)
    lost = after != before
    assert not lost[~on].any()
    n = int(on.sum())
    assert abs(lost[on].mean() - 0.4) < 3.0 * np.sqrt(0.24 / n)
    assert (after[lost] >= 0.0).all()
    assert (after[lost] < before[lost]).all()


@pytest.mark.parametrize(
    "fault",
    [
        'sensor = "wing_left.lift"\nkind = "bias"\nsize_percent = 8.0',
        'sensor = "engine0"\nkind = "stop"',
    ],
)
def test_an_aircraft_cannot_break_after_the_flight(fault):
    with pytest.raises(ScenarioError, match="cannot break in a flight that is over"):
        parse_injection(f"[[fault]]\nstart_s = 3.0\n{fault}\n")


def test_a_pitot_keeps_its_ratio_between_pressure_and_speed():
    out = inject(Fault("airspeed0", FaultKind.SCALE, ON, size=0.3)).rows["airspeed0"]
    t = t_s(out)
    old = FLIGHT.rows["airspeed0"]
    assert_allclose(out["cas_m_s"][t >= ON], 1.3 * old["cas_m_s"][t >= ON])
    assert_allclose(out["diff_press_pa"], out["cas_m_s"] ** 2 / RATIO)


def test_a_pitot_that_reads_far_too_low_stands_at_zero_with_a_negative_pressure():
    out = inject(Fault("airspeed0", FaultKind.BIAS, ON, size=-30.0)).rows["airspeed0"]
    broken = out[t_s(out) >= ON]
    assert (broken["cas_m_s"] == 0.0).all()
    assert (broken["diff_press_pa"] < 0.0).all()


def test_dropouts_take_rows_away():
    out = inject(
        Fault("imu0.gyro_x", FaultKind.DROPOUT, ON, OFF), Fault("gps0", FaultKind.DROPOUT, OFF)
    )
    t = t_s(out.rows["imu0"])
    assert not ((t >= ON) & (t < OFF)).any()
    assert len(t) == np.sum((t_s(FLIGHT.rows["imu0"]) < ON) | (t_s(FLIGHT.rows["imu0"]) >= OFF))
    assert t_s(out.rows["gps0"]).max() < OFF


def test_a_receiver_in_an_outage_goes_on_without_a_fix():
    out, old = inject(Fault("gps0", FaultKind.OUTAGE, ON, OFF)).rows["gps0"], FLIGHT.rows["gps0"]
    t = t_s(old)
    on = (t >= ON) & (t < OFF)
    last = np.flatnonzero(t < ON)[-1]
    assert (out["fix_type"][on] == 1).all()
    assert (out["fix_type"][~on] == 3).all()
    assert_array_equal(out["lat_rad"][on], old["lat_rad"][last])
    assert_array_equal(out["stamp_us"][on], old["stamp_us"][last])
    wander = (out["vel_ned_m_s"] - old["vel_ned_m_s"])[on, :2]
    assert 1.0 < np.std(wander) < 3.0


@pytest.mark.parametrize("kind", sorted(PLUMBING))
def test_blocked_tubes_do_what_the_pressure_model_says(kind):
    fault = Fault("airspeed0", kind, ON, OFF, drain_s=1.0)
    out = inject(fault)
    rows, baro = FLIGHT.rows["airspeed0"], FLIGHT.rows["baro0"]  # both at the same times
    difference, static = plumbing(
        [fault], t_s(rows), rows["diff_press_pa"], baro["static_press_pa"]
    )
    assert_allclose(out.rows["airspeed0"]["diff_press_pa"], difference, rtol=1e-9, atol=1e-9)
    expected = np.sqrt(np.maximum(RATIO * difference, 0.0))
    assert_allclose(out.rows["airspeed0"]["cas_m_s"], expected, rtol=1e-9)
    assert_allclose(out.rows["baro0"]["static_press_pa"], static)
    assert (
        out.rows["airspeed1"] is rows or (out.rows["airspeed1"] == FLIGHT.rows["airspeed1"]).all()
    )


def test_a_reading_out_of_bounds_is_rejected_as_a_decoder_does():
    out = inject(Fault("baro0", FaultKind.DEAD, ON, OFF))
    t = t_s(out.rows["baro0"])
    assert not ((t >= ON) & (t < OFF)).any()
    assert out.rejected["baro0", Rejection.OUT_OF_RANGE] == round((OFF - ON) * 10)


def test_attitude_faults_turn_one_angle():
    out = inject(Fault("attitude.pitch", FaultKind.BIAS, ON, OFF, size=0.1)).rows["attitude"]
    t = t_s(out)
    on = (t >= ON) & (t < OFF)
    half = [np.cos(0.05), 0.0, np.sin(0.05), 0.0]
    assert_allclose(out["q_ned_from_frd"][on], np.tile(half, (on.sum(), 1)), atol=1e-12)
    assert_array_equal(out["q_ned_from_frd"][~on], FLIGHT.rows["attitude"]["q_ned_from_frd"][~on])


def test_lu2016_table_2_comes_out_as_printed():
    out = inject(*lu2016_table2("imu0", ON, OFF)).rows["imu0"]
    old, t = FLIGHT.rows["imu0"], t_s(FLIGHT.rows["imu0"])
    on = (t >= ON) & (t < OFF)
    age = t[on] - ON
    acc = (out["acc_m_s2"] - old["acc_m_s2"])[on]
    gyro = (out["gyro_rad_s"] - old["gyro_rad_s"])[on]
    assert_allclose(acc[:, 0], 3.0)
    assert_allclose(acc[:, 1], 0.1 * age, atol=1e-12)
    assert_allclose(acc[:, 2], -4.0 * np.sin(0.5 * pi * age), atol=1e-9)
    assert_allclose(gyro[:, 0], radians(1.5))
    assert_allclose(gyro[:, 1], radians(1.0) * np.sin(0.5 * pi * age), atol=1e-9)
    assert_allclose(gyro[:, 2], radians(3.0))


def all_faults() -> list[Fault]:
    rng = np.random.default_rng(4)
    faults = []
    for channel in [*CHANNELS, "attitude.yaw"]:
        for kind in READING_KINDS:
            start = rng.uniform(-1.0, 8.0)
            end = start + rng.uniform(0.3, 4.0)
            faults.append(Fault(channel, kind, start, end, size=0.1, rate=0.02))
    faults += [Fault(f"airspeed{i}", k, 1.0 + i, 6.0) for i in (0, 1) for k in sorted(PLUMBING)]
    faults += [
        Fault("gps0", FaultKind.OUTAGE, 3.0, 4.0),
        Fault("imu1", FaultKind.DROPOUT, 5.0, 5.5),
    ]
    return faults


@given(st.lists(st.integers(0, len(FLIGHT)), max_size=12))
@settings(max_examples=15, deadline=None)
def test_where_a_stream_is_cut_changes_nothing(cuts):
    injection = Injection(all_faults(), AttitudeFollows())
    whole = RowInjector(injection, 9, FIRST_US).apply(FLIGHT)
    injector = RowInjector(injection, 9, FIRST_US)
    pieces = Batch.concatenate([injector.apply(b) for b in FLIGHT.split(sorted(cuts))])
    assert pieces.rejected == whole.rejected
    for sensor, rows in whole.rows.items():
        for name in rows.dtype.names:
            assert_array_equal(pieces.rows[sensor][name], rows[name], f"{sensor}.{name}")


def test_the_recorded_rows_stay_as_they_are():
    before = {s: r.copy() for s, r in FLIGHT.rows.items()}
    inject(*all_faults(), follows=AttitudeFollows())
    for sensor, rows in before.items():
        assert rows.tobytes() == FLIGHT.rows[sensor].tobytes()


def test_noise_is_normal_white_and_of_its_own_per_seed_and_name():
    t_us = np.arange(0, 4_000_000_000, 20_000)  # 200 000 readings
    n = keyed_normal(1, "imu0.acc_x#0", t_us)
    assert abs(n.mean()) < 0.01
    assert abs(n.std() - 1.0) < 0.01
    assert abs(np.mean(n**4) - 3.0) < 0.1
    assert abs(np.mean(n[1:] * n[:-1])) < 0.01
    for other in (keyed_normal(2, "imu0.acc_x#0", t_us), keyed_normal(1, "imu0.acc_y#0", t_us)):
        assert abs(np.mean(n * other)) < 0.01
    assert_array_equal(n[5:9], keyed_normal(1, "imu0.acc_x#0", t_us[5:9]))


# ----------------------------------------------------------------------------- files


def test_the_example_can_be_used():
    injection = parse_injection(EXAMPLE)
    assert [f.sensor for f in injection.faults] == ["airspeed0", "imu0.gyro_x"]
    assert injection.faults[1].size == pytest.approx(radians(3.0))
    assert injection.attitude == AttitudeFollows()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[fault]]\nsensor="airspeed0"\nkind="stuk"\nstart_s=1', "did you mean 'stuck'?"),
        ('[[faults]]\nsensor="airspeed0"\nkind="stuck"\nstart_s=1', "did you mean 'fault'?"),
        ('[[fault]]\nsensor="airspeed0"\nkind="bias"\nsize_ms=3\nstart_s=1', "did you mean"),
        ('[[fault]]\nsensor="airspeed0"\nkind="bias"\nstart_s=1', "needs size_m_s or size_kt"),
        ('[[fault]]\nsensor="wing"\nkind="stuck"\nstart_s=1', "'wing' is no sensor"),
        ('[[fault]]\nsensor="spool0"\nkind="bias"\nsize_deg=1\nstart_s=1', "its units are rpm"),
        ('[[fault]]\nsensor="imu0.acc_x"\nkind="stuck"\nstart_s=9\nend_s=3', "not after start_s"),
        (
            '[[fault]]\nsensor="airspeed0"\nkind="stuck"\nstart_s=1\n[attitude]\nfollows=true',
            "imu0, which has no fault",
        ),
        ("[[fault", "is no TOML"),
    ],
)
def test_mistakes_in_a_file_are_named(text, says):
    with pytest.raises(ScenarioError, match="faults") as caught:
        parse_injection(text)
    assert says in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(ScenarioError, match="cannot read"):
        load_injection(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="not text"):
        load_injection(tmp_path / "binary.toml")
