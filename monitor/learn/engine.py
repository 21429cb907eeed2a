"""Learning the single-shaft engine model of an aircraft from its healthy flights."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimators import engine_ticks as et
from estimators.engine_fit import Fit, Record, fit_single_shaft
from links.logs import open_log
from links.samples import Batch, Rows
from links.vocabulary import State
from monitor.learn.fit import Unfit
from monitor.learn.reading import Progress, read
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.settings.engine import ChannelSettings, SingleShaftSettings
from monitor.verdict import Verdict
from monitor.watch.engine import EngineWatch
from monitor.watch.engine_parts import Grid

__all__ = ["EngineFlight", "EngineLearnt", "flight_of", "learn_engine", "measure_engine"]

Array = NDArray[np.float64]

LEAST_S = 60.0
"""Time in flight with engine speed and throttle below which a log teaches nothing."""
LEAST_EXPLAINED = 0.8
"""Share of a speed's variance that throttle and airspeed must explain."""
ALIKE = 0.01
"""Channels that differ by less than this share of their speed measure one shaft."""
RANGE_SHARE, RANGE_STEP_RPM = 1.25, 100.0
ERROR_SHARE = 0.01
"""Least error of the model, as a share of the largest speed: weather and battery of other days."""
NOISE_SHARE = 1e-3
"""Least noise of a channel, as a share of its range: what a message rounds off."""


@dataclass(frozen=True, slots=True)
class EngineFlight:
    """Steps of one flight in which the aircraft flew and its throttle was known.

    Attributes
    ----------
    name
        Of the log.
    table, y : (K, 12), (K, 16) float64
        As :func:`estimators.engine_ticks.gather` gives them.
    """

    name: str
    table: Array
    y: Array

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels with readings, by number."""
        return tuple(int(i) for i in np.flatnonzero((self.y > 0.0).any(axis=0)))


@dataclass(frozen=True, slots=True)
class EngineLearnt:
    """A model and the channels that it explains.

    Attributes
    ----------
    fit
        The model with its quality.
    settings
        Of the model.
    channels
        Sensor -> settings.
    flights, seconds
        Names of the logs, and how long they flew in all [s].
    alike
        Channels taken for one shaft because they read the same.
    """

    fit: Fit
    settings: SingleShaftSettings
    channels: dict[str, ChannelSettings]
    flights: tuple[str, ...]
    seconds: float
    alike: tuple[str, ...]


def measure_engine(
    path: Path, settings: Settings, progress: Progress | None = None
) -> EngineFlight:
    """Read the engine's part of a log.

    Raises
    ------
    links.logs.LogError
        The file cannot be read as a log.
    Unfit
        The engine watch finds a fault in it, or it does not fly with engine speeds long enough.
    """
    log = open_log(path, settings.links.decoder_options())
    return flight_of(read(log, progress), settings, path.name)


def flight_of(batches: Iterable[Batch], settings: Settings, name: str) -> EngineFlight:
    """The same of a decoded flight.

    Raises
    ------
    Unfit
        As of :func:`measure_engine`.
    """
    tap = _Tap(settings)
    bare = settings.engine.model_copy(update={"model": "none", "channels": {}})
    pipeline = Pipeline(settings, watches=[EngineWatch(bare)], taps=[tap])
    verdicts: list[Verdict] = []
    first_us: int | None = None
    for batch in batches:
        for rows in batch.rows.values():
            if len(rows):
                least = int(rows["t_us"].min())
                first_us = least if first_us is None else min(first_us, least)
        verdicts += pipeline.feed(batch).verdicts
    verdicts += pipeline.finish().verdicts
    for v in verdicts:
        if v.state in (State.FAULTY, State.STOPPED):
            at_s = (v.t_us - (first_us or 0)) / 1e6
            raise Unfit(f"{name} is no healthy flight: at {at_s:.1f} s {v.evidence}")
    table, y = tap.steps()
    flies = (table[:, et.X_FLYING] > 0.5) & np.isfinite(table[:, et.X_THROTTLE])
    flight = EngineFlight(name, table[flies], y[flies])
    seconds = len(flight.y) * settings.engine.tick_s
    if not flight.channels:
        raise Unfit(f"{name} has no engine speed in flight")
    if seconds < LEAST_S:
        raise Unfit(
            f"{name} flies for {seconds:.0f} s with engine speed and throttle: "
            f"{LEAST_S:.0f} s are needed"
        )
    return flight


class _Tap:
    """Gathers the steps of the engine's grid as the watch does."""

    def __init__(self, settings: Settings) -> None:
        self._grid = Grid(settings.engine)
        self._parts: list[tuple[Array, Array]] = []

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Use released rows."""
        self._parts.append(self._grid.steps(rows))

    def steps(self) -> tuple[Array, Array]:
        """All steps."""
        tables, ys = zip(*self._parts, strict=True) if self._parts else ([], [])
        return (
            np.concatenate([np.zeros((0, et.N_TABLE)), *tables]),
            np.concatenate([np.zeros((0, et.N_CHANNELS)), *ys]),
        )


def learn_engine(flights: Sequence[EngineFlight], settings: Settings) -> EngineLearnt:
    """Fit the model to flights of one aircraft.

    Parameters
    ----------
    flights
        Healthy ones.
    settings
        Configuration; where it says which channel measures which shaft, that stands.

    Raises
    ------
    Unfit
        The flights have no channel in common, or throttle and airspeed do not explain its speed.
    """
    shared = set(flights[0].channels).intersection(*(f.channels for f in flights))
    configured = {int(s.removeprefix("spool")): c for s, c in settings.engine.channels.items()}
    channels = sorted(shared & set(configured)) if configured else sorted(shared)
    if not channels:
        raise Unfit("these flights have no engine-speed channel in common")
    shafts, alike = _shafts(flights, channels, {i: c.shaft for i, c in configured.items()})
    if len(shafts) > et.N_SHAFTS:
        raise Unfit(f"{len(shafts)} shafts: name those of the engine under [engine.channels]")
    tick_s = settings.engine.tick_s
    fits = {}
    for shaft, mine in shafts.items():
        records = [
            Record(f.table[:, et.X_THROTTLE + shaft], f.table[:, et.X_AIRSPEED], f.y[:, mine])
            for f in flights
        ]
        try:
            fits[shaft] = fit_single_shaft(records, tick_s)
        except ValueError as error:
            raise Unfit(str(error)) from None
    fit = fits[0] if 0 in fits else next(iter(fits.values()))
    for shaft, own in fits.items():
        if own.explained < LEAST_EXPLAINED:
            name = f"spool{shafts[shaft][0]}"
            raise Unfit(
                f"throttle and airspeed explain only {100.0 * own.explained:.0f} % of {name}: no "
                "single-shaft engine (a constant-speed propeller?), or a wrong throttle channel"
            )
    top = {i: max(float(np.nanmax(f.y[:, i])) for f in flights) for i in channels}
    learnt = {}
    for shaft, mine in shafts.items():
        for i, noise in zip(mine, fits[shaft].noise_rpm, strict=True):
            width = RANGE_STEP_RPM * math.ceil(RANGE_SHARE * top[i] / RANGE_STEP_RPM)
            told = configured.get(i)
            learnt[f"spool{i}"] = ChannelSettings(
                shaft=shaft,
                range_rpm=told.range_rpm if told else width,
                noise_rpm=_rounded(max(float(noise), NOISE_SHARE * width)),
                fault_probability=told.fault_probability if told else 0.01,
            )
    worst = max(fits.values(), key=lambda f: f.error_rpm)
    model = SingleShaftSettings(
        time_constant_s=_rounded(fit.time_constant_s),
        coefficients=tuple(_rounded(c, 6) for c in fit.coefficients),
        error_rpm=_rounded(max(worst.error_rpm, ERROR_SHARE * max(top.values()))),
        error_time_s=_rounded(worst.error_time_s),
    )
    seconds = sum(len(f.y) for f in flights) * tick_s
    return EngineLearnt(fit, model, learnt, tuple(f.name for f in flights), seconds, alike)


def _shafts(
    flights: Sequence[EngineFlight], channels: Sequence[int], given: dict[int, int]
) -> tuple[dict[int, list[int]], tuple[str, ...]]:
    """Shaft -> its channels, and those that were put together because they read the same."""
    shafts: dict[int, list[int]] = {}
    alike: list[str] = []
    for i in channels:
        if i in given:
            shafts.setdefault(given[i], []).append(i)
            continue
        same = next((s for s, mine in shafts.items() if _differ(flights, mine[0], i) < ALIKE), None)
        if same is None:
            shafts[max(shafts, default=-1) + 1] = [i]
        else:
            alike += [f"spool{k}" for k in (*shafts[same], i) if f"spool{k}" not in alike]
            shafts[same].append(i)
    return shafts, tuple(alike)


def _differ(flights: Sequence[EngineFlight], i: int, k: int) -> float:
    """Median difference of two channels as a share of their speed."""
    parts = []
    for f in flights:
        at, there = np.flatnonzero(np.isfinite(f.y[:, i])), np.flatnonzero(np.isfinite(f.y[:, k]))
        newest = np.searchsorted(there, at, side="right") - 1
        at, newest = at[newest >= 0], newest[newest >= 0]
        a, b = f.y[at, i], f.y[there[newest], k]
        parts.append(np.abs(a - b) / np.maximum(np.maximum(a, b), 1.0))
    together = np.concatenate(parts)
    return float(np.median(together)) if len(together) else math.inf


def _rounded(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")
