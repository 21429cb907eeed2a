"""UDP links."""

from __future__ import annotations

import socket
from typing import Any

from links.endpoints.base import MAX_PER_RECV, Link, Received, now_us, plain, readable, resolve

__all__ = ["SOCKET_BUFFER", "UdpEndpoint"]

SOCKET_BUFFER = 4 << 20
"""Receive buffer asked of the system, so that a pause of ours loses nothing [bytes]."""

_GONE = (ConnectionError, TimeoutError)


class UdpEndpoint(Link):
    """UDP, listening (``udpin``) or speaking to one peer (``udpout``)."""

    def __init__(self, name: str, host: str, port: int, *, listen: bool) -> None:
        super().__init__(name)
        family, address = resolve(name, host, port, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._peer: Any = None
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER)
            self._socket.setblocking(False)
            if listen:
                self._socket.bind(address)
            else:
                self._socket.connect(address)
                self._peer = address
        except OSError as error:
            self._socket.close()
            raise plain(name, error) from None
        self._listen = listen
        self._readable = readable(self._socket)
        self.counters.opened = 1

    @property
    def port(self) -> int:
        """Our own port, as the system chose it for port 0."""
        return int(self._socket.getsockname()[1])

    def recv(self, timeout_s: float) -> Received:
        out: Received = []
        waited = timeout_s <= 0
        while len(out) < MAX_PER_RECV:
            try:
                if self._listen:
                    data, self._peer = self._socket.recvfrom(65535)
                else:
                    data = self._socket.recv(65535)
            except BlockingIOError:
                if out or waited or not self._readable(timeout_s):
                    break
                waited = True  # looked first, for mostly there is something
                continue
            except _GONE:  # an earlier datagram found nobody at the peer
                self.counters.dropped += 1
            else:
                if data:
                    self._received(data)
                    out.append((data, now_us()))
            if out and not self._readable(0.0):  # costs a third of an attempt in vain
                break
        return out

    def send(self, data: bytes) -> None:
        if self._peer is None:
            self.counters.dropped += 1
            return
        try:
            if self._listen:
                self._socket.sendto(data, self._peer)
            else:
                self._socket.send(data)
        except OSError:  # nobody listens there (yet), or no room or route: as a lost datagram
            self.counters.dropped += 1
        else:
            self._sent(len(data))

    def close(self) -> None:
        self._socket.close()
