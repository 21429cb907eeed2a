"""The whole calibration: measure, look whether it can be learnt from, learn, and try it out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from monitor.learn.flights import Flight
from monitor.learn.thresholds import (
    Learnt,
    check_alike,
    check_enough,
    check_healthy,
    learn,
    raised_levels,
    widened,
    with_keys,
)
from monitor.settings import Settings

__all__ = ["Measure", "calibrate"]

ASSERT_HINT = " (--assert-healthy learns from it all the same)"


Measure = Callable[[Settings, str], Sequence[Flight]]
"""Runs all flights with these settings; the text says what for, beside a progress bar."""


def calibrate(
    measure: Measure, settings: Settings, airframe: str = "", *, assert_healthy: bool = False
) -> Learnt:
    """Thresholds of an airframe that are silent on the flights that they come from.

    Two to four passes over the flights. Noise levels come first, since every statistic is held to
    them; where the operator asserts that flights are healthy in which the defaults find faults,
    these are measured with thresholds out of reach; at last the result is tried out.

    Parameters
    ----------
    measure
        Runs the flights.
    settings
        What is learnt over: a profile, and hand-set keys.
    airframe
        Name to remember.
    assert_healthy
        Verdicts of faulty are false alarms: the operator says so.

    Raises
    ------
    Unfit
        Too little, not healthy, of different vehicles, or one flight given twice.
    """
    flights = measure(settings, "measuring")
    check_alike(flights)
    if not assert_healthy:
        check_healthy(flights, ASSERT_HINT)
    check_enough(flights)
    levels = raised_levels(flights, settings)
    base = measured = with_keys(settings, {c.key: c.value for c in levels})
    if levels:
        flights = measure(base, "measuring with its noise")
    if any(f.alarms for f in flights):
        measured = widened(base)
        flights = measure(measured, "measuring past the defaults")
        check_healthy(flights, ", even with every threshold out of reach: leave that flight out")
    learnt = learn(flights, base, airframe, levels, measured=measured)
    check_healthy(
        measure(learnt.settings, "trying it out"),
        ", even with the thresholds learnt from it: leave that flight out",
    )
    return learnt
