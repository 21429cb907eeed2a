"""When a message that is published periodically is due, as configured or as somebody asked."""

from __future__ import annotations

__all__ = ["LEAST_INTERVAL_US", "STOPPED", "Every", "OwnIntervals"]

STOPPED = -1
"""Interval of a message that is not sent, as MESSAGE_INTERVAL has it."""

LEAST_INTERVAL_US = 20_000
"""Shortest interval that may be asked for [us]; estimates are made ten times a second."""


class Every:
    """True once per period of host time, and at the first question."""

    def __init__(self, period_us: float) -> None:
        self._period_us = period_us
        self._next_us: float | None = None

    def retune(self, period_us: float) -> None:
        """Another period, counted from the last time."""
        if self._next_us is not None:
            self._next_us += period_us - self._period_us
        self._period_us = period_us

    def __call__(self, now_us: int) -> bool:
        if self._next_us is None:
            self._next_us = now_us + self._period_us
            return True
        if now_us < self._next_us:
            return False
        self._next_us = max(self._next_us + self._period_us, now_us + self._period_us / 2)
        return True


class OwnIntervals:
    """Messages whose interval was asked for by command: each has its own, the others share one."""

    def __init__(self) -> None:
        self._every: dict[str, tuple[int, Every | None]] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._every

    def put(self, name: str, interval_us: int) -> bool:
        """Give a message its own interval: -1 stops it, 0 takes its own away again."""
        if interval_us == 0:
            self._every.pop(name, None)
            return True
        if interval_us != STOPPED and interval_us < LEAST_INTERVAL_US:
            return False
        every = None if interval_us == STOPPED else Every(interval_us)
        self._every[name] = interval_us, every
        return True

    def get(self, name: str, otherwise_us: int) -> int:
        """The interval of a message that has its own, else the other [us]."""
        return self._every[name][0] if name in self._every else otherwise_us

    def due(self, now_us: int) -> set[str]:
        """Those that are due now."""
        return {n for n, (_, every) in self._every.items() if every is not None and every(now_us)}
