"""A trial on this machine: a synthetic aircraft over UDP into the daemon, and what came of it.

Three processes, as in use: the feed sends MAVLink to the daemon, the daemon publishes to us. We
know the truth and the daemon does not.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from monitor.commands.common import Refused
from monitor.commands.daemon_process import DaemonProcess

if TYPE_CHECKING:
    from links.samples import Rows
    from monitor.analyze import Analysis

__all__ = ["Listener", "Trial", "try_out"]

COMPILE_TIMEOUT_S = 3600.0
"""Time that the daemon may take to compile its kernels, once on a machine."""

SETTLE_S = 1.0

_WHILE_STARTING = {
    "compiling": "compiling kernels, once on this machine ...",
    "live page on": "",
}
"""What of a starting daemon's notes is passed on: as it stands, or in other words."""


class Listener:
    """Hears what the daemon publishes, with a ground station's decoder (pymavlink).

    Attributes
    ----------
    port
        UDP port of the loopback to publish to.
    messages
        (host monotonic [s], message), growing.
    t_us
        Newest vehicle time heard [us]; 0 before any.
    """

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.2)
        self.port = int(self._socket.getsockname()[1])
        self.messages: list[tuple[float, Any]] = []
        self.t_us = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Listener:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def of(self, kind: str) -> list[Any]:
        """Messages of one name so far."""
        return [message for _, message in list(self.messages) if message.get_type() == kind]

    def _listen(self) -> None:
        from pymavlink.dialects.v20 import ardupilotmega

        parser = ardupilotmega.MAVLink(None)
        while not self._ended.is_set():
            try:
                data = self._socket.recv(65535)
            except TimeoutError:
                continue
            for message in parser.parse_buffer(data) or ():
                self.messages.append((time.monotonic(), message))
                if message.get_type() == "NAMED_VALUE_FLOAT":
                    self.t_us = max(self.t_us, message.time_boot_ms * 1000)


@dataclass(frozen=True, slots=True)
class Trial:
    """What was broken, what the daemon said, and what its recording says afterwards.

    Attributes
    ----------
    truth
        ``truth.json`` of the feed.
    analysis
        Of the daemon's own recording.
    changes
        Changes of state that the daemon printed, as JSON values.
    status
        How the daemon's loop did, as JSON values.
    recording
        The telemetry log.
    estimates
        Name -> rows, of the analysis.
    busy
        Processor time of the daemon per second while the flight was fed [s/s]; NaN if not told.
    """

    truth: dict[str, Any]
    analysis: Analysis
    changes: list[dict[str, Any]]
    status: dict[str, Any]
    recording: Path
    estimates: Mapping[str, Rows]
    busy: float = float("nan")

    def agrees(self) -> bool:
        """Whether the daemon said in flight exactly what its recording gives afterwards."""
        from monitor.commands.showing import as_json

        again = [json.loads(json.dumps(as_json(v))) for v in self.analysis.verdicts]
        return again == self.changes


def try_out(
    scenario: str,
    profile: str,
    speed: float,
    out: Path,
    say: Callable[[str], None],
    further: tuple[str, ...] = (),
) -> Trial:
    """Fly a scenario into a daemon on this machine.

    Parameters
    ----------
    scenario, profile
        What flies, and the settings that it is watched with.
    speed
        Times real time.
    out
        Folder for the recording and the truth.
    say
        Told what breaks and what the daemon publishes, as it happens.
    further
        Arguments of the daemon.

    Raises
    ------
    Refused
        The daemon or the feed ended early; the sentence is theirs.
    """
    from monitor.analyze import analyze_log
    from monitor.recording import Estimates
    from monitor.settings import load

    recordings = out / "recording"
    for old in recordings.glob("mavsentry-*.tlog"):
        old.unlink()
    with Listener() as listener:
        arguments = ("--out", f"udpout:127.0.0.1:{listener.port}", "--profile", profile)
        with DaemonProcess((*arguments, "--record", str(recordings), *further)) as daemon:
            _until_ready(daemon, listener, say)
            began_s, used_s = time.monotonic(), daemon.usage()[0]
            truth = _fly(scenario, speed, out, daemon, listener, say)
            busy = (daemon.usage()[0] - used_s) / (time.monotonic() - began_s)
            time.sleep(SETTLE_S)
            if daemon.stop() != 0:
                raise Refused(f"the daemon failed: {daemon.notes}")
    (recording,) = recordings.glob("mavsentry-*.tlog")
    estimates = Estimates()
    analysis = analyze_log(recording, load(profile), sink=estimates)
    changes = [change for _, change in daemon.changes]
    status = daemon.last_status or {}
    return Trial(truth, analysis, changes, status, recording, estimates.joined(), busy)


def _until_ready(daemon: DaemonProcess, listener: Listener, say: Callable[[str], None]) -> None:
    """Wait for the first heartbeat: the daemon then works."""
    end_s = time.monotonic() + COMPILE_TIMEOUT_S
    told: set[str] = set()
    while not listener.of("HEARTBEAT"):
        if not daemon.running or time.monotonic() > end_s:
            raise Refused(f"the daemon did not start: {daemon.notes}")
        for line in daemon.notes.splitlines():
            for mark, said in _WHILE_STARTING.items():
                if mark in line and mark not in told:
                    told.add(mark)
                    say(said or line.removeprefix("mavsentry: "))
        time.sleep(0.05)


def _fly(
    scenario: str,
    speed: float,
    out: Path,
    daemon: DaemonProcess,
    listener: Listener,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Run the feed to its end; return the truth."""
    truth_file = out / "truth.json"
    truth_file.unlink(missing_ok=True)
    feed = subprocess.Popen(
        [
            *(sys.executable, "-m", "monitor.cli", "feed", scenario, "--speed", str(speed)),
            *("--to", f"udpout:127.0.0.1:{daemon.port}", "--truth", str(out)),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        commentary = _Commentary(truth_file, listener, say)
        while feed.poll() is None:
            commentary.go_on()
            if not daemon.running:
                raise Refused(f"the daemon failed: {daemon.notes}")
            time.sleep(0.05)
        _, said = feed.communicate()
    finally:
        if feed.poll() is None:
            feed.kill()
            feed.wait()
    if feed.returncode != 0:
        raise Refused(f"the feed failed: {said.strip().removeprefix('mavsentry: ')}")
    time.sleep(SETTLE_S)
    commentary.go_on()
    truth: dict[str, Any] = json.loads(truth_file.read_text(encoding="utf-8"))
    return truth


class _Commentary:
    """Says in order of vehicle time what breaks (from the truth) and what is published."""

    def __init__(self, truth_file: Path, listener: Listener, say: Callable[[str], None]) -> None:
        self._truth_file = truth_file
        self._listener = listener
        self._say = say
        self._events: list[tuple[int, str]] | None = None
        self._first_us = 0
        self._heard = 0

    def go_on(self) -> None:
        """Say what is new."""
        if self._events is None and self._truth_file.exists() and self._listener.t_us:
            truth = json.loads(self._truth_file.read_text(encoding="utf-8"))
            self._first_us = truth["first_t_us"]
            self._events = sorted(
                (fault[key], f"  {fault['sensor']} {what}")
                for fault in truth["faults"]
                for key, what in (
                    ("onset_t_us", f"breaks: {fault['model']}"),
                    ("end_t_us", "is whole again"),
                )
                if fault[key] is not None
            )
            airborne_s = truth["airborne"]["from_s"]
            if airborne_s is not None:
                self._events.insert(0, (self._first_us + round(airborne_s * 1e6), "  takes off"))
        while self._events and self._events[0][0] <= self._listener.t_us:
            self._tell(*self._events.pop(0))
        messages = list(self._listener.messages)
        for _, message in messages[self._heard :]:
            if message.get_type() == "STATUSTEXT":
                self._tell(self._listener.t_us, f"STATUSTEXT  {message.text}")
        self._heard = len(messages)

    def _tell(self, t_us: int, text: str) -> None:
        self._say(f"{(t_us - self._first_us) / 1e6:7.1f} s  {text}")
