"""The recorder keeps every frame that passed, and no failure of the disk is felt outside of it."""

import os
import shutil
import subprocess
import threading
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as wire

import monitor.recorder as recorders
from monitor.recorder import Recorder
from monitor.settings.recorder import RecorderSettings
from monitor.tlog_files import TlogFiles

from .recordings import frames, read_back, read_back_of, recordings

SETTINGS = RecorderSettings(free_min_mb=0.0)


def test_what_was_received_is_read_back_frame_by_frame(tmp_path):
    sent = frames(60) + frames(60, signed=True)
    with Recorder(tmp_path, SETTINGS) as recorder:
        stream = b"".join(sent)
        for k in range(0, len(stream), 37):
            recorder.take(stream[k : k + 37], 1_000_000 + k)
    back = read_back(tmp_path)
    assert [frame for frame, _ in back] == sent
    stamps = [stamp for _, stamp in back]
    assert stamps == sorted(stamps)
    ends, begin = [0], stamps[0] - 1_000_000
    for frame, stamp in back:
        ends.append(ends[-1] + len(frame))
        arrived = (ends[-1] - 1) // 37 * 37
        assert abs(stamp - begin - 1_000_000 - arrived) <= 3  # the link's number is in two bits


def test_how_the_rounds_of_writing_fell_does_not_matter(tmp_path):
    stream = b"".join(frames(40))
    for name, step in (("at-once", 1000), ("often", 5)):
        folder = tmp_path / name
        with Recorder(folder, SETTINGS) as recorder:
            for n, k in enumerate(range(0, len(stream), 37)):
                recorder.take(stream[k : k + 37], k)
                if n % step == step - 1:
                    assert recorder.flush(20.0)
        assert [frame for frame, _ in read_back(folder)] == frames(40)


def test_what_was_sent_stands_between_and_tears_nothing_apart(tmp_path):
    received, ours = frames(6), frames(2, system=7)
    stream = b"".join(received)
    with Recorder(tmp_path, SETTINGS) as recorder:
        recorder.take(stream[:70], 1_000)
        recorder.take_sent(ours[0], 2_000)
        recorder.take(stream[70:], 3_000)
        recorder.take_sent(ours[1], 4_000)
    back = [frame for frame, _ in read_back(tmp_path)]
    first = back.index(ours[0])
    assert 0 < first < 6
    assert back[:first] + back[first + 1 : -1] == received
    assert back[-1] == ours[1]


def test_the_bytes_of_links_that_interleave_stay_apart_and_tell_their_link(tmp_path):
    streams = [frames(30, system=k + 1) for k in range(4)]
    whole = [b"".join(stream) for stream in streams]
    with Recorder(tmp_path, SETTINGS) as recorder:
        for k in range(0, len(whole[0]), 11):
            for link, stream in enumerate(whole):
                recorder.take(stream[k : k + 11], 4 * k, link)
            if k % 5 == 0:
                recorder.flush(20.0)
        recorder.take_sent(frames(1, system=9)[0], 4 * k)
    back = read_back(tmp_path)
    for link, stream in enumerate(streams):
        mine = [(frame, stamp) for frame, stamp in back if frame in stream]
        assert [frame for frame, _ in mine] == stream
        assert {stamp & 0b11 for _, stamp in mine} == {min(link, 2)}
    assert back[-1][1] & 0b11 == 3


def test_bytes_that_are_no_frame_are_not_recorded(tmp_path):
    sent = frames(3)
    with Recorder(tmp_path, SETTINGS) as recorder:
        recorder.take(b"garbage" + sent[0] + b"\xfe\xfd" + sent[1] + sent[2], 0)
        recorder.take(frames(1)[0], 1)
    assert [frame for frame, _ in read_back(tmp_path)] == [*sent, sent[0]]


@pytest.mark.parametrize("cut", [1000, 20])
def test_the_key_of_the_network_is_never_on_the_disk(tmp_path, cut):
    key = bytes(range(100, 132))
    mav = wire.MAVLink(None, srcSystem=255, srcComponent=190)
    setup = mav.setup_signing_encode(1, 1, key, 1_000).pack(mav)
    sent = frames(2)
    stream = sent[0] + setup + sent[1]
    with Recorder(tmp_path, SETTINGS) as recorder:
        for k in range(0, len(stream), cut):
            recorder.take(stream[k : k + cut], k)
    assert recorder.withheld == 1
    assert [frame for frame, _ in read_back(tmp_path)] == sent
    assert key not in recordings(tmp_path)[0].read_bytes()


def test_bytes_of_this_file_and_of_all_are_counted(tmp_path):
    with Recorder(tmp_path, RecorderSettings(file_max_mb=0.01)) as recorder:
        for k, frame in enumerate(frames(500)):
            recorder.take(frame, k)
        assert recorder.flush(20.0)
        path, counts = recorder.path, (recorder.file_bytes, recorder.bytes)
    files = recordings(tmp_path)
    assert len(files) > 1
    assert path == files[-1]
    assert counts == (path.stat().st_size, sum(file.stat().st_size for file in files))


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError):
        Recorder(tmp_path / "file" / "folder", SETTINGS)


class Slow:
    """A disk whose writes wait for each other's permission."""

    def __init__(self, monkeypatch):
        self.gate = threading.Event()
        write = TlogFiles.append

        def append(files, records):
            self.gate.wait(20.0)
            write(files, records)

        monkeypatch.setattr(TlogFiles, "append", append)


def test_a_disk_that_stands_still_holds_up_nobody_and_loses_the_oldest(tmp_path, monkeypatch):
    disk = Slow(monkeypatch)
    monkeypatch.setattr(recorders, "STALLED_S", 0.1)
    sent = frames(900)
    with Recorder(tmp_path, RecorderSettings(queue_mb=0.01, free_min_mb=0.0)) as recorder:
        recorder.take(sent[0], 0)
        assert not recorder.flush(0.2)
        began_s = time.thread_time()
        for k, frame in enumerate(sent[1:], 1):
            recorder.take(frame, k)
        assert time.thread_time() - began_s < 0.05
        assert recorder.news() == ["recording has stopped: the disk stands still"]
        assert recorder.news() == []
        disk.gate.set()
        assert recorder.flush(20.0)
        (again,) = recorder.news()
        assert again.startswith(f"recording goes on in {recorder.path.name}; about ")
        lost = recorder.lost_bytes
    kept = [frame for frame, _ in read_back(tmp_path)]
    assert kept == [sent[0], *sent[len(sent) - len(kept) + 1 :]]
    assert sum(map(len, kept[1:])) <= 10_000
    assert lost == sum(map(len, sent)) - sum(map(len, kept))


def test_the_end_does_not_wait_for_a_disk_that_stands_still(tmp_path, monkeypatch):
    disk = Slow(monkeypatch)
    recorder = Recorder(tmp_path, SETTINGS)
    recorder.take(frames(1)[0], 0)
    assert not recorder.flush(0.2)
    began_s = time.monotonic()
    recorder.close()
    assert time.monotonic() - began_s < 2 * recorders.CLOSE_S + 0.5
    disk.gate.set()


def retrying(tmp_path, **keys):
    return Recorder(tmp_path, RecorderSettings(retry_s=0.01, free_min_mb=0.0, **keys))


def test_a_disk_that_is_full_stops_it_until_there_is_room(tmp_path, monkeypatch):
    full = True
    monkeypatch.setattr(
        "monitor.tlog_files.shutil.disk_usage",
        lambda _: (
            shutil._ntuple_diskusage(9, 9, 0) if full else shutil._ntuple_diskusage(9e9, 0, 9e9)
        ),
    )
    sent = frames(3)
    with Recorder(tmp_path, RecorderSettings(retry_s=0.01)) as recorder:
        recorder.take(sent[0], 0)
        assert recorder.flush(20.0)
        said = "recording has stopped: less than 100 MB are free on the disk"
        assert recorder.news() == [said]
        assert recorder.stopped == said
        assert not recordings(tmp_path)
        full = False
        time.sleep(0.02)
        recorder.take(sent[1], 1)
        assert recorder.flush(20.0)
        assert recorder.stopped is None
        assert recorder.news() == [
            f"recording goes on in {recorder.path.name}; about 0 kB were lost"
        ]
        assert recorder.lost_bytes == len(sent[0]) + 8
    assert [frame for frame, _ in read_back(tmp_path)] == [sent[1]]


def test_a_file_that_was_deleted_is_followed_by_another(tmp_path):
    with retrying(tmp_path) as recorder:
        assert recorder.flush(20.0)
        recorder.path.unlink()
        assert recorder.flush(20.0)
        assert recorder.news() == ["recording has stopped: the file was deleted"]
        time.sleep(0.02)
        recorder.take(frames(1)[0], 0)
        assert recorder.flush(20.0)
        assert recorder.stopped is None
    assert [frame for frame, _ in read_back(tmp_path)] == frames(1)


def test_a_folder_that_is_gone_is_waited_for_and_not_made(tmp_path):
    folder = tmp_path / "stick"
    with retrying(folder) as recorder:
        assert recorder.flush(20.0)
        shutil.rmtree(folder)
        for _ in range(3):
            time.sleep(0.02)
            recorder.take(frames(1)[0], 0)
            assert recorder.flush(20.0)
            assert recorder.stopped is not None
        assert not folder.exists()
        folder.mkdir()
        time.sleep(0.02)
        recorder.take(frames(1)[0], 0)
        assert recorder.flush(20.0)
        assert recorder.stopped is None
    assert len(read_back(folder)) == 1


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 64 kB, where one may be mounted."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", place]
    if os.geteuid() or not shutil.which("mount") or subprocess.run(mount).returncode:
        pytest.skip("only root may mount a small disk")
    yield place
    subprocess.run(["umount", "--lazy", place], check=True)


def test_a_small_disk_runs_full_and_is_used_again_once_it_has_room(small_disk):
    sent = frames(2000)
    (small_disk / "other").write_bytes(bytes(30_000))
    with retrying(small_disk) as recorder:
        for k, frame in enumerate(sent):
            recorder.take(frame, k)
        assert recorder.flush(20.0)
        assert recorder.stopped == "recording has stopped: No space left on device"
        (small_disk / "other").unlink()
        time.sleep(0.02)
        recorder.take(sent[0], 3000)
        assert recorder.flush(20.0)
        assert recorder.stopped is None
    first, second = recordings(small_disk)
    kept = [frame for frame, _ in read_back_of(first)]
    assert kept == sent[: len(kept)]
    assert first.stat().st_size > 28_000
    assert [frame for frame, _ in read_back_of(second)] == [sent[0]]
