"""A UDP relay between a vehicle and the daemon that loses, delays and repeats what it carries.

The stages are those of :mod:`tests.impairments`; here they act in real time, on one datagram at a
time. Their times are microseconds since the relay began.
"""

from __future__ import annotations

import heapq
import select
import socket
import threading
import time
from types import TracebackType
from typing import Self

from tests.impairments import Impairment

__all__ = ["Relay"]

LONGEST_WAIT_S = 0.05


class Relay:
    """Carries datagrams from its own port to another, through stages that may be exchanged.

    Parameters
    ----------
    to_port
        UDP port of the loopback that gets what comes through.

    Attributes
    ----------
    port
        Where to send to.
    stages
        What is done to each datagram, in this order; may be replaced at any time.
    taken, given
        Datagrams that came in and went out.
    """

    def __init__(self, to_port: int) -> None:
        self._to = ("127.0.0.1", to_port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self.stages: tuple[Impairment, ...] = ()
        self.taken = self.given = 0
        self._began_ns = time.monotonic_ns()
        self._waiting: list[tuple[int, int, bytes]] = []
        self._ended = False
        self._thread = threading.Thread(target=self._carry, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._ended = True
        self._thread.join()
        self._socket.close()

    def now_us(self) -> int:
        """Time that the stages are told [us]."""
        return (time.monotonic_ns() - self._began_ns) // 1000

    def _carry(self) -> None:
        while not self._ended:
            wait_s = LONGEST_WAIT_S
            if self._waiting:
                wait_s = min(wait_s, max(0.0, (self._waiting[0][0] - self.now_us()) / 1e6))
            if select.select([self._socket], [], [], wait_s)[0]:
                self._take()
            self._give()

    def _take(self) -> None:
        """Let all that has arrived pass the stages."""
        while True:
            try:
                datagram = self._socket.recv(65536)
            except BlockingIOError:
                return
            self.taken += 1
            passed = [(self.now_us(), datagram)]
            for stage in self.stages:
                passed = [arrival for item in passed for arrival in stage(*item)]
            for due_us, data in passed:
                heapq.heappush(self._waiting, (due_us, self.taken, data))

    def _give(self) -> None:
        """Send what is due."""
        now_us = self.now_us()
        while self._waiting and self._waiting[0][0] <= now_us:
            self._socket.sendto(heapq.heappop(self._waiting)[2], self._to)
            self.given += 1
