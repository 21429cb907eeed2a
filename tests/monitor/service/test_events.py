"""The log for programs: its lines, its levels, a file that is moved away, a disk that is slow."""

import io
import json
import logging
import re
import socket
import sys
import threading
import time

import pytest

from monitor.service import Event, EventLog, LogError, open_event_log
from monitor.service.events import WAITING_MAX
from tests.conftest import ROOT


def written(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_an_event_is_a_line_of_json_with_the_same_keys_first(tmp_path):
    file = tmp_path / "events.jsonl"
    log = open_event_log(str(file))
    before_s = time.time()
    log.log(Event.VERDICT, "airspeed0 faulty: stück\n2", "error", sensor="airspeed0", size=-3.5)
    log.log(Event.STATUS, "100 %s", worst_ms=float("nan"), reasons={"bad crc": 2})
    log.close()
    first, second = written(file)
    assert list(first) == ["time", "level", "event", "message", "sensor", "size"]
    assert first["level"] == "error"
    assert first["event"] == "verdict"
    assert first["message"] == "airspeed0 faulty: stück\n2"
    assert first["size"] == -3.5
    assert second["message"] == "100 %s"
    assert second["worst_ms"] is None
    assert second["reasons"] == {"bad crc": 2}
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", first["time"])
    assert first["time"] <= second["time"]
    stamp = time.strftime("%Y-%m-%dT%H", time.gmtime(before_s))
    assert first["time"].startswith(stamp[:11])


@pytest.mark.parametrize(
    ("level", "events"), [("debug", 4), ("info", 3), ("warning", 2), ("error", 1)]
)
def test_what_is_less_grave_is_left_out(tmp_path, level, events):
    log = open_event_log(str(tmp_path / "e"), level)
    for grave in ("debug", "info", "warning", "error"):
        log.log(Event.NOTE, grave, grave)
    log.close()
    assert len(written(tmp_path / "e")) == events


def test_a_file_that_was_moved_away_is_begun_anew_and_an_old_one_added_to(tmp_path):
    file, moved = tmp_path / "e", tmp_path / "e.1"
    file.write_text('{"event": "old"}\n')
    log = open_event_log(str(file))
    log.log(Event.START, "one")
    settle(log)
    file.rename(moved)
    log.log(Event.STOP, "two")
    log.close()
    assert [e["event"] for e in written(moved)] == ["old", "start"]
    assert [e["event"] for e in written(file)] == ["stop"]


def settle(log):
    end_s = time.monotonic() + 5.0
    while not log._queue.empty() and time.monotonic() < end_s:
        time.sleep(0.005)
    time.sleep(0.05)


class Slow(logging.Handler):
    """A disk that takes nothing before it is let."""

    def __init__(self):
        super().__init__()
        self.free = threading.Event()
        self.taken = []

    def emit(self, record):
        self.free.wait(10.0)
        self.taken.append(record.getMessage())


def test_a_slow_disk_holds_nobody_up_and_the_oldest_are_dropped():
    slow = Slow()
    log = EventLog(slow)
    began_s = time.monotonic()
    for k in range(WAITING_MAX + 101):
        log.log(Event.NOTE, str(k))
    assert time.monotonic() - began_s < 5.0
    assert log.dropped in (100, 101)  # one may be with the disk already
    began_s = time.monotonic()
    log.close(0.2)
    assert 0.15 < time.monotonic() - began_s < 1.5
    slow.free.set()
    end_s = time.monotonic() + 5.0
    while len(slow.taken) < WAITING_MAX and time.monotonic() < end_s:
        time.sleep(0.01)
    assert slow.taken[-1] == str(WAITING_MAX + 100)
    log._listener = None


def test_a_disk_that_fails_is_no_error_of_the_loop(tmp_path, capsys):
    log = open_event_log("/dev/full")
    assert log.trouble == ""
    log.log(Event.NOTE, "lost")
    settle(log)
    assert log.trouble == "events cannot be logged: No space left on device"
    log.close()
    assert capsys.readouterr().err == ""


def test_standard_error_takes_lines_too(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    log = open_event_log("-")
    log.log(Event.NOTE, "here")
    log.close()
    assert json.loads(stream.getvalue())["message"] == "here"


def test_the_journal_gets_fields_of_its_own(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal:
        journal.bind(str(tmp_path / "journal"))
        journal.settimeout(5.0)
        log = open_event_log("journal", journal=str(tmp_path / "journal"))
        log.log(Event.VERDICT, "one\ntwo", "error", sensor="aoa0", onset_t_us=None)
        entry = journal.recv(65536)
        log.close()
    assert entry.startswith(b"MESSAGE\n" + (7).to_bytes(8, "little") + b"one\ntwo\n")
    lines = entry.split(b"one\ntwo\n")[1].decode().splitlines()
    assert lines == [
        "PRIORITY=3",
        "SYSLOG_IDENTIFIER=mavsentry",
        "MAVSENTRY_EVENT=verdict",
        "MAVSENTRY_SENSOR=aoa0",
        "MAVSENTRY_ONSET_T_US=null",
    ]


def test_a_journal_that_was_started_anew_is_found_again(tmp_path):
    path = tmp_path / "journal"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as first:
        first.bind(str(path))
        log = open_event_log("journal", journal=str(path))
        log.log(Event.NOTE, "first")
        settle(log)
        assert b"first" in first.recv(65536)
    path.unlink()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as second:
        second.bind(str(path))
        second.settimeout(5.0)
        log.log(Event.NOTE, "second")
        assert b"second" in second.recv(65536)
        log.close()


def test_a_log_that_cannot_be_is_refused_in_a_sentence(tmp_path):
    with pytest.raises(LogError, match=r"cannot log to .*: Is a directory"):
        open_event_log(str(tmp_path))
    with pytest.raises(LogError, match="no journal"):
        open_event_log("journal", journal=str(tmp_path / "none"))


def test_every_event_is_documented():
    text = (ROOT / "docs" / "service.md").read_text(encoding="utf-8")
    table = text.partition("| event | when |")[2].partition("\n\n")[0]
    first = [row.split("|")[1] for row in table.splitlines()[2:]]
    named = {name for cell in first for name in re.findall(r"`(\w+)`", cell)}
    assert named == set(Event)


def test_without_a_log_nothing_is_done():
    log = open_event_log("")
    log.log(Event.NOTE, "nowhere")
    log.close()
    assert threading.active_count() == len(threading.enumerate())
    assert log._queue.empty()
