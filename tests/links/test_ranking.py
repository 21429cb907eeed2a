"""First usable wins: better sources take over, synthetic ones never hide a dead sensor."""

import pytest

from links.mavlink import Encoder


@pytest.fixture
def stream(start, vehicle):
    """Frames at given vehicle times [s] after the start at 10 s: (time, message, fields)."""

    def build(*events, first=start):
        out = first
        for t_s, message, fields in events:
            out += vehicle.encode("SYSTEM_TIME", time_boot_ms=round(t_s * 1000))
            out += vehicle.encode(message, **fields)
        return out

    return build


def hud(t_s, cas):
    return (t_s, "VFR_HUD", {"airspeed": cas})


def press(t_s):
    return (t_s, "SCALED_PRESSURE", {"time_boot_ms": round(t_s * 1000), "press_diff": 2.0})


def airspeed(t_s, cas):
    return (t_s, "AIRSPEED", {"id": 0, "airspeed": cas})


def cas_of(batch):
    return [round(float(c), 6) for c in batch.rows["airspeed0"]["cas_m_s"]]


def test_vfr_hud_alone_is_used_once_it_is_clear_that_there_is_nothing_better(decode, stream):
    batch, decoder = decode(stream(hud(10.5, 1.0), hud(11.9, 2.0), hud(12.1, 3.0), hud(13.0, 4.0)))
    assert cas_of(batch) == [3.0, 4.0]
    assert dict(decoder.sensors.used["airspeed0"]) == {"VFR_HUD": 2}


def test_vfr_hud_never_stands_in_for_a_pitot_that_fell_silent(decode, stream):
    batch, _ = decode(stream(press(10.5), hud(10.6, 9.0), hud(13.0, 9.0), hud(60.0, 9.0)))
    assert cas_of(batch) == [20.0]


def test_a_better_source_takes_over_at_once_and_the_next_steps_in_after_silence(decode, stream):
    batch, decoder = decode(
        stream(
            press(10.5), airspeed(11.0, 30.0), press(11.5), press(12.9), press(13.1), press(13.5)
        )
    )
    assert cas_of(batch) == [20.0, 30.0, 20.0, 20.0]
    assert decoder.sensors.used["airspeed0"].most_common()[0] == ("SCALED_PRESSURE", 3)


def test_an_unusable_row_does_not_hold_others_back(decode, stream):
    batch, _ = decode(stream(airspeed(10.5, float("nan")), press(10.6)))
    assert cas_of(batch) == [20.0]


def test_attitude_quaternion_before_attitude(decode, stream):
    batch, decoder = decode(
        stream(
            (10.1, "ATTITUDE_QUATERNION", {"time_boot_ms": 10_100, "q1": 1.0}),
            (10.2, "ATTITUDE", {"time_boot_ms": 10_200}),
            (10.3, "ATTITUDE_QUATERNION", {"time_boot_ms": 10_300, "q1": 1.0}),
        )
    )
    assert batch.rows["attitude"]["t_us"].tolist() == [10_000_000, 10_100_000, 10_300_000]
    assert decoder.sensors.used["attitude"]["ATTITUDE"] == 1  # before the better one spoke


def imu_events():
    return [
        (10.1, "HIGHRES_IMU", {"time_usec": 10_100_000, "xacc": 1.0}),
        (10.2, "SCALED_IMU", {"time_boot_ms": 10_200, "xacc": 1000}),
        (10.3, "HIGHRES_IMU", {"time_usec": 10_300_000, "xacc": 1.0}),
        (10.4, "SCALED_IMU", {"time_boot_ms": 10_400, "xacc": 1000}),
    ]


def test_px4_bias_faults_are_looked_for_in_scaled_imu(decode, stream, vehicle, start):
    batch, _ = decode(stream(*imu_events()))
    assert batch.rows["imu0"]["acc_m_s2"][:, 0].tolist() == [1.0, 1.0]
    px4 = Encoder(1, 1)
    first = px4.encode("HEARTBEAT", type=1, autopilot=12) + px4.encode(
        "ATTITUDE", time_boot_ms=10_000
    )
    batch, _ = decode(stream(*imu_events(), first=first))
    assert batch.rows["imu0"]["acc_m_s2"][:, 0].tolist() == pytest.approx([1.0, 9.80665, 9.80665])
    assert len(batch.rows["imu0"]) == 3


def test_the_order_is_configurable_and_what_is_not_ranked_is_not_used(decode, stream):
    events = [airspeed(10.5, 30.0), press(10.6)]
    batch, _ = decode(stream(*events), ranking={"airspeed": ("SCALED_PRESSURE", "AIRSPEED")})
    assert cas_of(batch) == [30.0, 20.0]
    batch, _ = decode(stream(*events), ranking={"airspeed": ("SCALED_PRESSURE",)})
    assert cas_of(batch) == [20.0]


def test_computed_angles_are_no_vane_unless_configured(decode, stream):
    events = [(10.5, "AOA_SSA", {"time_usec": 10_500_000, "AOA": 4.0})]
    assert "aoa0" not in decode(stream(*events))[0].rows
    batch, _ = decode(stream(*events), ranking={"aoa": ("NAMED_VALUE_FLOAT", "AOA_SSA")})
    assert batch.rows["aoa0"]["aoa_rad"] == pytest.approx([0.0698131700])


def test_scaled_pressure_2_before_the_named_value_of_the_second_pitot(decode, stream):
    batch, _ = decode(
        stream(
            (10.5, "NAMED_VALUE_FLOAT", {"time_boot_ms": 10_500, "name": "AS2", "value": 7.0}),
            (10.6, "SCALED_PRESSURE2", {"time_boot_ms": 10_600, "press_diff": 2.0}),
            (10.7, "NAMED_VALUE_FLOAT", {"time_boot_ms": 10_700, "name": "AS2", "value": 7.0}),
        )
    )
    assert [round(float(v), 6) for v in batch.rows["airspeed1"]["cas_m_s"]] == [7.0, 20.0]
    assert len(batch.rows["named"]) == 2
