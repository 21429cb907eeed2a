"""MAVLink 2 signatures: made and checked, sans-IO.

A signed frame ends in 13 bytes: a link id, a time of 48 bits in units of 10 us since 2015, and the
first 48 bits of SHA-256 over key, frame, link id and time. Every sender counts its time up on each
*stream* (its system id, component id and link id), so that a frame heard once is never believed
again. The first frame of a stream has nothing before it: it must not be more than a minute behind
our own time, which follows the newest time that was ever believed, as everybody's does.

Nothing of a frame is remembered before its signature was found right.

Source: MAVLink guide, "Message Signing".
Differs: a stream is entered only after the signature was checked (pymavlink enters it before, so
that a forged frame locks its sender out); the table is bounded by what can no longer be replayed.
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable, Iterable
from typing import Final, NoReturn

from fastcrc.crc16 import mcrf4xx

from links.mavlink.dialect import load_dialect
from links.vocabulary import Rejection

__all__ = [
    "KEY_BYTES",
    "NEW_STREAM_TICKS",
    "SECRET_MESSAGES",
    "TICKS_PER_S",
    "Signer",
    "SigningClock",
    "SigningKey",
    "Verifier",
    "carries_key",
    "is_signed",
    "ticks_of_unix_us",
]

KEY_BYTES: Final = 32
TICKS_PER_S: Final = 100_000
"""The unit of signing times is 10 us."""

NEW_STREAM_TICKS: Final = 60 * TICKS_PER_S
"""How far behind our own time the first frame of a stream may be."""

STREAMS_MAX: Final = 4096
"""Streams that are remembered: far more than a network of key holders has."""

SECRET_MESSAGES: Final = frozenset({"SETUP_SIGNING"})
"""Messages that carry a key: never obeyed, recorded, passed on or put into a log."""

_SECRET_IDS: Final = frozenset(load_dialect("common").by_name[n].id for n in SECRET_MESSAGES)
_EPOCH_UNIX_US: Final = 1_420_070_400_000_000
_LAST_TICK: Final = (1 << 48) - 1
_V2: Final = 0xFD
_SIGNED: Final = 0x01
_HEAD: Final = 10
_TAIL: Final = 13
_BYTES: Final = tuple(bytes([k]) for k in range(256))


class SigningKey:
    """The secret of a network. It compares, but is never shown, copied out or pickled.

    Parameters
    ----------
    secret
        32 bytes.

    Raises
    ------
    ValueError
        Of another length, or all zero, which to MAVLink means no signing.
    """

    __slots__ = ("_begun", "_secret")

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(secret)}")
        if not any(secret):
            raise ValueError("a signing key of zeros would mean no signing")
        self._secret = bytes(secret)
        self._begun = hashlib.sha256(self._secret)

    @classmethod
    def of_passphrase(cls, passphrase: str) -> SigningKey:
        """The key that Mission Planner, MAVProxy and QGroundControl make of a passphrase."""
        return cls(hashlib.sha256(passphrase.encode()).digest())

    def signature(self, frame: bytes) -> bytes:
        """The 6 bytes that belong after a frame, its link id and its time."""
        digest = self._begun.copy()
        digest.update(frame)
        return digest.digest()[:6]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SigningKey) and hmac.compare_digest(self._secret, other._secret)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return "SigningKey(...)"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a signing key is not pickled")


def ticks_of_unix_us(unix_us: int) -> int:
    """Signing time of a Unix time [us]; 0 before 2015."""
    return max((unix_us - _EPOCH_UNIX_US) // 10, 0)


def _unix_us() -> int:
    return time.time_ns() // 1000


class SigningClock:
    """Our own signing time: the host's clock, but never behind what was sent or believed.

    Parameters
    ----------
    start
        Where it starts at least: what an earlier run may have reached.
    unix_us
        The host's clock [us].

    Attributes
    ----------
    last
        The newest time given out or believed.
    """

    def __init__(self, start: int = 0, unix_us: Callable[[], int] = _unix_us) -> None:
        self.last = start
        self._unix_us = unix_us

    def now(self) -> int:
        """Our time."""
        return max(self.last, ticks_of_unix_us(self._unix_us()))

    def next(self) -> int:
        """A time for the next frame, later than all before."""
        self.last = min(max(self.last + 1, ticks_of_unix_us(self._unix_us())), _LAST_TICK)
        return self.last

    def believe(self, ticks: int) -> None:
        """Follow the time of a frame whose signature is right."""
        self.last = max(self.last, ticks)


class Signer:
    """Signs our frames for one link.

    Parameters
    ----------
    key
        The network's.
    clock
        One for all links.
    link
        Our number of the link, modulo 256 its id: every link is a stream of its own.
    dialect
        Its CRC_EXTRA table: a signed frame has another checksum.
    """

    def __init__(
        self, key: SigningKey, clock: SigningClock, link: int, dialect: str = "ardupilotmega"
    ) -> None:
        self._key, self._clock = key, clock
        self._link = _BYTES[link & 0xFF]
        self._extras = load_dialect(dialect).extras.tolist()

    def sign(self, frame: bytes) -> bytes:
        """The same message signed.

        Parameters
        ----------
        frame
            A whole MAVLink 2 frame that is not signed yet, as an Encoder makes it.

        Raises
        ------
        ValueError
            For anything else: MAVLink 1 has no signatures.
        """
        if frame[0] != _V2 or frame[2] & _SIGNED:
            raise ValueError("only a MAVLink 2 frame without a signature can be signed")
        extra = self._extras[frame[7] | frame[8] << 8 | frame[9] << 16] - 1
        body = frame[1:2] + _BYTES[frame[2] | _SIGNED] + frame[3 : _HEAD + frame[1]]
        crc = mcrf4xx(body + _BYTES[extra])
        ticks = self._clock.next()
        whole = (
            frame[:1] + body + crc.to_bytes(2, "little") + self._link + ticks.to_bytes(6, "little")
        )
        return whole + self._key.signature(whole)


class Verifier:
    """Checks signatures of all links: one table of streams, or a replay would only need another.

    Parameters
    ----------
    key
        The network's.
    clock
        Our time; it follows what is believed.
    streams
        (system, component, link id) -> newest time believed, of an earlier run.
    """

    def __init__(
        self,
        key: SigningKey,
        clock: SigningClock,
        streams: Iterable[tuple[tuple[int, int, int], int]] = (),
    ) -> None:
        self._key, self._clock = key, clock
        self._streams = {_stream_key(*who): ticks for who, ticks in streams}

    @property
    def streams(self) -> dict[tuple[int, int, int], int]:
        """(system, component, link id) -> newest time believed."""
        return {(k >> 16, k >> 8 & 0xFF, k & 0xFF): t for k, t in self._streams.items()}

    def check(self, frame: bytes) -> Rejection | None:
        """Whether a signed frame is to be believed: None, or why not.

        Parameters
        ----------
        frame
            A whole MAVLink 2 frame whose checksum is right and that :func:`is_signed`.
        """
        at = len(frame) - _TAIL
        if not hmac.compare_digest(self._key.signature(frame[:-6]), frame[-6:]):
            return Rejection.BAD_SIGNATURE
        ticks = int.from_bytes(frame[at + 1 : at + 7], "little")
        stream = frame[5] << 16 | frame[6] << 8 | frame[at]
        newest = self._streams.get(stream)
        if newest is None:
            if ticks < self._clock.now() - NEW_STREAM_TICKS:
                return Rejection.OLD_SIGNATURE
            if len(self._streams) >= STREAMS_MAX and not self._forget():
                return Rejection.OVERFLOW
        elif ticks <= newest:
            return Rejection.REPLAYED
        self._streams[stream] = ticks
        self._clock.believe(ticks)
        return None

    def _forget(self) -> bool:
        """Drop streams that are so old that a replay is refused without knowing them."""
        oldest = self._clock.now() - NEW_STREAM_TICKS
        kept = {stream: ticks for stream, ticks in self._streams.items() if ticks >= oldest}
        dropped = len(kept) < len(self._streams)
        self._streams = kept
        return dropped


def carries_key(frame: bytes) -> bool:
    """Whether a whole frame is one of :data:`SECRET_MESSAGES`."""
    if frame[0] == _V2:
        return (frame[7] | frame[8] << 8 | frame[9] << 16) in _SECRET_IDS
    return frame[5] in _SECRET_IDS


def is_signed(frame: bytes) -> bool:
    """Whether a frame carries a signature."""
    return frame[0] == _V2 and frame[2] & _SIGNED != 0


def _stream_key(system: int, component: int, link: int) -> int:
    return system << 16 | component << 8 | link
