"""``mavsentry run`` on a terminal: a pseudo-terminal of a given size and kind is its screen."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time

import pytest

from monitor.commands.daemon_process import free_port

from .conftest import COMMAND

ENDS_S = 120.0

pytestmark = pytest.mark.alone


class Terminal:
    """A command on a terminal of its own, whose Ctrl-C it hears; what it has written there."""

    def __init__(self, *arguments, columns=80, lines=24, **environment):
        self._ours, theirs = pty.openpty()
        self.resize(columns, lines)
        # Where these are set, they come before the terminal's own size.
        inherited = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES")}
        self._process = subprocess.Popen(
            [*COMMAND, *map(str, arguments)],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=inherited | {"TERM": "xterm-256color"} | environment,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        os.close(theirs)
        self.written = ""

    def resize(self, columns, lines):
        fcntl.ioctl(self._ours, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))

    def type(self, keys):
        os.write(self._ours, keys)

    def read_until(self, pattern, timeout_s=ENDS_S):
        """Read on to where this stands in what is new; None reads to the end."""
        end_s, begin = time.monotonic() + timeout_s, len(self.written)
        while pattern is None or not re.search(pattern, self.written[begin:]):
            assert time.monotonic() < end_s, self.written[-2000:]
            if not select.select([self._ours], [], [], 0.1)[0]:
                continue
            try:
                self.written += os.read(self._ours, 65536).decode(errors="replace")
            except OSError:  # the other side is closed
                assert pattern is None, self.written[-2000:]
                break
        return self.written[begin:]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait(10.0)
        os.close(self._ours)

    def status(self):
        return self._process.wait(10.0)


def test_ctrl_c_ends_well_and_leaves_the_last_picture_on_a_clean_terminal():
    with Terminal("run", "--in", f"udpin:127.0.0.1:{free_port()}") as terminal:
        terminal.read_until("nothing heard of a vehicle yet")
        terminal.resize(50, 12)
        drawn, end_s = [""], time.monotonic() + ENDS_S
        while {len(line) for line in drawn} != {50}:  # pages on their way had the old size
            assert time.monotonic() < end_s, drawn
            page = terminal.read_until("(?s)vehicle yet.*\x1b\\[H").rpartition("\x1b[H")[0]
            page = page.rpartition("\x1b[H")[2]
            drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", page).split("\r\n")
        assert len(drawn) == 12
        terminal.type(b"\x03")
        terminal.read_until(None)
        assert terminal.status() == 0
    last = terminal.written.rpartition("\x1b[?1049l")[2]
    assert "nothing heard of a vehicle yet" in last
    assert "mavsentry: stopped" in last
    assert terminal.written.rindex("\x1b[?25h") > terminal.written.rindex("\x1b[?25l")
    assert "Traceback" not in terminal.written


def test_a_flight_from_a_file_ends_with_its_states_and_no_color_is_heeded(flight_log):
    with Terminal("run", "--in", flight_log, columns=100, NO_COLOR="1") as terminal:
        terminal.read_until(None)
        assert terminal.status() == 0
    last = re.sub(r"\x1b\[[0-9;]*m", "", terminal.written.rpartition("\x1b[?1049l")[2])
    assert re.search(r"1 FAULTY: airspeed0", last)
    assert re.search(r"✕ FAULTY +airspeed0 +\d+ s", last)
    assert re.search(r"✓ ok +imu0 6 axes", last)
    assert not re.search(r"\x1b\[(?:\d+;)*[349][0-7]m", terminal.written)


def test_a_terminal_that_cannot_draw_gets_a_line_for_each_change(flight_log):
    with Terminal("run", "--in", flight_log, TERM="dumb") as terminal:
        terminal.read_until(None)
        assert terminal.status() == 0
    assert "\x1b" not in terminal.written
    assert re.search(r" s  imu0.acc_x +FAULTY", terminal.written)
