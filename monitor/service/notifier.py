"""Tells the service manager how we do: systemd's notification protocol.

A datagram of ``KEY=value`` lines to the socket that ``NOTIFY_SOCKET`` names; where none is named
every call does nothing. The watchdog is fed by the working loop itself, after a turn that worked:
a loop that hangs is silent, and systemd starts the daemon anew.

Source: sd_notify(3), sd_watchdog_enabled(3), systemd.service(5).
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import MutableMapping
from contextlib import suppress

__all__ = ["Notifier"]

_NOTIFY, _PERIOD, _PID = "NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"

STATUS_US = 5_000_000
"""The status is told this often at most."""


class Notifier:
    """Speaks to the service manager, if there is one; never waits for it.

    Parameters
    ----------
    environ
        The environment. What concerns us is taken out of it, so that programs that we start do not
        speak for us.
    pid
        Ours: the watchdog may be meant for another process.

    Attributes
    ----------
    watchdog_us
        Time between two signs of life: half of what the manager grants [us]; None if it waits for
        none.
    """

    def __init__(
        self, environ: MutableMapping[str, str] = os.environ, pid: int | None = None
    ) -> None:
        address = environ.pop(_NOTIFY, "")
        period, meant = environ.pop(_PERIOD, ""), environ.pop(_PID, "")
        self._socket: socket.socket | None = None
        self._address = "\0" + address[1:] if address.startswith("@") else address
        if address[:1] in ("/", "@") and hasattr(socket, "AF_UNIX"):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
        ours = meant in ("", str(os.getpid() if pid is None else pid))
        granted = int(period) if period.isdigit() and ours else 0
        self.watchdog_us = max(granted // 2, 1) if granted and self.active else None
        self._fed_us: int | None = None
        self._status = ""
        self._told_us: int | None = None

    @property
    def active(self) -> bool:
        """Whether there is somebody to tell."""
        return self._socket is not None

    def ready(self) -> None:
        """The loop turns, or has taken a new configuration."""
        self._say("READY=1")

    def starting(self, text: str, extend_s: float) -> None:
        """Still getting ready: what is done, and how much longer it may take at most."""
        self._say(f"STATUS={_line(text)}", f"EXTEND_TIMEOUT_USEC={round(extend_s * 1e6)}")

    def reloading(self) -> None:
        """The configuration is read anew; :meth:`ready` follows."""
        self._say("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        """We are on the way out."""
        self._say("STOPPING=1")

    def turned(self, now_us: int) -> None:
        """A turn of the loop worked: the watchdog is fed when it is time.

        Parameters
        ----------
        now_us
            Host monotonic time [us].
        """
        if self.watchdog_us is None:
            return
        if self._fed_us is None or now_us - self._fed_us >= self.watchdog_us:
            self._fed_us = now_us
            self._say("WATCHDOG=1")

    def wants_status(self, now_us: int) -> bool:
        """Whether it is time for :meth:`status`: making the sentence takes some work."""
        if not self.active or (self._told_us is not None and now_us - self._told_us < STATUS_US):
            return False
        self._told_us = now_us
        return True

    def status(self, text: str) -> None:
        """How it goes, a sentence for ``systemctl status``; the same is not said again."""
        if text != self._status:
            self._status = text
            self._say(f"STATUS={_line(text)}")

    def close(self) -> None:
        """Nothing more will be told."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _say(self, *lines: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # a manager that is gone or busy is not waited for
                self._socket.sendto("\n".join(lines).encode(), self._address)


def _line(text: str) -> str:
    return " ".join(text.split())
