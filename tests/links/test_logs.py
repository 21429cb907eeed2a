"""Telemetry logs: every frame that pymavlink finds, at any chunk size, damaged or not."""

import struct
from collections import Counter

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink import mavutil

from links.logs import LogError, TlogWriter, open_log, read_tlog
from links.mavlink import Decoder, Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from links.samples import Batch
from links.vocabulary import Rejection

T0 = 1_700_000_000_000_000


def pymavlink_counts(path):
    """Message name -> frames that pymavlink's own log reader finds."""
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    counts = Counter()
    while (message := log.recv_msg()) is not None:
        counts[message.get_type()] += 1
    log.close()
    return counts


def sequential_counts(path):
    """The same by walking the file: stamp, length byte, frame; every checksum must be right."""
    dialect = load_dialect()
    data = path.read_bytes()
    counts, at = Counter(), 0
    while at < len(data):
        at += 8
        v2 = data[at] == 0xFD
        assert v2 or data[at] == 0xFE
        size = data[at + 1] + (12 if v2 else 8)
        number = int.from_bytes(data[at + 7 : at + 10], "little") if v2 else data[at + 5]
        counts[dialect.by_id[number].name] += 1
        at += size
    return counts


def totals(path, **kwargs):
    reader = read_tlog(path, **kwargs)
    return Batch.concatenate(reader), reader


@pytest.fixture(scope="module")
def flight():
    """Bytes of a small log: 40 s of IMU and heartbeats, and their frames."""
    sender = Encoder(1, 1)
    frames = []
    for i in range(400):
        t_ms = 5000 + 100 * i
        if i % 10 == 0:
            beat = sender.encode("HEARTBEAT", type=1, autopilot=3)
            frames.append((T0 + t_ms * 1000, beat))
        frames.append((T0 + t_ms * 1000, sender.encode("SCALED_IMU", time_boot_ms=t_ms, xacc=i)))
    return frames


@pytest.fixture
def log_file(tmp_path, flight):
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as writer:
        for unix_us, frame in flight:
            writer.write(frame, unix_us)
    return path


@pytest.mark.parametrize("name", ["n1_calm_nominal", "f7_gps_faults"])
def test_sitl_counts_are_those_of_pymavlink(shared_data, name):
    path = shared_data / "sitl" / f"{name}.tlog"
    _, reader = totals(path)
    assert reader.decoder.counters.by_name == pymavlink_counts(path)
    assert reader.info.bad_bytes == 0


def test_alfa_flights_lose_nothing(shared_data):
    for path in sorted((shared_data / "alfa").glob("*.tlog")):
        _, reader = totals(path)
        ours = reader.decoder.counters.by_name
        assert ours == sequential_counts(path)
        theirs = pymavlink_counts(path)
        theirs.pop("BAD_DATA", None)
        assert all(ours[name] >= n for name, n in theirs.items())
        assert reader.info.bad_bytes == 0


def test_what_a_sitl_flight_holds(shared_data):
    batch, reader = totals(shared_data / "sitl" / "n1_calm_nominal.tlog")
    info = reader.info
    assert (info.vehicle.system_id, info.vehicle.autopilot, info.vehicle.type) == (1, 3, 1)
    assert info.messages == 81743
    assert info.first_t_us == 0  # the first stamp, 1.744 s before the first stamped message
    assert info.duration_s == pytest.approx(319.0, abs=0.1)
    assert info.sources["imu0"] == "RAW_IMU"
    assert len(batch.rows["imu1"]) == 12681
    assert not batch.rows["imu2"]["acc_m_s2"].any()
    assert (batch.rows["spool1"]["speed_rpm"] == -1).all()
    speed = np.linalg.norm(batch.rows["nav"]["vel_ned_m_s"], axis=1)
    flying = batch.rows["airspeed0"]["cas_m_s"] > 15
    assert 15 < speed[flying[: len(speed)]].mean() < 35


def test_the_chunk_size_changes_no_sample(shared_data, same_batch):
    path = next((shared_data / "alfa").glob("*no_failure.tlog"))
    whole, a = totals(path)
    small, b = totals(path, chunk=4099)
    same_batch(whole, small)
    assert a.info == b.info


def test_a_live_link_gives_the_samples_of_its_log(shared_data, same_batch):
    path = next((shared_data / "alfa").glob("*no_failure.tlog"))
    framer = Framer(load_dialect(), stamped=True)
    frames = framer.feed(path.read_bytes())
    live = Decoder()
    parts = [
        live.feed(frames.data[s:e])
        for s, e in zip(frames.start[:3000], frames.end[:3000], strict=True)
    ]
    recorded = Decoder(stamped=True)
    logged = recorded.feed(path.read_bytes()[: int(frames.end[2999])])
    same_batch(Batch.concatenate([*parts, live.finish()]), logged)


def test_written_logs_are_read_back(log_file, flight):
    batch, reader = totals(log_file)
    info = reader.info
    assert info.messages == len(flight)
    assert batch.rows["imu0"]["acc_m_s2"][:, 0] == pytest.approx(np.arange(400) * 9.80665e-3)
    assert (info.start_unix_us, info.end_unix_us) == (flight[0][0], flight[-1][0])
    assert info.first_t_us == 5_000_000
    assert info.duration_s == pytest.approx(39.9)
    assert info.bytes == info.bytes_read == log_file.stat().st_size
    assert info.gaps == []
    assert pymavlink_counts(log_file) == {"SCALED_IMU": 400, "HEARTBEAT": 40}


def test_the_first_record_has_the_time_that_most_stamps_agree_on(log_file, flight):
    with TlogWriter(log_file) as writer:  # like a recorder that does not know the time yet
        for unix_us, frame in flight[:5]:
            writer.write(frame, unix_us - 2_000_000)
        for unix_us, frame in flight[5:]:
            writer.write(frame, unix_us)
    assert totals(log_file)[1].info.first_t_us == 3_000_000
    assert totals(log_file, chunk=100)[1].info.first_t_us == 3_000_000


def test_gaps_of_the_recording_are_listed(log_file, flight):
    with TlogWriter(log_file) as writer:
        for unix_us, frame in flight[:100] + flight[200:]:
            writer.write(frame, unix_us)
    _, reader = totals(log_file, chunk=64)
    before = flight[99][0]
    assert reader.info.gaps == [(before, flight[200][0] - before)]


def test_a_cut_off_log_gives_all_but_its_last_frame(log_file, flight):
    log_file.write_bytes(log_file.read_bytes()[:-3])
    batch, reader = totals(log_file)
    assert len(batch.rows["imu0"]) == 399
    assert batch.rejected["frame", Rejection.TRUNCATED] == 1
    assert reader.info.bad_bytes == len(flight[-1][1]) + 8 - 3


def test_a_log_without_stamps_is_read_too(log_file, flight):
    log_file.write_bytes(b"".join(frame for _, frame in flight))
    batch, reader = totals(log_file)
    assert len(batch.rows["imu0"]) == 400
    assert reader.info.start_unix_us is None
    assert reader.info.bad_bytes == 0


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(st.tuples(st.integers(0, 14_000), st.binary(min_size=1, max_size=60)), max_size=8))
def test_damage_costs_only_what_it_touches(flight, decode, damage):
    records = [struct.pack(">Q", u) + f for u, f in flight]
    data = bytearray(b"".join(records))
    touched = np.zeros(len(data), bool)
    for at, new in damage:
        end = min(at + len(new), len(data))
        touched[at:end] = True
        data[at:end] = new[: end - at]
    framer = Framer(load_dialect(), stamped=True)
    found = framer.feed(bytes(data))
    rest = framer.finish()
    seen = {found.data[s:e] for s, e in zip(found.start, found.end, strict=True)}
    seen |= {rest.data[s:e] for s, e in zip(rest.start, rest.end, strict=True)}
    at = 0
    for record, (_, frame) in zip(records, flight, strict=True):
        whole = not touched[at + 8 : at + len(record)].any()
        assert not whole or frame in seen
        at += len(record)


def test_a_file_without_messages_is_refused(tmp_path):
    path = tmp_path / "noise.tlog"
    path.write_bytes(bytes(range(256)) * 40)
    with pytest.raises(LogError, match=r"noise\.tlog has no MAVLink message in it"):
        list(open_log(path))


def test_a_log_of_a_ground_station_alone_is_refused(tmp_path):
    path = tmp_path / "gcs.tlog"
    with TlogWriter(path) as writer:
        writer.write(Encoder(255, 190).encode("HEARTBEAT", type=6, autopilot=8), T0)
    with pytest.raises(LogError, match="no message of a vehicle"):
        list(open_log(path))


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.tlog", None, "cannot read .*a.tlog: No such file"),
        ("b.tlog", b"", "b.tlog is empty"),
        ("d.BIN", b"\xa3\x95\x80\x80", "no data of a vehicle"),
        ("misnamed.tlog", b"\xa3\x95\x80\x80", "no data of a vehicle"),
        ("e.tlog.gz", b"\x1f\x8b\x08\x00" + bytes(30), r"e.tlog.gz is packed \(gzip\): unpack it"),
        ("f.BIN", b"PK\x03\x04" + bytes(30), r"f.BIN is packed \(zip\)"),
    ],
)
def test_unusable_files_are_refused_in_one_sentence(tmp_path, name, content, sentence):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(LogError, match=sentence):
        list(open_log(path))


@pytest.mark.parametrize("name", ["flight.ulg", "flight.BIN", "flight"])
def test_a_telemetry_log_is_known_by_its_content_whatever_its_name(tmp_path, flight, name):
    path = tmp_path / name
    with TlogWriter(path) as writer:
        for stamp_us, frame in flight:
            writer.write(frame, stamp_us)
    reader = open_log(path)
    assert sum(map(len, reader)) > 0
    assert reader.info.format == "tlog"


def test_a_directory_is_refused(tmp_path):
    with pytest.raises(LogError, match="is a folder: name the logs in it"):
        open_log(tmp_path)
