"""Frames changed field by field: checksums, truncation, signatures, rounding, bytes untouched."""

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from links.catalog import MILLI_G
from links.mavlink import Decoder, Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer, Frames
from links.mavlink.options import DecoderOptions
from links.mavlink.patch import Carrier, StreamPatcher, blank_rows, put_rows, reframe
from links.samples import Batch

DIALECT = load_dialect()
RAW_IMU = DIALECT.by_name["RAW_IMU"]


def read_by_pymavlink(frame: bytes):
    """The message as pymavlink sees it; it raises where the checksum is wrong."""
    return mavlink.MAVLink(None).decode(bytearray(frame))


def payload_of(message, frame: bytes) -> np.ndarray:
    head = 10 if frame[0] == 0xFD else 6
    size = message.dtype.itemsize
    sent = frame[head : head + min(frame[1], size)]
    return np.frombuffer(sent.ljust(size, b"\0"), message.dtype).copy()


def carried(frames: Frames, sensors=None, options=None):
    carrier = Carrier(DIALECT, options or DecoderOptions(), None, sensors)
    t_us = np.arange(len(frames)) * 1000
    return carrier, list(carrier.read(frames, t_us, np.ones(len(frames), np.bool_)))


def one(message: str, /, version: int = 2, **fields) -> Frames:
    return Frames.at(Encoder(1, 1, version=version).encode(message, **fields), [0])


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("value", [0, 1, -1, 517, -32768])
def test_a_changed_frame_has_a_right_checksum_in_both_versions(version, value):
    frame = Encoder(7, 1, version=version).encode("RAW_IMU", time_usec=5, xacc=12, yacc=3, zmag=9)
    payload = payload_of(RAW_IMU, frame)
    payload["xacc"] = value
    new = reframe(frame, RAW_IMU, payload.tobytes())
    seen = read_by_pymavlink(new)
    assert (seen.xacc, seen.yacc, seen.zmag, seen.time_usec) == (value, 3, 9, 5)
    assert (new[0], seen.get_srcSystem()) == (frame[0], 7)
    framer = Framer(DIALECT)
    assert len(framer.feed(new)) == 1


def test_trailing_zeros_are_cut_and_come_back():
    frame = Encoder(1, 1).encode("SCALED_PRESSURE", time_boot_ms=1, press_abs=900.0, press_diff=2.0)
    message = DIALECT.by_name["SCALED_PRESSURE"]
    payload = payload_of(message, frame)
    payload["press_diff"] = 0.0  # the last field that was not zero
    short = reframe(frame, message, payload.tobytes())
    assert short[1] == 8
    assert len(short) == 8 + 12
    assert read_by_pymavlink(short).press_diff == 0.0
    payload["press_diff"] = 3.5
    long = reframe(short, message, payload.tobytes())
    assert read_by_pymavlink(long).press_diff == 3.5
    assert long[1] == 12


def test_a_payload_of_zeros_keeps_one_byte():
    frame = Encoder(1, 1).encode("SCALED_PRESSURE", press_diff=2.0)
    message = DIALECT.by_name["SCALED_PRESSURE"]
    assert reframe(frame, message, bytes(message.dtype.itemsize))[1] == 1


def test_what_a_frame_carries_beyond_the_dialect_is_kept():
    """A newer dialect's extension fields stand after those that are known here."""
    frame = Encoder(1, 1).encode("RAW_IMU", xacc=1, id=1, temperature=300)
    grown = bytes((frame[0], frame[1] + 3)) + frame[2:-2] + b"\1\2\3"
    payload = payload_of(RAW_IMU, grown)
    payload["xacc"] = 2
    new = reframe(grown + b"\0\0", RAW_IMU, payload.tobytes())
    assert new[1] == RAW_IMU.dtype.itemsize + 3
    assert new[-5:-2] == b"\1\2\3"
    assert payload_of(RAW_IMU, new)["xacc"] == 2


def test_a_signature_is_taken_off():
    plain = Encoder(1, 1).encode("RAW_IMU", xacc=5)
    signed = plain[:2] + b"\1" + plain[3:] + bytes(13)
    new = reframe(signed, RAW_IMU, payload_of(RAW_IMU, plain).tobytes())
    assert new == plain


@given(st.floats(-600.0, 600.0), st.floats(-80.0, 80.0))
@settings(max_examples=60, deadline=None)
def test_integers_round_to_the_nearest_and_saturate(acc, rate):
    frames = one("RAW_IMU", time_usec=1000, xacc=7, xgyro=-3)
    carrier, (imu,) = carried(frames, {"imu0"})
    payload = carrier.payloads[imu.group][1]
    after = imu.rows.copy()
    after["acc_m_s2"][0, 0], after["gyro_rad_s"][0, 0] = acc, rate
    put = put_rows(imu.entry, payload, imu.rows, after)
    expected = np.clip([acc / MILLI_G, rate / 1e-3], -32768, 32767)
    assert_allclose([payload["xacc"][0], payload["xgyro"][0]], expected, atol=0.5 + 1e-9)
    wide = abs(np.rint(acc / MILLI_G) + 0.5) > 32768 or abs(np.rint(rate * 1e3) + 0.5) > 32768
    assert bool(put.clipped[0]) == wide
    assert payload["yacc"][0] == 0
    assert payload["time_usec"][0] == 1000


def test_less_than_half_a_digit_is_lost_and_said_so():
    carrier, (imu,) = carried(one("RAW_IMU", xacc=7), {"imu0"})
    after = imu.rows.copy()
    after["acc_m_s2"][0, 0] += 0.4 * MILLI_G
    put = put_rows(imu.entry, carrier.payloads[imu.group][1], imu.rows, after)
    assert put.differs.all()
    assert not put.changed.any()


INVERTED = {
    "ATTITUDE": {"roll": 0.3, "pitch": -0.4, "yaw": 2.5, "rollspeed": 0.1},
    "ATTITUDE_QUATERNION": {"q1": 0.8, "q2": 0.6, "rollspeed": 0.1},
    "GPS_RAW_INT": {"fix_type": 3, "lat": 5, "lon": 6, "vel": 1234, "cog": 27123, "time_usec": 8},
    "GLOBAL_POSITION_INT": {"vx": 100, "vy": -200, "vz": 3, "lat": 5},
    "HIGHRES_IMU": {"xacc": 1.5, "zgyro": -0.25, "abs_pressure": 900.0, "temperature": 20.0,
                    "diff_pressure": 2.5, "fields_updated": 0xFFFF},
    "SCALED_PRESSURE2": {"press_abs": 950.0, "press_diff": 2.25, "temperature": 2512},
    "AIRSPEED": {"airspeed": 20.5, "raw_press": 2.5},
    "VFR_HUD": {"airspeed": 21.5, "groundspeed": 4.0},
    "RPM": {"rpm1": 4000.0, "rpm2": -1.0},
    "ESC_TELEMETRY_1_TO_4": {"rpm": [1000, 2000, 3000, 4000]},
    "NAMED_VALUE_FLOAT": {"name": "AOA1", "value": 4.5},
    "EFI_STATUS": {"rpm": 5500.0},
    "RAW_RPM": {"index": 1, "frequency": 70.0},
}  # fmt: skip


@pytest.mark.parametrize("name", INVERTED)
def test_every_source_can_be_undone(name):
    """What is put back unchanged, field by field, gives the frame that it was read from."""
    frames = one(name, **INVERTED[name])
    carrier, found = carried(frames)
    assert found
    for c in found:
        payload = carrier.payloads[c.group][1]
        original, nowhere = payload.copy(), c.rows.copy()
        for field in nowhere.dtype.names:
            if nowhere[field].dtype.kind == "f":
                nowhere[field] += 1000.0  # everything differs, so everything is written
        put_rows(c.entry, payload, nowhere, c.rows)
        for field in payload.dtype.names:
            if payload[field].dtype.kind == "f":
                assert_allclose(payload[field], original[field], rtol=3e-7, atol=1e-7)
            else:
                assert (payload[field] == original[field]).all(), field


def test_a_vane_of_the_full_dialect_can_be_undone():
    """SENSOR_AIRFLOW_ANGLES is in the dialect ``all`` only; an invalid angle is no reading."""
    everything = load_dialect("all")
    message = everything.by_name["SENSOR_AIRFLOW_ANGLES"]
    valid = {"angleofattack": 4.0, "angleofattack_valid": 1, "sideslip": 1.0}

    def read(**fields):
        frame = Encoder(1, 1, "all").encode("SENSOR_AIRFLOW_ANGLES", timestamp=5, **fields)
        carrier = Carrier(everything, DecoderOptions(dialect="all"), None)
        frames = Frames.at(frame, [0])
        return carrier, list(carrier.read(frames, np.array([5]), np.ones(1, np.bool_)))

    assert read(angleofattack=4.0)[1] == []
    carrier, (vane,) = read(**valid)
    after = vane.rows.copy()
    after["aoa_rad"] *= 2.0
    payload = carrier.payloads[message.id][1]
    put_rows(vane.entry, payload, vane.rows, after)
    assert_allclose([payload["angleofattack"][0], payload["sideslip"][0]], [8.0, 1.0], rtol=1e-6)


def test_a_sensor_is_blanked_where_its_frame_carries_another():
    carrier, found = carried(one("SCALED_PRESSURE", press_abs=900.0, press_diff=2.0, temperature=5))
    (pitot,) = [c for c in found if c.sensor == "airspeed0"]
    payload = carrier.payloads[pitot.group][1]
    assert carrier.sensors_in(pitot.group).tolist() == [2]
    blank_rows(pitot.entry, payload)
    assert np.isnan(payload["press_diff"][0])
    assert (payload["press_abs"][0], payload["temperature"][0]) == (900.0, 5)


# ----------------------------------------------------------------------------- streams


def stream(n: int = 60) -> bytes:
    """A log of two vehicles' frames in both versions, with garbage and foreign frames between."""
    old, new = Encoder(1, 1, version=1), Encoder(1, 1)
    ground = Encoder(255, 190, version=1)
    parts = [b"garbage\xfd\xfe"]

    def put(frame: bytes, t_ms: int) -> None:
        parts.append(struct.pack(">Q", 1_600_000_000_000_000 + 1000 * t_ms) + frame)

    for k in range(n):
        sender = old if k % 3 else new
        t_ms = 1000 + 100 * k
        put(sender.encode("HEARTBEAT", type=1, autopilot=3, mavlink_version=3), t_ms)
        put(sender.encode("RAW_IMU", time_usec=1000 * t_ms, xacc=k, zacc=-1000), t_ms)
        put(ground.encode("HEARTBEAT", type=6, autopilot=8), t_ms)
        put(sender.encode("SCALED_PRESSURE", time_boot_ms=t_ms, press_abs=950.0), t_ms)
        if k % 7 == 0:
            parts.append(b"\xfe\x09noise")
    return b"".join(parts)


STREAM = stream()


def nothing(frames, t_us, usable):
    return {}


def odd_imus(frames, t_us, usable):
    """Every second IMU frame loses its reading, every fifth is taken out."""
    out = {}
    for i in np.flatnonzero(frames.message == RAW_IMU.id).tolist():
        frame = frames.data[int(frames.start[i]) : int(frames.end[i])]
        payload = payload_of(RAW_IMU, frame)
        k = int(payload["xacc"][0])
        if k % 5 == 4:
            out[i] = b""
        elif k % 2:
            payload["xacc"] = 1000 + k
            out[i] = reframe(frame, RAW_IMU, payload.tobytes())
    return out


@given(st.lists(st.integers(0, len(STREAM)), max_size=20))
@settings(max_examples=40, deadline=None)
def test_a_stream_in_which_nothing_changes_is_copied_byte_by_byte(cuts):
    patcher = StreamPatcher(nothing)
    edges = [0, *sorted(cuts), len(STREAM)]
    parts = [patcher.feed(STREAM[a:b]) for a, b in itertools.pairwise(edges)]
    assert b"".join([*parts, patcher.finish()]) == STREAM


@given(st.lists(st.integers(0, len(STREAM)), max_size=20))
@settings(max_examples=40, deadline=None)
def test_how_a_stream_is_cut_does_not_change_the_copy(cuts):
    whole = StreamPatcher(odd_imus)
    expected = whole.feed(STREAM) + whole.finish()
    patcher = StreamPatcher(odd_imus)
    edges = [0, *sorted(cuts), len(STREAM)]
    parts = [patcher.feed(STREAM[a:b]) for a, b in itertools.pairwise(edges)]
    assert b"".join([*parts, patcher.finish()]) == expected


def test_only_the_frames_concerned_differ():
    patcher = StreamPatcher(odd_imus)
    copy = patcher.feed(STREAM) + patcher.finish()

    def read(data: bytes) -> tuple[Decoder, list[bytes], Batch]:
        decoder = Decoder(stamped=True)
        parts = [decoder.feed(data)]
        f = decoder.frames
        frames = [data[a - 8 : b] for a, b in zip(f.start.tolist(), f.end.tolist(), strict=True)]
        return decoder, frames, Batch.concatenate([*parts, decoder.finish()])

    was, frames_before, before = read(STREAM)
    now, frames_after, after = read(copy)
    assert now.counters.bad_bytes == was.counters.bad_bytes
    changed = set(frames_before) ^ set(frames_after)
    assert all(frame[8 + (5 if frame[8] == 0xFE else 7)] == RAW_IMU.id for frame in changed)
    x = np.rint(after.rows["imu0"]["acc_m_s2"][:, 0] / MILLI_G).astype(int)
    assert x.tolist() == [1000 + k if k % 2 else k for k in range(60) if k % 5 != 4]
    assert len(after.rows["baro0"]) == len(before.rows["baro0"])
