"""Learning an airframe's coefficients from its healthy flights."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from math import inf, isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimators.wing_fit import AirframeFit, fit_airframe
from estimators.wing_misfit import Misfit
from estimators.wing_model import AERODYNAMIC, Airframe
from estimators.wing_stream import WingStream
from links.logs import open_log
from links.samples import Batch, Rows
from monitor.learn.fit import Unfit
from monitor.learn.reading import Progress, read
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.settings.wing import LEARNT_KEYS, KnownAirframe, WingSettings, airframe_of, surfaces_of
from monitor.watch.wing import wing_tuning
from monitor.watch.wing_inputs import NEEDED, WingInputs

__all__ = [
    "AirframeFlight",
    "AirframeLearnt",
    "airframe_document",
    "airframe_flight_of",
    "doubt",
    "learn_airframe",
    "measure_airframe",
]

Array = NDArray[np.float64]

LEAST_S = 60.0
"""Time in flight with all inputs below which a log teaches nothing."""
LARGE = 2.5
"""Residuals after the fit, against what gusts explain, that no airframe of this form should leave:
models 15 % off come to 0.8 to 1.2."""


@dataclass(frozen=True, slots=True)
class AirframeFlight:
    """Ticks of one flight in which the aircraft flew and nothing was missing.

    Attributes
    ----------
    name
        Of the log.
    t_s, x, acc
        As of :class:`monitor.watch.wing_inputs.Ticks`.
    """

    name: str
    t_s: Array
    x: Array
    acc: Array


@dataclass(frozen=True, slots=True)
class AirframeLearnt:
    """A refined airframe and what it rests on.

    Attributes
    ----------
    start, fit
    healthy_percent
        Largest excess of each wing over the other, in the order of the faults, in the flights.
    flights, seconds
        Names of the logs, and how long they flew in all [s].
    travel
        Travel of elevator, aileron and rudder that the flights were read with [us, deg].
    unlike, unlike_limit
        Largest mean, over the flights, of what :class:`estimators.wing_misfit.Misfit` asks of the
        refined airframe, and its limit; infinite where no flight has a row that can be used.
    """

    start: KnownAirframe
    fit: AirframeFit
    healthy_percent: tuple[float, ...]
    flights: tuple[str, ...]
    seconds: float
    travel: tuple[tuple[float, float], ...]
    unlike: float
    unlike_limit: float


class _Tap:
    """Gathers the wing watch's inputs while the aircraft flies."""

    def __init__(self, settings: WingSettings) -> None:
        self._inputs = WingInputs(settings)
        self._epoch_us: int | None = None
        self.changes: list[tuple[float, bool]] = []
        self.ticks: list[tuple[Array, Array, Array, NDArray[np.int64]]] = []

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Look at the newly released rows."""
        if self._epoch_us is None:
            starts = [int(r["t_us"][0]) for r in rows.values() if len(r)]
            if not starts:
                return
            self._epoch_us = min(starts)
        for row in rows.get("phase", ()):
            self.changes.append(((int(row["t_us"]) - self._epoch_us) * 1e-6, bool(row["flying"])))
        ticks = self._inputs.take(rows, self._epoch_us)
        self.ticks.append((ticks.t_s, ticks.x, ticks.acc, ticks.lacks))


def measure_airframe(
    path: Path, settings: Settings, progress: Progress | None = None
) -> AirframeFlight:
    """Read the wing watch's part of a log.

    Raises
    ------
    links.logs.LogError
        The file cannot be read as a log.
    Unfit
        It does not fly with all inputs long enough; the message names what is missing.
    """
    log = open_log(path, settings.links.decoder_options())
    return airframe_flight_of(read(log, progress), settings, path.name)


def airframe_flight_of(batches: Iterable[Batch], settings: Settings, name: str) -> AirframeFlight:
    """The same of a decoded flight.

    Raises
    ------
    Unfit
        As of :func:`measure_airframe`.
    """
    tap = _Tap(settings.wing)
    pipeline = Pipeline(settings, watches=[], taps=[tap])
    for batch in batches:
        pipeline.feed(batch)
    pipeline.finish()
    if not tap.ticks:
        raise Unfit(f"{name}: nothing in it that the wing watch could use")
    t, x, acc, lacks = (np.concatenate(part) for part in zip(*tap.ticks, strict=True))
    flying = np.array([False, *(state for _, state in tap.changes)])
    past = np.searchsorted(np.array([at for at, _ in tap.changes]), t, side="right")
    aloft = flying[past]
    good = aloft & (lacks < 0) & (x[:, 17] >= settings.wing.least_airspeed_m_s)
    seconds = good.sum() * settings.wing.tick_s
    if seconds < LEAST_S:
        missing = np.bincount(lacks[aloft & (lacks >= 0)], minlength=len(NEEDED))
        why = f"; most often {NEEDED[int(missing.argmax())]} is missing" if missing.any() else ""
        raise Unfit(f"{name}: flies {seconds:.0f} s with all inputs, {LEAST_S:.0f} s needed{why}")
    return AirframeFlight(name, t[good], x[good], acc[good])


def learn_airframe(flights: Sequence[AirframeFlight], settings: Settings) -> AirframeLearnt:
    """Refine the airframe of ``[wing] airframe``.

    Raises
    ------
    Unfit
        The flights cannot be used.
    """
    start = airframe_of(settings.wing)
    tuning = wing_tuning(settings.wing, start.std)
    try:
        fit = fit_airframe(start.airframe, tuning, [(one.t_s, one.x) for one in flights])
    except ValueError as error:
        raise Unfit(str(error)) from None
    apart, unlike = np.zeros(4), []
    rows = round(settings.wing.misfit_until_s / settings.wing.period_s)
    for one in flights:
        refined = wing_tuning(settings.wing, tuple(fit.std.tolist()))
        run = WingStream(fit.airframe, refined).run(one.t_s, one.x, one.acc)
        if len(run.f):
            apart = np.maximum(apart, (run.f - run.f[:, [2, 3, 0, 1]]).max(axis=0))
        misfit = Misfit(settings.wing.misfit_limit, 1, rows)
        for value in run.unlike.tolist():
            misfit.note(value)
        unlike.append(misfit.mean)
    return AirframeLearnt(
        start,
        fit,
        tuple(apart.tolist()),
        tuple(one.name for one in flights),
        sum(len(one.t_s) for one in flights) * settings.wing.tick_s,
        tuple((one.travel_us, one.travel_deg) for one in surfaces_of(settings.wing)),
        max((mean for mean in unlike if isfinite(mean)), default=inf),
        settings.wing.misfit_limit,
    )


def doubt(learnt: AirframeLearnt) -> str:
    """Why the airframe is not to be trusted, in one sentence; empty where it is."""
    after, why = learnt.fit.scatter[1], []
    if not after <= LARGE:
        why.append(f"residuals stay at {after:.1f} after the fit ({LARGE:.1f} at most)")
    if not learnt.unlike <= learnt.unlike_limit:
        why.append(
            f"what no wing explains has {learnt.unlike:.1f} times the variance expected, so that "
            f"the wing watch would not judge these flights ({learnt.unlike_limit:.1f} at most)"
        )
    if not why:
        return ""
    return (
        f"this airframe does not fit these flights: {' and '.join(why)}; check mass, geometry, the "
        "coefficients it started from, and channels, directions and travels of the surfaces"
    )


def airframe_document(learnt: AirframeLearnt, name: str) -> str:
    """The refined airframe as a file that ``[wing] airframe`` takes."""
    fit, start = learnt.fit, learnt.start.airframe
    lines = [
        "# Airframe refined by `mavsentry learn airframe` from healthy flights:",
        *(f"# {flight}" for flight in learnt.flights),
        *textwrap.wrap(
            f"WARNING: {doubt(learnt)}." if doubt(learnt) else "",
            98,
            initial_indent="# ",
            subsequent_indent="# ",
        ),
        "",
        f'name = "{name}"',
        "",
        "[known]",
    ]
    names = [field.name for field in fields(Airframe)]
    lines += [f"{n} = {getattr(start, n)!r}" for n in names if n not in AERODYNAMIC]
    lines += ["", "[surfaces]"]
    if len(set(learnt.travel)) == 1:
        travel_us, travel_deg = learnt.travel[0]
        lines += [f"travel_us = {travel_us!r}", f"travel_deg = {travel_deg!r}"]
    else:
        lines.append("# Their travels differ: keep those of the [wing] settings.")
    lines += ["", "[coefficients]"]
    for n in AERODYNAMIC:
        was, std = getattr(start, n), float(fit.std[names.index(n)])
        said = f"was {was:g}" if n in fit.identified else "not identified"
        lines.append(f"{n} = {getattr(fit.airframe, n):.6g}  # {said}")
        lines.append(f"{n}_std = {std:.3g}")
    lines += ["", "[healthy]", "# Largest excess of each wing over the other in these flights, %."]
    lines += [f"{k} = {v:.3g}" for k, v in zip(LEARNT_KEYS, learnt.healthy_percent, strict=True)]
    return "\n".join(lines) + "\n"
