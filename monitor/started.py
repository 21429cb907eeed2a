"""When a log began, where its stamps are times that can be: one rule for report and fleet."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

__all__ = ["started"]

EARLIEST_UNIX_US: Final = 946_684_800_000_000
"""The year 2000: stamps before it are no Unix time [us]."""


def started(log: Mapping[str, Any]) -> datetime | None:
    """Start of a log in UTC; None where it does not tell, or tells what no calendar has.

    Parameters
    ----------
    log
        ``log`` of a ``summary.json``.
    """
    unix_us = log.get("start_unix_us")
    if unix_us is None or unix_us < EARLIEST_UNIX_US:
        return None
    try:
        return datetime.fromtimestamp(unix_us / 1e6, UTC)
    except (OverflowError, OSError, ValueError):
        return None
