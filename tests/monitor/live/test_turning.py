"""The watchdog is fed by turns that worked, and what is asked for happens between turns."""

import socket
import threading
import time
from types import SimpleNamespace

import pytest

from monitor.commands.live.turning import turn_until_stopped
from monitor.service import Notifier
from monitor.verdict import StepResult


class Manager:
    """In the service manager's place."""

    def __init__(self, address):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address)
        self.socket.settimeout(0.05)

    def heard(self, seconds):
        """(seconds since now, message) of so long."""
        out, began_s = [], time.monotonic()
        while (at_s := time.monotonic() - began_s) < seconds:
            try:
                out.append((at_s, self.socket.recv(4096).decode()))
            except TimeoutError:
                continue
        return out


class Asks:
    def __init__(self):
        self.stop = False
        self.wanted = set()

    def listen(self):
        self.wanted.add("listening")

    def take_reload(self):
        return self._take("reload")

    def take_status(self):
        return self._take("status")

    def _take(self, what):
        asked = what in self.wanted
        self.wanted.discard(what)
        return asked


class Loop:
    """A daemon that turns every 10 ms, hangs on request, and can fail."""

    def __init__(self, tmp_path):
        self.order = []
        self.free = threading.Event()
        self.free.set()
        self.fails = False
        self.manager = Manager(str(tmp_path / "notify"))
        environ = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "200000"}
        self.notifier = Notifier(environ)
        self.asks = Asks()
        self.running = SimpleNamespace(
            daemon=SimpleNamespace(turn=self.turn, finish=self.finish, status=lambda recent: None),
            pipeline=SimpleNamespace(states=dict),
            links=SimpleNamespace(hub=SimpleNamespace(ended=False)),
            checkpoints=SimpleNamespace(
                turn=lambda now_us: None, close=lambda: self.order.append("checkpoint")
            ),
            looks=[lambda result: self.order.append("look")],
            now_us=lambda: time.monotonic_ns() // 1000,
        )

    def turn(self):
        time.sleep(0.01)
        self.free.wait()
        if self.fails:
            raise RuntimeError("a fault of ours")
        self.order.append("turn")
        return StepResult()

    def finish(self):
        self.order.append("finish")
        return StepResult()

    def run(self):
        try:
            turn_until_stopped(
                self.running,
                self.asks,
                self.notifier,
                lambda result, states, status: None,
                lambda: self.order.append("status"),
                lambda: self.order.append("reload"),
            )
        except RuntimeError:
            self.order.append("failed")

    def __enter__(self):
        self.thread = threading.Thread(target=self.run)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.asks.stop = True
        self.free.set()
        self.thread.join(5.0)
        assert not self.thread.is_alive()
        self.notifier.close()
        self.manager.socket.close()


@pytest.fixture
def loop(tmp_path):
    with Loop(tmp_path) as loop:
        yield loop


def test_ready_is_said_once_after_a_turn_and_the_watchdog_is_fed(loop):
    said = [text for _, text in loop.manager.heard(1.05)]
    assert said[0] == "READY=1"
    assert said.count("READY=1") == 1
    assert 6 <= said.count("WATCHDOG=1") <= 11  # each 100 ms


def test_a_loop_that_hangs_stops_the_notifications_and_they_come_back(loop):
    assert "WATCHDOG=1" in [text for _, text in loop.manager.heard(0.5)]
    loop.free.clear()
    loop.manager.heard(0.1)  # said before
    assert loop.manager.heard(0.6) == []
    loop.free.set()
    assert "WATCHDOG=1" in [text for _, text in loop.manager.heard(0.5)]


def test_a_turn_that_fails_feeds_nothing_and_ends_the_loop(loop):
    loop.manager.heard(0.3)
    loop.fails = True
    loop.manager.heard(0.1)
    assert loop.manager.heard(0.4) == []
    loop.thread.join(5.0)
    assert loop.order[-1] == "failed"


def test_a_reload_is_told_from_its_beginning_to_its_end(loop):
    loop.manager.heard(0.2)
    loop.asks.wanted.add("reload")
    said = [text for _, text in loop.manager.heard(0.4) if text != "WATCHDOG=1"]
    assert [text.split("\n")[0] for text in said] == ["RELOADING=1", "READY=1"]
    assert loop.order.count("reload") == 1


def test_at_the_end_the_state_is_kept_before_what_waits_is_judged(loop):
    loop.manager.heard(0.2)
    loop.asks.stop = True
    loop.thread.join(5.0)
    assert loop.order[-3:] == ["checkpoint", "finish", "look"]
    assert [text for _, text in loop.manager.heard(0.1)][-1] == "STOPPING=1"


def test_the_end_of_a_log_ends_it(loop):
    loop.running.links.hub.ended = True
    loop.thread.join(5.0)
    assert "finish" in loop.order


def test_the_status_is_told_when_asked(loop):
    loop.asks.wanted.add("status")
    time.sleep(0.3)
    assert loop.order.count("status") == 1
