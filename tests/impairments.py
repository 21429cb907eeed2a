"""What a link, a vehicle or a host does to telemetry: timed frames in, timed frames out.

No I/O and no clock. An :class:`Impairment` takes one frame at the time it was sent and says when it
arrives: never, once, or more than once. The same stages work over a whole recorded flight
(:func:`through`) and frame by frame in a relay that keeps real time
(:mod:`tests.e2e.relay`).

::

    arrived = through(frames, Loss(0.3, seed=1), Delay(0.2, seed=2))
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = [
    "Bursts",
    "ClockJump",
    "Delay",
    "Duplicates",
    "Impairment",
    "Loss",
    "NoFix",
    "Outage",
    "Reboot",
    "Timed",
    "Without",
    "recorded",
    "retimed",
    "through",
]

Timed = tuple[int, bytes]
"""When a frame was sent or arrives [us], and the frame."""

Impairment = Callable[[int, bytes], Iterable[Timed]]
"""``stage(sent_us, frame)``: when the frame arrives, and as what."""

S = 1_000_000
_CRC = 2
_SIGNATURE = 13
_HEADER = {0xFE: 6, 0xFD: 10}
SERVO_OUTPUT_RAW, SYSTEM_TIME, GPS_RAW_INT, GPS2_RAW = 36, 2, 24, 124
_BEGINS_WITH = {i: c.ordered_fieldnames[0] for i, c in mavlink.mavlink_map.items()}
_FIX_TYPE_AT = {GPS_RAW_INT: 28, GPS2_RAW: 32}
"""Place of ``fix_type`` in the payload: wire order, by size."""


def through(frames: Iterable[Timed], *stages: Impairment) -> list[Timed]:
    """All frames after all stages, in order of arrival."""
    out: list[Timed] = []
    for t_us, frame in frames:
        passed: list[Timed] = [(t_us, frame)]
        for stage in stages:
            passed = [arrival for item in passed for arrival in stage(*item)]
        out += passed
    out.sort(key=lambda arrival: arrival[0])
    return out


class Loss:
    """Each frame is lost by chance, independently of the others."""

    def __init__(self, share: float, seed: int = 0) -> None:
        self._share = share
        self._rng = np.random.default_rng(seed)

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        if self._rng.random() >= self._share:
            yield t_us, frame


class Bursts:
    """Gilbert and Elliott's channel: it is good or bad, and all is lost while it is bad.

    Parameters
    ----------
    good_s, bad_s
        Mean duration of either state [s]; the share lost is ``bad_s / (good_s + bad_s)``.
    """

    def __init__(self, good_s: float, bad_s: float, seed: int = 0) -> None:
        self._mean_s = (good_s, bad_s)
        self._rng = np.random.default_rng(seed)
        self._bad = False
        self._until_us: float | None = None

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        if self._until_us is None:
            self._until_us = t_us + self._lasts_us()
        while t_us >= self._until_us:
            self._bad = not self._bad
            self._until_us += self._lasts_us()
        if not self._bad:
            yield t_us, frame

    def _lasts_us(self) -> float:
        return S * float(self._rng.exponential(self._mean_s[self._bad]))


class Duplicates:
    """Frames come a second time: two radios, or a ground station that forwards in a circle."""

    def __init__(self, share: float, later_s: float = 0.0, seed: int = 0) -> None:
        self._share = share
        self._later_us = round(later_s * S)
        self._rng = np.random.default_rng(seed)

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        yield t_us, frame
        if self._rng.random() < self._share:
            yield t_us + round(self._later_us * float(self._rng.random())), frame


class Delay:
    """Every frame is late by its own time, even chances up to ``most_s``: frames overtake others.

    With ``ordered`` none does: a queue that fills and empties (jitter).
    """

    def __init__(self, most_s: float, seed: int = 0, *, ordered: bool = False) -> None:
        self._most_us = most_s * S
        self._rng = np.random.default_rng(seed)
        self._ordered = ordered
        self._last_us = 0

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        at_us = t_us + round(self._most_us * float(self._rng.random()))
        if self._ordered:
            at_us = max(at_us, self._last_us)
            self._last_us = at_us
        yield at_us, frame


class Outage:
    """Nothing comes through from one moment to another, given as times of sending [us]."""

    def __init__(self, from_us: int, to_us: int) -> None:
        self._span = range(from_us, to_us)

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        if t_us not in self._span:
            yield t_us, frame


class Without:
    """Messages of some kinds are missing for a while."""

    def __init__(self, messages: Sequence[int], from_us: int, to_us: int) -> None:
        self._messages = frozenset(messages)
        self._span = range(from_us, to_us)

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        if t_us not in self._span or message_of(frame) not in self._messages:
            yield t_us, frame


class NoFix:
    """The receivers say that they have no fix, with the last position and velocity they knew."""

    def __init__(self, from_us: int, to_us: int) -> None:
        self._span = range(from_us, to_us)
        self._last: dict[int, bytes] = {}

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        at = _FIX_TYPE_AT.get(message_of(frame))
        if at is None:
            yield t_us, frame
        elif t_us not in self._span:
            self._last[message_of(frame)] = frame
            yield t_us, frame
        else:
            payload = bytearray(_payload(self._last.get(message_of(frame), frame)))
            payload = payload.ljust(at + 1, b"\0")
            payload[at] = 1
            yield t_us, _framed(frame, bytes(payload))


class ClockJump:
    """The vehicle's clock jumps: from a moment on its stamps since boot differ by so much [s]."""

    def __init__(self, at_us: int, by_s: float) -> None:
        self._at_us = at_us
        self._by_us = by_s * S

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        yield t_us, retimed(frame, lambda t: t + self._by_us) if t_us >= self._at_us else frame


class Reboot:
    """The autopilot boots anew in the air: silence, then stamps from zero on; GPS time goes on.

    Parameters
    ----------
    at_us
        When it stops [us].
    away_s
        For how long it says nothing; its clock starts at zero half-way through.
    """

    def __init__(self, at_us: int, away_s: float = 2.0) -> None:
        self._at_us = at_us
        self._back_us = at_us + round(away_s * S)
        self._zero_us = at_us + round(0.5 * away_s * S)
        self._ahead_us = 0

    def __call__(self, t_us: int, frame: bytes) -> Iterator[Timed]:
        if t_us < self._at_us:
            stamp_us = _stamp(frame)
            if stamp_us is not None:
                self._ahead_us = stamp_us - t_us
            yield t_us, frame
        elif t_us >= self._back_us:
            zero_us = self._zero_us + self._ahead_us
            yield t_us, retimed(frame, lambda t: max(t - zero_us, 1000))


def recorded(path: Path) -> list[Timed]:
    """Frames of a telemetry log and their stamps; what is no frame between them is left out."""
    data = path.read_bytes()
    out: list[Timed] = []
    at = 0
    while at + 8 + 12 <= len(data):
        if data[at + 8] not in _HEADER:
            at += 1
            continue
        (stamp,) = struct.unpack_from(">Q", data, at)
        end = at + 8 + _length(data[at + 8 : at + 11])
        out.append((stamp, data[at + 8 : end]))
        at = end
    return out


def retimed(frame: bytes, clock: Callable[[int], float]) -> bytes:
    """The frame as a vehicle would send it whose clock shows ``clock(t_us)`` at ``t_us``."""
    message = message_of(frame)
    name = _BEGINS_WITH.get(message, "")
    if name == "time_boot_ms":
        at, form, unit = 0, "<I", 1000
    elif message == SERVO_OUTPUT_RAW:
        at, form, unit = 0, "<I", 1
    elif message == SYSTEM_TIME:
        at, form, unit = 8, "<I", 1000
    elif name == "time_usec":
        at, form, unit = 0, "<Q", 1
    else:
        return frame
    payload = bytearray(_payload(frame).ljust(at + struct.calcsize(form), b"\0"))
    (stamp,) = struct.unpack_from(form, payload, at)
    if stamp == 0 or stamp * unit > 1e14:  # no time, or Unix time
        return frame
    struct.pack_into(form, payload, at, round(clock(stamp * unit) / unit))
    return _framed(frame, bytes(payload))


def _stamp(frame: bytes) -> int | None:
    """What a frame says of the vehicle's time, if it is time since boot [us]."""
    if _BEGINS_WITH.get(message_of(frame)) != "time_boot_ms":
        return None
    return 1000 * int.from_bytes(_payload(frame).ljust(4, b"\0")[:4], "little")


def message_of(frame: bytes) -> int:
    """Message id."""
    return frame[5] if frame[0] == 0xFE else int.from_bytes(frame[7:10], "little")


def _length(head: bytes) -> int:
    """Length of a frame that begins with these three bytes."""
    signature = _SIGNATURE if head[0] == 0xFD and head[2] & 1 else 0
    return _HEADER[head[0]] + head[1] + _CRC + signature


def _payload(frame: bytes) -> bytes:
    return frame[_HEADER[frame[0]] : _HEADER[frame[0]] + frame[1]]


def _framed(frame: bytes, payload: bytes) -> bytes:
    """The frame, not signed, with another payload and the check sum that goes with it."""
    head = frame[: _HEADER[frame[0]]]
    extra = mavlink.mavlink_map[message_of(frame)].crc_extra
    body = bytes([len(payload)]) + head[2:] + payload
    return head[:1] + body + struct.pack("<H", mcrf4xx(body + bytes([extra])))
