"""Which logs of a fleet get a report; the command line asks before it loads anything else."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Reports"]


class Reports(StrEnum):
    """Which logs get a ``report.html``."""

    NONE = "none"
    FOUND = "found"
    """Those with a fault, or with an engine that stopped."""
    ALL = "all"
