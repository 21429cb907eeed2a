"""What goes out and when, with fake time: masks, values, heartbeat."""

import math

import numpy as np
import pytest

from links.vocabulary import GYRO_ACC_AXES, Kind, Reason, State
from monitor.masks import mask_bit, masks
from monitor.publish import Message, Publisher
from monitor.settings.publish import PublishSettings
from monitor.verdict import AIR_ESTIMATE, IMU_ESTIMATE, StepResult, Verdict

S = 1_000_000


def verdict(sensor: str, state: State, t_s: float = 10.0, **extra) -> Verdict:
    return Verdict(t_us=round(t_s * S), sensor=sensor, state=state, **extra)


def run(publisher: Publisher, seconds: float, step_s: float = 0.02, start_s: float = 0.0, **due):
    """(host seconds, message) of everything that leaves while the loop turns every ``step_s``."""
    sent = []
    for k in range(round(seconds / step_s)):
        now_us = round((start_s + k * step_s) * S)
        args = {"t_us": now_us + 100 * S, "silent": False, **due}
        sent += [(now_us / S, m) for m in publisher.due(now_us, **args)]
    return sent


def named(sent, name: str):
    return [
        (t, m.fields["value"])
        for t, m in sent
        if m.name == "NAMED_VALUE_FLOAT" and m.fields["name"] == name
    ]


@pytest.mark.parametrize(
    ("sensor", "place"),
    [
        ("imu0.acc_x", ("IMU0", 0)),
        ("imu4.gyro_z", ("IMU4", 5)),
        ("airspeed2", ("AIR", 2)),
        ("aoa0", ("AIR", 8)),
        ("aoa2", ("AIR", 10)),
        ("spool3", ("ENG", 3)),
        ("wing_left.drag", ("WNG", 1)),
        ("wing_right.drag", ("WNG", 3)),
        ("gps0", None),
        ("attitude", None),
        ("airspeed3", None),
        ("imu5.acc_x", None),
    ],
)
def test_each_watched_sensor_has_the_bit_that_the_message_table_gives(sensor, place):
    assert mask_bit(sensor) == place


def test_every_mask_is_exact_in_a_float32():
    sensors = [f"imu{i}.{a}" for i in range(5) for a in GYRO_ACC_AXES]
    sensors += [f"airspeed{i}" for i in range(3)] + [f"aoa{i}" for i in range(3)]
    sensors += [f"spool{i}" for i in range(30)]
    found = masks(dict.fromkeys(sensors, State.FAULTY), {State.FAULTY})
    assert set(found) == {"AIR", "ENG", *(f"IMU{i}" for i in range(5))}
    assert all(int(np.float32(bits)) == bits for bits in found.values())


def test_an_absent_sensor_has_no_mask():
    assert masks({"imu2.acc_x": State.ABSENT, "aoa0": State.OK}, {State.FAULTY}) == {"AIR": 0}


def test_heartbeat_is_1_hz_and_says_what_state_the_monitor_is_in():
    publisher = Publisher(PublishSettings())
    sent = [(t, m) for t, m in run(publisher, 5.0) if m.name == "HEARTBEAT"]
    assert len(sent) == 5
    assert {m.fields["system_status"] for _, m in sent} == {4}
    publisher.note(StepResult([verdict("airspeed0", State.FAULTY)]))
    sent = [m for _, m in run(publisher, 2.0, start_s=5.0) if m.name == "HEARTBEAT"]
    assert [m.fields["system_status"] for m in sent] == [5, 5]
    sent = [m for _, m in run(publisher, 2.0, start_s=7.0, silent=True) if m.name == "HEARTBEAT"]
    assert [m.fields["system_status"] for m in sent] == [6, 6]


def test_before_the_vehicle_is_heard_only_the_heartbeat_leaves():
    sent = run(Publisher(PublishSettings()), 3.0, t_us=None)
    assert [m.name for _, m in sent] == ["HEARTBEAT"] * 3
    assert {m.fields["system_status"] for _, m in sent} == {6}


def test_a_stalled_loop_does_not_send_a_burst_of_heartbeats_afterwards():
    publisher = Publisher(PublishSettings())
    publisher.due(0, None, False)
    late = [m for k in range(10) for m in publisher.due(60 * S + k * 20_000, None, False)]
    assert [m.name for m in late] == ["HEARTBEAT"]


def test_masks_go_out_at_2_hz_and_a_fault_at_once():
    publisher = Publisher(PublishSettings())
    publisher.note(StepResult([verdict("airspeed0", State.OK), verdict("airspeed1", State.OK)]))
    sent = run(publisher, 3.1)
    assert len(named(sent, "FLT_AIR")) == 7
    assert {v for _, v in named(sent, "FLT_AIR")} == {0.0}
    assert {v for _, v in named(sent, "MON_AIR")} == {3.0}
    publisher.note(StepResult([verdict("airspeed1", State.FAULTY)]))
    first = publisher.due(round(3.1 * S), 103 * S, False)
    assert (
        Message("NAMED_VALUE_FLOAT", {"time_boot_ms": 103_000, "name": "FLT_AIR", "value": 2.0})
        in first
    )
    assert first[0].fields["name"] == "FLT_AIR"


def test_an_unmonitored_sensor_leaves_the_monitor_mask():
    publisher = Publisher(PublishSettings())
    publisher.note(
        StepResult(
            [
                verdict("imu0.acc_x", State.OK),
                verdict("imu0.acc_y", State.UNMONITORED, reason=Reason.ON_GROUND),
                verdict("imu0.gyro_z", State.SUSPECT),
            ]
        )
    )
    assert named(run(publisher, 0.1), "MON_IMU0") == [(0.0, 0b100001)]


def air_row(t_s: float, **values) -> np.ndarray:
    row = np.zeros(1, dtype=AIR_ESTIMATE)
    for name in AIR_ESTIMATE.names[1:]:
        row[name] = np.nan
    row["t_us"] = round(t_s * S)
    for name, value in values.items():
        row[name] = value
    return row


def test_values_go_out_at_5_hz_and_only_what_is_known():
    publisher = Publisher(PublishSettings())
    sent = []
    for k in range(100):
        now_s = k * 0.02
        publisher.note(
            StepResult(estimates={"air": air_row(100 + now_s, cas_m_s=18.5, aoa_rad=0.1)})
        )
        sent += [
            (now_s, m) for m in publisher.due(round(now_s * S), round((100 + now_s) * S), False)
        ]
    cas = named(sent, "R_CAS")
    assert len(cas) == 10
    assert {v for _, v in cas} == {18.5}
    assert named(sent, "R_AOA")[0][1] == pytest.approx(math.degrees(0.1))
    assert not named(sent, "R_TAS")
    airspeed = [m for _, m in sent if m.name == "AIRSPEED"]
    assert len(airspeed) == 10
    assert airspeed[0].fields["id"] == 9
    assert not [m for _, m in sent if m.name == "WIND_COV"]


def test_wind_covariance_is_in_square_metres_per_second():
    publisher = Publisher(PublishSettings())
    row = air_row(100.0, wind_ned_m_s=(3.0, -4.0, 0.5), wind_std_ned_m_s=(0.3, 0.4, 0.2))
    publisher.note(StepResult(estimates={"air": row}))
    wind = next(m for _, m in run(publisher, 0.1) if m.name == "WIND_COV")
    assert (wind.fields["wind_x"], wind.fields["wind_y"]) == (3.0, -4.0)
    assert wind.fields["var_horiz"] == pytest.approx(0.25)
    assert wind.fields["var_vert"] == pytest.approx(0.04)


def test_an_old_or_already_sent_estimate_is_not_sent_again():
    publisher = Publisher(PublishSettings())
    publisher.note(StepResult(estimates={"air": air_row(100.0, cas_m_s=18.0)}))
    assert len(named(run(publisher, 5.0), "R_CAS")) == 1
    publisher.note(StepResult(estimates={"air": air_row(101.0, cas_m_s=18.0)}))
    assert not named(run(publisher, 1.0, start_s=5.0), "R_CAS")


def test_no_value_is_sent_over_a_silent_link():
    publisher = Publisher(PublishSettings())
    publisher.note(StepResult(estimates={"air": air_row(100.0, cas_m_s=18.0)}))
    assert not named(run(publisher, 1.0, silent=True), "R_CAS")


def test_what_the_dialect_lacks_is_left_out():
    publisher = Publisher(PublishSettings(), has_message=lambda name: name != "AIRSPEED")
    publisher.note(StepResult(estimates={"air": air_row(100.0, cas_m_s=18.0)}))
    sent = run(publisher, 0.5)
    assert named(sent, "R_CAS")
    assert "AIRSPEED" not in {m.name for _, m in sent}


def imu_row() -> np.ndarray:
    row = np.zeros(1, dtype=IMU_ESTIMATE)
    row["t_us"] = 100 * S
    row["acc_fault_m_s2"] = (1.5, 0.0, 0.0)
    row["acc_fault_std_m_s2"] = 0.05
    row["gyro_fault_std_rad_s"] = 0.001
    row["acc_m_s2"] = (0.1, -0.2, -9.80665)
    row["gyro_rad_s"] = (0.01, 0.02, -0.03)
    return row


def test_reconstructed_imu_faults_go_out_as_a_float_array():
    publisher = Publisher(PublishSettings())
    publisher.note(StepResult(estimates={"imu1": imu_row()}))
    message = next(m for _, m in run(publisher, 0.1) if m.name == "DEBUG_FLOAT_ARRAY")
    assert message.fields["name"] == "IMU_FLT"
    assert message.fields["array_id"] == 1
    assert message.fields["time_usec"] == 100 * S
    assert message.fields["data"][:12] == [1.5, 0, 0, 0, 0, 0, *[0.05] * 3, *[0.001] * 3]
    assert len(message.fields["data"]) == 58


def test_tables_of_test_statistics_are_not_sent():
    publisher = Publisher(PublishSettings())
    publisher.note(StepResult(estimates={"imu0_tests": imu_row(), "air_tests": imu_row()}))
    assert {m.name for _, m in run(publisher, 0.1)} == {"HEARTBEAT"}


def test_the_reconstructed_imu_is_off_until_asked_for():
    publisher = Publisher(PublishSettings())
    publisher.note(StepResult(estimates={"imu0": imu_row()}))
    assert {m.name for _, m in run(publisher, 0.1)} == {"DEBUG_FLOAT_ARRAY", "HEARTBEAT"}


def test_the_reconstructed_imu_as_highres_and_as_scaled():
    high = Publisher(PublishSettings(imu_reconstructed="HIGHRES_IMU"))
    high.note(StepResult(estimates={"imu1": imu_row()}))
    message = next(m for _, m in run(high, 0.1) if m.name == "HIGHRES_IMU")
    assert message.fields["id"] == 10
    assert message.fields["zacc"] == pytest.approx(-9.80665)
    scaled = Publisher(PublishSettings(imu_reconstructed="SCALED_IMU"))
    scaled.note(StepResult(estimates={"imu1": imu_row()}))
    message = next(m for _, m in run(scaled, 0.1) if m.name == "SCALED_IMU2")
    assert (message.fields["zacc"], message.fields["zgyro"]) == (-1000, -30)


def test_a_change_is_announced_once():
    publisher = Publisher(PublishSettings())
    publisher.note(
        StepResult(
            [
                verdict(
                    "airspeed0",
                    State.FAULTY,
                    t_s=99.0,
                    kind=Kind.BIAS,
                    magnitude=-3.14,
                    unit="m/s",
                    onset_t_us=88 * S,
                )
            ]
        )
    )
    sent = [m for _, m in run(publisher, 10.0) if m.name == "STATUSTEXT"]
    assert [m.fields for m in sent] == [
        {"severity": 2, "text": "airspeed0 FAULTY: 3.1 m/s low since 12 s"}
    ]


def test_nothing_is_monitored_while_the_vehicle_is_not_heard() -> None:
    publisher = Publisher(PublishSettings())
    publisher.note(StepResult([verdict("airspeed0", State.OK), verdict("airspeed1", State.FAULTY)]))
    heard = named(run(publisher, 1.0), "MON_AIR")
    silent = run(publisher, 1.0, start_s=1.0, silent=True)
    assert {value for _, value in heard} == {3}
    assert {value for _, value in named(silent, "MON_AIR")} == {0}
    assert {value for _, value in named(silent, "FLT_AIR")} == {2}  # what was found stands
