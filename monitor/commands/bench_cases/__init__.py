"""What ``mavsentry bench`` measures: one :class:`BenchCase` per name, in files by subject.

Each module here has a function ``cases() -> list[BenchCase]``. It imports what the cases need,
prepares their inputs, and leaves out a peer that is not installed (naming it in ``missing``).
A case's ``run`` and its peers do the same work on the same input.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

__all__ = ["BULK_BYTES", "BenchCase", "Measured", "missing"]

BULK_BYTES = 100_000_000
"""Least size of a log that is decoded in bulk."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A value that was measured with its own median and 99th percentile of time [us]."""

    value: float
    median_us: float | None = None
    p99_us: float | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class BenchCase:
    """One thing measured.

    Attributes
    ----------
    name
        As DESIGN section 6 lists it.
    unit
        Of ``value``; ``"us"`` where times per unit of work are the result.
    run
        Does ``calls`` units of work; None where only ``value`` is measured.
    calls
        Units of work that one ``run`` does; the reported times are per unit.
    peers
        Peer name -> the same work done by it.
    note
        One sentence on what is compared with what.
    value
        Measures and returns ``value``; None where times alone are the result.
    peer_calls
        Peer name -> units of work of one call of it, where that differs from ``calls``.
    missing
        Peers that are not installed here.
    """

    name: str
    unit: str = "us"
    run: Callable[[], object] | None = None
    calls: int = 1
    peers: Mapping[str, Callable[[], object]] = field(default_factory=dict)
    note: str = ""
    value: Callable[[], float | Measured] | None = None
    peer_calls: Mapping[str, int] = field(default_factory=dict)
    missing: tuple[str, ...] = ()


def missing(*peers: str) -> tuple[str, ...]:
    """Those of the peers that are not installed here."""
    return tuple(peer for peer in peers if importlib.util.find_spec(peer) is None)
