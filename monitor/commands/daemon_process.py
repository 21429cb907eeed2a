"""The daemon as a process of its own, for who watches it from outside: demo, selftest, bench."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from monitor.places import STATE_VARIABLE

__all__ = ["DaemonProcess", "free_port"]


def free_port() -> int:
    """A UDP port of the loopback that nothing is bound to now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class DaemonProcess:
    """``mavsentry run --json`` on UDP loopback; its changes of state as they come.

    Parameters
    ----------
    arguments
        Further arguments of ``run``.
    port
        UDP port that it listens on; None takes a free one.
    state
        Folder of what it keeps for its next start; None gives it an empty one and removes that, so
        that it neither takes up what another has learnt nor leaves anything behind.

    Attributes
    ----------
    changes
        (host monotonic [s], verdict as JSON values), growing.
    last_status
        How its loop is doing, as it last said: at SIGUSR1 and at its end.
    started_s
        Host monotonic time of the start [s].
    """

    def __init__(
        self,
        arguments: tuple[str, ...] = (),
        port: int | None = None,
        state: Path | None = None,
    ) -> None:
        self.port = free_port() if port is None else port
        self.changes: list[tuple[float, dict[str, Any]]] = []
        self.last_status: dict[str, Any] | None = None
        self.started_s = time.monotonic()
        self._own_state = own = TemporaryDirectory(prefix="mavsentry-")
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "monitor.cli", "run", "--json"),
                *("--in", f"udpin:127.0.0.1:{self.port}", *arguments),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, STATE_VARIABLE: str(state) if state else own.name},
            # A Ctrl-C for us is no Ctrl-C for it: it is stopped by `stop`, after the last sample.
            start_new_session=True,
        )
        self._notes: list[str] = []
        self._readers = [
            threading.Thread(target=reader, daemon=True)
            for reader in (self._read_changes, self._read_notes)
        ]
        for reader in self._readers:
            reader.start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def notes(self) -> str:
        """What it said on standard error so far."""
        return "\n".join(self._notes)

    def wait_for(self, matching: dict[str, str], timeout_s: float) -> float | None:
        """Seconds from the start to the first change with these values; None if none comes.

        ``sensor`` matches a whole group too: ``imu0`` matches ``imu0.acc_x``.
        """
        end_s = time.monotonic() + timeout_s
        seen = 0
        while True:
            for at_s, change in self.changes[seen:]:
                seen += 1
                if all(
                    change[key] == value or str(change[key]).startswith(value + ".")
                    for key, value in matching.items()
                ):
                    return at_s - self.started_s
            if time.monotonic() > end_s or not self.running:
                return None
            time.sleep(0.01)

    def usage(self) -> tuple[float, float]:
        """Processor time used so far [s] and resident memory now [MB]; NaN where not told."""
        try:
            fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
            pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):
            return float("nan"), float("nan")
        ticks = int(fields[11]) + int(fields[12])
        return ticks / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def kill(self) -> None:
        """End it at once, as the kernel does when memory is short; then read what it has said."""
        self._process.kill()
        self.stop()

    def stop(self, timeout_s: float = 10.0) -> int:
        """Ask it to end, read what it still says, return its exit status."""
        if self.running:
            self._process.send_signal(signal.SIGTERM)
        try:
            status = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            status = self._process.wait()
        for reader in self._readers:
            reader.join(timeout_s)
        self._own_state.cleanup()
        for stream in (self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()
        return status

    def __enter__(self) -> DaemonProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _read_changes(self) -> None:
        for text in self._lines(self._process.stdout):
            values = json.loads(text)
            if "status" in values:
                self.last_status = values["status"]
            else:
                self.changes.append((time.monotonic(), values))

    def _read_notes(self) -> None:
        for text in self._lines(self._process.stderr):
            self._notes.append(text)

    def _lines(self, stream: Any) -> Iterator[str]:
        for text in stream:
            if text.strip():
                yield text.rstrip("\n")
