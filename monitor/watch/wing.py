"""Wing watch: how the aircraft flies against how it should, as verdicts on lift and drag."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimators.wing_stream import WingRun, WingStream, WingTuning
from links.samples import Rows
from links.vocabulary import Reason
from monitor.retune import Retuned, blend, differing
from monitor.settings import Settings
from monitor.settings.wing import WingSettings, airframe_of
from monitor.verdict import WING_ESTIMATE, WING_TESTS, StepResult, Verdict
from monitor.watch.wing_inputs import NEEDED, Ticks, WingInputs
from monitor.watch.wing_judge import WingJudge

__all__ = ["WingWatch", "wing_tuning"]

Array = NDArray[np.float64]

GROUND, SLOW, GOOD = -3, -2, -1
"""States of a tick; 0 and above: which of NEEDED is missing."""
TAKEN = frozenset(
    {
        "lift_percent",
        "drag_percent",
        "lift_sigmas",
        "drag_sigmas",
        "confirm_s",
        "clear_share",
        "clear_s",
        "least_airspeed_m_s",
    }
)
"""Settings that can change in flight: what is asked of a verdict. The rest is the model."""
PATIENCE_S = 2.0
"""A shorter lack of an input is no change of state."""


def wing_tuning(s: WingSettings, coefficient_std: tuple[float, ...]) -> WingTuning:
    """What the chain of estimators is told."""
    return WingTuning(
        coefficient_std=np.array(coefficient_std),
        gust_m_s=s.gust_m_s,
        tas_std_m_s=s.airspeed_std_m_s,
        tilt_std_rad=radians(s.tilt_std_deg),
        share=s.noise_share,
        floor=np.array([s.floor_m_s2] * 3 + [s.floor_rad_s2] * 3),
        tau_wind_s=s.wind_time_s,
        tau_acc_s=s.filter_time_s,
        period_s=s.period_s,
        contradiction_m_s2=s.contradiction_m_s2,
        N=s.window,
        lam_percent=s.growth_percent,
        R_percent2=s.carried_std_percent**2,
    )


class WingWatch:
    """Judges lift and drag of both wings by the accelerations that the aircraft has.

    It keeps a wind of its own, from attitude, ground velocity and airspeed of the last ten seconds:
    the air watch's is slower, and there only once the aircraft has turned.
    """

    name = "wing"
    quantities = frozenset(
        {"imu", "attitude", "nav", "airspeed", "baro", "servo", "spool", "param"}
    )

    def __init__(self, settings: WingSettings) -> None:
        self._settings = settings
        self._known = airframe_of(settings) if settings.airframe else None
        self._inputs = WingInputs(settings)
        learnt = self._known.learnt_percent if self._known is not None else (None,) * 4
        self._judge = WingJudge(settings, learnt)
        self._stream: WingStream | None = None
        self._epoch_us: int | None = None
        self._phases: list[tuple[int, bool]] = []
        self._status = GROUND
        self._since_s = 0.0

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings (see :class:`monitor.verdict.Watch`).

        The airframe and its model stand for as long as the watch does.
        """
        fixed = set(differing(self._settings, settings.wing)) - TAKEN
        self._settings, done = blend(self._settings, settings.wing, fixed)
        self._judge.retune(self._settings)
        return done.under("wing")

    def peaks(self) -> dict[str, float]:
        """Settings key -> largest difference between healthy wings [%]."""
        return self._judge.peaks()

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        """Use the newly released rows (see :class:`monitor.verdict.Watch`)."""
        phase = rows.get("phase")
        changes = [(int(r["t_us"]), bool(r["flying"])) for r in phase] if phase is not None else []
        if self._known is None:
            return StepResult(
                [
                    verdict
                    for t_us, flying in changes
                    if flying
                    for verdict in self._judge.cannot(
                        t_us, Reason.NO_AIRFRAME, "no [wing] airframe is configured"
                    )
                ]
            )
        self._phases += changes
        if self._epoch_us is None:
            starts = [int(r["t_us"][0]) for s, r in rows.items() if s != "phase" and len(r)]
            if not starts:
                return StepResult()
            self._epoch_us = min(starts)
        ticks = self._inputs.take(rows, self._epoch_us)
        return self._use(ticks, self._epoch_us) if len(ticks.t_s) else StepResult()

    def _use(self, ticks: Ticks, epoch_us: int) -> StepResult:
        """Runs of ticks of one state, in order."""
        status = self._statuses(ticks, epoch_us)
        edges = np.flatnonzero(np.diff(status, prepend=status[0] - 1))
        verdicts: list[Verdict] = []
        runs: list[WingRun] = []
        for a, b in zip(edges, [*edges[1:], len(status)], strict=True):
            now = int(status[a])
            if now != self._status:
                self._enter(now, float(ticks.t_s[a]))
            if now == GOOD and self._stream is not None:
                if self._judge.waiting:
                    t_us = epoch_us + round(float(ticks.t_s[a]) * 1e6)
                    verdicts += self._judge.cannot(t_us, Reason.LEARNING)
                run = self._stream.run(ticks.t_s[a:b], ticks.x[a:b], ticks.acc[a:b])
                verdicts += self._judge.judge(run, epoch_us)
                runs.append(run)
            else:
                verdicts += self._cannot(now, float(ticks.t_s[b - 1]), epoch_us)
        estimates = {"wing": _rows(runs, epoch_us)} if any(len(r.t_s) for r in runs) else {}
        tests = _tests(self._judge.tests(), epoch_us)
        if len(tests):
            estimates["wing_tests"] = tests
        return StepResult(verdicts, estimates)

    def _statuses(self, ticks: Ticks, epoch_us: int) -> NDArray[np.int64]:
        t_us = epoch_us + np.rint(ticks.t_s * 1e6).astype(np.int64)
        changes = np.array([t for t, _ in self._phases], np.int64)
        flying = np.array([False, *(flying for _, flying in self._phases)])
        past = np.searchsorted(changes, t_us, side="right")
        self._phases = self._phases[max(int(past[-1]) - 1, 0) :]
        status = ticks.lacks.copy()
        slow = (status < 0) & (ticks.x[:, 17] < self._settings.least_airspeed_m_s)
        status[slow] = SLOW
        status[~flying[past]] = GROUND
        return status

    def _enter(self, status: int, t_s: float) -> None:
        """A new state of the ticks begins; what is missing may change without a new beginning."""
        if not (self._status in (GOOD, GROUND) or status in (GOOD, GROUND)):
            self._status = status
            return
        if self._status == GROUND and self._known is not None:
            known = self._known
            self._stream = WingStream(known.airframe, wing_tuning(self._settings, known.std))
            self._judge.renew()
        self._status, self._since_s = status, t_s

    def _cannot(self, status: int, t_s: float, epoch_us: int) -> list[Verdict]:
        """Why the wings are not judged, once it has lasted."""
        if status == GROUND:
            t_us = epoch_us + round(self._since_s * 1e6)
            return self._judge.cannot(t_us, Reason.ON_GROUND)
        if t_s - self._since_s < PATIENCE_S:
            return []
        t_us = epoch_us + round((self._since_s + PATIENCE_S) * 1e6)
        if status == SLOW:
            return self._judge.cannot(t_us, Reason.MANOEUVRE, "too slow for the wings' model")
        why = f"missing: {NEEDED[status]}"
        return self._judge.cannot(t_us, Reason.REFERENCE_MISSING, why)


def _tests(rows: list[tuple[float, ...]], epoch_us: int) -> Rows:
    """Rows of :meth:`WingJudge.tests` where any fault was tested."""
    told = np.array(rows).reshape(-1, len(WING_TESTS.names or ()))
    told = told[np.isfinite(told[:, 1:]).any(axis=1)]
    out = np.zeros(len(told), WING_TESTS)
    out["t_us"] = epoch_us + np.rint(told[:, 0] * 1e6).astype(np.int64)
    for name, column in zip((WING_TESTS.names or ())[1:], told[:, 1:].T, strict=True):
        out[name] = column
    return out


def _rows(runs: list[WingRun], epoch_us: int) -> Rows:
    f, std = np.concatenate([r.f for r in runs]), np.concatenate([r.std for r in runs])
    out = np.zeros(len(f), WING_ESTIMATE)
    t_s = np.concatenate([r.t_s for r in runs])
    out["t_us"] = epoch_us + np.rint(t_s * 1e6).astype(np.int64)
    for i, name in enumerate(("right_lift", "right_drag", "left_lift", "left_drag")):
        out[f"{name}_percent"], out[f"{name}_std_percent"] = f[:, i], std[:, i]
    apart = np.hypot(std[:, 4:], np.concatenate([r.lasting for r in runs]))
    out["lift_apart_std_percent"], out["drag_apart_std_percent"] = apart[:, 0], apart[:, 1]
    return out
