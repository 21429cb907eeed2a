"""TCP links: a client that connects again, a server for several clients.

A peer that vanishes without a word (cable pulled, power gone) leaves a connection that looks open.
The system is told to ask after a silent peer and to give up on one that confirms nothing.
"""

from __future__ import annotations

import socket
from collections.abc import Hashable
from contextlib import suppress

from links.endpoints.base import (
    STREAM_CHUNK,
    Link,
    LinkOptions,
    Taken,
    now_us,
    plain,
    resolve,
    unknown,
)
from links.endpoints.opening import Opener
from links.endpoints.sending import SendQueue

__all__ = ["CONNECT_S", "MOST_CLIENTS", "TcpClient", "TcpServer"]

CONNECT_S = 5.0
"""A connection that has not come about after this time is given up [s]."""

MOST_CLIENTS = 16
"""Clients of a server at the same time; one more is turned away."""

CHUNKS_EACH = 4
"""Chunks read of one connection at a time, so that one cannot starve the others."""

_KEEP_ALIVE = (  # ask after 5 s of silence, every 2 s, three times; 10 s for what we sent
    ("TCP_KEEPIDLE", 5),
    ("TCP_KEEPINTVL", 2),
    ("TCP_KEEPCNT", 3),
    ("TCP_USER_TIMEOUT", 10_000),
)


class _Stream:
    """One non-blocking TCP connection with a bounded queue of what still has to leave."""

    def __init__(self, sock: socket.socket, queue: SendQueue) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEP_ALIVE:
            if hasattr(socket, option):  # each system has its own
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        self.sock = sock
        self.queue = queue
        self.stands = True

    def read(self, limit: int) -> list[bytes]:
        """Chunks that have arrived; ``stands`` says whether there can be more."""
        chunks: list[bytes] = []
        while self.stands and len(chunks) < limit:
            try:
                data = self.sock.recv(STREAM_CHUNK)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if data:
                chunks.append(data)
            self.stands = bool(data)
        return chunks

    def flush(self) -> None:
        """Hand on what the system has room for; a broken connection shows when it is read."""
        with suppress(OSError):
            self.queue.flush(self.sock.send)

    def close(self) -> None:
        self.queue.clear()
        self.sock.close()


class TcpClient(Link):
    """TCP to a server, connected again whenever the connection is lost or silent."""

    def __init__(self, name: str, host: str, port: int, options: LinkOptions) -> None:
        super().__init__(name, "tcp")
        self._host, self._port = host, port
        self._options = options
        self._stream: _Stream | None = None
        self._since_us = 0
        self._opener = Opener(name, self._make, socket.socket.close, options)
        self._opener.begin(now_us())
        self.tend(now_us())

    @property
    def is_open(self) -> bool:
        return self._stream is not None

    @property
    def backoff_s(self) -> float:
        return self._opener.backoff_s

    def waits(self) -> tuple[int, ...]:
        return (self._stream.sock.fileno(),) if self._stream else ()

    def take(self, limit: int) -> list[Taken]:
        if self._stream is None:
            return []
        chunks = self._stream.read(min(limit, CHUNKS_EACH))
        arrived_us = now_us()
        for chunk in chunks:
            self._received(chunk, arrived_us)
        if chunks:
            self._since_us = arrived_us
            self._opener.proven()
        if not self._stream.stands:
            self._lose(f"{self.name}: the connection was closed")
        return [Taken(chunk, arrived_us, None) for chunk in chunks]

    def send(self, data: bytes) -> None:
        if self._stream is None:
            self.tend(now_us())  # who only sends may not think of it
        if self._stream is None:
            self.counters.dropped += 1
            return
        self._stream.queue.add(data)
        self._stream.flush()

    def tend(self, now_us: int) -> None:
        if (sock := self._opener.poll(now_us)) is not None:
            self._stream = _Stream(sock, SendQueue(self._options.queue_bytes, self.counters))
            self._since_us = now_us
            self.counters.opened += 1
        if self._stream is not None:
            self._stream.flush()
            silent_s = (now_us - self._since_us) / 1e6
            if self.heard_us is not None and 0 < self._options.watchdog_s < silent_s:
                self._lose(f"{self.name} is silent for {silent_s:.0f} s")
        self.trouble = self._opener.trouble

    def close(self) -> None:
        self._opener.close()
        self._drop()

    def _lose(self, trouble: str) -> None:
        self._drop()
        self._opener.lost(trouble, now_us())
        self.trouble = trouble

    def _drop(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _make(self) -> socket.socket:
        try:  # of several addresses the first that answers
            return socket.create_connection((self._host, self._port), CONNECT_S)
        except (socket.gaierror, UnicodeError):
            raise unknown(self.name, self._host) from None
        except OSError as error:
            raise plain(self.name, error) from None


class TcpServer(Link):
    """TCP server: hears every client and sends to every one of them."""

    def __init__(self, name: str, host: str, port: int, options: LinkOptions) -> None:
        super().__init__(name, "tcpin")
        self._host, self._asked_port = host, port
        self._options = options
        self._server: socket.socket | None = None
        self._clients: dict[Hashable, _Stream] = {}
        self._opener = Opener(name, self._make, socket.socket.close, options)
        self._server = self._opener.first()
        self.trouble = self._opener.trouble

    @property
    def port(self) -> int:
        """Our own port, as the system chose it for port 0."""
        return int(self._server.getsockname()[1]) if self._server else 0

    @property
    def is_open(self) -> bool:
        return bool(self._clients)

    @property
    def backoff_s(self) -> float:
        return self._opener.backoff_s

    @property
    def peers(self) -> int:
        return len(self._clients)

    def waits(self) -> tuple[int, ...]:
        own = (self._server.fileno(),) if self._server else ()
        return (*own, *(client.sock.fileno() for client in self._clients.values()))

    def take(self, limit: int) -> list[Taken]:
        self._accept()
        out: list[Taken] = []
        for peer, client in list(self._clients.items()):
            chunks = client.read(min(limit, CHUNKS_EACH))
            arrived_us = now_us()
            for chunk in chunks:
                self._received(chunk, arrived_us)
                out.append(Taken(chunk, arrived_us, peer))
            if not client.stands:
                self._forget(peer)
        return out

    def send(self, data: bytes) -> None:
        self._accept()
        if not self._clients:
            self.counters.dropped += 1
            return
        for client in self._clients.values():
            client.queue.add(data)
            client.flush()

    def tend(self, now_us: int) -> None:
        if (server := self._opener.poll(now_us)) is not None:
            self._server = server
        for client in self._clients.values():
            client.flush()
        self.trouble = self._opener.trouble

    def close(self) -> None:
        self._opener.close()
        for peer in list(self._clients):
            self._forget(peer)
        if self._server is not None:
            self._server.close()
            self._server = None

    def _accept(self) -> None:
        while self._server is not None:
            try:
                sock, address = self._server.accept()
            except OSError:  # nobody waits, or gone again before we looked
                return
            if len(self._clients) >= MOST_CLIENTS:
                sock.close()
                continue
            queue = SendQueue(self._options.queue_bytes, self.counters)
            self._clients[address] = _Stream(sock, queue)
            self.counters.opened += 1

    def _forget(self, peer: Hashable) -> None:
        self._clients.pop(peer).close()

    def _make(self) -> socket.socket:
        family, address = resolve(self.name, self._host, self._asked_port, socket.SOCK_STREAM)
        server = socket.socket(family, socket.SOCK_STREAM)
        try:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind(address)
            server.listen(MOST_CLIENTS)
            server.setblocking(False)
        except OSError as error:
            server.close()
            raise plain(self.name, error) from None
        return server
