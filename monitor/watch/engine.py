"""Engine watch: engine speeds, throttle and flight in; verdicts on channels and engines out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimators import engine_state as es
from estimators import engine_ticks as et
from estimators.engine_judge import N_ENGINES, judge
from links.samples import Rows
from monitor.retune import Retuned, blend
from monitor.settings import Settings
from monitor.settings.engine import EngineSettings
from monitor.verdict import ENGINE_ESTIMATE, ENGINE_TESTS, StepResult
from monitor.watch.engine_parts import Grid, Unit, groups, judge_rules, units
from monitor.watch.engine_words import verdict

__all__ = ["EngineWatch"]

Array = NDArray[np.float64]

STEPS_AT_ONCE = 512
"""Steps that are judged by one call: there is room for what is said of so many."""


TESTS_S = 0.2
"""Time between two rows of tests."""
N_RATIOS = et.N_CHANNELS + N_ENGINES


FIXED = (
    "model",
    "channels",
    "single_shaft",
    "two_spool",
    "throttle_channels",
    "throttle_idle_us",
    "throttle_full_us",
    "tick_s",
    "timing_s",
    "memory_s",
)
"""Settings that the models, their filters and the grid of time are made by."""


class EngineWatch:
    """Judges engine-speed channels, and says when an engine has stopped.

    Three passes over the steps of a grid of time: rows to steps, the filters of the shafts over the
    steps, the judgement. None needs what a later one says, so each runs over many steps at once.
    """

    name = "engine"
    quantities = frozenset(
        {"spool", "servo", "airspeed", "gps", "baro", "nav", "demand", "heartbeat", "param"}
    )

    def __init__(self, settings: EngineSettings) -> None:
        self._settings = settings
        self._grid = Grid(settings)
        self._judge_rules = judge_rules(settings)
        self._groups = groups(settings)
        self._units = units(settings)
        self._judged = es.new_judged()
        self._every = _steps(settings.emit_s, settings)
        self._closed = 0
        self._tests_every = _steps(TESTS_S, settings)
        self._untold = np.empty((0, N_RATIOS))

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings (see :class:`monitor.verdict.Watch`)."""
        self._settings, done = blend(self._settings, settings.engine, FIXED)
        self._grid.retune(self._settings)
        self._judge_rules = judge_rules(self._settings)
        self._every = _steps(self._settings.emit_s, self._settings)
        return done.under("engine")

    def peaks(self) -> dict[str, float]:
        """No key of it is learnt from peaks: its model is (``learn engine``)."""
        return {}

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        """Use the newly released rows (see :class:`monitor.verdict.Watch`)."""
        table, y = self._grid.steps(rows)
        return self._judge(table, y) if len(table) else StepResult()

    def _judge(self, table: Array, y: Array) -> StepResult:
        """The filters and the judgement over closed steps."""
        steps, epoch_us = len(table), self._grid.epoch_us
        w, least, most, mu, sd = np.full((5, steps, et.N_CHANNELS), np.nan)
        speed, std = np.full((2, steps, et.N_SHAFTS), np.nan)
        for unit in self._units:
            self._estimate(unit, table, y, (w, least, most, mu, sd), (speed, std))
        halted, ratios = np.empty((steps, et.N_SHAFTS)), np.empty((steps, N_RATIOS))
        log = np.empty((min(steps, STEPS_AT_ONCE) * es.MOST_SAID, es.N_LOG))
        result, said_s = StepResult(), [np.empty(0)]
        for first in range(0, steps, STEPS_AT_ONCE):
            part = slice(first, first + STEPS_AT_ONCE)
            said = judge(
                self._judged,
                self._judge_rules,
                self._groups,
                table[part],
                y[part],
                w[part],
                least[part],
                most[part],
                mu[part],
                sd[part],
                halted[part],
                ratios[part],
                log,
            )
            said_s.append(log[:said, es.L_T].copy())
            result.verdicts += [verdict(row, epoch_us) for row in log[:said]]
        chosen = slice(-self._closed % self._every, None, self._every)
        tests = self._tests(table[:, et.X_T], ratios, np.concatenate(said_s))
        if len(tests):
            result.estimates["engine_tests"] = tests
        self._closed += steps
        if self._units and len(table[chosen]):
            # of an engine that stands or windmills its channels are believed, not its model
            speed = np.where(np.isfinite(halted), halted, speed)
            result.estimates["engine"] = self._rows(
                table[chosen], speed[chosen], std[chosen], epoch_us
            )
        return result

    def _tests(self, t_s: Array, ratios: Array, said_s: Array) -> Rows:
        """Largest ratios up to every second step or so, and up to one that said something."""
        due = (self._closed + np.arange(1, len(t_s) + 1)) % self._tests_every == 0
        ends = np.flatnonzero(due | np.isin(t_s, said_s))
        before = len(self._untold)
        ratios = np.concatenate((self._untold, ratios))
        last = before + int(ends[-1]) + 1 if len(ends) else 0
        self._untold = ratios[last:]
        if not len(ends):
            return np.zeros(0, ENGINE_TESTS)
        starts = np.concatenate(([0], before + ends[:-1] + 1))
        largest = np.fmax.reduceat(ratios[:last], starts, axis=0)
        some = np.isfinite(largest).any(axis=1)
        out = np.zeros(int(some.sum()), ENGINE_TESTS)
        out["t_us"] = self._grid.epoch_us + np.rint(t_s[ends[some]] * 1e6).astype(np.int64)
        for name, column in zip((ENGINE_TESTS.names or ())[1:], largest[some].T, strict=True):
            out[name] = column
        return out

    def _estimate(
        self,
        unit: Unit,
        table: Array,
        y: Array,
        channels: tuple[Array, ...],
        shafts: tuple[Array, Array],
    ) -> None:
        """One filter: what its channels should read, and the speeds of its shafts."""
        w, least, most, mu, sd = channels
        own, model = unit.channels, unit.model
        heard = np.maximum(y[:, own], 0.0)  # -1 is an RPM message's word for no pulses
        inputs = unit.inputs(table)
        track = unit.filter.run(inputs, heard)
        C = model.linear.C
        expected = track.x @ C.T
        w[:, own], mu[:, own] = track.works, expected
        least[:, own], most[:, own] = unit.limits(inputs, track.x, expected)
        sd[:, own] = np.sqrt(np.einsum("ia,kab,ib->ki", C, track.P, C) + model.linear.r)
        shafts[0][:, unit.shafts] = np.maximum(track.x @ model.G.T, 0.0)
        shafts[1][:, unit.shafts] = np.sqrt(np.einsum("ia,kab,ib->ki", model.G, track.P, model.G))

    def _rows(self, table: Array, speed: Array, std: Array, epoch_us: int) -> Rows:
        out = np.zeros(len(table), ENGINE_ESTIMATE)
        out["t_us"] = epoch_us + np.rint(table[:, et.X_T] * 1e6).astype(np.int64)
        out["speed_rpm"], out["speed_std_rpm"] = speed, std
        out["throttle"] = table[:, et.X_THROTTLE]
        out["climb_power_m_s"] = 0.5 * (table[:, et.X_P] + table[:, et.X_PG])
        return out


def _steps(interval_s: float, settings: EngineSettings) -> int:
    """Steps of the grid in an interval, one at least."""
    return max(round(interval_s / settings.tick_s), 1)
