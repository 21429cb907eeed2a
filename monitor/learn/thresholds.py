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
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

from monitor.learn.flights import Flight, same_flight, vehicle_words
from monitor.learn.rules import LEVELS, RULES, Kind, Rule
from monitor.settings import Settings
from monitor.settings.learnt import LearntLog, LearntSettings

__all__ = [
    "FACTOR",
    "LEAST_FLIGHTS",
    "LEAST_S",
    "LOWER_FLIGHTS",
    "LOWER_S",
    "Change",
    "Learnt",
    "Outcome",
    "TooLittle",
    "Unfit",
    "check_alike",
    "check_enough",
    "check_healthy",
    "default_of",
    "learn",
    "raised_levels",
    "widened",
    "with_keys",
]

FACTOR = 1.3
"""Threshold over the largest healthy value, in the size of a fault (algorithm note, "the deployed
form"). A log likelihood grows with the square of the size, hence times 1.69."""
LEAST_FLIGHTS, LEAST_S = 3, 600.0
"""Nothing is learnt from fewer flights, or from less judged time of each sensor [s]: a flight has
few turns and one weather, and three show at least that their maxima resemble each other."""
LOWER_FLIGHTS, LOWER_S = 5, 3600.0
"""No threshold is lowered on less [s]: an hour bounds the rate of false alarms at three an hour."""
CEILING = 3.0
"""Where only faults so many times as large could be found, something is wrong with the aircraft."""
DIGITS = 3


class Unfit(ValueError):
    """Flights that nothing can be learnt from, in one plain sentence."""


class TooLittle(Unfit):
    """Too few flights, or too little of them judged."""


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
    """

    settings: Settings
    changes: tuple[Change, ...]
    hours: float

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
        (:func:`check_healthy`).
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
        Fewer than :data:`LEAST_FLIGHTS`, or no kind of sensor was judged for :data:`LEAST_S`.
    Unfit
        A threshold would have to be beyond :data:`CEILING` times its default.
    ValueError
        A flight was measured with other settings.
    """
    if any(f.settings != (measured or settings) for f in flights):
        raise ValueError("a flight was measured with other settings: its peaks do not compare")
    check_enough(flights)
    changes = [*levels, *(_change(rule, flights, settings) for rule in RULES)]
    used = {r.quantity for r in RULES if _seconds(flights, r.quantity) >= LEAST_S}
    hours = min(_seconds(flights, quantity) for quantity in used) / 3600.0
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
    return Learnt(values.model_copy(update={"learnt": provenance}), tuple(changes), hours)


def raised_levels(flights: Sequence[Flight], settings: Settings) -> list[Change]:
    """Noise levels that the flights show to be above the settings'; they are never lowered."""
    out = []
    for level in LEVELS:
        seen = [
            (f.levels[level.measured] * level.factor, f)
            for f in flights
            if level.measured in f.levels
        ]
        default = default_of(settings, level.key)
        if not seen or max(s[0] for s in seen) <= default:
            continue
        value, where = max(seen, key=lambda s: s[0])
        out.append(
            Change(
                key=level.key,
                default=default,
                value=_up(value),
                floor=default,
                peak=value,
                log=where.name,
                flights=len(seen),
                seconds=sum(max(f.judged_s.values(), default=0.0) for _, f in seen),
                outcome=Outcome.RAISED,
                why="below it the model's own errors count, not noise",
                kind=Kind.LEVEL,
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


def check_alike(flights: Sequence[Flight]) -> None:
    """All flights are of one vehicle, and each is there once.

    Raises
    ------
    Unfit
        Naming two logs that are of different vehicles, or of the same flight.
    """
    for i, b in enumerate(flights):
        for a in flights[:i]:
            if same_flight(a, b):
                raise Unfit(f"{a.name} and {b.name} are the same flight: give it once")
            if a.vehicle is not None and b.vehicle is not None and a.vehicle != b.vehicle:
                raise Unfit(
                    f"{a.name} ({vehicle_words(a.vehicle)}) and {b.name} "
                    f"({vehicle_words(b.vehicle)}) are of different vehicles: thresholds belong "
                    "to one airframe"
                )


def check_enough(flights: Sequence[Flight]) -> None:
    """There is enough to learn anything from.

    Raises
    ------
    TooLittle
        Fewer than :data:`LEAST_FLIGHTS`, or no kind of sensor was judged for :data:`LEAST_S`.
    """
    quantities = dict.fromkeys(r.quantity for r in RULES)
    if len(flights) >= LEAST_FLIGHTS and any(_seconds(flights, q) >= LEAST_S for q in quantities):
        return
    need = (
        f"thresholds need {LEAST_FLIGHTS} healthy flights and {LEAST_S / 60.0:.0f} judged minutes "
        "of each sensor"
    )
    judged = []
    for quantity in quantities:
        total = _per_sensor(flights, quantity)
        if total:
            sensor = min(total, key=lambda s: total[s])
            judged.append(f"{total[sensor] / 60.0:.1f} min of {sensor}")
    said = " and ".join(judged) if judged else "no sensor"
    many = "this flight" if len(flights) == 1 else f"these {len(flights)} flights"
    raise TooLittle(f"{need}; {many} judged {said}")


def check_healthy(flights: Iterable[Flight], hint: str = "") -> None:
    """No flight has a verdict of faulty, nor do sensors disagree in one.

    Raises
    ------
    Unfit
        Naming sensor, time and log of the first one; ``hint`` follows.
    """
    for f in flights:
        if f.alarms:
            a = f.alarms[0]
            more = f" (and {len(f.alarms) - 1} more)" if len(f.alarms) > 1 else ""
            raise Unfit(
                f"{f.name} is not a healthy flight: {a.sensor} {a.state} at {a.detected_s:.1f} s"
                f"{more}: {a.evidence}{hint}"
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


def _seconds(flights: Sequence[Flight], quantity: str) -> float:
    """The least time for which any sensor of a quantity was judged in all flights together [s]."""
    return min(_per_sensor(flights, quantity).values(), default=0.0)


def _per_sensor(flights: Sequence[Flight], quantity: str) -> dict[str, float]:
    total: dict[str, float] = {}
    for f in flights:
        for sensor, seconds in f.judged(quantity).items():
            total[sensor] = total.get(sensor, 0.0) + seconds
    return total


def _change(rule: Rule, flights: Sequence[Flight], settings: Settings) -> Change:
    """What becomes of one key."""
    default = default_of(settings, rule.key)
    made = [
        f
        for f in flights
        if rule.least <= f.count(rule.quantity) <= rule.most
        and math.isfinite(f.peaks.get(rule.key, math.nan))
    ]
    seconds = _seconds(made, rule.quantity)
    peak, log = math.nan, ""
    if made:
        loudest = max(made, key=lambda f: _needed(f, rule.key))
        peak = _needed(loudest, rule.key)
        log = loudest.name if peak > 0.0 else ""
    if not made or seconds < LEAST_S:
        value, outcome = default, Outcome.KEPT_UNSEEN
    elif rule.kind is Kind.SIZE:
        value, outcome = default, Outcome.KEPT_SIZE
    else:
        value, outcome = _threshold(rule, default, peak, len(made), seconds)
    if value > rule.scaled(default, CEILING):
        raise Unfit(
            f"{rule.key} would have to be {value:.3g} instead of {default:g} for {log} to be a "
            f"healthy flight, and only faults {CEILING:g} times as large be found: leave it out"
        )
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
    )


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
