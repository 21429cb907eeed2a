"""An analysis that takes no time, for tests of what a fleet does around it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from links.logs import LogError
from monitor.analyze import Analysis
from monitor.settings import Settings
from tests.monitor.fleet.small_fleet import fault, summary


class Analyses:
    """Reads a log by its words: ``faulty``, ``junk``, ``mistake``, ``unreadable``, ``slow``.

    Attributes
    ----------
    of
        Contents of the logs that were analyzed, in their order.
    """

    def __init__(self) -> None:
        self.of: list[str] = []

    def __call__(
        self, path: Path, settings: Settings, check: Callable[[int, int], None]
    ) -> Analysis:
        text = path.read_text()
        self.of.append(text)
        check(50, 100)
        if "junk" in text:
            raise LogError(f"{path} holds no messages")
        if "mistake" in text:
            raise IndexError("list index out of range")
        if "unreadable" in text:
            raise OSError(5, "Input/output error")
        return Analysis(path, summary([fault()] if "faulty" in text else []), settings, [])


@pytest.fixture
def analyses(monkeypatch: pytest.MonkeyPatch) -> Analyses:
    made = Analyses()
    monkeypatch.setattr("monitor.analyze.analyze_log", made)
    return made
