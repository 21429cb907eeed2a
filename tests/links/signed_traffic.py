"""Signed MAVLink as pymavlink makes it, and what a forger makes of it."""

from __future__ import annotations

import hashlib
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as peer

from links.mavlink.dialect import load_dialect

PASSPHRASE = "a passphrase of the field"
SECRET = hashlib.sha256(PASSPHRASE.encode()).digest()
NOW_UNIX_US = 1_790_000_000_000_000
NOW = (NOW_UNIX_US - 1_420_070_400_000_000) // 10
"""The signing time of these tests [10 us]."""


class Station:
    """A sender that signs with pymavlink."""

    def __init__(
        self,
        system: int = 1,
        component: int = 1,
        link: int = 0,
        time: int = NOW,
        secret: bytes | None = SECRET,
        version: int = 2,
    ) -> None:
        self.mav: Any = peer.MAVLink(None, srcSystem=system, srcComponent=component)
        self.version = version
        if secret is not None:
            self.mav.signing.secret_key = bytearray(secret)
            self.mav.signing.link_id = link
            self.mav.signing.timestamp = time
            self.mav.signing.sign_outgoing = True

    def frame(self, message: Any) -> bytes:
        packed = bytes(message.pack(self.mav, force_mavlink1=self.version == 1))
        self.mav.seq = (self.mav.seq + 1) % 256
        return packed

    def heartbeat(self) -> bytes:
        return self.frame(peer.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3))

    def attitude(self, ms: int) -> bytes:
        return self.frame(peer.MAVLink_attitude_message(ms, 0.1, 0.2, 0.3, 0, 0, 0))


def sealed(frame: bytearray) -> bytes:
    """A MAVLink 2 frame with its checksum made right."""
    message = frame[7] | frame[8] << 8 | frame[9] << 16
    extra = bytes([load_dialect().by_id[message].crc_extra])
    end = 10 + frame[1]
    frame[end : end + 2] = mcrf4xx(bytes(frame[1:end]) + extra).to_bytes(2, "little")
    return bytes(frame)


def unsigned(frame: bytes) -> bytes:
    """The same message with its signature taken off."""
    bare = bytearray(frame[:-13])
    bare[2] = 0
    return sealed(bare)


def heard_by_pymavlink(data: bytes, secret: bytes | None = SECRET) -> list[Any]:
    """What pymavlink makes of a stream when it demands signatures; raises on a bad one."""
    mav: Any = peer.MAVLink(None)
    if secret is not None:
        mav.signing.secret_key = bytearray(secret)
        mav.signing.timestamp = NOW
    return list(mav.parse_buffer(data) or ())
