"""One file per watch: rows to an estimator, to detection, to verdicts with evidence."""

from __future__ import annotations

from monitor.settings import Settings
from monitor.verdict import Watch
from monitor.watch.air import AirWatch
from monitor.watch.engine import EngineWatch
from monitor.watch.imu import ImuWatch
from monitor.watch.wing import WingWatch

__all__ = ["build_watches"]


def build_watches(settings: Settings) -> list[Watch]:
    """The watches that the settings ask for, in the order in which they see the rows."""
    return [
        ImuWatch(settings.imu),
        AirWatch(settings.air, settings.triplex, settings.vane),
        EngineWatch(settings.engine),
        WingWatch(settings.wing),
    ]
