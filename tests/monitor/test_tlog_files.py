"""The folder of recordings: bounds, whole last records, and none that another is writing."""

import os
import resource
import time

import pytest
from pymavlink import mavutil

from links.logs.tlog import read_tlog
from links.mavlink.dialect import load_dialect
from monitor.settings.recorder import RecorderSettings
from monitor.tlog_files import Record, TlogFiles, mend

from .recordings import frames, read_back, read_back_of, recordings

DAY_S = 86_400.0


def records(count: int) -> list[Record]:
    return [Record(k, 0, frame) for k, frame in enumerate(frames(count))]


def writing(folder, **keys) -> TlogFiles:
    files = TlogFiles(folder, RecorderSettings(**({"free_min_mb": 0.0} | keys)))
    files.begin()
    return files


def old(folder, name: str, age_s: float, size: int = 50_000):
    path = folder / name
    path.write_bytes(bytes(size))
    os.utime(path, (time.time() - age_s,) * 2)
    return path


def test_files_are_bounded_and_the_oldest_go_first(tmp_path):
    oldest = old(tmp_path, "mavsentry-20200101T000000Z-000.tlog", 9e7)
    other = old(tmp_path, "flight.tlog", 9e7, 90_000)
    files = writing(tmp_path, file_max_mb=0.01, total_max_mb=0.03)
    for k in range(0, 2000, 50):
        files.append(records(2000)[k : k + 50])
    files.close()
    kept = recordings(tmp_path)
    assert not oldest.exists()
    assert other.exists()
    assert sum(p.stat().st_size for p in kept) <= 31_000
    assert all(p.stat().st_size <= 10_100 for p in kept)
    assert read_back(tmp_path)[-1][0] == frames(2000)[-1]


def test_one_long_round_is_cut_into_files_as_many_short_ones_are(tmp_path):
    sizes = []
    for name, step in (("long", 2000), ("short", 7)):
        (tmp_path / name).mkdir()
        files = writing(tmp_path / name, file_max_mb=0.01)
        for k in range(0, 2000, step):
            files.append(records(2000)[k : k + step])
        files.close()
        assert [frame for frame, _ in read_back(tmp_path / name)] == frames(2000)
        sizes.append([p.stat().st_size for p in recordings(tmp_path / name)])
    assert sizes[0] == sizes[1]


def test_recordings_that_are_too_old_go(tmp_path):
    names = [f"mavsentry-{day}.tlog" for day in (5, 2)]
    week, fresh = (old(tmp_path, name, float(name[10]) * DAY_S) for name in names)
    other = old(tmp_path, "flight.tlog", 9 * DAY_S)
    writing(tmp_path, max_age_days=3.0).close()
    assert (week.exists(), fresh.exists(), other.exists()) == (False, True, True)


def test_a_new_file_is_begun_when_one_is_old(tmp_path, monkeypatch):
    files = writing(tmp_path, file_max_minutes=1.0)
    files.append(records(1))
    now_s = time.monotonic() + 59.0
    monkeypatch.setattr("monitor.tlog_files.time.monotonic", lambda: now_s)
    files.append(records(1))
    assert len(recordings(tmp_path)) == 1
    now_s += 2.0
    files.append(records(1))
    files.close()
    assert [len(read_back_of(p)) for p in recordings(tmp_path)] == [2, 1]


def test_a_name_that_is_taken_is_left_to_its_file(tmp_path):
    first = writing(tmp_path)
    second = TlogFiles(tmp_path, RecorderSettings(free_min_mb=0.0))
    second._stem = first._stem
    second.begin()
    assert first.path != second.path
    first.append(records(2))
    second.append(records(3))
    first.close()
    second.close()
    assert [len(read_back_of(p)) for p in recordings(tmp_path)] == [2, 3]


def test_what_another_is_writing_is_neither_deleted_nor_mended(tmp_path):
    theirs = writing(tmp_path)
    theirs.append(records(50))
    with theirs.path.open("ab") as file:
        file.write(b"half a record")
    os.utime(theirs.path, (1.0, 1.0))
    ours = TlogFiles(tmp_path, RecorderSettings(free_min_mb=0.0, total_max_mb=0.001))
    ours._stem = "mavsentry-later"
    assert ours.mend_last(load_dialect()) is None
    ours.begin()
    ours.close()
    assert theirs.path.exists()
    theirs.abandon()
    assert ours.path.unlink() is None
    assert ours.mend_last(load_dialect()) == (
        f"mended {theirs.path.name}: its last record was half written, 13 bytes were cut off"
    )
    assert len(read_back_of(theirs.path)) == 50


def test_the_wall_clock_is_set_in_flight_and_the_stamps_go_on(tmp_path, monkeypatch):
    files = writing(tmp_path)
    files.append(records(1))
    monkeypatch.setattr("monitor.tlog_files.time.time_ns", lambda: 0)
    files.append([Record(1_000_000, 0, frames(1)[0]), Record(900_000, 0, frames(1)[0])])
    files.close()
    stamps = [stamp for _, stamp in read_back(tmp_path)]
    assert abs(stamps[1] - stamps[0] - 1_000_000) <= 3
    assert stamps[2] == stamps[1]


@pytest.fixture
def flight(tmp_path):
    files = writing(tmp_path)
    files.append(records(300))
    files.close()
    return files.path


def readable_by_pymavlink(path) -> int:
    log = mavutil.mavlink_connection(str(path))
    count = 0
    while log.recv_match() is not None:
        count += 1
    log.close()
    return count


def test_wherever_a_recording_was_interrupted_its_whole_records_stay(flight):
    data = flight.read_bytes()
    ends = [0]
    for frame, _ in read_back_of(flight):
        ends.append(ends[-1] + 8 + len(frame))
    for cut in range(ends[-3], ends[-1] + 1):
        flight.write_bytes(data[:cut])
        whole = max(end for end in ends if end <= cut)
        assert mend(flight, load_dialect()) == cut - whole
        assert flight.read_bytes() == data[:whole]
        assert mend(flight, load_dialect()) == 0


def test_zeros_that_a_power_cut_left_are_cut_off(flight):
    size = flight.stat().st_size
    with flight.open("ab") as file:
        file.write(bytes(1_000_000))
    assert mend(flight, load_dialect()) == 1_000_000
    assert flight.stat().st_size == size


def test_every_reader_takes_what_was_mended(flight):
    with flight.open("r+b") as file:
        file.truncate(flight.stat().st_size - 5)
    mend(flight, load_dialect())
    assert readable_by_pymavlink(flight) == 299
    reader = read_tlog(flight)
    assert sum(len(batch) for batch in reader) == 299
    assert (reader.info.messages, reader.info.bad_bytes) == (299, 0)


def test_a_file_without_any_record_is_left_as_it_is(tmp_path):
    path = tmp_path / "mavsentry-x.tlog"
    for content in (b"", b"something else\n" * 30):
        path.write_bytes(content)
        assert mend(path, load_dialect()) == 0
        assert path.read_bytes() == content


def test_a_limit_of_file_size_leaves_whole_records(tmp_path):
    files = writing(tmp_path)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            files.append(records(1000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    files.abandon()
    kept = [frame for frame, _ in read_back_of(files.path)]
    assert kept == frames(1000)[: len(kept)]
    assert files.bytes == files.file_bytes == files.path.stat().st_size > 9_900


def test_an_empty_file_is_not_left_behind_by_a_failure(tmp_path):
    files = writing(tmp_path)
    files.abandon()
    assert not recordings(tmp_path)


def test_it_is_on_the_disk_as_often_as_stated(tmp_path, monkeypatch):
    synced = []
    fsync = os.fsync
    files = writing(tmp_path, sync_s=5.0)
    monkeypatch.setattr("monitor.tlog_files.os.fsync", lambda fd: synced.append(fsync(fd)))
    now_s = time.monotonic()
    monkeypatch.setattr("monitor.tlog_files.time.monotonic", lambda: now_s)
    for _ in range(20):  # a second each
        files.append(records(1))
        files.tend()
        now_s += 1.0
    assert len(synced) in (3, 4)
    before = len(synced)
    for _ in range(20):
        files.tend()
        now_s += 1.0
    assert len(synced) - before <= 1, "nothing new, nothing to do"
    files.close()
