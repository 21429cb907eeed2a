"""Bulk decoding: every field of every message as pymavlink gives it, whatever the blocks."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from links.logs import LogError
from links.logs.tlog import tlog_columns
from links.mavlink import Encoder
from links.mavlink import columns as columns_module
from links.mavlink.columns import ColumnDecoder
from links.mavlink.dialect import load_dialect
from links.mavlink.scan import NO_STAMP

STAMP = struct.Struct(">Q")
FLIGHTS = ["n1_calm_nominal", "h2_ramp60"]


def sequential(data):
    """(stamp, pymavlink message) of a sound log, record by record: no search, nothing swallowed."""
    mav, at = ardupilotmega.MAVLink(None), 0
    while at < len(data):
        (stamp,) = STAMP.unpack_from(data, at)
        at += 8
        size = data[at + 1] + (12 if data[at] == 0xFD else 8)
        yield stamp, mav.decode(bytearray(data[at : at + size]))
        at += size


def assert_equal_to_pymavlink(data):
    theirs = {}
    for number, (stamp, message) in enumerate(sequential(data)):
        theirs.setdefault(message.get_type(), []).append((number, stamp, message))
    columns = ColumnDecoder(stamped=True).finish(data)
    assert columns.bad_bytes == 0
    assert columns.frames == sum(map(len, theirs.values()))
    assert {name: len(r) for name, r in columns.messages.items()} == {
        name: len(told) for name, told in theirs.items()
    }
    for name, records in columns.messages.items():
        numbers, stamps, messages = zip(*theirs[name], strict=True)
        assert records["frame"].tolist() == list(numbers)
        assert records["unix_us"].tolist() == list(stamps)
        assert records["system"].tolist() == [m.get_srcSystem() for m in messages]
        assert records["component"].tolist() == [m.get_srcComponent() for m in messages]
        assert records["sequence"].tolist() == [m.get_seq() for m in messages]
        fields = records["fields"]
        assert set(fields.dtype.names) == set(messages[0].get_fieldnames())
        for field in fields.dtype.names:
            expected = [getattr(m, f"_{field}_raw", getattr(m, field)) for m in messages]
            if fields.dtype[field].kind == "S":
                expected = [e if isinstance(e, bytes) else e.encode() for e in expected]
                assert fields[field].tolist() == expected, (name, field)
            else:
                np.testing.assert_array_equal(
                    np.asarray(fields[field], float), np.array(expected, float), f"{name}.{field}"
                )


@pytest.mark.parametrize("flight", FLIGHTS)
def test_every_field_of_a_sitl_flight_is_pymavlinks(shared_data, flight):
    data = (shared_data / "sitl" / f"{flight}.tlog").read_bytes()
    frames = ColumnDecoder(stamped=True).finish(data[:1_000_000])
    end = 1_000_000 - frames.bad_bytes
    assert_equal_to_pymavlink(data[:end])


def test_every_field_of_the_alfa_flights_is_pymavlinks(shared_data):
    for path in sorted((shared_data / "alfa").glob("*.tlog")):
        assert_equal_to_pymavlink(path.read_bytes())


def small_stream():
    v1, v2 = Encoder(1, 1, version=1), Encoder(7, 42)
    return [
        v2.encode("HEARTBEAT", type=1, autopilot=3),
        v1.encode("ATTITUDE", time_boot_ms=5, roll=0.25),
        v2.encode("STATUSTEXT", severity=4, text="hello"),
        v2.encode("RAW_IMU", time_usec=7, xacc=-5),
        v1.encode("RAW_IMU", time_usec=8, ymag=2),
        v2.encode("RAW_IMU", time_usec=9, id=2, temperature=-40),
    ] * 3


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 700), max_size=6), st.booleans())
def test_blocks_of_any_size_give_the_same_records(cuts, stamped):
    data = b"".join(
        (STAMP.pack(i + 1) if stamped else b"") + f for i, f in enumerate(small_stream())
    )
    data = data[:200] + b"\xfd\x03junk" + data[200:]
    whole = ColumnDecoder(stamped=stamped).finish(data)
    decoder, parts, at = ColumnDecoder(stamped=stamped), [], 0
    for cut in sorted(c for c in cuts if c < len(data)):
        parts.append(decoder.feed(data[at:cut]))
        at = cut
    parts.append(decoder.finish(data[at:]))
    assert sum(p.frames for p in parts) == whole.frames
    assert sum(p.bad_bytes for p in parts) == whole.bad_bytes
    for name, records in whole.messages.items():
        pieces = [p.messages[name] for p in parts if name in p.messages]
        assert np.concatenate(pieces).tobytes() == records.tobytes()


@pytest.mark.parametrize("piece", [300, 1009, 1 << 19])
def test_a_file_is_read_in_pieces_of_any_size(tmp_path, monkeypatch, piece):
    data = b"".join(STAMP.pack(i + 1) + f for i, f in enumerate(40 * small_stream()))
    data = data[:5000] + b"\xfd\x03junk" + data[5000:-3]
    path = tmp_path / "a.tlog"
    path.write_bytes(data)
    whole = ColumnDecoder(stamped=True).finish(data)
    monkeypatch.setattr("links.mavlink.columns._PIECE", piece)
    columns = tlog_columns(path)
    assert (columns.frames, columns.bad_bytes) == (whole.frames, whole.bad_bytes)
    assert columns.bad_bytes > 6
    assert set(columns.messages) == set(whole.messages)
    for name, records in whole.messages.items():
        assert columns.messages[name].tobytes() == records.tobytes()


def test_a_file_that_shrinks_while_it_is_read_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(STAMP.pack(1) + f for f in 40 * small_stream()))
    monkeypatch.setattr("links.mavlink.columns._PIECE", 1000)
    fill = columns_module._fill
    monkeypatch.setattr(columns_module, "_fill", lambda *a: (path.write_bytes(b""), fill(*a)))
    with pytest.raises(LogError, match="became shorter"):
        tlog_columns(path)


def test_what_was_cut_off_or_never_sent_is_zero():
    records = ColumnDecoder().finish(b"".join(small_stream())).messages["RAW_IMU"][:3]
    fields = records["fields"]
    assert fields["time_usec"].tolist() == [7, 8, 9]
    assert fields["xacc"].tolist() == [-5, 0, 0]
    assert fields["ymag"].tolist() == [0, 2, 0]
    assert fields["id"].tolist() == [0, 0, 2]
    assert fields["temperature"].tolist() == [0, 0, -40]
    assert records["version"].tolist() == [2, 1, 2]
    assert records["unix_us"].tolist() == [NO_STAMP] * 3
    assert records["system"].tolist() == [7, 1, 7]


def test_signed_frames_unknown_messages_and_garbage_are_told_apart():
    mav = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = b"k" * 32
    mav.signing.sign_outgoing = True
    signed = ardupilotmega.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3).pack(mav)
    unknown = bytes([0xFD, 2, 0, 0, 5, 1, 1, 0x31, 0xD4, 0]) + b"abcd"
    columns = ColumnDecoder().finish(signed + unknown + signed + b"\xfe\x01")
    assert columns.messages["HEARTBEAT"]["fields"]["base_mode"].tolist() == [81, 81]
    assert columns.unknown == {0xD431: 1}
    assert columns.bad_bytes == 2


def test_only_the_messages_asked_for_are_kept():
    data = b"".join(small_stream())
    columns = ColumnDecoder(messages=["ATTITUDE"]).finish(data)
    assert set(columns.messages) == {"ATTITUDE"}
    assert columns.messages["ATTITUDE"]["frame"].tolist() == [1, 7, 13]
    assert columns.frames == 18
    with pytest.raises(ValueError, match="ardupilotmega has no message NONSENSE"):
        ColumnDecoder(messages=["NONSENSE"])


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=400), st.booleans())
def test_random_bytes_never_raise(data, stamped):
    columns = ColumnDecoder(stamped=stamped).finish(data)
    assert columns.bad_bytes <= len(data)


def test_a_log_file_is_read_at_once(tmp_path):
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(STAMP.pack(i + 1) + f for i, f in enumerate(small_stream())))
    columns = tlog_columns(path, messages=["HEARTBEAT"])
    assert columns.messages["HEARTBEAT"]["unix_us"].tolist() == [1, 7, 13]
    with pytest.raises(LogError, match=r"cannot read .*none\.tlog: No such file"):
        tlog_columns(tmp_path / "none.tlog")


def test_any_dialect_can_be_read():
    message = load_dialect("all").by_name["SENSOR_AIRFLOW_ANGLES"]
    frame = Encoder(1, 1, dialect="all").encode(message.name, timestamp=3, angleofattack=2.5)
    fields = ColumnDecoder("all").finish(frame).messages[message.name]["fields"]
    assert fields["angleofattack"].tolist() == [2.5]
