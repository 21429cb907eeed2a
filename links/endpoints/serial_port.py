"""Serial ports through pyserial, which comes with the extra ``serial``.

A USB device may come back under another name (ttyACM0, then ttyACM1). Name it by what does not
change: ``/dev/serial/by-id/usb-...``, a pattern such as ``/dev/serial/by-id/*CubeOrange*-if00``, or
pyserial's ``hwgrep://2DAE:1016`` (vendor and product, a serial number or part of a description).
The name is looked up anew at each opening, and a name that has come to mean another device is
followed.
"""

from __future__ import annotations

import glob
import os
import select
from contextlib import suppress
from typing import Any

from links.endpoints.base import (
    STREAM_CHUNK,
    Link,
    LinkError,
    LinkOptions,
    Taken,
    now_us,
    plain,
)
from links.endpoints.opening import Opener, aside
from links.endpoints.sending import SendQueue

__all__ = ["DEFAULT_BAUD", "SerialEndpoint"]

DEFAULT_BAUD = 115200

BITS_PER_BYTE = 10
"""Start, eight of data, stop."""

LOOK_AFTER_US = 1_000_000
"""How often it is looked whether the name still means the device that is open [us]."""

PERMISSION = (
    "the user must belong to the group that owns the device, mostly dialout: "
    "sudo usermod -aG dialout $USER, then log in again"
)


class SerialEndpoint(Link):
    """Serial port, opened in a thread again and again while the device is away."""

    def __init__(self, name: str, device: str, baud: int, options: LinkOptions) -> None:
        super().__init__(name, "serial")
        try:
            import serial
        except ImportError:
            raise LinkError(
                f"{name} is a serial port, which needs the extra: pip install 'mavsentry[serial]'"
            ) from None
        self._serial: Any = serial
        self._device, self._baud = device, baud
        self._watchdog_us = round(options.watchdog_s * 1e6)
        # What would take longer than a second to leave is worth less than what is newer.
        self._queue_bytes = min(options.queue_bytes, max(baud // BITS_PER_BYTE, 1024))
        self._queue = SendQueue(self._queue_bytes, self.counters)
        self._port: Any = None
        self._descriptor: int | None = None
        self._since_us = self._looked_us = 0
        self._opener = Opener(name, self._make, _close, options)
        self._stands(self._opener.first(), now_us())

    @property
    def is_open(self) -> bool:
        return self._port is not None

    @property
    def backoff_s(self) -> float:
        return self._opener.backoff_s

    @property
    def blind(self) -> bool:
        return self._port is not None and self._descriptor is None

    def waits(self) -> tuple[int, ...]:
        return () if self._descriptor is None else (self._descriptor,)

    def take(self, limit: int) -> list[Taken]:
        if self._port is None:
            return []
        try:
            data = self._read()
        except BlockingIOError:
            return []
        except (OSError, TypeError) as error:  # pyserial reports a vanished device as either
            self._lose(f"{self.name}: the device is gone ({error})")
            return []
        if data is None:
            return []
        arrived_us = now_us()
        self._since_us = arrived_us
        self._received(data, arrived_us)
        self._opener.proven()
        return [Taken(data, arrived_us, None)]

    def send(self, data: bytes) -> None:
        if self._port is None:
            self.tend(now_us())  # who only sends may not think of it
        if self._port is None:
            self.counters.dropped += 1
            return
        self._queue.add(data)
        self._flush()

    def tend(self, now_us: int) -> None:
        if (port := self._opener.poll(now_us)) is not None:
            self._stands(port, now_us)
        if self._port is not None:
            self._flush()
        if self._port is not None:
            silent_us = now_us - self._since_us
            if self.heard_us is not None and 0 < self._watchdog_us < silent_us:
                self._lose(f"{self.name} is silent for {silent_us / 1e6:.0f} s")
            elif now_us - self._looked_us >= LOOK_AFTER_US:
                self._looked_us = now_us
                if self._elsewhere():
                    self._lose(f"{self.name} is another device now")
        self.trouble = self._opener.trouble

    def close(self) -> None:
        self._opener.close()
        self._drop()

    def _read(self) -> bytes | None:
        """What there is, None if nothing; raises OSError when the device is gone."""
        if self._descriptor is None:
            waiting = self._port.in_waiting
            return bytes(self._port.read(waiting)) if waiting else None
        data = os.read(self._descriptor, STREAM_CHUNK)
        if not data and _hung_up(self._descriptor):
            raise OSError("hung up")
        return data or None

    def _flush(self) -> None:
        write = self._port.write
        if (descriptor := self._descriptor) is not None:
            write = lambda data: os.write(descriptor, data)  # noqa: E731
        try:
            self._queue.flush(write)
        except (OSError, TypeError) as error:
            if "timeout" not in str(error).lower():  # pyserial's word for no room now
                self._lose(f"{self.name}: the device is gone ({error})")

    def _stands(self, port: Any, now_us: int) -> None:
        self._port = port
        self._descriptor = None
        self.trouble = self._opener.trouble
        if port is None:
            return
        self.counters.opened += 1
        self._since_us = now_us
        if os.name == "posix":
            with suppress(AttributeError, OSError):  # none behind loop://, rfc2217://
                self._descriptor = port.fileno()

    def _elsewhere(self) -> bool:
        """Whether the name leads to another device than the one that is open."""
        if self._descriptor is None:
            return False
        try:
            now = os.stat(self._device)
            ours = os.fstat(self._descriptor)
        except OSError:  # a pattern, or the name is away: the port itself will tell
            return False
        return (now.st_rdev, now.st_ino) != (ours.st_rdev, ours.st_ino)

    def _lose(self, trouble: str) -> None:
        self._drop()
        self._opener.lost(trouble, now_us())
        self.trouble = trouble

    def _drop(self) -> None:
        if self._port is not None:
            _close(self._port)
            self._port = self._descriptor = None
            self._queue.clear()

    def _make(self) -> Any:
        device = self._device
        more: dict[str, object] = {}
        if "://" not in device:
            more["exclusive"] = True if os.name == "posix" else None
            if any(sign in device for sign in "*?["):
                found = sorted(glob.glob(device))
                if not found:
                    raise LinkError(
                        f"cannot open {self.name}: no device fits; "
                        "`ls /dev/serial/by-id` lists those that are there",
                        may_mend=True,
                    )
                device = found[0]
        try:
            return self._serial.serial_for_url(
                device, baudrate=self._baud, timeout=0, write_timeout=0, **more
            )
        except (OSError, ValueError) as error:  # SerialException is an OSError
            denied = isinstance(error, PermissionError) or getattr(error, "errno", 0) == 13
            raise plain(self.name, error, PERMISSION if denied else "") from None


def _hung_up(descriptor: int) -> bool:
    """Whether the device behind it has gone; to a read that looks like a silence."""
    asked = select.poll()
    asked.register(descriptor, 0)
    return bool(asked.poll(0))


def _close(port: Any) -> None:
    """Close a port; it may wait for what still has to leave, hence aside."""

    def close() -> None:
        with suppress(OSError):
            port.close()

    aside(close, "close a serial port")
