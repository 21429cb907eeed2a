"""Judgement of the wings: estimates in, changes of state out.

A wing is damaged when it has lost more lift, or gained more drag, than the *other* one. What both
have in common cannot be told from a wrong airspeed, another payload or an updraft. Before a wing is
judged at all, the airframe has to fit (:mod:`estimators.wing_misfit`).
"""

from __future__ import annotations

from collections import deque
from math import ceil, hypot, isfinite, nan

import numpy as np
from numpy.typing import NDArray

from estimators.wing_misfit import Misfit
from estimators.wing_model import FAULTS
from estimators.wing_stream import WingRun
from links.vocabulary import Kind, Reason, State
from monitor.settings.wing import WingSettings
from monitor.verdict import Verdict

__all__ = ["SENSORS", "WingJudge"]

Array = NDArray[np.float64]

SENSORS = tuple(f"wing_{fault}" for fault in FAULTS)
"""In the order of :data:`estimators.wing_model.FAULTS`."""
OTHER = (2, 3, 0, 1)
BEGUN = 0.25
"""A fault began when its estimate was last below this share of what it is when found."""
REMEMBERED = 240
"""Rows of estimates in which that moment is looked for, count."""
STEP_PERCENT_S = 0.8
"""A difference that grew faster than this did not creep up [%/s]."""
LEARNT_MARGIN_PERCENT = 2.0
"""Over the largest difference of the healthy flights that an airframe was learnt from: a few
flights do not show the largest there is."""
UNLIKE = (
    "the aircraft does not fly as this airframe says, with wings whole or damaged: residuals have "
    "{mean:.1f} times the variance expected, {limit:.1f} allowed; learn it with `mavsentry learn "
    "airframe`, or check its coefficients and the surfaces of [wing]"
)
UNTOLD = "the flight does not tell this: its deviation has no bound"
CONTRADICTION = "accelerometers and velocity contradict one another"
ESTIMATOR = "wing_stream"


class WingJudge:
    """States of four faults.

    Parameters
    ----------
    settings
    learnt
        Largest excess of each wing over the other that healthy flights of this airframe showed [%];
        None where none were learnt from.
    """

    def __init__(
        self, settings: WingSettings, learnt: tuple[float | None, ...] = (None,) * 4
    ) -> None:
        s = settings
        self._learnt = learnt
        self.retune(s)
        self._misfit_limit = s.misfit_limit
        self._misfit_rows = tuple(
            ceil(asked_s / s.period_s) for asked_s in (s.misfit_after_s, s.misfit_until_s)
        )
        self._peaks = {"wing.lift_percent": nan, "wing.drag_percent": nan}
        self._said: list[State | None] = [None] * 4
        self._reason: Reason | None = None
        self._tests: list[tuple[float, ...]] = []
        self.renew()

    def retune(self, settings: WingSettings) -> None:
        """Take other limits of a verdict; what is found, or being confirmed, goes on."""
        s = settings
        self._limit = (s.lift_percent, s.drag_percent, s.lift_percent, s.drag_percent)
        self._sigmas, self._confirm_s = (s.lift_sigmas, s.drag_sigmas), s.confirm_s
        self._clear_share, self._clear_s = s.clear_share, s.clear_s

    def renew(self) -> None:
        """A new flight: nothing is held against a wing."""
        self._begun = False
        self._near = [nan] * 4
        self._misfit = Misfit(self._misfit_limit, *self._misfit_rows)
        self._damaged = [False] * 4
        self._found: list[tuple[float, Kind] | None] = [None] * 4
        self._since: list[float] = [nan] * 4
        self._below: list[float] = [nan] * 4
        self._past: list[deque[tuple[float, float]]] = [deque(maxlen=REMEMBERED) for _ in range(4)]

    @property
    def waiting(self) -> bool:
        """No estimate has come since the flight began, and nobody was told so."""
        return not self._begun and self._reason is not Reason.LEARNING

    def peaks(self) -> dict[str, float]:
        """Largest differences of wings that were judged and not damaged [%]."""
        return {key: value for key, value in self._peaks.items() if isfinite(value)}

    def tests(self) -> list[tuple[float, ...]]:
        """Rows since the last call: time [s], and of each fault its excess over the threshold."""
        told, self._tests = self._tests, []
        return told

    def cannot(self, t_us: int, reason: Reason, why: str = "") -> list[Verdict]:
        """The wings cannot be judged from here on."""
        if self._reason is reason:
            return []
        self._reason = reason
        self._said = [State.UNMONITORED] * 4
        return [
            Verdict(t_us, sensor, State.UNMONITORED, reason, evidence=why) for sensor in SENSORS
        ]

    def judge(self, run: WingRun, epoch_us: int) -> list[Verdict]:
        """Verdicts on rows of estimates."""
        out: list[Verdict] = []
        columns = (run.t_s, run.f, run.std[:, 4:], run.lasting, run.trusted, run.unlike)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        for t_s, f, std, lasting, trusted, unlike in rows:
            self._begun = True
            t_us = epoch_us + round(t_s * 1e6)
            fits = self._misfit.note(unlike)
            if fits is False:
                why = UNLIKE.format(mean=self._misfit.mean, limit=self._misfit_limit)
                out += self.cannot(t_us, Reason.AIRFRAME_MISFIT, why)
                continue
            if not trusted:
                out += self.cannot(t_us, Reason.REFERENCE_NOT_TRUSTED, CONTRADICTION)
                continue
            if fits is None:
                out += self.cannot(t_us, Reason.LEARNING)
                continue
            self._reason = None
            self._near = [nan] * 4
            for i in range(4):
                known = (std[i % 2], lasting[i % 2])
                out += self._one(i, t_s, f[i] - f[OTHER[i]], known, epoch_us)
            self._tests.append((t_s, *self._near))
        return out

    def _one(
        self, i: int, t_s: float, apart: float, known: tuple[float, float], epoch_us: int
    ) -> list[Verdict]:
        """One fault at one row: its excess over the other wing's, and the deviations of that."""
        std = hypot(*known)
        learnt = self._learnt[i]
        sigmas = self._sigmas[i % 2]
        if learnt is None:
            limit = max(self._limit[i], sigmas * std)
        else:
            limit = max(self._limit[i], sigmas * known[0], learnt + LEARNT_MARGIN_PERCENT)
        if not isfinite(std):
            return self._untold(i, epoch_us + round(t_s * 1e6))
        self._past[i].append((t_s, apart))
        held = self._clear_share * self._limit[i] if self._damaged[i] else limit
        self._near[i] = max(apart / held, 0.0)
        if self._damaged[i]:
            self._clear(i, t_s, apart)
        else:
            key = "wing.lift_percent" if i % 2 == 0 else "wing.drag_percent"
            if apart > limit:
                self._since[i] = t_s if not isfinite(self._since[i]) else self._since[i]
                self._damaged[i] = t_s - self._since[i] >= self._confirm_s
                self._below[i] = nan
                if self._damaged[i]:
                    self._misfit.settle()
            else:
                self._since[i] = nan
                peak = self._peaks[key]
                self._peaks[key] = apart if not apart <= peak else peak
        state = State.FAULTY if self._damaged[i] else State.OK
        if state is self._said[i]:
            return []
        again = self._said[i] is State.FAULTY
        self._said[i] = state
        return [self._verdict(i, t_s, state, (apart, limit, std), again, epoch_us)]

    def _untold(self, i: int, t_us: int) -> list[Verdict]:
        """No bound on the deviation: neither whole nor damaged; what was found is kept."""
        self._since[i] = self._below[i] = nan
        if self._said[i] is State.UNMONITORED:
            return []
        self._said[i] = State.UNMONITORED
        reason = Reason.REFERENCE_NOT_TRUSTED
        return [Verdict(t_us, SENSORS[i], State.UNMONITORED, reason, evidence=UNTOLD)]

    def _clear(self, i: int, t_s: float, apart: float) -> None:
        if apart >= self._clear_share * self._limit[i]:
            self._below[i] = nan
            return
        if not isfinite(self._below[i]):
            self._below[i] = t_s
        if t_s - self._below[i] >= self._clear_s:
            self._damaged[i] = False
            self._found[i] = None
            self._since[i] = self._below[i] = nan

    def _verdict(
        self,
        i: int,
        t_s: float,
        state: State,
        values: tuple[float, float, float],
        again: bool,
        epoch_us: int,
    ) -> Verdict:
        apart, limit, std = values
        t_us = epoch_us + round(t_s * 1e6)
        side, what = FAULTS[i].split(".")
        other = "left" if side == "right" else "right"
        if state is State.OK:
            said = f"the {side} wing's {what} is that of the {other} one{' again' if again else ''}"
            return Verdict(t_us, SENSORS[i], state, estimator=ESTIMATOR, evidence=said)
        found = self._found[i]
        if found is None:
            found = self._found[i] = self._began(i, t_s, apart)
        onset_s, kind = found
        changed = "lost" if what == "lift" else "gained"
        return Verdict(
            t_us,
            SENSORS[i],
            state,
            kind=kind,
            onset_t_us=epoch_us + round(onset_s * 1e6),
            magnitude=-apart if what == "lift" else apart,
            unit="%",
            statistic=apart,
            threshold=limit,
            estimator=ESTIMATOR,
            evidence=f"the {side} wing has {changed} {apart:.1f} % {what} more than the {other} "
            f"one within {t_s - onset_s:.0f} s, give or take {std:.1f} %",
        )

    def _began(self, i: int, t_s: float, apart: float) -> tuple[float, Kind]:
        """When a fault that is found now began, and whether it came at once."""
        small = (at for at, was in reversed(self._past[i]) if was < BEGUN * apart)
        onset_s = next(small, self._past[i][0][0])
        is_step = apart > STEP_PERCENT_S * max(t_s - onset_s, 0.5)
        return onset_s, Kind.BIAS if is_step else Kind.DRIFT
