"""kill -9 in flight, and the daemon again: ``python -m tests.e2e.restart [SECONDS ...]``.

A flight is played over UDP loopback, fast until the daemon has learnt, then in real time. A pitot
breaks; then the daemon is killed. While it is dead an accelerometer breaks. Each row of the table
is a restart after so many seconds, with the checkpoint and without one.
"""

import socket
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from monitor.commands.daemon_process import DaemonProcess
from sim_feeds.player import frames
from sim_feeds.scenario import parse
from tests.circuit import circuit

from .test_live import READY_S, Listener

BREAKS_S, KILLED_S = 70.0, 82.0
"""Seconds of the flight at which the pitot breaks and the daemon is killed."""

FAST = 8.0
"""Pace until shortly before that, times real time."""

STARTS_S = 30.0
"""Within this a process has started."""

SCENARIO = """\
title = "A pitot breaks, and an accelerometer while nobody looks"
aircraft = "small-uav"
seed = 7

{flight}
[imu]
count = 3

[airspeed]
count = 2

[[fault]]
sensor = "airspeed0"
kind = "bias"
size_m_s = -7.0
start_s = {breaks_s}

[[fault]]
sensor = "imu0.acc_x"
kind = "bias"
size_m_s2 = 3.0
start_s = {unseen_s}
"""


@dataclass
class Restart:
    """What a daemon did that was started after another one had been killed.

    Attributes
    ----------
    first_mask_s
        From the start of the process to the first FLT_AIR [s].
    first_masks
        FLT_AIR and MON_AIR as they were first sent.
    first_verdict_s
        From the start to the first change of state that was said [s].
    before, after
        Sensors called faulty by the killed one, and by its successor.
    faulty_from_s
        From the start to the first time that each was called faulty [s].
    announced
        STATUSTEXT of the successor.
    notes
        What it said on standard error.
    """

    first_mask_s: float = float("nan")
    first_masks: dict[str, float] = field(default_factory=dict)
    first_verdict_s: float = float("nan")
    before: list[str] = field(default_factory=list)
    after: list[str] = field(default_factory=list)
    faulty_from_s: dict[str, float] = field(default_factory=dict)
    announced: list[str] = field(default_factory=list)
    notes: str = ""


class Player:
    """Plays a flight into a port; the pace can be changed."""

    def __init__(self, flight: list[tuple[int, bytes]], port: int) -> None:
        self._flight, self._port = flight, port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._first_us = flight[0][0]
        self.t_s = 0.0
        self._thread = threading.Thread(target=self._play, daemon=True)

    def __enter__(self) -> "Player":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._flight.clear()
        self._thread.join()
        self._socket.close()

    def wait_until(self, t_s: float) -> None:
        while self.t_s < t_s and self._thread.is_alive():
            time.sleep(0.005)

    def _play(self) -> None:
        due_s = time.monotonic()
        for t_us, frame in list(self._flight):
            t_s = (t_us - self._first_us) / 1e6
            due_s += (t_s - self.t_s) / (FAST if t_s < KILLED_S - 8.0 else 1.0)
            self.t_s = t_s
            wait_s = due_s - time.monotonic()
            if wait_s > 0:
                time.sleep(wait_s)
            if not self._flight:
                return
            self._socket.sendto(frame, ("127.0.0.1", self._port))


def restart(dead_s: float, folder: Path, *, keeps: bool = True, then_s: float = 20.0) -> Restart:
    """Kill the daemon in flight, start it again after ``dead_s``; watch it from its first mask on.

    On a busy machine a process takes some seconds to start; the flight is long enough for that.
    """
    config = folder / "sentry.toml"
    config.write_text(f"[checkpoint]\ninterval_s = {1.0 if keeps else 0.0}\n")
    end_s = KILLED_S + dead_s + STARTS_S + then_s
    text = SCENARIO.format(
        flight=circuit(end_s), breaks_s=BREAKS_S, unseen_s=KILLED_S + min(dead_s, 1.0) / 2
    )
    flight = []
    for t_us, frame in frames(parse(text)):
        flight.append((t_us, frame))
        if t_us - flight[0][0] > end_s * 1e6:
            break
    out = Restart()
    with Listener() as listener:
        arguments = ("--out", f"udpout:127.0.0.1:{listener.port}", "--config", str(config))
        with DaemonProcess(arguments, state=folder / "state") as first:
            listener.wait_for("HEARTBEAT", READY_S)
            with Player(flight, first.port) as player:
                player.wait_until(KILLED_S)
                first.kill()
                out.before = _faulty(first)
                time.sleep(dead_s)
                listener.messages.clear()
                with DaemonProcess(arguments, first.port, folder / "state") as second:
                    listener.wait_for("NAMED_VALUE_FLOAT", STARTS_S)
                    player.wait_until(player.t_s + then_s)
                    second.stop()
        out.after, out.notes = _faulty(second), second.notes
        out.first_verdict_s = min((at for at, _ in second.changes), default=0) - second.started_s
        for at_s, change in second.changes:
            if change["state"] == "faulty":
                out.faulty_from_s.setdefault(change["sensor"], at_s - second.started_s)
        for at_s, message in listener.messages:
            if message.get_type() == "STATUSTEXT":
                out.announced.append(message.text)
            if message.get_type() == "NAMED_VALUE_FLOAT" and message.name.endswith("_AIR"):
                if not out.first_masks:
                    out.first_mask_s = at_s - second.started_s
                out.first_masks.setdefault(message.name, message.value)
    return out


def _faulty(daemon: DaemonProcess) -> list[str]:
    return sorted({c["sensor"] for _, c in daemon.changes if c["state"] == "faulty"})


def main() -> None:
    for dead_s in [float(a) for a in sys.argv[1:]] or [0.5, 5.0, 30.0]:
        for keeps in (True, False):
            with tempfile.TemporaryDirectory() as folder:
                found = restart(dead_s, Path(folder), keeps=keeps)
            print(f"dead for {dead_s} s, {'checkpoint' if keeps else 'no checkpoint'}: {found}")


if __name__ == "__main__":
    main()
