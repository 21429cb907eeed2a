"""From the peaks of healthy flights to thresholds: a table lookup and a maximum.

A threshold becomes the larger of its floor and the largest healthy maximum times :data:`FACTOR`.
It may rise on the least data that is accepted at all, since an alarm too few is what the operator
asks for by calling the flights healthy; it falls below its default only on :data:`LOWER_FLIGHTS`
flights and :data:`LOWER_S` judged, and never below its floor.

What a flight is silent at is an upper bound of what the test needs: a peak beyond the threshold in
force, on a flight without a verdict, counts as that threshold (the test's other conditions held).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

from monitor.learn.fit import LEAST_S, Unfit, check_enough, least_seconds
from monitor.learn.flights import Flight, vehicle_words
from monitor.learn.rules import LEVELS, RULES, Kind, Rule
from monitor.settings import Settings
from monitor.settings.learnt import LearntLog, LearntSettings

__all__ = [
    "CEILING",
    "FACTOR",
    "LOWER_FLIGHTS",
    "LOWER_S",
    "Change",
    "Learnt",
    "Outcome",
    "beyond_ceiling",
    "default_of",
    "learn",
    "raised_levels",
    "widened",
    "with_keys",
]

FACTOR = 1.3
"""Threshold over the largest healthy value, in the size of a fault (algorithm note, "the deployed
form"). A log likelihood grows with the square of the size, hence times 1.69."""
LOWER_FLIGHTS, LOWER_S = 5, 3600.0
"""No threshold is lowered on less [s]: an hour bounds the rate of false alarms at three an hour."""
CEILING = 3.0
"""Where only faults so many times as large could be found, something is wrong with the aircraft."""
DIGITS = 3


class Outcome(Enum):
    """What became of a key."""

    LOWERED = "lowered"
    RAISED = "raised"
    FLOOR = "lowered to its floor"
    KEPT_SIZE = "kept: a physical size"
    KEPT_FLOOR = "kept: never below the default"
    KEPT_DATA = "kept: too little data to lower it"
    KEPT_UNSEEN = "kept: its test was not made"


@dataclass(frozen=True, slots=True)
class Change:
    """One key, before and after.

    Attributes
    ----------
    key
        Dotted settings key.
    default, value
        Before and after, in the key's unit.
    floor
        Never learnt below this.
    peak
        Largest healthy value, NaN where the test was not made.
    log
        Name of the flight that showed it.
    flights, seconds
        How many flights made the test, and the least time that any of its sensors was judged [s].
    outcome
        What became of it.
    why
        What its floor rests on, or why it is kept.
    kind
        What the key is to a verdict.
    power
        Smallest fault found is proportional to value ** power.
    loudest
        Number of that flight among those learnt from; -1 where none stands out.
    without
        What is learnt without that flight, in the key's unit.
    beyond
        Flights whose peak is beyond the default: so many at most would be flagged by it.
    """

    key: str
    default: float
    value: float
    floor: float
    peak: float
    log: str
    flights: int
    seconds: float
    outcome: Outcome
    why: str
    kind: Kind = Kind.STATISTIC
    power: float = 1.0
    loudest: int = -1
    without: float = math.nan
    beyond: int = 0

    @property
    def fault_growth(self) -> float:
        """Smallest fault found over that with the default: above 1 is less sensitive."""
        return math.pow(self.value / self.default, self.power)


@dataclass(frozen=True, slots=True)
class Learnt:
    """Thresholds of an airframe.

    Attributes
    ----------
    settings
        The settings measured with, with what was learnt over them and where it came from.
    changes
        Every key that was looked at.
    hours
        Least judged time of any sensor that something was learnt of [h].
    flights
        Those learnt from.
    """

    settings: Settings
    changes: tuple[Change, ...]
    hours: float
    flights: tuple[Flight, ...] = field(default=(), repr=False, compare=False)

    @property
    def overrides(self) -> dict[str, float]:
        """Dotted key -> value, of the keys that are not at their default any more."""
        return {c.key: c.value for c in self.changes if c.value != c.default}


def learn(
    flights: Sequence[Flight],
    settings: Settings,
    airframe: str = "",
    levels: Sequence[Change] = (),
    *,
    measured: Settings | None = None,
) -> Learnt:
    """Thresholds from the peaks of healthy flights.

    Costs nothing: flights are measured once, and any subset of them can be learnt from.

    Parameters
    ----------
    flights
        All measured with one configuration. That they are healthy is for the caller to say
        (:func:`monitor.learn.fit.check_healthy`).
    settings
        What is learnt over: its values are the defaults.
    airframe
        Name to remember.
    levels
        Noise levels that were raised before, hence are in ``settings`` already.
    measured
        What the flights were measured with; None: ``settings``.

    Raises
    ------
    TooLittle
        See :func:`monitor.learn.fit.check_enough`.
    Unfit
        A threshold would have to be beyond :data:`CEILING` times its default.
    ValueError
        A flight was measured with other settings.
    """
    if any(f.settings != (measured or settings) for f in flights):
        raise ValueError("a flight was measured with other settings: its peaks do not compare")
    check_enough(flights)
    changes = [*levels, *(_change(rule, flights, settings) for rule in RULES)]
    used = {r.quantity for r in RULES if least_seconds(flights, r.quantity) >= LEAST_S}
    hours = min(least_seconds(flights, quantity) for quantity in used) / 3600.0
    made = [c for c in changes if c.value != c.default]
    provenance = LearntSettings(
        airframe=airframe,
        vehicle=next((vehicle_words(f.vehicle) for f in flights if f.vehicle), ""),
        hours=round(hours, 3),
        keys=tuple(c.key for c in made),
        logs=tuple(
            LearntLog(name=f.name, sha256=f.sha256, seconds=round(f.seconds, 1))
            for f in flights
            if f.sha256
        ),
    )
    values = with_keys(settings, {c.key: c.value for c in made})
    settings = values.model_copy(update={"learnt": provenance})
    return Learnt(settings, tuple(changes), hours, tuple(flights))


def raised_levels(flights: Sequence[Flight], settings: Settings) -> list[Change]:
    """Noise levels that the flights show to be above the settings'; they are never lowered."""
    out = []
    for level in LEVELS:
        seen = sorted(
            (-f.levels[level.measured] * level.factor, k)
            for k, f in enumerate(flights)
            if level.measured in f.levels
        )
        default = default_of(settings, level.key)
        if not seen or -seen[0][0] <= default:
            continue
        value, second = -seen[0][0], -seen[1][0] if len(seen) > 1 else 0.0
        where = flights[seen[0][1]]
        out.append(
            Change(
                key=level.key,
                default=default,
                value=_up(value),
                floor=default,
                peak=value,
                log=where.name,
                flights=len(seen),
                seconds=sum(max(flights[k].judged_s.values(), default=0.0) for _, k in seen),
                outcome=Outcome.RAISED,
                why="below it the model's own errors count, not noise",
                kind=Kind.LEVEL,
                loudest=seen[0][1],
                without=max(_up(second), default),
                beyond=sum(-level > default for level, _ in seen),
            )
        )
    return out


def widened(settings: Settings) -> Settings:
    """The settings with every learnable threshold as high as it may ever become.

    On a flight that its operator calls healthy the quantities can then be followed past the point
    at which they would have been taken for a fault.
    """
    return with_keys(
        settings,
        {
            r.key: r.scaled(default_of(settings, r.key), CEILING)
            for r in RULES
            if r.kind is not Kind.SIZE
        },
    )


def default_of(settings: Settings, key: str) -> float:
    """Value of a dotted key."""
    return float(functools.reduce(getattr, key.split("."), settings))  # type: ignore[arg-type]


def with_keys(settings: Settings, values: dict[str, float]) -> Settings:
    """The settings with these dotted keys over them, validated."""
    raw = settings.model_dump()
    for key, value in values.items():
        *tables, name = key.split(".")
        functools.reduce(dict.__getitem__, tables, raw)[name] = value
    return Settings.model_validate(raw)


def _change(rule: Rule, flights: Sequence[Flight], settings: Settings) -> Change:
    """What becomes of one key."""
    default = default_of(settings, rule.key)
    made = [k for k, f in enumerate(flights) if _made(rule, f)]
    seconds = least_seconds([flights[k] for k in made], rule.quantity)
    ranked = sorted(((_needed(flights[k], rule.key), -k) for k in made), reverse=True)
    peak, at = ranked[0] if ranked else (math.nan, 1)
    second = ranked[1][0] if len(ranked) > 1 else 0.0
    loudest = -at if peak > 0.0 else -1
    value = without = default
    if not made or seconds < LEAST_S:
        outcome = Outcome.KEPT_UNSEEN
    elif rule.kind is Kind.SIZE:
        outcome = Outcome.KEPT_SIZE
    else:
        value, outcome = _threshold(rule, default, peak, len(made), seconds)
        without, _ = _threshold(rule, default, second, len(made), seconds)
    log = flights[loudest].name if loudest >= 0 else ""
    if value > rule.scaled(default, CEILING):
        raise Unfit(_blinding(rule, value, default, log))
    return Change(
        key=rule.key,
        default=default,
        value=value,
        floor=rule.least_value(default),
        peak=peak,
        log=log,
        flights=len(made),
        seconds=seconds,
        outcome=outcome,
        why=rule.why,
        kind=rule.kind,
        power=rule.power,
        loudest=loudest,
        without=without,
        beyond=sum(needed > default for needed, _ in ranked),
    )


def _made(rule: Rule, flight: Flight) -> bool:
    """Whether the rule's test was made in this flight."""
    peak = flight.peaks.get(rule.key, math.nan)
    return rule.least <= flight.count(rule.quantity) <= rule.most and math.isfinite(peak)


def _blinding(rule: Rule, value: float, default: float, log: str) -> str:
    return (
        f"{rule.key} would have to be {value:.3g} instead of {default:g} for {log} to be a "
        f"healthy flight, and only faults {CEILING:g} times as large be found: leave it out"
    )


def beyond_ceiling(flight: Flight, settings: Settings) -> str:
    """Why a flight's peaks cannot be learnt over these settings, in one sentence; or nothing."""
    for rule in RULES:
        if rule.kind is not Kind.SIZE and _made(rule, flight):
            default = default_of(settings, rule.key)
            value = _up(rule.scaled(_needed(flight, rule.key), FACTOR))
            if value > rule.scaled(default, CEILING):
                return _blinding(rule, value, default, flight.name)
    return ""


def _needed(flight: Flight, key: str) -> float:
    """Healthy maximum of a flight: its peak, or what it was silent at if that is less."""
    peak = flight.peaks[key]
    return peak if flight.alarms else min(peak, default_of(flight.settings, key))


def _threshold(
    rule: Rule, default: float, peak: float, flights: int, seconds: float
) -> tuple[float, Outcome]:
    wanted = _up(rule.scaled(peak, FACTOR))
    if wanted >= default:
        return wanted, Outcome.RAISED if wanted > default else Outcome.KEPT_FLOOR
    floor = rule.least_value(default)
    if floor == default:
        return default, Outcome.KEPT_FLOOR
    if flights < LOWER_FLIGHTS or seconds < LOWER_S:
        return default, Outcome.KEPT_DATA
    return (wanted, Outcome.LOWERED) if wanted > floor else (floor, Outcome.FLOOR)


def _up(value: float) -> float:
    """Rounded up to three significant digits: never below what was meant."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - DIGITS + 1)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.{DIGITS}g}")
