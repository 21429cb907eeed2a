"""Serial ports through pyserial, which comes with the extra ``serial``."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from links.endpoints.base import RETRY_S, Link, LinkError, Received, now_us, plain

__all__ = ["DEFAULT_BAUD", "SerialEndpoint"]

DEFAULT_BAUD = 115200


class SerialEndpoint(Link):
    """Serial port through pyserial, opened again when the device comes back."""

    def __init__(self, name: str, device: str, baud: int) -> None:
        super().__init__(name)
        try:
            import serial
        except ImportError:
            raise LinkError(
                f"{name} is a serial port, which needs the extra: pip install 'mavsentry[serial]'"
            ) from None
        self._open: Callable[[], Any] = lambda: serial.serial_for_url(
            device, baudrate=baud, timeout=0, write_timeout=0
        )
        self._port: Any = None
        self._next_try_s = 0.0
        try:
            self._port = self._open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise plain(name, error) from None
        self.counters.opened = 1

    def recv(self, timeout_s: float) -> Received:
        deadline_s = time.monotonic() + timeout_s
        port = self._reopened()
        if port is None:
            time.sleep(timeout_s)
            return []
        try:
            port.timeout = max(deadline_s - time.monotonic(), 0.0)
            data = bytes(port.read(1))
            if data:
                port.timeout = 0
                data += bytes(port.read(max(port.in_waiting, 1)))
        except (OSError, TypeError):  # pyserial reports a vanished device as either
            self._lost()
            return []
        if not data:
            return []
        self._received(data)
        return [(data, now_us())]

    def send(self, data: bytes) -> None:
        port = self._reopened()
        try:
            if port is not None and port.write(data) == len(data):
                self._sent(len(data))
                return
        except (OSError, TypeError) as error:
            if "timeout" not in str(error).lower():
                self._lost()
        self.counters.dropped += 1

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _lost(self) -> None:
        self.close()
        self._next_try_s = time.monotonic() + RETRY_S

    def _reopened(self) -> Any:
        if self._port is None and time.monotonic() >= self._next_try_s:
            try:
                self._port = self._open()
                self.counters.opened += 1
            except (OSError, ValueError):
                self._next_try_s = time.monotonic() + RETRY_S
        return self._port
