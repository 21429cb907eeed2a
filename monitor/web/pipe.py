"""Messages between the daemon and its web process, over a pair of connected sockets.

Each is a length (four bytes, big-endian), a kind (one byte) and its body. The daemon's end never
waits: what the socket does not take at once stays with it until the next try, and nothing new is
accepted before that is gone.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from typing import Final

__all__ = ["BEGIN", "FRAME", "SETUP", "Incoming", "Outgoing"]

SETUP, BEGIN, FRAME = b"s", b"b", b"f"
"""Kinds: how to serve, what stands now, a frame."""

BODY_MAX: Final = 1 << 23
"""Bytes of a message; a longer one is a fault of ours."""

_HEAD = struct.Struct(">Ic")
_CHUNK = 1 << 18


class Outgoing:
    """The daemon's end.

    Parameters
    ----------
    end
        Of the pair; made non-blocking.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        self._rest = b""

    def ready(self) -> bool:
        """Whether a message would be accepted; sends on what still waits.

        Raises
        ------
        OSError
            The other side is gone.
        """
        if self._rest:
            try:
                self._rest = self._rest[self._end.send(self._rest) :]
            except BlockingIOError:
                return False
        return not self._rest

    def send(self, kind: bytes, body: bytes) -> None:
        """Send a message as far as it goes; only when :meth:`ready`.

        Raises
        ------
        OSError
            The other side is gone.
        """
        self._rest = _HEAD.pack(len(body), kind) + body
        self.ready()

    def close(self) -> None:
        """The other side then sees the end."""
        self._end.close()


class Incoming:
    """Bytes as they come to whole messages.

    Parameters
    ----------
    end
        Of the pair.
    """

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._held = bytearray()

    def receive(self) -> bool:
        """Take what has come; False when the other side has ended."""
        try:
            data = self._end.recv(_CHUNK)
        except BlockingIOError:
            return True
        except OSError:
            return False
        self._held += data
        return bool(data)

    def messages(self) -> Iterator[tuple[bytes, bytes]]:
        """Kind and body of every whole message.

        Raises
        ------
        ValueError
            A length that no message has.
        """
        while len(self._held) >= _HEAD.size:
            length, kind = _HEAD.unpack_from(self._held)
            if length > BODY_MAX:
                raise ValueError(f"a message of {length} bytes")
            end = _HEAD.size + length
            if len(self._held) < end:
                return
            body = bytes(self._held[_HEAD.size : end])
            del self._held[:end]
            yield kind, body
