"""What signals ask for, in a process of its own."""

import os
import pty
import select
import signal
import subprocess
import sys
import time

import pytest

SCRIPT = """
import sys, time
from monitor.commands.live.signals import Signals
signals = Signals()
print("made", flush=True)
time.sleep(float(sys.argv[1]))
signals.listen()
print("listens", flush=True)
while not signals.stop:
    if signals.take_reload(): print("reload", flush=True)
    if signals.take_status(): print("status", flush=True)
    time.sleep(0.01)
print("stops", flush=True)
time.sleep(float(sys.argv[2]))
print("stopped", flush=True)
"""


class Process:
    def __init__(self, before_s=0.0, after_s=0.0, terminal=False):
        arguments = [sys.executable, "-c", SCRIPT, str(before_s), str(after_s)]
        if terminal:
            pid, self._out = pty.fork()
            if pid == 0:
                os.execv(arguments[0], arguments)
            self.pid, self._process = pid, None
        else:
            self._process = subprocess.Popen(arguments, stdout=subprocess.PIPE)
            self.pid, self._out = self._process.pid, self._process.stdout.fileno()
        self.said = ""

    def until(self, word, timeout_s=20.0):
        end_s = time.monotonic() + timeout_s
        while word not in self.said.split():
            assert time.monotonic() < end_s, self.said
            if select.select([self._out], [], [], 0.1)[0]:
                self.said += os.read(self._out, 4096).decode()
        return self

    def send(self, *numbers):
        for number in numbers:
            os.kill(self.pid, number)
            time.sleep(0.1)
        return self

    def hang_up(self):
        os.close(self._out)
        return self

    def end(self):
        """Exit status, or minus the signal that ended it."""
        if self._process is None:
            return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        self.said += self._process.stdout.read().decode()
        self._process.stdout.close()
        return self._process.wait(20.0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_one_request_to_stop_stops_in_order(number):
    process = Process().until("listens").send(number)
    assert process.end() == 0
    assert process.said.split()[-2:] == ["stops", "stopped"]


@pytest.mark.parametrize(
    ("first", "second"),
    [(signal.SIGTERM, signal.SIGTERM), (signal.SIGINT, signal.SIGTERM)],
)
def test_a_second_one_ends_at_once(first, second):
    process = Process(after_s=30.0).until("listens").send(first).until("stops").send(second)
    began_s = time.monotonic()
    assert process.end() == -second
    assert time.monotonic() - began_s < 5.0
    assert "stopped" not in process.said


def test_before_the_loop_turns_a_request_ends_it_with_status_0():
    process = Process(before_s=30.0).until("made").send(signal.SIGTERM)
    assert process.end() == 0
    assert "listens" not in process.said


def test_a_reload_or_a_status_before_the_loop_turns_harms_nothing():
    process = Process(before_s=1.0).until("made").send(signal.SIGHUP, signal.SIGUSR1)
    process.until("listens").send(signal.SIGTERM)
    assert process.end() == 0


def test_reload_and_status_are_asked_for_once_each():
    process = Process().until("listens").send(signal.SIGHUP, signal.SIGUSR1, signal.SIGHUP)
    process.until("status").send(signal.SIGTERM)
    assert process.end() == 0
    assert sorted(process.said.split()[2:5]) == ["reload", "reload", "status"]


def test_on_a_terminal_that_is_there_a_hangup_signal_reloads():
    process = Process(terminal=True).until("listens").send(signal.SIGHUP).until("reload")
    process.send(signal.SIGTERM).until("stopped")
    assert process.end() == 0


def test_a_terminal_that_goes_away_stops_it_in_order():
    process = Process(terminal=True).until("listens").hang_up()
    assert process.end() == 0
