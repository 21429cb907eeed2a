"""Against a flood on a UDP socket: the system itself throws most of what strangers send away.

A flood of small datagrams fills the socket's buffer within milliseconds where the system grants
little (``net.core.rmem_max`` is 208 KiB by default), and then the vehicle's are lost with the rest.
So, while there is a flood, a classic BPF program on the socket lets the datagrams of believed peers
pass and a random share of all others: enough for a vehicle that comes back from another address,
too few to do harm. It needs no privilege. Where there is none (not Linux) the flood is read and
thrown away by us, which is enough as long as the buffer is.
"""

from __future__ import annotations

import ctypes
import socket
import struct
import sys
from collections.abc import Hashable, Iterable
from typing import Final

__all__ = ["FloodGuard"]

ALARM: Final = 500
"""Datagrams refused within a second that are a flood."""

SHARE_PER_S: Final = 500.0
"""Strangers' datagrams that are to come through each second."""

CALM_PER_S: Final = 250.0
"""Strangers' datagrams sent a second at which the flood is over."""

_PERIOD_US = 1_000_000
_ATTACH, _DETACH = 26, 27  # SO_ATTACH_FILTER, SO_DETACH_FILTER of Linux

# Classic BPF: linux/filter.h, linux/bpf_common.h
_LOAD_HALF, _LOAD_WORD, _EQUAL, _AT_LEAST, _RETURN = 0x28, 0x20, 0x15, 0x35, 0x06
_SOURCE_PORT = 0  # data begins with the UDP header
_SOURCE_IPV4 = 0xFFF00000 + 12  # SKF_NET_OFF, then the place in the IP header
_RANDOM = 0xFFFFF000 + 56  # SKF_AD_OFF + SKF_AD_RANDOM
_WHOLE = 0xFFFFFFFF
_INSTRUCTION = struct.Struct("=HBBI")


class FloodGuard:
    """Sees a flood begin and end, and has the system thin it out meanwhile.

    Attributes
    ----------
    on
        Whether the system throws datagrams away for us now.
    """

    def __init__(self) -> None:
        self.on = False
        self._able = sys.platform == "linux"
        self._since_us = 0
        self._strange = self._refused = 0
        self._share = 1.0

    def tend(
        self,
        sock: socket.socket,
        peers: Iterable[Hashable],
        strange: int,
        refused: int,
        now_us: int,
    ) -> None:
        """Attach, renew or take away the program.

        Parameters
        ----------
        sock
            The socket.
        peers
            Addresses that are believed.
        strange, refused
            Datagrams of strangers that were read so far, and how many of them were thrown away.
        """
        if not self._able:
            return
        passed_s = (now_us - self._since_us) * 1e-6
        alarm = not self.on and refused - self._refused > ALARM
        if not alarm and passed_s < _PERIOD_US * 1e-6:
            return
        sent_per_s = (strange - self._strange) / max(passed_s, 0.01) / self._share
        if alarm and passed_s <= 2.0 * _PERIOD_US * 1e-6:
            self._share = min(SHARE_PER_S / sent_per_s, 1.0)
            self.renew(sock, peers, on=True)
        elif self.on and sent_per_s < CALM_PER_S:
            self._share = 1.0
            self._take_away(sock)
        elif self.on:
            self._share = min(SHARE_PER_S / sent_per_s, 1.0)
            self.renew(sock, peers)
        self._since_us, self._strange, self._refused = now_us, strange, refused

    def renew(
        self, sock: socket.socket, peers: Iterable[Hashable], *, on: bool | None = None
    ) -> None:
        """Let the present peers pass, if there is a flood."""
        if not (self.on if on is None else on):
            return
        program = _program(peers, round(self._share * 0xFFFFFFFF), sock.family)
        code = ctypes.create_string_buffer(program, len(program))
        count = len(program) // _INSTRUCTION.size
        try:
            sock.setsockopt(
                socket.SOL_SOCKET, _ATTACH, struct.pack("@HP", count, ctypes.addressof(code))
            )
            self.on = True
        except OSError:
            self._able = self.on = False

    def reset(self) -> None:
        """Begin anew: the socket is another one."""
        self.on = False
        self._share = 1.0

    def _take_away(self, sock: socket.socket) -> None:
        self.on = False
        try:
            sock.setsockopt(socket.SOL_SOCKET, _DETACH, 0)
        except OSError:
            self._able = False


def _program(peers: Iterable[Hashable], share: int, family: int) -> bytes:
    """The program: peers pass whole, of others ``share`` in 2**32.

    Peers are told by port and IPv4 address; over IPv6 by their port only, which lets a few
    strangers through that are then refused by us.
    """
    out: list[tuple[int, int, int, int]] = []
    for peer in peers:
        host, port = peer[0], peer[1]  # type: ignore[index]
        if family == socket.AF_INET:
            address = int.from_bytes(socket.inet_aton(host), "big")
            out += [
                (_LOAD_HALF, 0, 0, _SOURCE_PORT),
                (_EQUAL, 0, 3, port),
                (_LOAD_WORD, 0, 0, _SOURCE_IPV4),
                (_EQUAL, 0, 1, address),
                (_RETURN, 0, 0, _WHOLE),
            ]
        else:
            out += [
                (_LOAD_HALF, 0, 0, _SOURCE_PORT),
                (_EQUAL, 0, 1, port),
                (_RETURN, 0, 0, _WHOLE),
            ]
    out += [
        (_LOAD_WORD, 0, 0, _RANDOM),
        (_AT_LEAST, 0, 1, share),
        (_RETURN, 0, 0, 0),
        (_RETURN, 0, 0, _WHOLE),
    ]
    return b"".join(_INSTRUCTION.pack(*step) for step in out)
