"""Learning an airframe's thresholds from its healthy flights.

::

    flights = [measure(batches, settings, name) for name, batches in healthy]   # once per flight
    learnt = learn(flights, settings)                                           # costs nothing
    without = learn([f for f in flights if f is not judged], settings)          # leave one out
    Pipeline(without.settings)

The command is :func:`calibrate` and :func:`document`. Thresholds never come from the flight that is
judged by them: a learnt file names its flights with their digests, and ``analyze`` says so when it
meets one of them.
"""

from monitor.learn.calibrate import Measure, calibrate
from monitor.learn.document import document
from monitor.learn.flights import Alarm, Flight, measure, measure_log, same_flight
from monitor.learn.thresholds import (
    Change,
    Learnt,
    Outcome,
    TooLittle,
    Unfit,
    check_alike,
    check_healthy,
    learn,
    raised_levels,
    widened,
)

__all__ = [
    "Alarm",
    "Change",
    "Flight",
    "Learnt",
    "Measure",
    "Outcome",
    "TooLittle",
    "Unfit",
    "calibrate",
    "check_alike",
    "check_healthy",
    "document",
    "learn",
    "measure",
    "measure_log",
    "raised_levels",
    "same_flight",
    "widened",
]
