"""What a checkpoint must have in common with who takes it up: code, settings, and the time."""

from __future__ import annotations

import hashlib
import time
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from links.mavlink.options import DecoderOptions
from monitor.settings import Settings

__all__ = ["SECTIONS", "Moment", "age_s", "code_digest", "reading", "shaping"]

SECTIONS = ("streams", "phase", "imu", "air", "triplex", "vane", "engine", "wing", "mute")
"""Sections that the pipeline works by."""

_ROOTS = ("links", "estimators", "monitor")
_APART = frozenset({"commands", "fleet", "learn", "pages", "report", "web", "baselines"})
"""Folders that no part of the state comes from."""

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


@cache
def code_digest() -> str:
    """Digest of the sources that the state is of, and of the package's version."""
    try:
        whole = hashlib.sha256(version("mavsentry").encode())
    except PackageNotFoundError:
        whole = hashlib.sha256()
    top = Path(__file__).parents[2]
    for root in _ROOTS:
        for path in sorted((top / root).rglob("*.py")):
            place = path.relative_to(top)
            if _APART.isdisjoint(place.parts):
                whole.update(str(place).encode())
                whole.update(path.read_bytes())
    return whole.hexdigest()[:32]


def shaping(settings: Settings) -> dict[str, Any]:
    """What of the settings shapes the state, in JSON's types."""
    return {name: getattr(settings, name).model_dump(mode="json") for name in SECTIONS}


def reading(options: DecoderOptions) -> dict[str, Any]:
    """How the stream is read, in JSON's types."""
    plain: dict[str, Any] = _plain(asdict(options))
    return plain


@dataclass(frozen=True, slots=True)
class Moment:
    """When something was, by three clocks of the host.

    Attributes
    ----------
    boot
        Identifies the host's run since it was switched on; empty where the host has no such thing.
    since_boot_us
        Time since then, that asleep included [us].
    unix_us
        The wall clock [us]: wrong on a computer without a battery for it, until somebody sets it.
    """

    boot: str
    since_boot_us: int
    unix_us: int

    @staticmethod
    def now() -> Moment:
        """The present."""
        try:
            boot = _BOOT_ID.read_text("ascii").strip()
        except (OSError, UnicodeDecodeError):
            boot = ""
        clock = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
        return Moment(boot, time.clock_gettime_ns(clock) // 1000, time.time_ns() // 1000)


def age_s(then: Moment, now: Moment) -> float | None:
    """How long ago it was, by the host [s]; None where the host cannot tell.

    While the host has not been switched off it knows exactly. Otherwise its wall clock is asked,
    and believed if it goes forward: one that is behind is wrong, and says nothing.
    """
    if then.boot and then.boot == now.boot:
        return (now.since_boot_us - then.since_boot_us) / 1e6
    passed_s = (now.unix_us - then.unix_us) / 1e6
    return passed_s if passed_s >= 0.0 else None


def _plain(value: Any) -> Any:
    """In JSON's types."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, set | frozenset):
        return sorted(map(_plain, value))
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value
