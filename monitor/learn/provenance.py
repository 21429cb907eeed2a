"""Whether thresholds in force were learnt from the very flight that they judge."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from monitor.learn.flights import digest
from monitor.settings.learnt import LearntSettings

__all__ = ["provenance"]

FROM_THIS_FLIGHT = "thresholds were learnt from this very flight: its silence proves nothing"


def provenance(learnt: LearntSettings, log: Path, vehicle: str) -> dict[str, Any] | None:
    """What ``summary.json`` says of learnt thresholds under ``learnt``; None without any.

    Parameters
    ----------
    learnt
        The settings' section.
    log
        The file that is judged.
    vehicle
        Whose flight it is, in the words of :func:`monitor.learn.flights.vehicle_words`.

    Raises
    ------
    OSError
        The log cannot be read.
    """
    if not learnt.logs:
        return None
    own = digest(log) in {known.sha256 for known in learnt.logs}
    note = None
    if own:
        note = FROM_THIS_FLIGHT
    elif learnt.vehicle and vehicle != learnt.vehicle:
        note = f"thresholds were learnt from another vehicle ({learnt.vehicle})"
    return {
        "airframe": learnt.airframe,
        "flights": len(learnt.logs),
        "hours": learnt.hours,
        "from_this_flight": own,
        "note": note,
    }
