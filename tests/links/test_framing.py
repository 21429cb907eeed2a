"""Frames out of bytes: nothing lost, nothing invented, whatever the cut and the damage."""

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from links.mavlink import Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import NO_STAMP, Framer, Frames
from links.mavlink.rows import gather_payloads
from links.vocabulary import Rejection

DIALECT = load_dialect()
STAMP = struct.Struct(">Q")


def scan(data, cuts=(), *, stamped=False):
    """(frames as bytes, stamps, framer, rejected) of a stream cut at some places."""
    framer = Framer(DIALECT, stamped=stamped)
    frames, stamps = [], []

    def collect(found: Frames) -> None:
        for s, e in zip(found.start, found.end, strict=True):
            frames.append(found.data[s:e])
        stamps.extend(found.stamp_us.tolist())

    edges = [0, *sorted(cuts), len(data)]
    for a, b in itertools.pairwise(edges):
        collect(framer.feed(data[a:b]))
    collect(framer.finish())
    return frames, stamps, framer, framer.take_rejected()


def mixed(n):
    """n frames of both protocol versions."""
    v1, v2 = Encoder(1, 1, version=1), Encoder(1, 1)
    return [
        (v1 if i % 3 else v2).encode("ATTITUDE", time_boot_ms=1000 + i, roll=0.1 * i)
        for i in range(n)
    ]


def test_mavlink_1_frames_after_mavlink_2_frames_are_all_found():
    frames = mixed(50)
    found, _, framer, rejected = scan(b"".join(frames))
    assert found == frames
    assert framer.bad_bytes == 0
    assert not rejected


def test_garbage_between_frames_costs_no_frame():
    frames = mixed(20)
    noise = [b"\xfd", b"\xfe\x09", b"\xfd" * 11, bytes(range(256)), b"\xfe\xff\x00\x01\x01\x1e"]
    data = b"".join(f + noise[i % len(noise)] for i, f in enumerate(frames))
    found, _, framer, rejected = scan(data)
    assert found == frames
    assert framer.bad_bytes == len(data) - sum(map(len, frames))
    assert rejected["frame", Rejection.GARBAGE] == framer.bad_bytes


def test_a_flipped_bit_costs_one_frame():
    frames = mixed(9)
    broken = bytearray(frames[4])
    broken[12] ^= 0x04
    found, _, framer, rejected = scan(b"".join(frames[:4]) + bytes(broken) + b"".join(frames[5:]))
    assert found == frames[:4] + frames[5:]
    assert framer.bad_bytes == len(broken)
    assert rejected["frame", Rejection.BAD_CRC] == 1


def test_a_frame_inside_a_cut_off_frame_is_found():
    a, b = mixed(2)
    found, _, framer, _ = scan(a[:-5] + b)
    assert found == [b]
    assert framer.bad_bytes == len(a) - 5


def test_the_end_of_a_cut_off_stream_is_counted():
    a, b = mixed(2)
    found, _, framer, rejected = scan(a + b[:-1])
    assert found == [a]
    assert framer.bad_bytes == len(b) - 1
    assert rejected["frame", Rejection.TRUNCATED] == 1


def test_unknown_messages_are_passed_over_and_counted():
    frames = mixed(4)
    # number 54321 with a payload that itself looks like the start of a frame
    body = bytes([0xFD, 9, 0, 0, 0, 1, 1, 0, 0])
    unknown = bytes([0xFD, len(body), 0, 0, 5, 1, 1, 0x31, 0xD4, 0]) + body + b"\x12\x34"
    data = frames[0] + unknown + frames[1] + unknown + unknown + frames[2] + unknown
    found, _, framer, rejected = scan(data)
    assert found == frames[:3]
    assert framer.unknown[0xD431] == 4
    assert rejected == {("frame", Rejection.UNKNOWN_MESSAGE): 4}
    assert framer.bad_bytes == 0


def test_an_unknown_number_in_garbage_swallows_no_frame():
    frames = mixed(6)
    # claims 200 bytes of payload, which would cover the frames that follow
    lure = bytes([0xFD, 200, 0, 0, 5, 1, 1, 0x31, 0xD4, 0])
    found, *_ = scan(frames[0] + lure + b"".join(frames[1:]))
    assert found == frames


def test_signed_frames_are_read_without_their_signature():
    mav = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = b"k" * 32
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = 1
    mav.signing.link_id = 3
    signed = ardupilotmega.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3).pack(mav)
    plain = mixed(1)
    found, _, framer, _ = scan(signed + plain[0])
    assert found == [signed, plain[0]]
    assert framer.bad_bytes == 0
    frames = Framer(DIALECT).feed(signed)
    beat = gather_payloads(frames, np.arange(1), DIALECT.by_name["HEARTBEAT"])[0]
    assert (beat["type"], beat["autopilot"], beat["base_mode"]) == (1, 3, 81)


def test_unknown_incompatibility_flags_are_refused():
    frame = bytearray(Encoder(1, 1).encode("HEARTBEAT", type=1))
    frame[2] = 0x02
    found, *_ = scan(bytes(frame))
    assert found == []


def test_cut_off_zeros_and_missing_extensions_read_as_zero():
    full = Encoder(1, 1).encode("RAW_IMU", time_usec=5, zacc=-3)
    old = Encoder(1, 1, version=1).encode("RAW_IMU", time_usec=6, ymag=2, id=2, temperature=9)
    longer = Encoder(1, 1).encode("RAW_IMU", time_usec=7, id=3, temperature=40)
    frames = Framer(DIALECT).feed(full + old + longer)
    rows = gather_payloads(frames, np.arange(3), DIALECT.by_name["RAW_IMU"])
    assert rows["time_usec"].tolist() == [5, 6, 7]
    assert rows["zacc"].tolist() == [-3, 0, 0]
    assert rows["ymag"].tolist() == [0, 2, 0]
    assert rows["id"].tolist() == [0, 0, 3]
    assert rows["temperature"].tolist() == [0, 0, 40]


def test_stamps_with_magic_bytes_are_no_frames():
    frames = mixed(30)
    stamps = [0x0000FDFEFDFEFD00 + i for i in range(30)]
    data = b"".join(STAMP.pack(s) + f for s, f in zip(stamps, frames, strict=True))
    found, got, framer, _ = scan(data, stamped=True)
    assert found == frames
    assert got == stamps
    assert framer.bad_bytes == 0


def test_a_log_with_a_missing_stamp_loses_no_frame():
    a, b, c = mixed(3)
    found, stamps, framer, _ = scan(STAMP.pack(11) + a + b + STAMP.pack(13) + c, stamped=True)
    assert found == [a, b, c]
    assert stamps == [11, NO_STAMP, 13]
    assert framer.bad_bytes == 0


def test_damage_in_a_log_costs_the_frames_it_touches():
    a, b, c = mixed(3)
    data = STAMP.pack(11) + a + STAMP.pack(12) + b[:-4] + b"\xfe\x01" + STAMP.pack(13) + c
    found, stamps, framer, _ = scan(data, stamped=True)
    assert found == [a, c]
    assert stamps == [11, 13]
    assert framer.bad_bytes == 8 + len(b) - 4 + 2


@given(st.binary(max_size=600), st.booleans())
def test_random_bytes_never_raise_and_are_all_accounted_for(data, stamped):
    found, _, framer, _ = scan(data, stamped=stamped)
    stamps = 8 * len(found) if stamped else 0
    assert framer.bytes == len(data)
    used = framer.bad_bytes + sum(map(len, found))
    assert used <= len(data) <= used + stamps + 300 * framer.unknown.total()


@settings(max_examples=60)
@given(
    st.lists(
        st.one_of(
            st.sampled_from(mixed(6)),
            st.binary(max_size=30),
            st.sampled_from([f[:-2] for f in mixed(3)] + [b"\xfd", b"\xfe\x05"]),
        ),
        max_size=30,
    ),
    st.booleans(),
    st.lists(st.integers(0, 900), max_size=40),
)
def test_where_the_stream_is_cut_changes_nothing(pieces, stamped, cuts):
    data = b"".join((STAMP.pack(i + 1) if stamped else b"") + p for i, p in enumerate(pieces))
    whole = scan(data, stamped=stamped)
    cut = scan(data, [c for c in cuts if c < len(data)], stamped=stamped)
    assert cut[0] == whole[0]
    assert cut[1] == whole[1]
    assert cut[2].bad_bytes == whole[2].bad_bytes
    assert cut[3] == whole[3]


def test_frames_byte_by_byte_come_as_soon_as_they_are_complete():
    (frame,) = mixed(1)
    framer = Framer(DIALECT)
    counts = [len(framer.feed(frame[i : i + 1])) for i in range(len(frame))]
    assert counts == [0] * (len(frame) - 1) + [1]


@pytest.mark.parametrize("name", ["HEARTBEAT", "GPS_RAW_INT", "RAW_IMU", "STATUSTEXT"])
def test_base_size_is_what_mavlink_1_carries(name):
    v1 = {"HEARTBEAT": 9, "GPS_RAW_INT": 30, "RAW_IMU": 26, "STATUSTEXT": 51}
    assert DIALECT.by_name[name].base_size == v1[name]


def test_an_unknown_dialect_is_named():
    with pytest.raises(ValueError, match="no MAVLink dialect called 'nonsense'"):
        load_dialect("nonsense")
    with pytest.raises(ValueError, match="no MAVLink dialect"):
        load_dialect("../evil")
