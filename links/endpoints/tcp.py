"""TCP links: a client that connects again, a server for one client at a time."""

from __future__ import annotations

import errno
import select
import socket
import time

from links.endpoints.base import (
    MAX_PER_RECV,
    RETRY_S,
    STREAM_CHUNK,
    Link,
    Received,
    now_us,
    plain,
    readable,
    resolve,
)

__all__ = ["SEND_BACKLOG", "TcpClient", "TcpServer"]

SEND_BACKLOG = 1 << 20
"""Bytes kept for a peer that reads slowly; more is dropped, by whole messages."""


class _Stream:
    """One non-blocking TCP connection with a bounded backlog of what still has to leave."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sock = sock
        self.backlog = bytearray()

    def read(self) -> tuple[list[bytes], bool]:
        """Chunks that have arrived, and whether the connection still stands."""
        chunks: list[bytes] = []
        while len(chunks) < MAX_PER_RECV:
            try:
                data = self.sock.recv(STREAM_CHUNK)
            except BlockingIOError:
                break
            except OSError:
                return chunks, False
            if not data:
                return chunks, False
            chunks.append(data)
        return chunks, True

    def write(self, data: bytes) -> bool:
        """Take all of ``data`` or none of it: half a message would break the stream."""
        if len(self.backlog) + len(data) > SEND_BACKLOG:
            return False
        self.backlog += data
        self.flush()
        return True

    def flush(self) -> None:
        """Hand on what the system has room for; a broken connection shows when it is read."""
        try:
            while self.backlog:
                del self.backlog[: self.sock.send(self.backlog)]
        except OSError:
            return


class _TcpEndpoint(Link):
    """What the two sides of TCP share: one stream, or none now."""

    _stream: _Stream | None = None

    def recv(self, timeout_s: float) -> Received:
        if self._stream is None:
            return []
        self._stream.flush()
        if not readable(self._stream.sock)(timeout_s):
            return []
        chunks, standing = self._stream.read()
        if not standing:
            self._drop_stream()
        for chunk in chunks:
            self._received(chunk)
        return [(chunk, now_us()) for chunk in chunks]

    def send(self, data: bytes) -> None:
        if self._stream is not None and self._stream.write(data):
            self._sent(len(data))
        else:
            self.counters.dropped += 1

    def close(self) -> None:
        self._drop_stream()

    def _drop_stream(self) -> None:
        if self._stream is not None:
            self._stream.sock.close()
            self._stream = None

    def _start_stream(self, sock: socket.socket) -> None:
        self._drop_stream()
        self._stream = _Stream(sock)
        self.counters.opened += 1


class TcpClient(_TcpEndpoint):
    """TCP to a server, connected again whenever the connection is lost."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name)
        self._family, self._address = resolve(name, host, port, socket.SOCK_STREAM)
        self._pending: socket.socket | None = None
        self._next_try_s = 0.0
        self._connect(0.0)

    def recv(self, timeout_s: float) -> Received:
        deadline_s = time.monotonic() + timeout_s
        if self._stream is None:
            self._connect(timeout_s)
        left_s = max(deadline_s - time.monotonic(), 0.0)
        if self._stream is None:
            time.sleep(left_s)
            return []
        return super().recv(left_s)

    def send(self, data: bytes) -> None:
        if self._stream is None:
            self._connect(0.0)
        super().send(data)

    def close(self) -> None:
        super().close()
        if self._pending is not None:
            self._pending.close()
            self._pending = None

    def _connect(self, timeout_s: float) -> None:
        """Begin a connection, or see whether the one begun has come about."""
        if self._pending is None:
            if time.monotonic() < self._next_try_s:
                return
            self._next_try_s = time.monotonic() + RETRY_S
            sock = socket.socket(self._family, socket.SOCK_STREAM)
            sock.setblocking(False)
            if sock.connect_ex(self._address) not in (0, errno.EINPROGRESS, errno.EWOULDBLOCK):
                sock.close()
                return
            self._pending = sock
        _, writable, failed = select.select([], [self._pending], [self._pending], timeout_s)
        if not (writable or failed):
            return
        sock, self._pending = self._pending, None
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            sock.close()
            return
        self._start_stream(sock)


class TcpServer(_TcpEndpoint):
    """TCP server for one client at a time."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name)
        family, address = resolve(name, host, port, socket.SOCK_STREAM)
        self._server = socket.socket(family, socket.SOCK_STREAM)
        try:
            self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._server.bind(address)
            self._server.listen(4)
            self._server.setblocking(False)
        except OSError as error:
            self._server.close()
            raise plain(name, error) from None

    @property
    def port(self) -> int:
        """Our own port, as the system chose it for port 0."""
        return int(self._server.getsockname()[1])

    def recv(self, timeout_s: float) -> Received:
        deadline_s = time.monotonic() + timeout_s
        while True:
            waiting = [self._server, *([self._stream.sock] if self._stream else [])]
            left_s = max(deadline_s - time.monotonic(), 0.0)
            ready, _, _ = select.select(waiting, [], [], left_s)
            if self._server in ready:
                self._accept()
            if self._stream is not None and (out := super().recv(0.0)):
                return out
            if time.monotonic() >= deadline_s:
                return []

    def send(self, data: bytes) -> None:
        if readable(self._server)(0.0):
            self._accept()
        super().send(data)

    def close(self) -> None:
        super().close()
        self._server.close()

    def _accept(self) -> None:
        try:
            client, _ = self._server.accept()
        except OSError:  # gone again before we looked
            return
        self._start_stream(client)
