"""UDP links: one that listens to whoever speaks, one that speaks to a single peer."""

from __future__ import annotations

import ipaddress
import socket
import struct
from abc import abstractmethod
from collections.abc import Hashable
from contextlib import suppress
from typing import Any

from links.endpoints.base import (
    Link,
    LinkOptions,
    Taken,
    now_us,
    plain,
    resolve,
)
from links.endpoints.flood_guard import FloodGuard
from links.endpoints.opening import Opener
from links.endpoints.peers import Peers, Strangers

__all__ = ["SOCKET_BUFFER", "UdpListener", "UdpSpeaker"]

SOCKET_BUFFER = 4 << 20
"""Receive buffer asked of the system, so that a pause of ours loses nothing [bytes]."""

MAX_DATAGRAM = 65535

LOOK_AFTER_US = 1_000_000
"""How often the system is asked what it threw away [us]."""

_GONE = (ConnectionError, TimeoutError)
_MEMINFO = 55  # SO_MEMINFO of Linux: nine counts, the last one of datagrams thrown away
_DROPS = struct.Struct("9I")


class _Udp(Link):
    """What both kinds share: the socket, and the opener that makes it."""

    def __init__(self, name: str, kind: str, host: str, port: int, options: LinkOptions) -> None:
        super().__init__(name, kind)
        self._host, self._asked_port = host, port
        self._options = options
        self._socket: socket.socket | None = None
        self._thrown_away = 0
        self._looked_us = 0
        self._opener = Opener(name, self._make, socket.socket.close, options)
        self._stands(self._opener.first())

    @property
    def port(self) -> int:
        """Our own port, as the system chose it for port 0; 0 while there is no socket."""
        return int(self._socket.getsockname()[1]) if self._socket else 0

    @property
    def is_open(self) -> bool:
        return self._socket is not None

    @property
    def backoff_s(self) -> float:
        return self._opener.backoff_s

    def waits(self) -> tuple[int, ...]:
        return (self._socket.fileno(),) if self._socket else ()

    def tend(self, now_us: int) -> None:
        if (made := self._opener.poll(now_us)) is not None:
            self._stands(made)
        if self._socket is not None and now_us - self._looked_us >= LOOK_AFTER_US:
            self._looked_us = now_us
            thrown_away = _thrown_away(self._socket)
            self._count_thrown_away(thrown_away - self._thrown_away)
            self._thrown_away = thrown_away
        self.trouble = self._opener.trouble

    def close(self) -> None:
        self._opener.close()
        self._drop()

    def _count_thrown_away(self, count: int) -> None:
        self.counters.overflowed += count

    @abstractmethod
    def _make(self) -> socket.socket:
        """Open the socket; may take long."""

    def _stands(self, made: socket.socket | None) -> None:
        self._socket = made
        self.counters.opened += made is not None
        self.trouble = self._opener.trouble

    def _lose(self, trouble: str) -> None:
        self._drop()
        self._opener.lost(trouble, now_us())
        self.trouble = trouble

    def _drop(self) -> None:
        if self._socket is not None:
            self._thrown_away = 0
            self._socket.close()
            self._socket = None

    def _new_socket(self, family: int) -> socket.socket:
        sock = socket.socket(family, socket.SOCK_DGRAM)
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER)
        return sock


class UdpListener(_Udp):
    """``udpin``: hears whoever speaks, answers every peer that was believed."""

    def __init__(self, name: str, host: str, port: int, options: LinkOptions) -> None:
        self._peers = Peers(options.peer_timeout_s)
        self._strangers = Strangers()
        self._strange = 0
        self._guard = FloodGuard()
        super().__init__(name, "udpin", host, port, options)

    @property
    def peers(self) -> int:
        return len(self._peers)

    def take(self, limit: int) -> list[Taken]:
        out: list[Taken] = []
        if self._socket is None:
            return out
        receive, peers = self._socket.recvfrom, self._peers
        protect = len(peers) > 0
        arrived_us, size = now_us(), 0
        for _ in range(limit):
            try:
                data, peer = receive(MAX_DATAGRAM)
            except BlockingIOError:
                break
            except _GONE:  # an earlier datagram found nobody at its peer
                self.counters.dropped += 1
                continue
            except OSError as error:
                self._lose(str(plain(self.name, error)))
                break
            if not data:
                continue
            if protect and peer not in peers:
                self._strange += 1
                if not self._strangers.lets(peer, arrived_us):
                    self.counters.refused += 1
                    continue
            size += len(data)
            out.append(Taken(data, arrived_us, peer))
        if out:
            self.counters.received += len(out)
            self.counters.received_bytes += size
            self.heard_us = arrived_us
        return out

    def accepted(self, peer: Hashable, now_us: int) -> None:
        known = peer in self._peers
        self._peers.heard(peer, now_us)
        if not known:
            self._strangers.pardon(peer)
            if self._socket is not None:
                self._guard.renew(self._socket, self._peers)

    def tend(self, now_us: int) -> None:
        super().tend(now_us)
        self._peers.forget_silent(now_us)
        if self._socket is not None:
            refused = self.counters.refused
            self._guard.tend(self._socket, self._peers, self._strange, refused, now_us)

    def send(self, data: bytes) -> None:
        if self._socket is None or not self._peers:
            self.counters.dropped += 1
            return
        for peer in self._peers:
            try:
                self._socket.sendto(data, peer)  # type: ignore[call-overload]
            except OSError:  # nobody there (any more), or no room or route: a lost datagram
                self.counters.dropped += 1
            else:
                self._sent(len(data))

    def _count_thrown_away(self, count: int) -> None:
        if self._guard.on:  # what the guard has thrown away counts among them
            self.counters.refused += count
        else:
            self.counters.overflowed += count

    def _drop(self) -> None:
        super()._drop()
        self._guard.reset()

    def _make(self) -> socket.socket:
        family, address = resolve(self.name, self._host, self._asked_port, socket.SOCK_DGRAM)
        sock = self._new_socket(family)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise plain(self.name, error) from None
        return sock


class UdpSpeaker(_Udp):
    """``udpout``: speaks to one peer and hears only it.

    The peer's name is asked for again while nobody answers there, and in a silence of somebody who
    had been heard: names move to other addresses. The socket stands meanwhile.
    """

    def __init__(self, name: str, host: str, port: int, options: LinkOptions) -> None:
        self._own_port = self._turn = 0
        self._named = not _is_address(host)
        self._watchdog_us = round(options.watchdog_s * 1e6)
        self._heard_here = False
        super().__init__(name, "udpout", host, port, options)

    def take(self, limit: int) -> list[Taken]:
        out: list[Taken] = []
        for _ in range(limit):
            if self._socket is None:
                break
            try:
                data = self._socket.recv(MAX_DATAGRAM)
            except BlockingIOError:
                break
            except _GONE as error:
                self._unheard(error)
                continue
            except OSError as error:
                self._lose(str(plain(self.name, error)))
                break
            if data:
                arrived_us = now_us()
                self._received(data, arrived_us)
                out.append(Taken(data, arrived_us, None))
        if out:
            self._heard_here = True
            self._opener.proven()
        return out

    def send(self, data: bytes) -> None:
        if self._socket is None:
            self.tend(now_us())  # who only sends may not think of it
        if self._socket is None:
            self.counters.dropped += 1
            return
        try:
            self._socket.send(data)
        except BlockingIOError:
            self.counters.dropped += 1
        except _GONE as error:  # nobody listens there (yet)
            self._unheard(error)
        except OSError as error:  # no route, no such address of ours any more
            self.counters.dropped += 1
            self._lose(str(plain(self.name, error)))
        else:
            self._sent(len(data))

    def tend(self, now_us: int) -> None:
        super().tend(now_us)
        silent_us = now_us - self.heard_us if self.heard_us is not None else 0
        if self._heard_here and 0 < self._watchdog_us < silent_us:
            self._ask_again(f"nothing is heard of {self.name}")

    def _unheard(self, error: OSError) -> None:
        self.counters.dropped += 1
        self._ask_again(str(plain(self.name, error)))

    def _ask_again(self, trouble: str) -> None:
        """See whether the peer's name leads elsewhere by now."""
        if self._named and self._opener.idle:
            self._opener.lost(trouble, now_us())

    def _make(self) -> socket.socket:
        where = (self.name, self._host, self._asked_port, socket.SOCK_DGRAM)
        family, address = resolve(*where, turn=self._turn)
        self._turn += 1  # localhost may be ::1 and 127.0.0.1: whoever listens is found
        sock = self._new_socket(family)
        try:
            if self._own_port:  # by which the peer may know us
                with suppress(OSError):
                    sock.bind(("", self._own_port))
            sock.connect(address)
        except OSError as error:
            sock.close()
            raise plain(self.name, error) from None
        return sock

    def _stands(self, made: socket.socket | None) -> None:
        if made is not None and self._socket is not None:
            if made.getpeername() == self._socket.getpeername():
                made.close()
                return
            self._drop()
        super()._stands(made)
        if made is not None:
            self._heard_here = False
            self._own_port = int(made.getsockname()[1])


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    return True


def _thrown_away(sock: socket.socket) -> int:
    """Datagrams that the system threw away for want of room; 0 where it does not tell."""
    try:
        told: Any = sock.getsockopt(socket.SOL_SOCKET, _MEMINFO, _DROPS.size)
    except OSError:
        return 0
    return int(_DROPS.unpack(told)[8]) if len(told) == _DROPS.size else 0
