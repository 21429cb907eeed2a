"""What a pipeline said over a stream, kept in memory: verdicts, estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from links.samples import Rows
from monitor.verdict import StepResult, Verdict

__all__ = ["Estimates", "Recording"]


class Estimates:
    """Gathers estimates in memory; for a stream of bounded length."""

    def __init__(self) -> None:
        self._parts: dict[str, list[Rows]] = {}

    def add(self, estimates: Mapping[str, Rows]) -> None:
        """Append new rows, by the estimate's name."""
        for name, rows in estimates.items():
            self._parts.setdefault(name, []).append(rows)

    def joined(self) -> dict[str, Rows]:
        """Name -> all rows in time order."""
        return {name: np.concatenate(parts) for name, parts in self._parts.items()}


@dataclass(slots=True)
class Recording:
    """Gathers what a pipeline says: verdicts in time order, estimates per name."""

    verdicts: list[Verdict] = field(default_factory=list)
    _estimates: Estimates = field(default_factory=Estimates)

    def add(self, result: StepResult) -> None:
        """Append one step's verdicts and estimates."""
        self.verdicts += result.verdicts
        self._estimates.add(result.estimates)

    @property
    def estimates(self) -> dict[str, Rows]:
        """Name -> all estimate rows in time order."""
        return self._estimates.joined()
