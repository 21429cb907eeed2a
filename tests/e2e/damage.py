"""What happens to telemetry logs on their way: functions from a clean log's frames to bytes."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.impairments import retimed

Frames = Sequence[tuple[int, bytes]]
"""(stamp [us], frame) of MAVLink 2 without signatures."""

S = 1_000_000
HEAD, CRC = 10, 2


def frames_of(data: bytes) -> list[tuple[int, bytes]]:
    """Frames of a log in which nothing is damaged."""
    out = []
    at = 0
    while at < len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        end = at + 8 + HEAD + data[at + 9] + CRC
        out.append((stamp, data[at + 8 : end]))
        at = end
    return out


def log_of(frames: Frames) -> bytes:
    """A log of these frames."""
    return b"".join(struct.pack(">Q", stamp) + frame for stamp, frame in frames)


def flown(frames: Frames, from_s: float, to_s: float = np.inf) -> list[tuple[int, bytes]]:
    """Frames of a span of time, which counts from the first."""
    first = frames[0][0]
    return [x for x in frames if from_s * S <= x[0] - first < to_s * S]


def _framed(frame: bytes, payload: bytes) -> bytes:
    """The frame with another payload and the check sum that goes with it."""
    message = frame[7] | frame[8] << 8 | frame[9] << 16
    body = bytes([len(payload)]) + frame[2:HEAD] + payload
    crc = mcrf4xx(body + bytes([mavlink.mavlink_map[message].crc_extra]))
    return frame[:1] + body + struct.pack("<H", crc)


NO_NUMBERS = (np.nan, np.inf, -np.inf, 1e38, -1e38, 1e-40, 0.0)


def absurd(frame: bytes, rng: np.random.Generator) -> bytes:
    """The frame with values that no sensor has, and a right check sum: a fault of the sender."""
    payload = bytearray(frame[HEAD : HEAD + frame[1]])
    how = rng.integers(0, 4)
    if how == 0:
        payload[:] = rng.bytes(len(payload))
    elif how == 1:
        payload[rng.integers(0, len(payload))] ^= 1 << rng.integers(0, 8)
    elif how == 2 and len(payload) >= 4:
        value = NO_NUMBERS[rng.integers(0, len(NO_NUMBERS))]
        struct.pack_into("<f", payload, 4 * int(rng.integers(0, len(payload) // 4)), value)
    else:
        payload[:] = bytes([(0, 0x7F, 0x80, 0xFF)[rng.integers(0, 4)]]) * len(payload)
    return _framed(frame, bytes(payload))


def stepped(frames: Frames, at_s: float, by_s: float) -> list[tuple[int, bytes]]:
    """The vehicle's clock jumps once."""
    first = frames[0][0]
    return [
        (stamp, retimed(frame, lambda t: t + by_s * S) if stamp - first >= at_s * S else frame)
        for stamp, frame in frames
    ]


def drifting(frames: Frames, rate: float) -> list[tuple[int, bytes]]:
    """The vehicle's clock goes fast or slow."""
    return [(stamp, retimed(frame, lambda t: t * rate)) for stamp, frame in frames]


def lossy(frames: Frames, share: float, seed: int = 0) -> list[tuple[int, bytes]]:
    """One message after another is lost by chance."""
    kept = np.random.default_rng(seed).random(len(frames)) >= share
    return [x for x, keep in zip(frames, kept, strict=True) if keep]


def bursts(frames: Frames, share: float, length: int, seed: int = 0) -> list[tuple[int, bytes]]:
    """Whole stretches of messages are lost."""
    kept = np.random.default_rng(seed).random(len(frames) // length + 1) >= share
    return [x for i, x in enumerate(frames) if kept[i // length]]


def shuffled(frames: Frames, reach: int, seed: int = 0) -> list[tuple[int, bytes]]:
    """Messages overtake one another by up to ``reach`` places."""
    late = np.arange(len(frames)) + np.random.default_rng(seed).integers(0, reach, len(frames))
    return [frames[i] for i in np.argsort(late, kind="stable")]


def flipped(data: bytes, share: float, seed: int = 0) -> bytes:
    """Single bits of this share of the bytes are wrong."""
    rng = np.random.default_rng(seed)
    out = np.frombuffer(data, np.uint8).copy()
    at = rng.integers(0, len(out), round(share * len(out)))
    out[at] ^= np.uint8(1) << rng.integers(0, 8, len(at), dtype=np.uint8)
    return out.tobytes()
