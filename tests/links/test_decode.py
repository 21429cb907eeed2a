"""Messages to samples: units, instances, rejections, whose input counts, any cut of the bytes."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from links import catalog
from links.mavlink import Decoder, DecoderOptions, Encoder, encode
from links.mavlink.dialect import load_dialect
from links.samples import QUANTITIES, Batch, quantity_of
from links.vocabulary import Rejection

DEG = math.pi / 180


def one(decode, start, vehicle, message, **fields):
    """Rows of a single message after the start of a stream, and the rejections."""
    options = {"dialect": "all"} if message == "SENSOR_AIRFLOW_ANGLES" else {}
    sender = Encoder(1, 1, **options) if options else vehicle
    batch, _ = decode(start + sender.encode(message, **fields), **options)
    return batch.rows, batch.rejected


# ---------------------------------------------------------------- units, one value per quantity


def test_imu_units(decode, start, vehicle):
    rows, _ = one(
        decode, start, vehicle, "RAW_IMU", time_usec=10_100_000, xacc=500, zacc=-1000, ygyro=250
    )
    assert rows["imu0"]["t_us"].tolist() == [10_100_000]
    np.testing.assert_allclose(rows["imu0"]["acc_m_s2"][0], [4.903325, 0, -9.80665])
    np.testing.assert_allclose(rows["imu0"]["gyro_rad_s"][0], [0, 0.25, 0])


def test_highres_imu_is_si_already_and_carries_pressure_where_it_says_so(decode, start, vehicle):
    fields = {
        "time_usec": 10_000_500,
        "xacc": 1.5,
        "zgyro": -0.25,
        "abs_pressure": 1000.0,
        "diff_pressure": 2.0,
        "temperature": 20.0,
        "id": 1,
    }
    rows, _ = one(decode, start, vehicle, "HIGHRES_IMU", fields_updated=0x63F, **fields)
    assert rows["imu1"]["acc_m_s2"][0].tolist() == [1.5, 0, 0]
    assert rows["imu1"]["gyro_rad_s"][0].tolist() == [0, 0, -0.25]
    np.testing.assert_allclose(rows["baro1"]["static_press_pa"], 1e5)
    np.testing.assert_allclose(rows["baro1"]["temperature_k"], 293.15)
    np.testing.assert_allclose(rows["airspeed1"]["cas_m_s"], 20.0)  # sqrt(2 * 200 Pa)
    rows, _ = one(decode, start, vehicle, "HIGHRES_IMU", fields_updated=0x3F, **fields)
    assert set(rows) == {"heartbeat", "attitude", "imu1"}


def test_attitude_units(decode, start, vehicle):
    rows, _ = one(
        decode, start, vehicle, "ATTITUDE", time_boot_ms=10_100, yaw=math.pi / 2, pitchspeed=0.1
    )
    half = math.sqrt(0.5)
    np.testing.assert_allclose(rows["attitude"]["q_ned_from_frd"][1], [half, 0, 0, half], atol=1e-7)
    np.testing.assert_allclose(rows["attitude"]["rate_rad_s"][1], [0, 0.1, 0], rtol=1e-6)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_quaternion_turns_the_nose_where_the_angles_say(roll, pitch, yaw):
    payload = np.zeros(1, load_dialect().by_name["ATTITUDE"].dtype)
    payload["roll"], payload["pitch"], payload["yaw"] = roll, pitch, yaw
    (source,) = [s for s in catalog.SOURCES if s.message == "ATTITUDE"]
    w, x, y, z = source.fills[0].compute(payload)[0]
    nose = [w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)]
    right_down = 2 * (y * z + w * x)
    expected = [
        math.cos(pitch) * math.cos(yaw),
        math.cos(pitch) * math.sin(yaw),
        -math.sin(pitch),
    ]
    np.testing.assert_allclose(nose, expected, atol=1e-6)
    np.testing.assert_allclose(right_down, math.sin(roll) * math.cos(pitch), atol=1e-6)


def test_attitude_quaternion_is_normalised_and_a_zero_one_is_refused(decode, start, vehicle):
    good = vehicle.encode(
        "ATTITUDE_QUATERNION", time_boot_ms=10_010, q1=0.5, q2=0.5, q3=0.5, q4=0.51
    )
    bad = vehicle.encode("ATTITUDE_QUATERNION", time_boot_ms=10_020)
    batch, _ = decode(start + good + bad)
    q = batch.rows["attitude"]["q_ned_from_frd"]
    assert len(q) == 2
    np.testing.assert_allclose(np.linalg.norm(q[1]), 1.0)
    assert batch.rejected["attitude", Rejection.NON_FINITE] == 1


def test_gps_units(decode, start, vehicle):
    rows, _ = one(
        decode, start, vehicle, "GPS_RAW_INT",
        time_usec=9_900_000, fix_type=3, lat=450000000, lon=-900000000, alt=123456,
        vel=2000, cog=9000, satellites_visible=12, h_acc=1500, vel_acc=250,
    )  # fmt: skip
    gps = rows["gps0"][0]
    assert gps["t_us"] == gps["stamp_us"] == 9_900_000
    np.testing.assert_allclose([gps["lat_rad"], gps["lon_rad"]], [45 * DEG, -90 * DEG])
    np.testing.assert_allclose(gps["vel_ned_m_s"], [0, 20, np.nan], atol=1e-12)
    np.testing.assert_allclose(
        [gps["alt_m"], gps["h_std_m"], gps["v_std_m"], gps["vel_std_m_s"]],
        [123.456, 1.5, np.nan, 0.25],
    )
    assert (gps["fix_type"], gps["satellites"]) == (3, 12)


def test_unknown_gps_speed_is_nan(decode, start, vehicle):
    rows, _ = one(decode, start, vehicle, "GPS2_RAW", fix_type=1, vel=0xFFFF, cog=0)
    assert np.isnan(rows["gps1"]["vel_ned_m_s"]).all()
    assert rows["gps1"]["fix_type"].tolist() == [1]
    assert rows["gps1"]["stamp_us"].tolist() == [0]


def test_nav_units(decode, start, vehicle):
    rows, _ = one(
        decode, start, vehicle, "GLOBAL_POSITION_INT",
        time_boot_ms=10_050, lat=-353632610, lon=1491652299, alt=584120, relative_alt=-38,
        vx=1550, vy=-20, vz=-300,
    )  # fmt: skip
    nav = rows["nav"][0]
    np.testing.assert_allclose(nav["vel_ned_m_s"], [15.5, -0.2, -3.0])
    np.testing.assert_allclose(
        [nav["lat_rad"] / DEG, nav["lon_rad"] / DEG, nav["alt_m"], nav["height_m"]],
        [-35.3632610, 149.1652299, 584.12, -0.038],
    )


def test_pressure_gives_baro_and_airspeed(decode, start, vehicle):
    rows, _ = one(
        decode, start, vehicle, "SCALED_PRESSURE2",
        time_boot_ms=10_020, press_abs=950.0, press_diff=2.0, temperature=-1500,
    )  # fmt: skip
    np.testing.assert_allclose(rows["baro1"]["static_press_pa"], 95_000)
    np.testing.assert_allclose(rows["baro1"]["temperature_k"], 258.15)
    np.testing.assert_allclose(rows["airspeed1"]["diff_press_pa"], 200)
    np.testing.assert_allclose(rows["airspeed1"]["cas_m_s"], 20.0)


def test_negative_differential_pressure_is_zero_airspeed_and_stays_visible(decode, start, vehicle):
    rows, rejected = one(
        decode, start, vehicle, "SCALED_PRESSURE", time_boot_ms=10_020, press_diff=-0.5
    )
    assert rows["airspeed0"]["cas_m_s"].tolist() == [0.0]
    np.testing.assert_allclose(rows["airspeed0"]["diff_press_pa"], -50)
    assert rejected["baro0", Rejection.OUT_OF_RANGE] == 1  # 0 hPa
    assert "baro0" not in rows


def test_airspeed_ratio_holds_from_its_parameter_on(decode, start, vehicle):
    press = [
        vehicle.encode("SCALED_PRESSURE", time_boot_ms=10_000 + i, press_diff=1.0) for i in (1, 2)
    ]
    second = vehicle.encode("SCALED_PRESSURE2", time_boot_ms=10_003, press_diff=1.0)
    ratio = vehicle.encode("PARAM_VALUE", param_id="ARSPD_RATIO", param_value=1.44, param_type=9)
    nonsense = vehicle.encode("PARAM_VALUE", param_id="ARSPD_RATIO", param_value=0.0, param_type=9)
    data = start + press[0] + ratio + nonsense + press[1] + second
    batch, _ = decode(data, airspeed_ratio=4.0)
    np.testing.assert_allclose(batch.rows["airspeed0"]["cas_m_s"], [20.0, 12.0])
    np.testing.assert_allclose(batch.rows["airspeed1"]["cas_m_s"], [20.0])
    assert batch.rows["param"]["name"].tolist() == [b"ARSPD_RATIO"] * 2


@pytest.mark.parametrize(
    ("message", "fields", "sensor", "field", "value"),
    [
        ("AIRSPEED", {"id": 2, "airspeed": 31.5, "raw_press": 5.0}, "airspeed2", "cas_m_s", 31.5),
        ("AIRSPEED", {"id": 0, "raw_press": 5.0}, "airspeed0", "diff_press_pa", 500.0),
        ("NAMED_VALUE_FLOAT", {"name": "AS2", "value": 21.0}, "airspeed1", "cas_m_s", 21.0),
        ("NAMED_VALUE_FLOAT", {"name": "AOA1", "value": 9.0}, "aoa0", "aoa_rad", 9 * DEG),
        ("NAMED_VALUE_FLOAT", {"name": "AOA3", "value": -9.0}, "aoa2", "aoa_rad", -9 * DEG),
        (
            "SENSOR_AIRFLOW_ANGLES",
            {"angleofattack": 3.0, "angleofattack_valid": 1},
            "aoa0",
            "aoa_rad",
            3 * DEG,
        ),
        ("RPM", {"rpm1": 4200.0, "rpm2": -1.0}, "spool0", "speed_rpm", 4200.0),
        ("RPM", {"rpm1": 4200.0, "rpm2": -1.0}, "spool1", "speed_rpm", -1.0),
        ("RAW_RPM", {"index": 3, "frequency": 900.0}, "spool3", "speed_rpm", 900.0),
        ("EFI_STATUS", {"rpm": 5100.0}, "spool0", "speed_rpm", 5100.0),
        ("ESC_TELEMETRY_1_TO_4", {"rpm": [1, 2, 3, 4]}, "spool2", "speed_rpm", 3.0),
        ("ESC_TELEMETRY_5_TO_8", {"rpm": [1, 2, 3, 4]}, "spool7", "speed_rpm", 4.0),
        ("HEARTBEAT", {"type": 1, "autopilot": 3, "base_mode": 217}, "heartbeat", "armed", 1),
        ("EXTENDED_SYS_STATE", {"landed_state": 2}, "landed", "landed_state", 2),
        ("SYS_STATUS", {"onboard_control_sensors_health": 0x80000001}, "sys_status", "health",
         0x80000001),
        ("NAMED_VALUE_FLOAT", {"name": "XYZ", "value": 5.0}, "named", "value", 5.0),
        ("STATUSTEXT", {"severity": 4, "text": "hello"}, "text", "severity", 4),
        ("SCALED_IMU3", {"xacc": 100}, "imu2", "acc_m_s2", [0.980665, 0, 0]),
        ("SCALED_PRESSURE3", {"press_abs": 900.0}, "baro2", "static_press_pa", 90_000.0),
    ],
)  # fmt: skip
def test_one_value_of_each_message(decode, start, vehicle, message, fields, sensor, field, value):
    rows, _ = one(decode, start, vehicle, message, **fields)
    np.testing.assert_allclose(rows[sensor][field][-1], value, rtol=1e-6)


def test_servo_outputs_of_the_main_port(decode, start, vehicle):
    main = vehicle.encode(
        "SERVO_OUTPUT_RAW", time_usec=10_000_100, servo1_raw=1100, servo16_raw=1900
    )
    aux = vehicle.encode("SERVO_OUTPUT_RAW", time_usec=10_000_200, port=1, servo1_raw=1)
    batch, _ = decode(start + main + aux)
    assert batch.rows["servo"]["pwm_us"][:, [0, 15]].tolist() == [[1100, 1900]]


def test_px4_integer_parameters_are_bits(decode, vehicle):
    beat = vehicle.encode("HEARTBEAT", type=1, autopilot=12)
    clock = vehicle.encode("ATTITUDE", time_boot_ms=1000)
    bits = np.array([77], "<i4").view("<f4")[0]
    data = (
        beat + clock + vehicle.encode("PARAM_VALUE", param_id="A", param_value=bits, param_type=6)
    )
    assert decode(data)[0].rows["param"]["value"].tolist() == [77.0]


# ---------------------------------------------------------------- the whole table


@pytest.mark.parametrize("source", catalog.SOURCES, ids=lambda s: f"{s.message}-{s.sensor}")
def test_every_source_gives_rows_of_its_sensor(source, decode):
    dialect = load_dialect("all")
    message = dialect.by_name[source.message]
    sender = Encoder(1, 1, "all")
    start = sender.encode("HEARTBEAT", type=1, autopilot=3) + sender.encode(
        "SYSTEM_TIME", time_boot_ms=5000
    )
    if source.message == "PARAM_VALUE":
        fields = {"param_value": 1.0, "param_id": "A"}
    else:
        fields = {
            name: 1
            for name in message.wire_fields
            if message.dtype[name].kind in "fiu" and message.dtype[name].shape == ()
        }
    fields |= {"port": 0} if "port" in fields else {}
    fields |= {"fields_updated": 0x7FF} if "fields_updated" in fields else {}
    fields |= {"time_boot_ms": 5001} if "time_boot_ms" in fields else {}
    fields |= {"time_usec": 5_001_000} if "time_usec" in fields else {}
    fields |= {"press_abs": 900.0, "abs_pressure": 900.0} if "press_diff" in fields else {}
    fields |= {"abs_pressure": 900.0} if "abs_pressure" in fields else {}
    fields |= {"q2": 0, "q3": 0, "q4": 0} if "q1" in fields else {}
    fields = {k: v for k, v in fields.items() if k in message.wire_fields}
    ranking = {source.quantity: (source.key,)}
    batch, decoder = decode(
        start + sender.encode(source.message, **fields), dialect="all", ranking=ranking, settle_us=0
    )
    sensor = source.sensor.format(1)
    assert len(batch.rows[sensor]) >= 1
    assert decoder.sensors.used[sensor][source.message] >= 1
    assert batch.rows[sensor].dtype == QUANTITIES[quantity_of(sensor)]


def test_the_table_and_the_ranking_name_existing_things():
    dialect = load_dialect("all")
    for source in catalog.SOURCES:
        message = dialect.by_name[source.message]
        dtype = QUANTITIES[source.quantity]
        for fill in source.fills:
            assert fill.into in dtype.names
            assert set(fill.fields) <= set(message.wire_fields)
        assert source.instance is None or source.instance in message.wire_fields
    for name, (field, _, _) in catalog.STAMPS.items():
        assert field in dialect.by_name[name].wire_fields
    keys = {(s.quantity, s.key) for s in catalog.SOURCES} | {
        (quantity_of(sensor), "NAMED_VALUE_FLOAT") for sensor, *_ in catalog.NAMED_INPUTS.values()
    }
    ranked = {(q, k) for q, order in catalog.RANKING.items() for k in order}
    assert ranked <= keys
    assert keys - ranked == {("aoa", "AOA_SSA")}  # computed by ArduPilot, no vane
    assert set(catalog.RANKING) == set(QUANTITIES)


# ---------------------------------------------------------------- bad values


@pytest.mark.parametrize(
    ("message", "fields", "sensor", "reason"),
    [
        ("HIGHRES_IMU", {"xacc": math.nan}, "imu0", Rejection.NON_FINITE),
        ("HIGHRES_IMU", {"zgyro": math.inf}, "imu0", Rejection.NON_FINITE),
        ("HIGHRES_IMU", {"xacc": 1e6}, "imu0", Rejection.OUT_OF_RANGE),
        ("HIGHRES_IMU", {"id": 200}, "imu", Rejection.OUT_OF_RANGE),
        ("ATTITUDE", {"pitch": math.nan}, "attitude", Rejection.NON_FINITE),
        ("AIRSPEED", {"airspeed": -4.0}, "airspeed0", Rejection.OUT_OF_RANGE),
        ("AIRSPEED", {"airspeed": math.nan}, "airspeed0", Rejection.NON_FINITE),
        ("SCALED_PRESSURE", {"press_diff": math.nan}, "airspeed0", Rejection.NON_FINITE),
        ("GPS_RAW_INT", {"lat": 2_000_000_000}, "gps0", Rejection.OUT_OF_RANGE),
        ("NAMED_VALUE_FLOAT", {"name": "AOA1", "value": 1e4}, "aoa0", Rejection.OUT_OF_RANGE),
        ("RPM", {"rpm1": math.nan}, "spool0", Rejection.NON_FINITE),
    ],
)
def test_bad_values_are_counted_not_used(decode, start, vehicle, message, fields, sensor, reason):
    rows, rejected = one(decode, start, vehicle, message, **fields)
    assert rejected[sensor, reason] == 1
    assert len(rows.get(sensor, ())) == (1 if sensor == "attitude" else 0)


def test_a_float_message_with_nan_extras_is_still_airspeed(decode, start, vehicle):
    rows, _ = one(decode, start, vehicle, "AIRSPEED", airspeed=20.0, raw_press=math.nan)
    assert rows["airspeed0"]["cas_m_s"].tolist() == [20.0]


def test_unused_instances_are_given_as_they_are(decode, start, vehicle):
    rows, rejected = one(decode, start, vehicle, "SCALED_IMU3", time_boot_ms=10_005)
    assert not rows["imu2"]["acc_m_s2"].any()
    assert not rejected


# ---------------------------------------------------------------- whose messages count


def test_our_own_output_is_never_an_input(decode, start):
    own = Encoder(1, 191)
    data = start + b"".join(
        [
            own.encode("NAMED_VALUE_FLOAT", time_boot_ms=10_000, name="FLT_AIR", value=1.0),
            own.encode("AIRSPEED", id=0, airspeed=99.0),
            own.encode("HIGHRES_IMU", time_usec=10_000_000, id=0),
            own.encode("STATUSTEXT", text="airspeed0 FAULTY"),
            own.encode("HEARTBEAT", type=18, autopilot=8),
            own.encode("SCALED_IMU", time_boot_ms=99_000),
        ]
    )
    batch, _ = decode(data)
    alone, _ = decode(start)
    assert {s: r.tobytes() for s, r in batch.rows.items()} == {
        s: r.tobytes() for s, r in alone.rows.items()
    }
    assert batch.rejected["frame", Rejection.OTHER_SYSTEM] == 6


def test_other_systems_are_counted_and_not_used(decode, start):
    other = Encoder(9, 1).encode("SCALED_IMU", time_boot_ms=1, xacc=5)
    batch, decoder = decode(start + other)
    assert "imu0" not in batch.rows
    assert batch.rejected["frame", Rejection.OTHER_SYSTEM] == 1
    assert decoder.vehicle.system_id == 1


def test_texts_and_named_values_of_companions_are_heard_but_are_no_sensors(decode, start):
    companion = Encoder(1, 158)
    data = start + companion.encode("NAMED_VALUE_FLOAT", time_boot_ms=77, name="AOA1", value=2.0)
    batch, _ = decode(data + companion.encode("STATUSTEXT", text="hi"))
    assert batch.rows["named"]["t_us"].tolist() == [10_000_000]
    assert batch.rows["text"]["text"].tolist() == [b"hi"]
    assert "aoa0" not in batch.rows
    allowed, _ = decode(data, components={"NAMED_VALUE_FLOAT": frozenset({1, 158})})
    assert len(allowed.rows["aoa0"]) == 1


def test_the_vehicle_is_the_first_autopilot_and_nothing_before_it_is_lost(decode, vehicle):
    early = b"".join(vehicle.encode("SCALED_IMU", time_boot_ms=1000 + i) for i in range(5))
    ground = Encoder(255, 190).encode("HEARTBEAT", type=6, autopilot=8)
    unstamped = vehicle.encode("RPM", rpm1=1.0)
    beat = vehicle.encode("HEARTBEAT", type=1, autopilot=3)
    late = Encoder(2, 1).encode("HEARTBEAT", type=2, autopilot=3)
    batch, decoder = decode(unstamped + ground + early + beat + late)
    assert (decoder.vehicle.system_id, decoder.vehicle.autopilot, decoder.vehicle.type) == (1, 3, 1)
    assert len(batch.rows["imu0"]) == 5
    assert batch.rows["spool0"]["t_us"].tolist() == [1_000_000]
    assert batch.rows["spool0"]["seq"].tolist() == [0]


def test_a_configured_system_is_waited_for(decode, start):
    second = Encoder(2, 1)
    data = start + second.encode("HEARTBEAT", type=1, autopilot=3)
    data += second.encode("SCALED_IMU", time_boot_ms=7)
    batch, decoder = decode(data, system_id=2)
    assert decoder.vehicle.system_id == 2
    assert batch.rows["imu0"]["t_us"].tolist() == [7000]


def test_without_a_heartbeat_the_one_who_says_most_is_the_vehicle(decode, vehicle):
    data = Encoder(5, 1).encode("SCALED_IMU", time_boot_ms=5)
    data += b"".join(vehicle.encode("SCALED_IMU", time_boot_ms=1000 + i) for i in range(5))
    batch, decoder = decode(data)
    assert decoder.vehicle.system_id == 1
    assert len(batch.rows["imu0"]) == 5
    batch, decoder = decode(data * 3, hold_back=8)
    assert len(batch.rows["imu0"]) == 15


def test_hold_back_is_bounded(decode):
    ground = Encoder(255, 190)
    data = b"".join(ground.encode("HEARTBEAT", autopilot=8) for _ in range(50))
    batch, decoder = decode(data, hold_back=16)
    assert decoder.vehicle is None
    assert batch.rejected["frame", Rejection.OVERFLOW] == 48
    assert batch.rejected["frame", Rejection.OTHER_SYSTEM] == 2


# ---------------------------------------------------------------- order and cuts


def test_rows_are_numbered_in_arrival_order_without_holes(decode, noisy_stream):
    batch, _ = decode(noisy_stream(3, 400))
    seq = np.concatenate([r["seq"] for r in batch.rows.values()])
    assert sorted(seq.tolist()) == list(range(len(seq)))
    for rows in batch.rows.values():
        assert (np.diff(rows["seq"]) > 0).all()


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 10_000),
    st.lists(st.integers(0, 8000), max_size=60),
    st.sampled_from([8192, 5]),
)
@example(383, [951], 8192)  # rows of one source out of time order
def test_where_the_bytes_are_cut_changes_no_sample(
    noisy_stream, decode, same_batch, seed, cuts, hold_back
):
    data = noisy_stream(seed, 150)
    whole, a = decode(data, hold_back=hold_back)
    cut, b = decode(data, cuts, hold_back=hold_back)
    same_batch(whole, cut)
    assert a.counters == b.counters
    assert a.vehicle == b.vehicle
    assert a.sensors.used == b.sensors.used


def test_byte_by_byte_is_the_same_too(noisy_stream, decode, same_batch):
    data = noisy_stream(11, 60)
    same_batch(decode(data)[0], decode(data, range(len(data)))[0])


@settings(deadline=None)
@given(st.binary(max_size=400), st.booleans())
def test_random_bytes_never_raise(decode, data, stamped):
    batch, _ = decode(data, stamped=stamped)
    assert isinstance(batch, Batch)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted({s.message for s in catalog.SOURCES})), st.data())
def test_random_payloads_never_raise_and_no_usable_row_is_outside_its_bounds(message, data):
    decoder = Decoder(DecoderOptions(dialect="all"))
    sender = Encoder(1, 1, "all")
    decoder.feed(
        sender.encode("HEARTBEAT", type=1, autopilot=3)
        + sender.encode("SYSTEM_TIME", time_boot_ms=5000)
    )
    layout = load_dialect("all").by_name[message]
    raw = data.draw(st.binary(min_size=layout.dtype.itemsize, max_size=layout.dtype.itemsize))
    values = layout.packer.unpack(raw)
    batch = decoder.feed(sender.packer(message)(*values))
    for sensor, rows in batch.rows.items():
        for field in ("acc_m_s2", "gyro_rad_s", "cas_m_s", "aoa_rad", "speed_rpm", "lat_rad"):
            if field in rows.dtype.names:
                assert np.isfinite(rows[field]).all(), (sensor, field)
                assert (np.abs(rows[field]) <= 1e6).all()


def test_counters_tell_who_said_what(decode, start, vehicle):
    frames = [vehicle.encode("SCALED_IMU", time_boot_ms=10_000 + i) for i in range(10)]
    del frames[3:5]
    _, decoder = decode(start + b"".join(frames) + encode("VFR_HUD"))
    counters = decoder.counters
    assert counters.messages == 11
    assert counters.by_name["SCALED_IMU"] == 8
    assert counters.by_source[1, 1] == 11
    assert counters.lost >= 2


def test_an_unknown_quantity_in_the_ranking_is_named():
    with pytest.raises(ValueError, match="'airspeeed'"):
        Decoder(DecoderOptions(ranking={"airspeeed": ("AIRSPEED",)}))
