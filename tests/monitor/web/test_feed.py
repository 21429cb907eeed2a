"""The daemon's side: frames when they are due and taken, never a wait, a process that is kept."""

import os
import socket
import sys
import time

import pytest

from monitor.verdict import StepResult
from monitor.web.address import VARIABLE, listen
from monitor.web.feed import WebFeed
from monitor.web.pipe import BEGIN, BODY_MAX, FRAME, SETUP, Incoming, Outgoing
from monitor.web.process import FIRST_WAIT_US, HUNG_US, LASTING_US, LONGEST_WAIT_US, WebProcess

S = 1_000_000


class FakeSnapshots:
    def __init__(self):
        self.noted = self.skipped = self.frames = 0

    def note(self, result):
        self.noted += 1

    def skip(self):
        self.skipped += 1

    def frame(self, now_us, status):
        self.frames += 1
        return b"frame"

    def hello(self, status):
        return b"hello"


class FakeProcess:
    fresh = True
    takes = True

    def __init__(self):
        self.sent = []

    def ready(self, now_us):
        return self.takes

    def send(self, kind, body):
        self.sent.append((kind, body))


class Turning:
    def __init__(self):
        self.snapshots, self.process = FakeSnapshots(), FakeProcess()
        self.us = 0
        self.feed = WebFeed(self.snapshots, self.process, lambda: None, 5.0, lambda: self.us)

    def turn(self, seconds, every_us=20_000):
        end_us = self.us + round(seconds * S)
        while self.us < end_us:
            self.feed.turn(StepResult())
            self.us += every_us


def test_a_frame_is_made_at_the_rate_and_every_result_is_noted():
    turning = Turning()
    turning.turn(10.0)
    assert turning.snapshots.noted == 500
    assert turning.snapshots.frames == 50
    assert turning.process.sent[:2] == [(BEGIN, b"hello"), (FRAME, b"frame")]


def test_a_loop_that_stood_still_does_not_catch_up():
    turning = Turning()
    turning.turn(1.0)
    turning.us += 60 * S
    before = turning.snapshots.frames
    turning.turn(1.0)
    assert turning.snapshots.frames - before <= 6


def test_frames_that_nobody_takes_are_not_even_made():
    turning = Turning()
    turning.turn(1.0)
    turning.process.takes = False
    made = turning.snapshots.frames
    turning.turn(2.0)
    assert (turning.snapshots.frames, turning.snapshots.skipped) == (made, 10)


def test_a_process_that_is_new_is_told_first_what_stands():
    turning = Turning()
    turning.turn(1.0)
    turning.process.fresh, turning.process.sent = True, []
    turning.turn(0.2)
    assert [kind for kind, _ in turning.process.sent] == [BEGIN, FRAME]


def test_messages_arrive_whole_however_they_are_cut():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        outgoing, incoming = Outgoing(ours), Incoming(theirs)
        bodies = [b"", b"x", bytes(3_000_000), b"y" * 70_000]
        heard = []
        for body in bodies:
            outgoing.send(FRAME, body)
            while not outgoing.ready():
                assert incoming.receive()
                heard += incoming.messages()
        incoming.receive()
        heard += incoming.messages()
        assert heard == [(FRAME, body) for body in bodies]


def test_who_does_not_read_is_never_waited_for():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        outgoing = Outgoing(ours)
        began_s = time.perf_counter()
        sent = 0
        while outgoing.ready():
            outgoing.send(FRAME, bytes(2000))
            sent += 1
        assert 10 < sent < 5000
        assert time.perf_counter() - began_s < 1.0
        assert len(outgoing._rest) <= 2005


def test_the_end_of_the_other_side_is_seen():
    ours, theirs = socket.socketpair()
    with ours:
        theirs.close()
        outgoing = Outgoing(ours)
        with pytest.raises(OSError):
            outgoing.send(FRAME, b"x")
        assert not Incoming(ours).receive()


def test_a_length_that_no_message_has_is_a_fault():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        incoming = Incoming(theirs)
        ours.sendall((BODY_MAX + 1).to_bytes(4, "big") + FRAME)
        incoming.receive()
        with pytest.raises(ValueError, match="a message of"):
            list(incoming.messages())


def process(script, said, setup=None):
    """A web process that is this script."""
    command = (sys.executable, "-c", script)
    return WebProcess(listen("127.0.0.1:0"), setup or {}, said.append, command)


def ended(web, now_us):
    """Turn until the process was seen to have ended."""
    end_s = time.monotonic() + 20.0
    while web.pid is not None:
        web.ready(now_us)
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_one_that_keeps_ending_is_told_once_and_tried_ever_less_often():
    said = []
    web = process("raise SystemExit(3)", said)
    now_us = waited_us = FIRST_WAIT_US
    try:
        web.ready(now_us)
        for _ in range(3):
            ended(web, now_us)
            assert not web.ready(now_us + waited_us - 1)
            assert web.pid is None
            now_us += waited_us
            waited_us = min(2 * waited_us, LONGEST_WAIT_US)
            web.ready(now_us)
            assert web.pid is not None
        assert said == ["the live page's process ended with status 3; it is started again"]
        ended(web, now_us + LASTING_US + 1)  # it had lived long: its end is news again
        assert len(said) == 2
    finally:
        web.close()


def test_one_that_hangs_is_ended_and_started_again():
    said = []
    web = process("import time; time.sleep(600)", said)
    now_us = FIRST_WAIT_US
    try:
        assert web.ready(now_us)
        first = web.pid
        while web.ready(now_us):  # until the pipe is full
            web.send(FRAME, bytes(1 << 16))
        now_us += HUNG_US
        assert not web.ready(now_us)
        assert web.pid == first  # slow is not hung
        now_us += 1
        web.ready(now_us)
        ended(web, now_us)
        assert said == ["the live page's process ended by signal 9; it is started again"]
        assert web.ready(now_us + LONGEST_WAIT_US)
        assert web.pid != first
        assert web.fresh
    finally:
        web.close()


def test_the_process_is_told_how_to_serve_and_never_sees_the_token_elsewhere(monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, "a secret of the environment")
    seen = tmp_path / "seen"
    script = (
        "import os, socket, sys; pipe = socket.socket(fileno=int(sys.argv[2]));"
        f"open({str(seen)!r}, 'wb').write(repr((sys.argv, dict(os.environ))).encode() + b'|'"
        " + pipe.recv(99999)); pipe.recv(1)"
    )
    web = process(script, [], {"token": "the token"})
    try:
        assert web.ready(FIRST_WAIT_US)
        end_s = time.monotonic() + 20.0
        while not (seen.exists() and b"|" in seen.read_bytes()):
            assert time.monotonic() < end_s
            time.sleep(0.01)
    finally:
        web.close()
    around, _, told = seen.read_bytes().partition(b"|")
    assert b"a secret" not in around
    assert b"the token" not in around
    assert told[4:5] == SETUP
    assert b"the token" in told


def test_one_that_does_not_end_is_ended():
    web = process("import time; time.sleep(600)", [])
    assert web.ready(FIRST_WAIT_US)
    pid = web.pid
    web.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
