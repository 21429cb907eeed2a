"""The whole calibration: measure, look which flights can be learnt from, learn, and try it out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from monitor.learn.fit import (
    TooLittle,
    Unfit,
    alarm_words,
    check_alike,
    check_enough,
    check_healthy,
)
from monitor.learn.flights import Alarm, Flight
from monitor.learn.thresholds import (
    Learnt,
    beyond_ceiling,
    learn,
    raised_levels,
    widened,
    with_keys,
)
from monitor.settings import Settings

__all__ = ["Calibration", "LeftOut", "Measure", "Trial", "calibrate", "flagged_by_the_others"]

ASSERT_HINT = " (--assert-healthy learns from it all the same)"
ONE_IN = 10
"""One flight in so many may be left out, and one in any case: more are not the exception."""

Trial = tuple[int, Settings]
"""Number of a flight, and the settings to run it with."""
Measure = Callable[[Sequence[Trial], str], Sequence[Flight]]
"""Runs flights, in the order given; the text says what for, beside a progress bar."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A flight that was not learnt from.

    Attributes
    ----------
    name
        Of the log.
    why
        What was found in it.
    """

    name: str
    why: str


@dataclass(frozen=True, slots=True)
class Calibration:
    """Thresholds of an airframe, and how they came about.

    Attributes
    ----------
    learnt
        The thresholds.
    numbers
        Of the flights learnt from, as the caller counts them.
    flagged
        How many of these had a verdict by the settings learnt over.
    left_out
        The other flights.
    crossed
        Flights that are flagged by what the others teach, each with what is said of it; None before
        :func:`flagged_by_the_others` has looked.
    """

    learnt: Learnt
    numbers: tuple[int, ...]
    flagged: int
    left_out: tuple[LeftOut, ...] = ()
    crossed: tuple[tuple[str, Alarm], ...] | None = None


def calibrate(
    measure: Measure,
    count: int,
    settings: Settings,
    airframe: str = "",
    *,
    assert_healthy: bool = False,
) -> Calibration:
    """Thresholds of an airframe that are silent on the flights that they come from.

    Two to four passes over the flights. Noise levels come first, since every statistic is held to
    them; where the operator asserts that flights are healthy in which the defaults find faults,
    these are measured with thresholds out of reach; at last the result is tried out.

    One flight in ten may turn out not to be healthy: it is left out, and named. Without the
    operator's assertion that is a flight with a verdict; with it, one that no threshold short of
    blinding the monitor would keep silent.

    Parameters
    ----------
    measure
        Runs the flights.
    count
        How many there are.
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
    first = measure([(k, settings) for k in range(count)], "measuring")
    check_alike(first)
    numbers, left_out = list(range(count)), list[LeftOut]()
    if not assert_healthy:
        sick = {k: alarm_words(f) for k, f in enumerate(first) if f.alarms}
        numbers = _without(first, numbers, sick, left_out)
        check_healthy((first[k] for k in numbers), ASSERT_HINT)
    check_enough([first[k] for k in numbers])
    while True:
        flights = [first[k] for k in numbers]
        levels = raised_levels(flights, settings)
        base = measured = with_keys(settings, {c.key: c.value for c in levels})
        if levels:
            flights = list(measure([(k, base) for k in numbers], "measuring with its noise"))
        if not any(f.alarms for f in flights):
            break
        measured = widened(base)
        flights = list(measure([(k, measured) for k in numbers], "measuring past the defaults"))
        apart = {k: why for k, f in zip(numbers, flights, strict=True) if (why := _apart(f, base))}
        if not apart:
            break
        kept = _without(first, numbers, apart, left_out)
        if kept == numbers:
            check_healthy(
                flights, ", even with every threshold out of reach: leave that flight out"
            )
            raise Unfit(next(iter(apart.values())))
        numbers = kept
    learnt = learn(flights, base, airframe, levels, measured=measured)
    check_healthy(
        measure([(k, learnt.settings) for k in numbers], "trying it out"),
        ", even with the thresholds learnt from it: leave that flight out",
    )
    flagged = sum(bool(first[k].alarms) for k in numbers)
    return Calibration(learnt, tuple(numbers), flagged, tuple(left_out))


def _apart(flight: Flight, base: Settings) -> str:
    """Why a flight, measured with thresholds out of reach, cannot be healthy; or nothing."""
    if flight.alarms:
        return f"{alarm_words(flight)}, even with every threshold out of reach"
    return beyond_ceiling(flight, base)


def _without(
    flights: Sequence[Flight], numbers: list[int], bad: dict[int, str], left_out: list[LeftOut]
) -> list[int]:
    """The flights without the bad ones, if these are few and the rest is enough; else all."""
    kept = [k for k in numbers if k not in bad]
    if not bad or len(left_out) + len(bad) > max(1, len(flights) // ONE_IN):
        return numbers
    try:
        check_enough([flights[k] for k in kept])
    except TooLittle:
        return numbers
    left_out += [LeftOut(flights[k].name, why) for k, why in bad.items()]
    return kept


def flagged_by_the_others(measure: Measure, calibration: Calibration) -> Calibration:
    """Judge each flight by what the others teach, and say which are flagged.

    A threshold rests on its loudest flight, so that a flight that is the loudest in nothing is
    judged by the same thresholds with and without it; only the others run again.
    """
    learnt = calibration.learnt
    trials: dict[int, dict[str, float]] = {}
    for change in learnt.changes:
        if change.loudest >= 0 and change.without < change.value:
            trials.setdefault(change.loudest, {})[change.key] = change.without
    again = [
        (calibration.numbers[at], with_keys(learnt.settings, values))
        for at, values in sorted(trials.items())
    ]
    flights = measure(again, "leaving each flight out") if again else []
    crossed = tuple((f.name, f.alarms[0]) for f in flights if f.alarms)
    return replace(calibration, crossed=crossed)
