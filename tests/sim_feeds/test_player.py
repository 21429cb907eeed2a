"""Frames as an autopilot sends them: decoded by pymavlink they say the truth."""

import itertools
import json

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim_feeds.player import frames, frames_of, play, save_truth, truth, truth_table, unix_us
from sim_feeds.scenario import Flight, bundled, load, parse

FLIGHT = """
title = "circle"
aircraft = "small-uav"
[start]
speed_m_s = 20.0
agl_m = 150.0
boot_s = 30.0
[[leg]]
do = "orbit"
duration_s = 25.0
bank_deg = 30.0
[[wind]]
kind = "constant"
speed_m_s = 5.0
toward_deg = 45.0
[aoa]
count = 3
[airspeed]
count = 3
[imu]
count = 3
acc_noise_m_s2 = 0.0
gyro_noise_deg_s = 0.0
acc_bias_m_s2 = 0.0
gyro_bias_deg_s = 0.0
acc_walk_m_s2 = 0.0
gyro_walk_deg_s = 0.0
[gps]
velocity_std_m_s = 0.0
slow_velocity_std_m_s = 0.0
position_std_m = 0.0
height_std_m = 0.0
"""
BOOT_S = 30.0
G = 9.80665


def decoded(flight: Flight) -> dict[str, list]:
    out: dict[str, list] = {}
    parser = dialect.MAVLink(None)
    parser.robust_parsing = False
    for t_us, frame in frames_of(flight):
        (message,) = parser.parse_buffer(frame)
        message.sent_us = t_us
        out.setdefault(message.get_type(), []).append(message)
    return out


@pytest.fixture(scope="module")
def flight() -> Flight:
    return parse(FLIGHT).fly(5)


@pytest.fixture(scope="module")
def said(flight) -> dict[str, list]:
    return decoded(flight)


def column(messages, *names) -> np.ndarray:
    return np.array([[getattr(m, n) for n in names] for m in messages], dtype=float)


def test_everything_that_ardupilot_sends_is_there(said):
    assert set(said) >= {
        "HEARTBEAT",
        "SYS_STATUS",
        "EXTENDED_SYS_STATE",
        "SYSTEM_TIME",
        "PARAM_VALUE",
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "RAW_IMU",
        "SCALED_IMU2",
        "SCALED_IMU3",
        "GPS_RAW_INT",
        "GLOBAL_POSITION_INT",
        "SCALED_PRESSURE",
        "SCALED_PRESSURE2",
        "SCALED_PRESSURE3",
        "VFR_HUD",
        "NAMED_VALUE_FLOAT",
        "SERVO_OUTPUT_RAW",
        "RPM",
    }
    first = said["HEARTBEAT"][0]
    assert (first.type, first.autopilot) == (
        dialect.MAV_TYPE_FIXED_WING,
        dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
    )
    assert first.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
    assert (first.get_srcSystem(), first.get_srcComponent()) == (1, 1)


def test_rates(said):
    for name, hz in {"RAW_IMU": 50, "GPS_RAW_INT": 5, "ATTITUDE": 25, "HEARTBEAT": 1}.items():
        assert len(said[name]) == pytest.approx(25.0 * hz, abs=2)


@pytest.mark.parametrize("name", ["RAW_IMU", "SCALED_IMU2", "SCALED_IMU3"])
def test_imu_is_the_truth_within_its_quantum(flight, said, name):
    """1 mg and 1 mrad/s; SCALED_IMU stamps whole milliseconds, so time adds to the error."""
    messages = said[name]
    stamp = "time_usec" if name == "RAW_IMU" else "time_boot_ms"
    t = column(messages, stamp)[:, 0] * (1e-6 if name == "RAW_IMU" else 1e-3) - BOOT_S
    here = flight.truth.at(t)
    acc = column(messages, "xacc", "yacc", "zacc") * G / 1000.0
    gyro = column(messages, "xgyro", "ygyro", "zgyro") / 1000.0
    slack = 1e-5 if name == "RAW_IMU" else 0.002
    assert np.abs(acc - here.specific_force_m_s2).max() <= 0.5e-3 * G + slack
    assert np.abs(gyro - here.rate_rad_s).max() <= 0.5e-3 + slack


def test_gps_stamp_validity_and_arrival(flight, said):
    """Velocity is that of stamp - 0.07 s; the message arrives about 0.1 s after its stamp."""
    messages = said["GPS_RAW_INT"]
    valid = column(messages, "time_usec")[:, 0] * 1e-6 - BOOT_S - 0.07
    here = flight.truth.at(valid)
    north, east = here.vel_ned_m_s[:, 0], here.vel_ned_m_s[:, 1]
    speed, course = column(messages, "vel", "cog").T / 100.0
    assert np.abs(speed - np.hypot(north, east)).max() < 0.006
    off = (course - np.degrees(np.arctan2(east, north)) + 180.0) % 360.0 - 180.0
    assert np.abs(off).max() < 0.01
    late = np.array([m.sent_us * 1e-6 for m in messages]) - BOOT_S - valid
    assert late.min() >= 0.17 - 1e-6
    assert np.median(late) < 0.2
    lat, lon, alt = column(messages, "lat", "lon", "alt").T
    assert np.abs(lat * 1e-7 - np.degrees(here.lat_rad)).max() < 2e-7
    assert np.abs(lon * 1e-7 - np.degrees(here.lon_rad)).max() < 2e-7
    assert np.abs(alt * 1e-3 - here.height_m).max() < 1e-3


def test_pressures_and_vanes(flight, said):
    for i, name in enumerate(["SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"]):
        cas = np.sqrt(2.0 * 100.0 * np.maximum(column(said[name], "press_diff")[:, 0], 0.0))
        expected = flight.readings[f"airspeed{i}"].values[:, 0]
        np.testing.assert_allclose(cas, expected, rtol=1e-6)
        assert np.abs(column(said[name], "press_abs")[:, 0] - 990.0).max() < 20.0
    for i in range(3):
        vane = [m for m in said["NAMED_VALUE_FLOAT"] if m.name == f"AOA{i + 1}"]
        degrees = column(vane, "value")[:, 0]
        np.testing.assert_allclose(
            np.radians(degrees), flight.readings[f"aoa{i}"].values[:, 0], rtol=1e-6
        )


def test_attitude_and_velocity_are_the_autopilots(flight, said):
    nav = flight.navigation
    t = column(said["ATTITUDE"], "time_boot_ms")[:, 0] * 1e-3 - BOOT_S
    roll, pitch, yaw = column(said["ATTITUDE"], "roll", "pitch", "yaw").T
    true = flight.truth.at(t).euler_rad
    assert np.degrees(np.abs(roll - true[:, 0])).max() < 1.5
    assert np.degrees(np.abs(pitch - true[:, 1])).max() < 1.5
    assert np.degrees(np.abs((yaw - true[:, 2] + np.pi) % (2 * np.pi) - np.pi)).max() < 4.0
    q = column(said["ATTITUDE_QUATERNION"], "q1", "q2", "q3", "q4")
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-6)
    at = column(said["GLOBAL_POSITION_INT"], "time_boot_ms")[:, 0] * 1e-3 - BOOT_S
    velocity = column(said["GLOBAL_POSITION_INT"], "vx", "vy", "vz") / 100.0
    assert np.abs(velocity - flight.truth.at(at).vel_ned_m_s).max() < 0.6
    assert np.abs(velocity - flight.truth.at(at).vel_ned_m_s).max() > 0.02, "it has errors"
    assert len(nav.t_s) > 0


def test_order_of_transmission_and_sequence(flight):
    sent, raw = zip(*frames_of(flight), strict=True)
    assert all(a <= b for a, b in itertools.pairwise(sent))
    assert [f[4] for f in raw[:600]] == [i % 256 for i in range(600)]
    assert all(f[0] == 0xFD for f in raw)


def test_no_message_is_sent_before_it_is_known(flight, said):
    for name in ("RAW_IMU", "GPS_RAW_INT"):
        assert all(m.sent_us >= m.time_usec for m in said[name])
    for name in ("ATTITUDE", "SCALED_IMU2", "SCALED_PRESSURE"):
        assert all(m.sent_us >= m.time_boot_ms * 1000 - 500 for m in said[name])


def test_high_resolution_imu_and_airspeed_messages():
    text = FLIGHT.replace("[imu]", '[messages]\nimu = "highres"\nairspeed = "airspeed"\n[imu]')
    flight = parse(text.replace("count = 3\nacc", "count = 4\nacc")).fly(5)
    said = decoded(flight)
    assert "RAW_IMU" not in said
    for i in range(4):
        own = [m for m in said["HIGHRES_IMU"] if m.id == i]
        here = flight.truth.at(column(own, "time_usec")[:, 0] * 1e-6 - BOOT_S)
        acc = column(own, "xacc", "yacc", "zacc")
        assert np.abs(acc - here.specific_force_m_s2).max() < 1e-4
    for i in range(3):
        own = [m for m in said["AIRSPEED"] if m.id == i]
        np.testing.assert_allclose(
            column(own, "airspeed")[:, 0], flight.readings[f"airspeed{i}"].values[:, 0], rtol=1e-6
        )


def brief(table) -> None:
    """A circuit cut short: its aircraft is flown before the first frame goes out."""
    if "circuit" in table:
        table["circuit"]["duration_s"] = 5.0
        table.pop("fault", None)


def head(name: str, seed: int, seconds: float) -> bytes:
    source = frames(load(name, brief), seed)
    first, frame = next(source)
    rest = itertools.takewhile(lambda item: item[0] < first + seconds * 1e6, source)
    return frame + b"".join(f for _, f in rest)


@pytest.mark.parametrize("name", bundled())
def test_bundled_scenarios_play_two_seconds(name):
    if load(name).six_dof:
        pytest.importorskip("jsbsim", reason="the extra sim is not installed")
    data = head(name, 1, 2.0)
    parser = dialect.MAVLink(None)
    parser.robust_parsing = False
    messages = parser.parse_buffer(data)
    assert {m.get_type() for m in messages} >= {
        "HEARTBEAT",
        "ATTITUDE",
        "GPS_RAW_INT",
        "SYSTEM_TIME",
    }


def test_same_seed_same_bytes():
    text = FLIGHT.replace("25.0\nbank", "8.0\nbank")
    one, two, other = (b"".join(f for _, f in frames(parse(text), s)) for s in (1, 1, 2))
    assert one == two
    assert one != other


def test_parked_and_flying_are_told():
    text = FLIGHT.replace("speed_m_s = 20.0\nagl_m = 150.0", "").replace("orbit", "wait")
    text = text.replace("bank_deg = 30.0\n", "").replace(
        "[[wind]]", '[[leg]]\ndo = "take-off"\n[[wind]]'
    )
    said = decoded(parse(text).fly(1))
    landed = [m.landed_state for m in said["EXTENDED_SYS_STATE"]]
    assert [k for k, _ in itertools.groupby(landed)] == [
        dialect.MAV_LANDED_STATE_ON_GROUND,
        dialect.MAV_LANDED_STATE_TAKEOFF,
        dialect.MAV_LANDED_STATE_IN_AIR,
    ]
    armed = [bool(m.base_mode & 128) for m in said["HEARTBEAT"]]
    assert armed[:2] == [False, False]
    assert all(armed[3:])


class FakeTime:
    """A clock that only sleep moves."""

    def __init__(self) -> None:
        self.now = 100.0
        self.slept = 0.0

    def clock(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept += seconds


@pytest.mark.parametrize(("speed", "took"), [(1.0, 25.0), (5.0, 5.0), (None, 0.0)])
def test_play_keeps_the_pace(flight, speed, took):
    time, log = FakeTime(), []
    count = play(
        frames_of(flight),
        lambda frame: log.append((time.now, frame)),
        speed,
        clock=time.clock,
        sleep=time.sleep,
    )
    assert count == len(log)
    assert time.slept == pytest.approx(took, abs=0.2)
    if speed:
        first = next(frames_of(flight))[0]
        for (now, _), (t_us, _) in zip(log[::500], list(frames_of(flight))[::500], strict=True):
            due = 100.0 + (t_us - first) * 1e-6 / speed
            assert now == pytest.approx(due, abs=2e-3)


def test_truth_file(tmp_path):
    flight = load("demo").fly()
    table_path, arrays_path = save_truth(flight, tmp_path)
    table = json.loads(table_path.read_text())
    assert table == json.loads(json.dumps(truth_table(flight)))
    by_sensor = {f["sensor"]: f for f in table["faults"]}
    bias = by_sensor["imu0.acc_x"]
    assert (bias["kind"], bias["size"], bias["unit"]) == ("bias", 1.5, "m/s^2")
    assert bias["onset_t_us"] == table["first_t_us"] + round(bias["onset_s"] * 1e6)
    first_us, _ = next(frames_of(flight))
    assert first_us == table["first_t_us"], "seconds from the first record are seconds of flight"
    assert unix_us(flight, first_us) == table["start_unix_us"]
    with np.load(arrays_path) as arrays:
        assert set(arrays) == set(truth(flight))
        assert np.diff(arrays["t_us"]).tolist() == [20_000] * (len(arrays["t_us"]) - 1)
        assert arrays["vel_ned_m_s"].shape == (len(arrays["t_us"]), 3)
