"""Learning an airframe's thresholds from its healthy flights.

::

    flights = [measure(batches, settings, name) for name, batches in healthy]   # once per flight
    learnt = learn(flights, settings)                                           # costs nothing
    without = learn([f for f in flights if f is not judged], settings)          # leave one out
    Pipeline(without.settings)

The command is :func:`calibrate`, :func:`flagged_by_the_others` and :func:`document`. Thresholds
never come from the flight that is judged by them: a learnt file names its flights with their
digests, and ``analyze`` says so when it meets one of them.
"""

from monitor.learn.calibrate import (
    Calibration,
    LeftOut,
    Measure,
    Trial,
    calibrate,
    flagged_by_the_others,
)
from monitor.learn.document import document
from monitor.learn.fit import TooLittle, Unfit, check_alike, check_healthy
from monitor.learn.flights import Alarm, Flight, measure, measure_log, same_flight
from monitor.learn.thresholds import Change, Learnt, Outcome, learn, raised_levels, widened

__all__ = [
    "Alarm",
    "Calibration",
    "Change",
    "Flight",
    "Learnt",
    "LeftOut",
    "Measure",
    "Outcome",
    "TooLittle",
    "Trial",
    "Unfit",
    "calibrate",
    "check_alike",
    "check_healthy",
    "document",
    "flagged_by_the_others",
    "learn",
    "measure",
    "measure_log",
    "raised_levels",
    "same_flight",
    "widened",
]
