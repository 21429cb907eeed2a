"""Short telemetry logs cut from recorded flights, most with a fault injected in their middle."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from monitor.commands.common import Refused
from monitor.commands.inject import inject_log
from sim_feeds.injection import parse_injection

__all__ = ["Cut", "corrupt", "cuts", "make"]

STAMP_BYTES = 8
HEADERS = {0xFE: 8, 0xFD: 12}
"""First byte of a frame -> its length without the payload."""
SIGNATURE_BYTES, SIGNED = 13, 0x01

OF_A_SHORT_FLIGHT = 0.8
"""Share of a flight no longer than the logs that is cut from it, so that cuts differ."""

FAULTS = (
    'sensor = "airspeed0"\nkind = "scale"\nfraction = 0.3',
    'sensor = "airspeed0"\nkind = "scale"\nfraction = -0.4',
    'sensor = "imu0.acc_z"\nkind = "bias"\nsize_m_s2 = 3.0',
    'sensor = "imu0.gyro_x"\nkind = "bias"\nsize_deg_s = 4.0',
    "",
)


@dataclass(frozen=True, slots=True)
class Cut:
    """One log to be made.

    Attributes
    ----------
    to
        The file.
    flight
        That it is cut from.
    begin
        Share of the flight that lies before it.
    size
        About so many bytes.
    fault
        Body of a ``[[fault]]``; empty for none.
    """

    to: Path
    flight: Path
    begin: float
    size: int
    fault: str


def cuts(flights: Sequence[Path], folder: Path, count: int, size: int, seed: int) -> list[Cut]:
    """Recipes of so many different logs."""
    rng = random.Random(seed)
    long = [f for f in flights if f.stat().st_size > size // 2]
    return [
        Cut(
            folder / f"{long[k % len(long)].stem}" / f"{k:05d}.tlog",
            long[k % len(long)],
            rng.random(),
            size,
            FAULTS[rng.randrange(len(FAULTS))],
        )
        for k in range(count)
    ]


def make(cut: Cut) -> str:
    """Write one log; return the sensor that breaks in it, empty if none does."""
    data, starts = _flight(cut.flight)
    size = min(cut.size, int(OF_A_SHORT_FLIGHT * len(data)))
    begin = next(s for s in starts if s >= cut.begin * (len(data) - size))
    end = next((s for s in starts if s >= begin + size), len(data))
    cut.to.parent.mkdir(parents=True, exist_ok=True)
    whole = cut.to.with_suffix(".cut")
    whole.write_bytes(data[begin:end])
    try:
        return _inject(whole, cut)
    except Refused:  # the flight has no such sensor
        shutil.copyfile(whole, cut.to)
        return ""
    finally:
        whole.unlink()


def _inject(whole: Path, cut: Cut) -> str:
    if not cut.fault:
        raise Refused("no fault")
    first, last = _flight_times(whole.read_bytes())
    start_s = 0.6 * (last - first) / 1e6
    injection = parse_injection(f"[[fault]]\n{cut.fault}\nstart_s = {start_s:.1f}\n")
    inject_log(whole, injection, cut.to)
    return cut.fault.split('"')[1]


def corrupt(logs: Sequence[Path], folder: Path, count: int, seed: int) -> None:
    """Files of which nothing can be made: noise, zeros, text, empty, headers alone, each another.

    A log that is merely damaged is read as far as it goes, and is no such file.
    """
    rng = random.Random(seed)
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        whole = logs[k % len(logs)].read_bytes()
        broken = (
            rng.randbytes(1 + rng.randrange(200_000)),
            bytes(1000 + k),
            b"nothing but words %d, " % k * 500,
            b"",
            bytes(b ^ 0x5A for b in whole[: 20_000 + k]),
        )[k % 5]
        suffix = (".tlog", ".BIN", ".ulg")[k % 3]
        (folder / f"corrupt-{k:03d}{suffix}").write_bytes(broken)


@lru_cache(maxsize=2)
def _flight(path: Path) -> tuple[bytes, list[int]]:
    """A telemetry log and where its records begin."""
    data = path.read_bytes()
    return data, list(_records(data))


def _flight_times(data: bytes) -> tuple[int, int]:
    """Unix time of the first and the last record [us]."""
    starts = list(_records(data))
    first, last = (
        int.from_bytes(data[s : s + STAMP_BYTES], "big") for s in (starts[0], starts[-1])
    )
    return first, last


def _records(data: bytes) -> Iterator[int]:
    at = 0
    while at + STAMP_BYTES + 3 < len(data):
        magic, payload, flags = data[at + STAMP_BYTES : at + STAMP_BYTES + 3]
        if magic not in HEADERS:
            return
        yield at
        signed = magic == 0xFD and flags & SIGNED
        at += STAMP_BYTES + HEADERS[magic] + payload + (SIGNATURE_BYTES if signed else 0)
