"""Thresholds for each recorded flight from the other flights only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from monitor.learn import Flight, Trial, Unfit, calibrate, measure_log
from monitor.settings import Settings

__all__ = ["Learner", "calibrated", "leave_one_out"]

Learner = Callable[[Sequence[Path], Settings], Settings]
"""Settings learnt from healthy logs over others.

Raises :class:`monitor.learn.Unfit` when they are no base to learn from."""


def calibrated() -> Learner:
    """``mavsentry learn thresholds``; a log is measured once per settings."""
    measured: dict[tuple[Path, str], Flight] = {}

    def one(log: Path, settings: Settings) -> Flight:
        key = log, settings.model_dump_json()
        if key not in measured:
            measured[key] = measure_log(log, settings)
        return measured[key]

    def learner(logs: Sequence[Path], settings: Settings) -> Settings:
        def measure(trials: Sequence[Trial], _: str) -> list[Flight]:
            return [one(logs[k], tried) for k, tried in trials]

        return calibrate(measure, len(logs), settings).learnt.settings

    return learner


def leave_one_out(
    logs: Sequence[Path], settings: Settings, learner: Learner
) -> tuple[list[Settings], str]:
    """Settings per flight, and one sentence on where they come from.

    Where the others are no base to learn from, all flights keep the settings given: flights that
    are judged by different rules would not make one table.
    """
    learnt: list[Settings] = []
    for judged in logs:
        try:
            learnt.append(learner([log for log in logs if log != judged], settings))
        except Unfit as reason:
            text = str(reason).rstrip(".")
            return [settings] * len(logs), (
                f"thresholds of the bundled profile {settings.profile}: nothing could be learnt "
                f"from the other flights ({text})"
            )
    return learnt, (
        f"each flight is judged with thresholds learnt from the {len(logs) - 1} others, over the "
        f"profile {settings.profile}"
    )
