"""A fault injected into a flight at a moment, and what the pipeline says of it.

The pipeline of the healthy flight is kept (pickled) just before each moment, and every trial goes
on from there: verdicts depend on the rows alone, not on where the stream is cut, so that this gives
what the whole flight would give.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, radians
from typing import Any, Final

import numpy as np

from links.samples import Batch
from links.vocabulary import Reason, State
from monitor import summary
from monitor.commands.bench_detect.configurations import Configuration, Shape, Target, pair_of
from monitor.commands.bench_detect.flights import Flight
from monitor.commands.bench_detect.search import Outcome
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.verdict import Verdict
from monitor.watch import build_watches
from sim_feeds.attitude_follow import AttitudeFollows
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.injection import Injection, RowInjector

__all__ = ["Healthy", "Moment", "fault_of", "judge", "moments", "outcome_of", "watch_healthy"]

US: Final = 1_000_000
SETTLED_S: Final = 1.0
"""A sensor has been ``ok`` for this long when it is broken."""
AFTERMATH_S: Final = 10.0
"""For this long after the sensor was named, others that are blamed count as blame errors."""
PIECE_S: Final = 2.5
"""A trial is judged this much at a time, and ended when it is decided."""


@dataclass(frozen=True, slots=True)
class Healthy:
    """A healthy flight in one configuration, as the pipeline judges it.

    Attributes
    ----------
    spans_us
        When all targets were ``ok`` and a longest window was left before the landing.
    duration_s, judged_s
        Of the flight; of the time in which the first target was judged.
    false
        Faults found, as ``summary.json`` has them.
    """

    spans_us: tuple[tuple[int, int], ...]
    duration_s: float
    judged_s: float
    false: tuple[dict[str, Any], ...]


@dataclass(frozen=True, slots=True)
class Moment:
    """Where and when a trial begins.

    Attributes
    ----------
    flight
        Its name.
    first_us, onset_us
        Vehicle times of the first record and of the fault.
    sense
        +1 reads high, -1 low.
    seed
        Of the injection.
    pipeline
        State just before the onset, pickled; only the watches that read what the fault changes.
    pieces
        Rows from there to the end of the longest window, a few seconds each.
    """

    flight: str
    first_us: int
    onset_us: int
    sense: int
    seed: int
    pipeline: bytes
    pieces: tuple[Batch, ...]


def watch_healthy(
    flight: Flight, configuration: Configuration, settings: Settings, longest_s: float
) -> Healthy:
    """Judge a flight as it is, and find the times at which a trial may begin."""
    pipeline = Pipeline(configuration.settings(settings))
    result = pipeline.feed(configuration.thinned(flight.batch))
    verdicts = [*result.verdicts, *pipeline.finish().verdicts]
    margin_us = round((longest_s + settings.streams.horizon_s + SETTLED_S) * US)
    spans = [(flight.first_us, flight.last_us - margin_us)]
    for target in configuration.targets:
        own = [v for v in verdicts if v.sensor == target.sensor]
        spans = _common(spans, _ok_spans(own, flight.last_us, margin_us))
    first = configuration.targets[0].sensor
    seconds = summary.monitored(verdicts, flight.first_us, pipeline.now_us)
    return Healthy(
        tuple(spans),
        flight.duration_s,
        sum(m["seconds"] for m in seconds if m["sensor"] == first),
        tuple(summary.faults(verdicts, flight.first_us)),
    )


def _ok_spans(verdicts: list[Verdict], last_us: int, margin_us: int) -> list[tuple[int, int]]:
    """When a sensor was ``ok`` for a while, and ``margin_us`` before it was on the ground."""
    ends = [*(v.t_us for v in verdicts[1:]), last_us]
    down = [v.t_us for v in verdicts if v.reason is Reason.ON_GROUND]
    spans = []
    for v, end_us in zip(verdicts, ends, strict=True):
        landed_us = min((t for t in down if t >= v.t_us), default=last_us)
        begin_us = v.t_us + round(SETTLED_S * US)
        end_us = min(end_us, landed_us - margin_us)
        if v.state is State.OK and begin_us < end_us:
            spans.append((begin_us, end_us))
    return spans


def _common(a: list[tuple[int, int]], b: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Intersection of two lists of spans."""
    both = [(max(x0, y0), min(x1, y1)) for x0, x1 in a for y0, y1 in b]
    return sorted((begin, end) for begin, end in both if begin < end)


def moments(
    flights: Sequence[Flight],
    healthy: Sequence[Healthy],
    settings: Sequence[Settings],
    configuration: Configuration,
    trials: int,
    longest_s: float,
    rng: np.random.Generator,
) -> list[Moment]:
    """Draw the moments of the trials, one in each equal share of the time in which one may be.

    Parameters
    ----------
    flights, healthy, settings
        One each per flight.
    configuration
        Sensors that the aircraft carries.
    trials
        How many.
    longest_s
        Longest window [s].
    rng
        Draws times, senses and seeds.

    Returns
    -------
    list of Moment
        In random order, so that those given up early are spread; empty when there is no time in
        which a trial may be.
    """
    spans = [(i, *span) for i, h in enumerate(healthy) for span in h.spans_us]
    lengths = np.array([end - begin for _, begin, end in spans], np.float64)
    if not len(spans):
        return []
    edges = np.concatenate(([0.0], np.cumsum(lengths)))
    drawn: dict[int, list[int]] = {}
    for k in range(trials):
        where = (k + rng.random()) / trials * edges[-1]
        j = min(int(np.searchsorted(edges, where, "right")) - 1, len(spans) - 1)
        drawn.setdefault(spans[j][0], []).append(spans[j][1] + int(where - edges[j]))
    found = [
        moment
        for i, onsets_us in drawn.items()
        for moment in _kept(
            flights[i], sorted(onsets_us), configuration, settings[i], longest_s, rng
        )
    ]
    return [found[k] for k in rng.permutation(len(found))]


def _kept(
    flight: Flight,
    onsets_us: list[int],
    configuration: Configuration,
    settings: Settings,
    longest_s: float,
    rng: np.random.Generator,
) -> list[Moment]:
    """The pipeline just before each onset of one flight."""
    batch = configuration.thinned(flight.batch)
    used = configuration.settings(settings)
    watches = [w for w in build_watches(used) if w.quantities & configuration.changed]
    pipeline = Pipeline(used, watches)
    end_s = longest_s + settings.streams.horizon_s + SETTLED_S
    edges_us = [round(s * US) for s in np.append(np.arange(PIECE_S, end_s, PIECE_S), end_s)]
    cuts = [_first_seq(batch, onset_us) for onset_us in onsets_us]
    found = []
    for before, cut, onset_us in zip(batch.split(cuts), cuts, onsets_us, strict=False):
        pipeline.feed(before)
        pieces = batch.split([cut, *(_first_seq(batch, onset_us + e) for e in edges_us)])[1:-1]
        found.append(
            Moment(
                flight.name,
                flight.first_us,
                onset_us,
                1 if rng.random() < 0.5 else -1,
                int(rng.integers(2**31)),
                pickle.dumps(pipeline),
                tuple(pieces),
            )
        )
    return found


def _first_seq(batch: Batch, t_us: int) -> int:
    """Arrival number of the first row that is not before a time."""
    firsts = []
    for rows in batch.rows.values():
        after = rows["seq"][rows["t_us"] >= t_us]
        if len(after):
            firsts.append(int(after.min()))
    return min(firsts, default=int(np.iinfo(np.int64).max) - 1)


def fault_of(target: Target, shape: Shape, size: float, onset_s: float) -> Fault:
    """The fault model of a size in the unit of the target's ladder; a negative one reads low."""
    per_s = size / 60.0
    step = shape is Shape.STEP
    match target.quantity:
        case "airspeed":
            if step:
                return Fault(target.sensor, FaultKind.SCALE, onset_s, size=size / 100.0)
            # Icing lowers the reading by a share that grows; a negative rate raises it.
            return Fault(target.sensor, FaultKind.ICING, onset_s, rate=-per_s / 100.0)
        case "acc":
            unit = 1.0
        case _:
            unit = radians(1.0)
    if step:
        return Fault(target.sensor, FaultKind.BIAS, onset_s, size=size * unit)
    return Fault(target.sensor, FaultKind.DRIFT, onset_s, rate=per_s * unit)


def judge(
    moment: Moment,
    configuration: Configuration,
    target: Target,
    shape: Shape,
    size: float,
    longest_s: float,
) -> Outcome:
    """Make one trial."""
    onset_s = (moment.onset_us - moment.first_us) / US
    injection = Injection(
        faults=[fault_of(target, shape, moment.sense * size, onset_s)],
        attitude=AttitudeFollows() if configuration.attitude_follows else None,
    )
    injector = RowInjector(injection, moment.seed, moment.first_us)
    pipeline: Pipeline = pickle.loads(moment.pipeline)
    verdicts: list[Verdict] = []
    outcome = Outcome()
    for piece in moment.pieces:
        verdicts += pipeline.feed(injector.apply(piece)).verdicts
        outcome = outcome_of(
            verdicts,
            moment.onset_us,
            target.sensor,
            longest_s,
            pair_counts=configuration.pair_counts,
        )
        if pipeline.now_us > moment.onset_us + (outcome.named_s + AFTERMATH_S) * US:
            break
    return outcome


def outcome_of(
    verdicts: Sequence[Verdict],
    onset_us: int,
    sensor: str,
    longest_s: float,
    *,
    pair_counts: bool,
) -> Outcome:
    """What verdicts say of a fault.

    Parameters
    ----------
    verdicts
        In time order.
    onset_us
        When the fault began.
    sensor
        What was broken.
    longest_s
        Later verdicts do not count.
    pair_counts
        Whether naming the axis that cannot be told apart is an answer.
    """
    until_us = onset_us + round(longest_s * US)
    faulty = [v for v in verdicts if v.state is State.FAULTY and onset_us <= v.t_us <= until_us]
    answers = {sensor, pair_of(sensor)} if pair_counts else {sensor}
    right = [v for v in faulty if v.sensor in answers]
    if right:
        until_us = right[0].t_us + round(AFTERMATH_S * US)
        faulty = [v for v in faulty if v.t_us <= until_us]
        right = [v for v in right if v.t_us <= until_us]
    base = sensor.partition(".")[0]
    wrong = [v.sensor for v in faulty if v.sensor not in answers]
    return Outcome(
        named_s=(right[0].t_us - onset_us) / US if right else inf,
        announced_s=(_detected_us(right[0]) - onset_us) / US if right else inf,
        as_pair=bool(right) and all(v.sensor != sensor for v in right),
        wrong_sensor=tuple(s for s in wrong if s.partition(".")[0] != base),
        wrong_axis=tuple(s for s in wrong if s.partition(".")[0] == base),
        misled=bool(faulty) and faulty[0].sensor not in answers,
    )


def _detected_us(verdict: Verdict) -> int:
    return verdict.t_us if verdict.detected_t_us is None else verdict.detected_t_us
