"""Byte streams that a vehicle, its ground station and a bad radio would produce."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from links.mavlink import Decoder, DecoderOptions, Encoder
from links.samples import Batch


def assert_same_batch(a: Batch, b: Batch) -> None:
    assert a.rejected == b.rejected
    assert set(a.rows) == set(b.rows)
    for sensor, rows in a.rows.items():
        assert rows.dtype == b.rows[sensor].dtype
        assert rows.tobytes() == b.rows[sensor].tobytes(), sensor


@pytest.fixture(scope="session")
def same_batch() -> Callable[[Batch, Batch], None]:
    """Asserts that two batches hold the same rows to the last bit, and the same rejections."""
    return assert_same_batch


@pytest.fixture(scope="session")
def decode() -> Callable[..., tuple[Batch, Decoder]]:
    """Whole stream, cut at the given places, to one batch and its decoder."""

    def run(data: bytes, cuts: Any = (), stamped: bool = False, **options: Any) -> Any:
        decoder = Decoder(DecoderOptions(**options), stamped=stamped)
        edges = [0, *sorted(c for c in cuts if c < len(data)), len(data)]
        parts = [decoder.feed(data[a:b]) for a, b in itertools.pairwise(edges)]
        return Batch.concatenate([*parts, decoder.finish()]), decoder

    return run


@pytest.fixture
def vehicle() -> Encoder:
    """System 1's autopilot."""
    return Encoder(1, 1)


@pytest.fixture
def start(vehicle: Encoder) -> bytes:
    """HEARTBEAT of an ArduPlane and a first stamp at 10 s."""
    return vehicle.encode("HEARTBEAT", type=1, autopilot=3) + vehicle.encode(
        "ATTITUDE", time_boot_ms=10_000
    )


@pytest.fixture(scope="session")
def noisy_stream() -> Callable[[int, int], bytes]:
    """A seeded stream of everything at once: two protocol versions, noise, a second system, our own
    component, a reboot, wrapped and Unix stamps, values out of range."""

    def build(seed: int, events: int) -> bytes:
        rng = np.random.default_rng(seed)
        senders = [
            Encoder(1, 1, version=1),
            Encoder(1, 1),
            Encoder(1, 191),
            Encoder(255, 190),
            Encoder(7, 1),
        ]
        t_ms = int(rng.choice([500, 40_000, 2**32 - 300]))
        out = bytearray()
        for _ in range(events):
            t_ms += int(rng.integers(0, 60))
            if rng.random() < 0.01:
                t_ms = int(rng.integers(1, 2000))
            ms = t_ms & 0xFFFFFFFF
            e = senders[int(rng.choice(5, p=[0.4, 0.4, 0.05, 0.05, 0.1]))]
            float_value = float(rng.choice([np.nan, 1e9, 12.5, -3.0]))
            frame = [
                lambda e=e: e.encode("HEARTBEAT", type=1, autopilot=int(rng.choice([3, 8, 12]))),
                lambda e=e, ms=ms: e.encode("SCALED_IMU", time_boot_ms=ms, xacc=-1000, zgyro=7),
                lambda e=e, ms=ms: e.encode("RAW_IMU", time_usec=ms * 1000 + 7, zacc=-990),
                lambda e=e, ms=ms, v=float_value: e.encode(
                    "ATTITUDE", time_boot_ms=ms, roll=v, yaw=0.5
                ),
                lambda e=e, ms=ms: e.encode("ATTITUDE_QUATERNION", time_boot_ms=ms, q1=1.0),
                lambda e=e, ms=ms, v=float_value: e.encode(
                    "SCALED_PRESSURE", time_boot_ms=ms, press_abs=950.0, press_diff=v
                ),
                lambda e=e, v=float_value: e.encode("VFR_HUD", airspeed=v),
                lambda e=e: e.encode("RPM", rpm1=4000.0, rpm2=-1.0),
                lambda e=e, ms=ms: e.encode(
                    "GPS_RAW_INT", time_usec=max(ms * 1000 - 200_000, 0), fix_type=3, vel=1500
                ),
                lambda e=e, ms=ms: e.encode(
                    "SERVO_OUTPUT_RAW", time_usec=(ms * 1000) & 0xFFFFFFFF, servo1_raw=1500
                ),
                lambda e=e: e.encode("PARAM_VALUE", param_id="ARSPD_RATIO", param_value=1.9),
                lambda e=e, ms=ms: e.encode(
                    "SYSTEM_TIME", time_boot_ms=ms, time_unix_usec=1_700_000_000_000_000 + ms * 1000
                ),
                lambda e=e: e.encode("STATUSTEXT", severity=6, text="hello"),
                lambda e=e, ms=ms: e.encode(
                    "NAMED_VALUE_FLOAT", time_boot_ms=ms, name="AS2", value=21.0
                ),
            ][int(rng.integers(14))]()
            damage = rng.random()
            if damage < 0.02:
                frame = frame[: int(rng.integers(1, len(frame)))]
            elif damage < 0.05:
                at = int(rng.integers(len(frame)))
                frame = frame[:at] + bytes([frame[at] ^ 0x10]) + frame[at + 1 :]
            elif damage < 0.07:
                frame += rng.bytes(int(rng.integers(1, 40)))
            out += frame
        return bytes(out)

    return build
