"""Watch of vanes beside the pitot bank: samples and the bank's estimates in, verdicts out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimators import air_vane as vane
from estimators.air_vane import VaneLimits, new_vanes, run
from links.samples import Rows
from links.vocabulary import Kind, Reason, State
from monitor.retune import Retuned, blend
from monitor.settings import Settings
from monitor.settings.vane import VaneSettings
from monitor.verdict import PHASE_ROW, Verdict
from monitor.watch.air_tests import VaneTests

__all__ = ["AirVaneWatch", "limits"]

BESIDE_US = 110_000
"""The bank gives an estimate when 0.12 s of samples after its moment have come."""
WHITE = 0.9, 3.1
"""Squared steps over squares (von Neumann's ratio) between which scatter is noise: white noise has
2, an oscillation of 1 Hz sampled at 20 Hz 0.1."""
RUNAWAY_RAD_S = math.radians(0.5)
"""A drift faster than this is called a runaway, as in the triplex logic."""
STEP_SHARE = 0.6
"""A shift that has made this share of itself at once is a step."""

_EVENT = np.dtype(
    [("order_us", "<i8"), ("t_us", "<i8"), ("code", "<i8"), ("index", "<i8"), ("value", "<f8", 3)]
)
_STATES = {vane.UNMONITORED: State.UNMONITORED, vane.OK: State.OK, vane.FAULTY: State.FAULTY}
_REASONS = {
    vane.LEARNING: Reason.LEARNING,
    vane.ON_GROUND: Reason.ON_GROUND,
    vane.MISSING: Reason.REFERENCE_MISSING,
}
_REFERENCE = (Reason.REFERENCE_MISSING, Reason.REFERENCE_NOT_TRUSTED)


def limits(s: VaneSettings) -> VaneLimits:
    """The kernels' limits."""
    rad = math.radians
    return VaneLimits(
        offset_prior_rad=rad(s.offset_prior_deg),
        scale_prior=s.scale_prior,
        offset_walk_rad=rad(s.offset_walk_deg),
        shifted_walk_rad=rad(s.shifted_walk_deg),
        gust_tau_s=s.gust_tau_s,
        noise_rad=rad(s.noise_deg),
        timing_s=s.timing_s,
        jump_rad=rad(s.jump_deg),
        margin=s.margin,
        confirm_s=s.confirm_s,
        least_rad=rad(s.least_deg),
        updraft_m_s=s.updraft_m_s,
        learn_s=s.learn_s,
        learnt_rad=rad(s.learnt_deg),
        constant_s=s.constant_s,
        moved_rad=rad(s.moved_deg),
        scatter_rad=rad(s.scatter_deg),
        scatter_ratio=s.scatter_ratio,
        scatter_s=s.scatter_s,
        scatter_hold_s=s.scatter_hold_s,
        gross_rad=rad(s.gross_deg),
        gross_s=s.gross_s,
        readmit_s=s.readmit_s,
    )


class AirVaneWatch:
    """Judges up to three vanes, each alone, by the bank's angle of attack.

    Attributes
    ----------
    tests
        How near they came to a verdict, for the bank's next rows of tests.
    """

    def __init__(self, settings: VaneSettings) -> None:
        self.tests = VaneTests()
        self._settings = settings
        self._limits = limits(settings)
        self._state = new_vanes()
        self._epoch_us: int | None = None
        self._phase: Rows = np.zeros(0, PHASE_ROW)
        self._reference: list[tuple[int, Reason]] = []

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings (see :class:`monitor.verdict.Watch`)."""
        self._settings, done = blend(self._settings, settings.vane)
        self._limits = limits(self._settings)
        return done.under("vane")

    def step(
        self, rows: Mapping[str, Rows], estimates: Rows | None, said: Sequence[Verdict]
    ) -> list[Verdict]:
        """Use the newly released rows.

        Parameters
        ----------
        rows
            As of :meth:`monitor.verdict.Watch.step`.
        estimates
            The bank's, of this step; None without any.
        said
            The bank's verdicts: why it judges nobody goes for the vanes as well.
        """
        self._reference += [(v.t_us, v.reason) for v in said if v.reason in _REFERENCE]
        del self._reference[:-64]
        vanes = {s: r for s, r in rows.items() if s[:3] == "aoa" and len(r)}
        phase = rows.get("phase")
        if phase is None:
            phase = np.zeros(0, PHASE_ROW)
        if self._epoch_us is None:
            phase = np.concatenate([self._phase, phase])
            if not vanes:
                self._phase = phase[-1:]
                return []
            self._epoch_us = min(int(r["t_us"][0]) for r in vanes.values())
        parts = _events(vanes, phase, estimates)
        if not parts:
            return []
        events = np.concatenate(parts)
        events = events[np.argsort(events["order_us"], kind="stable")]
        log = np.empty((3 * len(events) + 8, vane.N_LOG))
        tests = np.empty((len(events), vane.N_TEST))
        n, n_tests = run(
            self._state,
            self._limits,
            (events["t_us"] - self._epoch_us) * 1e-6,
            np.ascontiguousarray(events["code"]),
            np.ascontiguousarray(events["index"]),
            np.ascontiguousarray(events["value"]),
            log,
            tests,
        )
        if n_tests:
            self.tests.add(tests[:n_tests], self._epoch_us)
        return [self._verdict(row, self._epoch_us) for row in log[:n]]

    def _verdict(self, row: NDArray[np.float64], epoch_us: int) -> Verdict:
        t_us = epoch_us + round(row[vane.G_T] * 1e6)
        sensor = f"aoa{int(row[vane.G_VANE])}"
        state = _STATES[float(row[vane.G_STATUS])]
        if state is State.UNMONITORED:
            reason = _REASONS[float(row[vane.G_REASON])]
            if reason is Reason.REFERENCE_MISSING:
                known_us = t_us - int(vane.LATEST_S * 1e6)
                reason = next((r for t, r in reversed(self._reference) if t <= known_us), reason)
            return Verdict(t_us, sensor, state, reason)
        if state is State.OK:
            again = " again" if row[vane.G_AGAIN] else ""
            return Verdict(
                t_us,
                sensor,
                state,
                estimator="air_vane",
                evidence=f"{sensor} agrees with attitude, ground speed and wind{again}",
            )
        return Verdict(
            t_us,
            sensor,
            state,
            kind=_kind(row),
            onset_t_us=min(epoch_us + round(row[vane.G_ONSET] * 1e6), t_us),
            magnitude=float(row[vane.G_SHOWN] - row[vane.G_EXPECT]),
            unit="rad",
            statistic=float(row[vane.G_STAT]),
            threshold=float(row[vane.G_LIMIT]),
            estimator="air_vane",
            evidence=_evidence(row, sensor),
        )


def _events(vanes: Mapping[str, Rows], phase: Rows, estimates: Rows | None) -> list[Rows]:
    """Events of every stream; ``order_us`` merges them."""
    out = []
    if len(phase):
        events = _of(vane.EV_PHASE, 0, phase["t_us"])
        events["value"][:, 0] = phase["flying"]
        out.append(events)
    for sensor in sorted(vanes):
        i = int(sensor[3:] or 0)
        if i < vane.N_VANES:
            r = vanes[sensor]
            r = r[np.isfinite(r["aoa_rad"])]
            events = _of(vane.EV_VANE, i, r["t_us"])
            events["value"][:, 0] = r["aoa_rad"]
            out.append(events)
    if estimates is not None:
        e = estimates[np.isfinite(estimates["aoa_rad"] + estimates["tas_m_s"])]
        events = _of(vane.EV_AIR, 0, e["t_us"])
        events["order_us"] += BESIDE_US
        for k, name in enumerate(("aoa_rad", "aoa_std_rad", "tas_m_s")):
            events["value"][:, k] = e[name]
        out.append(events)
    return out


def _of(code: int, index: int, t_us: NDArray[np.int64]) -> Rows:
    events = np.zeros(len(t_us), _EVENT)
    events["t_us"] = events["order_us"] = t_us
    events["code"], events["index"] = code, index
    return events


def _kind(row: NDArray[np.float64]) -> Kind:
    cause = float(row[vane.G_CAUSE])
    if cause == vane.CONSTANT:
        return Kind.STUCK
    if cause == vane.SCATTER:
        low, high = WHITE
        return Kind.NOISE if low < row[vane.G_ROUGH] < high else Kind.OSCILLATION
    if cause == vane.GROSS:
        return Kind.BIAS
    shift, early = row[vane.G_SHOWN] - row[vane.G_EXPECT], row[vane.G_EARLY]
    if abs(early) > STEP_SHARE * abs(shift):
        return Kind.BIAS
    rate = abs(shift) / max(row[vane.G_T] - row[vane.G_ONSET], 0.1)
    return Kind.RUNAWAY if rate > RUNAWAY_RAD_S else Kind.DRIFT


def _evidence(row: NDArray[np.float64], sensor: str) -> str:
    """One sentence; a lone vane's names the vertical wind that would be the other explanation."""
    cause, lasting_s = float(row[vane.G_CAUSE]), max(row[vane.G_T] - row[vane.G_ONSET], 0.1)
    lasting = f"for {lasting_s:.1f} s"
    if cause == vane.CONSTANT:
        shown = math.degrees(row[vane.G_SHOWN])
        return f"{sensor} has shown exactly {shown:.1f} deg {lasting} while the aircraft flies"
    if cause == vane.SCATTER:
        rms = math.degrees(row[vane.G_STAT])
        return f"{sensor} has scattered by {rms:.1f} deg {lasting}, more than gusts can make it"
    off = row[vane.G_SHOWN] - row[vane.G_EXPECT]
    side = "above" if off > 0.0 else "below"
    draught = "an updraft" if off > 0.0 else "a downdraft"
    asked = row[vane.G_TAS] * math.tan(min(abs(off), 1.0))
    return (
        f"{sensor} has read {abs(math.degrees(off)):.1f} deg {side} what attitude, ground speed "
        f"and wind say {lasting}; it would take {draught} of {asked:.0f} m/s to explain that"
    )
