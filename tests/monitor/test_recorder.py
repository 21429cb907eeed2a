"""The recorder keeps every frame that was received, within its bounds."""

import os
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as wire

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.recorder import Recorder, whole_frames
from monitor.settings.recorder import RecorderSettings


def frames(count: int, *, signed: bool = False) -> list[bytes]:
    mav = wire.MAVLink(None, srcSystem=1, srcComponent=1)
    if signed:
        mav.signing.secret_key = bytes(range(32))
        mav.signing.sign_outgoing = True
        mav.signing.timestamp = 1
    return [
        mav.attitude_encode(k, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(mav, force_mavlink1=k % 3 == 1)
        for k in range(count)
    ]


def read_back(folder) -> list[tuple[bytes, int]]:
    out = []
    for file in sorted(folder.glob("*.tlog")):
        out += read_back_of(file)
    return out


def read_back_of(file) -> list[tuple[bytes, int]]:
    framer = Framer(load_dialect(), stamped=True)
    out = list(whole_frames(framer.feed(file.read_bytes())))
    out += list(whole_frames(framer.finish()))
    assert framer.bad_bytes == 0
    return out


def test_what_was_received_is_read_back_frame_by_frame(tmp_path):
    sent = frames(60) + frames(60, signed=True)
    with Recorder(tmp_path, RecorderSettings()) as recorder:
        stream = b"".join(sent)
        for k in range(0, len(stream), 37):
            recorder.take(stream[k : k + 37], 1_000_000 + k)
    back = read_back(tmp_path)
    assert [frame for frame, _ in back] == sent
    stamps = [stamp for _, stamp in back]
    assert stamps == sorted(stamps)
    assert stamps[-1] - stamps[0] > 0.9 * len(stream) - 100


def test_what_was_sent_stands_between_and_tears_nothing_apart(tmp_path):
    received, ours = frames(6), frames(2)
    stream = b"".join(received)
    with Recorder(tmp_path, RecorderSettings()) as recorder:
        recorder.take(stream[:70], 1_000)
        recorder.take_sent(ours[0], 2_000)
        recorder.take(stream[70:], 3_000)
        recorder.take_sent(ours[1], 4_000)
    back = [frame for frame, _ in read_back(tmp_path)]
    first = back.index(ours[0], 1)
    assert back[:first] + back[first + 1 : -1] == received
    assert back[-1] == ours[1]


def test_bytes_that_are_no_frame_are_not_recorded(tmp_path):
    sent = frames(3)
    with Recorder(tmp_path, RecorderSettings()) as recorder:
        recorder.take(b"garbage" + sent[0] + b"\xfe\xfd" + sent[1] + sent[2], 0)
        recorder.take(frames(1)[0], 1)
    assert [frame for frame, _ in read_back(tmp_path)] == [*sent, sent[0]]


def test_files_are_bounded_and_the_oldest_go_first(tmp_path):
    old = tmp_path / "mavsentry-20200101T000000Z-000.tlog"
    old.write_bytes(bytes(50_000))
    os.utime(old, (1.0, 1.0))
    other = tmp_path / "flight.tlog"
    other.write_bytes(bytes(90_000))
    settings = RecorderSettings(file_max_mb=0.01, total_max_mb=0.03)
    with Recorder(tmp_path, settings) as recorder:
        for k, frame in enumerate(frames(2000)):
            recorder.take(frame, k)
    kept = sorted(tmp_path.glob("mavsentry-*.tlog"))
    assert old not in kept
    assert other.exists()
    assert sum(p.stat().st_size for p in kept) <= 31_000
    assert all(p.stat().st_size <= 10_100 for p in kept)
    newest = read_back_last(kept)
    assert newest == frames(2000)[-1]


def read_back_last(kept) -> bytes:
    framer = Framer(load_dialect(), stamped=True)
    data = kept[-1].read_bytes() or kept[-2].read_bytes()
    return list(whole_frames(framer.feed(data)))[-1][0]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full disk is feigned by /dev/full")
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path):
    with Recorder(tmp_path, RecorderSettings(file_max_mb=0.1)) as recorder:
        first = recorder.path
        first.with_name(first.name.replace("-000", "-001")).symlink_to("/dev/full")
        sent = frames(5000)
        for k, frame in enumerate(sent):
            recorder.take(frame, k)
            recorder.take_sent(frame, k)
        assert recorder.stopped == "recording has stopped: No space left on device"
    kept = [frame for frame, _ in read_back_of(first)]
    assert kept == [frame for frame in sent for _ in (0, 1)][: len(kept)]
    assert first.stat().st_size > 100_000


def test_bytes_of_this_file_and_of_all_are_counted(tmp_path):
    with Recorder(tmp_path, RecorderSettings(file_max_mb=0.01)) as recorder:
        for k, frame in enumerate(frames(500)):
            recorder.take(frame, k)
        path, counts = recorder.path, (recorder.file_bytes, recorder.bytes)
    files = sorted(tmp_path.glob("*.tlog"))
    assert len(files) > 1
    assert path == files[-1]
    assert counts == (path.stat().st_size, sum(file.stat().st_size for file in files))
