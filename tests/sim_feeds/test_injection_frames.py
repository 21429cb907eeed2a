"""Faults on the wire: what a decoder reads from a patched log is what the rows would have been."""

import struct
from math import pi

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from links.catalog import MILLI_G
from links.mavlink import Decoder, DecoderOptions, Encoder
from links.mavlink.patch import StreamPatcher
from links.samples import Batch
from sim_feeds.attitude_follow import AttitudeFollows
from sim_feeds.faults import PLUMBING, Fault, FaultKind
from sim_feeds.injection import Injection, RowInjector
from sim_feeds.injection_frames import FrameInjector, Tally
from sim_feeds.injection_survey import Survey
from sim_feeds.player import frames_of, unix_us
from sim_feeds.scenario import parse
from sim_feeds.section import ScenarioError

SCENARIO = """
title = "Half a minute of level flight and a turn"
aircraft = "small-uav"
seed = 5
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 14.0
[[leg]]
do = "turn"
angle_deg = 90.0
[airspeed]
count = 2
{more}
"""
HIGHRES = '[messages]\nimu = "highres"\nairspeed = "airspeed"\n'
ON, OFF = 5.0, 11.0


def log_of(more: str = "") -> bytes:
    flight = parse(SCENARIO.format(more=more)).fly()
    stamp = struct.Struct(">Q").pack
    return b"".join(stamp(unix_us(flight, t_us)) + frame for t_us, frame in frames_of(flight))


LOGS = {"raw": log_of(), "highres": log_of(HIGHRES), "vane": log_of("[aoa]\ncount = 1\n")}


def decode(log: bytes) -> tuple[Decoder, Batch]:
    decoder = Decoder(stamped=True)
    return decoder, Batch.concatenate([decoder.feed(log), decoder.finish()])


def patched(
    log: bytes, injection: Injection, seed: int = 2, chunk: int = 1 << 20
) -> tuple[bytes, FrameInjector]:
    decoder, _ = decode(log)
    injector = FrameInjector(injection, seed, decoder.first_t_us or 0, autopilot=3)
    patcher = StreamPatcher(injector.change)
    parts = [patcher.feed(log[i : i + chunk]) for i in range(0, len(log), chunk)]
    return b"".join([*parts, patcher.finish()]), injector


RESOLUTION = {
    "acc_m_s2": 0.5 * MILLI_G,
    "gyro_rad_s": 0.5e-3,
    "vel_ned_m_s": 0.01,  # speed and course of 16 m/s, each to a hundredth
    "cas_m_s": 2e-5,
    "diff_press_pa": 1e-4,
    "static_press_pa": 0.02,
    "rate_rad_s": 1e-6,
    "aoa_rad": 1e-6,
    "speed_rpm": 1e-2,
    "lat_rad": 1e-9,
    "lon_rad": 1e-9,
    "alt_m": 1e-3,
}


def assert_same_within_resolution(rows: Batch, wire: Batch) -> None:
    assert rows.rows.keys() == wire.rows.keys()
    for sensor, expected in rows.rows.items():
        found = wire.rows[sensor]
        assert len(found) == len(expected), sensor
        if sensor == "named":  # AS2 is the pitot's, and changed on the wire only
            continue
        for name in expected.dtype.names:
            if name == "seq" or expected[name].dtype.kind not in "fi":
                continue
            if name == "q_ned_from_frd":
                turn = np.abs(np.sum(found[name] * expected[name], axis=1))
                assert_allclose(turn, 1.0, atol=2e-7)
                continue
            tolerance = RESOLUTION.get(name, 0.0) * 1.001 + 1e-12
            assert_allclose(found[name], expected[name], atol=tolerance, err_msg=f"{sensor}.{name}")


CASES = [
    ("raw", channel, kind)
    for channel in ("imu0.acc_x", "imu1.gyro_z", "airspeed0", "gps0.vel_n", "spool0")
    for kind in FaultKind
    if kind not in PLUMBING | {FaultKind.OUTAGE, FaultKind.DROPOUT, FaultKind.STOP}
]
CASES += [("raw", "airspeed0", kind) for kind in sorted(PLUMBING)]
CASES += [("raw", c, FaultKind.NOISE) for c in ("airspeed1", "baro0", "attitude.roll")]
CASES += [
    ("highres", c, k)
    for c in ("imu0.acc_z", "airspeed0", "baro0")
    for k in (FaultKind.SCALE, FaultKind.NOISE, FaultKind.STUCK)
]
CASES += [("vane", "aoa0", k) for k in (FaultKind.BIAS, FaultKind.JAMMING, FaultKind.ICING)]


@pytest.mark.parametrize(("log", "channel", "kind"), CASES)
def test_patching_then_decoding_is_decoding_then_changing_rows(log, channel, kind):
    fault = Fault(channel, kind, ON, OFF, size=0.2, rate=0.05, period_s=1.3)
    injection = Injection([fault])
    data = LOGS[log]
    decoder, batch = decode(data)
    rows = RowInjector(injection, 2, decoder.first_t_us).apply(batch)
    new, injector = patched(data, injection)
    assert_same_within_resolution(rows, decode(new)[1])
    assert sum(t.changed for t in injector.tallies.values()) > 0


@pytest.mark.parametrize("follows", [None, AttitudeFollows()])
def test_several_faults_at_once_and_an_attitude_that_follows(follows):
    faults = [
        Fault("imu0.gyro_x", FaultKind.BIAS, ON, OFF, size=3.0 * pi / 180.0),
        Fault("imu0.gyro_x", FaultKind.NOISE, 7.0, size=0.02),
        Fault("imu0.acc_y", FaultKind.BIAS, ON, OFF, size=1.0),
        Fault("airspeed0", FaultKind.STATIC_BLOCKED, 6.0, 9.0),
        Fault("airspeed0", FaultKind.SCALE, 8.0, size=-0.2),
        Fault("gps0.vel_e", FaultKind.NOISE, 4.0, size=2.0),
    ]
    injection = Injection(faults, follows)
    decoder, batch = decode(LOGS["raw"])
    rows = RowInjector(injection, 2, decoder.first_t_us).apply(batch)
    new, _ = patched(LOGS["raw"], injection)
    wire = decode(new)[1]
    if follows is not None:
        # The filter sees more attitude frames on the wire, and rounded readings; the deviation is
        # 15 degrees.
        a, b = rows.rows["attitude"], wire.rows["attitude"]
        turn = np.abs(np.sum(a["q_ned_from_frd"] * b["q_ned_from_frd"], axis=1))
        assert 2.0 * np.arccos(np.minimum(turn, 1.0)).max() < 0.005
        was = batch.rows["attitude"]["q_ned_from_frd"]
        moved = np.abs(np.sum(a["q_ned_from_frd"] * was, axis=1))
        assert 2.0 * np.arccos(np.minimum(moved, 1.0)).max() > 0.1
        rows.rows["attitude"]["q_ned_from_frd"] = b["q_ned_from_frd"]
    assert_same_within_resolution(rows, wire)


def test_where_a_log_is_cut_changes_no_byte():
    faults = [
        Fault("imu0.acc_x", FaultKind.STUCK, ON, OFF),
        Fault("airspeed0", FaultKind.PITOT_DRAINING, ON, OFF),
        Fault("gps0", FaultKind.OUTAGE, ON, OFF),
        Fault("imu1", FaultKind.DROPOUT, ON, OFF),
        Fault("imu0.gyro_y", FaultKind.NOISE, ON, OFF, size=0.1),
    ]
    injection = Injection(faults, AttitudeFollows())
    whole, _ = patched(LOGS["raw"], injection)
    assert patched(LOGS["raw"], injection, chunk=997)[0] == whole
    assert patched(LOGS["raw"], injection, chunk=64_000)[0] == whole


def test_without_faults_the_log_is_copied():
    assert patched(LOGS["raw"], Injection())[0] == LOGS["raw"]


def test_another_seed_is_another_noise():
    injection = Injection([Fault("airspeed0", FaultKind.NOISE, ON, size=1.0)])
    assert patched(LOGS["raw"], injection, 1)[0] == patched(LOGS["raw"], injection, 1)[0]
    assert patched(LOGS["raw"], injection, 1)[0] != patched(LOGS["raw"], injection, 2)[0]


def test_a_dropout_takes_frames_out_that_carry_nothing_else():
    new, injector = patched(LOGS["raw"], Injection([Fault("imu0", FaultKind.DROPOUT, ON, OFF)]))
    before, after = decode(LOGS["raw"]), decode(new)
    gone = before[0].counters.by_name["RAW_IMU"] - after[0].counters.by_name["RAW_IMU"]
    assert gone == injector.tallies["imu0", "RAW_IMU"].removed
    assert gone == pytest.approx((OFF - ON) * 50.0, abs=2)
    assert after[0].counters.bad_bytes == 0
    rest = dict(before[0].counters.by_name)
    assert {**rest, "RAW_IMU": rest["RAW_IMU"] - gone} == dict(after[0].counters.by_name)


def test_a_dropout_leaves_the_other_sensors_of_a_frame():
    fault = Fault("airspeed0", FaultKind.DROPOUT, ON, OFF)
    new, injector = patched(LOGS["raw"], Injection([fault]))
    tally = injector.tallies["airspeed0", "SCALED_PRESSURE"]
    assert (tally.removed, tally.blanked) == (0, tally.readings)
    (_, before), (_, after) = decode(LOGS["raw"]), decode(new)
    assert len(after.rows["baro0"]) == len(before.rows["baro0"])
    assert_array_equal(
        after.rows["baro0"]["static_press_pa"], before.rows["baro0"]["static_press_pa"]
    )
    assert len(after.rows["airspeed0"]) == len(before.rows["airspeed0"]) - tally.blanked


def test_an_outage_freezes_position_and_stamp_on_the_wire():
    new, _ = patched(LOGS["raw"], Injection([Fault("gps0", FaultKind.OUTAGE, ON, OFF)]))
    gps = decode(new)[1].rows["gps0"]
    without = gps["fix_type"] < 3
    assert without.sum() == pytest.approx((OFF - ON) * 5.0, abs=1)
    assert len(np.unique(gps["stamp_us"][without])) == 1
    assert len(np.unique(gps["lat_rad"][without])) == 1


def test_more_than_an_integer_holds_is_clipped_and_counted():
    fault = Fault("imu0.acc_z", FaultKind.BIAS, ON, OFF, size=-390.0)
    new, injector = patched(LOGS["raw"], Injection([fault]))
    tally = injector.tallies["imu0", "RAW_IMU"]
    assert tally.clipped == tally.changed == tally.readings > 200
    imu = decode(new)[1].rows["imu0"]
    assert imu["acc_m_s2"][:, 2].min() == pytest.approx(-32768 * MILLI_G)


def test_less_than_the_resolution_is_counted_as_lost():
    fault = Fault("imu0.acc_x", FaultKind.BIAS, ON, OFF, size=0.3 * MILLI_G)
    new, injector = patched(LOGS["raw"], Injection([fault]))
    assert injector.tallies["imu0", "RAW_IMU"].changed == 0
    assert injector.tallies["imu0", "RAW_IMU"].readings > 200
    assert new == LOGS["raw"]


def test_every_message_of_a_pitot_is_changed():
    """SCALED_PRESSURE2 and NAMED_VALUE_FLOAT AS2, SCALED_PRESSURE and VFR_HUD."""
    stamp, t_us = 1_600_000_000_000_000, 2_000_000
    encoder = Encoder(1, 1)
    frames = [encoder.encode("HEARTBEAT", type=1, autopilot=3)]
    for k in range(50):
        ms = (t_us + 100_000 * k) // 1000
        frames.append(
            encoder.encode("SCALED_PRESSURE2", time_boot_ms=ms, press_abs=950.0, press_diff=2.0)
        )
        frames.append(encoder.encode("NAMED_VALUE_FLOAT", time_boot_ms=ms, name="AS2", value=20.0))
        frames.append(encoder.encode("NAMED_VALUE_FLOAT", time_boot_ms=ms, name="XYZ", value=20.0))
    log = b"".join(struct.pack(">Q", stamp + i) + f for i, f in enumerate(frames))
    new, injector = patched(log, Injection([Fault("airspeed1", FaultKind.SCALE, 2.0, size=0.1)]))
    assert {k: t.changed for k, t in injector.tallies.items()} == {
        ("airspeed1", "SCALED_PRESSURE2"): 30,
        ("airspeed1", "NAMED_VALUE_FLOAT"): 30,
    }
    named = decode(new)[1].rows["named"]
    assert_allclose(named["value"][named["name"] == b"AS2"][-30:], 22.0, rtol=1e-6)
    assert_allclose(named["value"][named["name"] == b"XYZ"], 20.0)


def test_a_pitot_is_scaled_through_its_own_ratio():
    """An offset in m/s needs ARSPD_RATIO: pressure is speed squared over it."""
    encoder, frames = Encoder(1, 1), []
    frames.append(encoder.encode("HEARTBEAT", type=1, autopilot=3))
    frames.append(encoder.encode("SCALED_PRESSURE", time_boot_ms=1000, press_abs=950.0))
    frames.append(encoder.encode("PARAM_VALUE", param_id="ARSPD_RATIO", param_value=1.5))
    pressure = 20.0**2 / 1.5
    for k in range(40):
        frames.append(
            encoder.encode(
                "SCALED_PRESSURE",
                time_boot_ms=1100 + 100 * k,
                press_abs=950.0,
                press_diff=pressure / 100.0,
            )
        )
    log = b"".join(struct.pack(">Q", 10**15 + i) + f for i, f in enumerate(frames))
    new, _ = patched(log, Injection([Fault("airspeed0", FaultKind.BIAS, 2.0, size=5.0)]))
    rows = decode(new)[1].rows["airspeed0"][1:]
    broken = rows["t_us"] >= 3_000_000
    assert_allclose(rows["cas_m_s"][~broken], 20.0, rtol=1e-6)
    assert_allclose(rows["cas_m_s"][broken], 25.0, rtol=1e-6)
    assert_allclose(rows["diff_press_pa"][broken], 25.0**2 / 1.5, rtol=1e-6)


def test_signed_frames_lose_their_signature_where_they_change():
    plain = Encoder(1, 1).encode("RAW_IMU", time_usec=3_000_000, xacc=100)
    injector = FrameInjector(Injection([Fault("imu0.acc_x", FaultKind.BIAS, 1.0, size=1.0)]))
    signed = plain[:2] + b"\1" + plain[3:] + bytes(13)
    out = injector.apply(signed, 3_000_000)
    assert injector.unsigned == 1
    assert out[2] == 0
    assert len(out) == len(plain)
    assert injector.apply(signed, 500_000) == signed
    assert injector.unsigned == 1


def test_one_frame_at_a_time_gives_the_same():
    injection = Injection([Fault("imu0.gyro_z", FaultKind.DRIFT, 1.0, rate=0.1)])
    injector = FrameInjector(injection)
    seen = []
    for k in range(40):
        t_us = 100_000 * k
        frame = Encoder(1, 1).encode("RAW_IMU", time_usec=t_us, zgyro=7)
        out = injector.apply(frame, t_us)
        decoder = Decoder(DecoderOptions(system_id=1))
        imu = Batch.concatenate([decoder.feed(out), decoder.finish()]).rows.get("imu0")
        seen += [] if imu is None else imu["gyro_rad_s"][:, 2].tolist()
    t = np.arange(40 - len(seen), 40) * 0.1
    assert_allclose(seen, np.rint(7 + 1e3 * 0.1 * np.clip(t - 1.0, 0.0, None)) * 1e-3)
    assert injector.tallies["imu0", "RAW_IMU"] == Tally(readings=29, changed=29)


# ----------------------------------------------------------------------------- survey


def surveyed(log: bytes) -> Survey:
    survey, decoder = Survey(), Decoder(stamped=True)
    for data in (log[:50_000], log[50_000:]):
        decoder.feed(data)
        survey.note(*decoder.timed)
    return survey


def test_a_survey_says_what_a_log_carries():
    survey = surveyed(LOGS["raw"])
    assert set(survey.sensors) >= {"imu0", "imu1", "airspeed0", "airspeed1", "gps0", "attitude"}
    assert survey.carriers["imu1"].keys() == {"SCALED_IMU2"}
    assert survey.carriers["airspeed0"].keys() == {"SCALED_PRESSURE", "VFR_HUD"}
    assert survey.left == frozenset()  # VFR_HUD mirrors airspeed0


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (Fault("airspeed2", FaultKind.DEAD, 1.0), "carries no airspeed2: it has imu0"),
        (Fault("imu0.acc_x", FaultKind.DEAD, 500.0), "begins at 500 s, but the log ends at 20.0 s"),
        (Fault("gps0.vel_d", FaultKind.DEAD, 1.0), "gps0 of this log has no vertical velocity"),
    ],
)
def test_what_does_not_fit_the_log_is_said(fault, says):
    with pytest.raises(ScenarioError) as caught:
        surveyed(LOGS["raw"]).check(Injection([fault]), 20.0)
    assert says in str(caught.value)


def test_a_hud_that_shows_something_else_is_left_alone():
    encoder, frames = Encoder(1, 1), []
    for k in range(50):
        ms = 1000 + 100 * k
        frames.append(encoder.encode("HEARTBEAT", type=1, autopilot=3))
        frames.append(
            encoder.encode("SCALED_PRESSURE", time_boot_ms=ms, press_abs=950.0, press_diff=2.0)
        )
        frames.append(encoder.encode("VFR_HUD", airspeed=13.0))  # the autopilot's own estimate
    log = b"".join(struct.pack(">Q", 10**15 + i) + f for i, f in enumerate(frames))
    assert surveyed(log).left == {("airspeed0", "VFR_HUD")}
