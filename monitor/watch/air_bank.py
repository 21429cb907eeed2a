"""Watch of the pitots with the filter bank: rows in, verdicts with evidence and air data out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import CheckLimits
from estimators.air_data_3d_bank import WindBounds
from estimators.air_data_3d_judge import G_T, N_LOG, JudgeLimits
from estimators.air_data_3d_noise import NoiseLevels
from estimators.air_data_3d_stream import (
    EV_ATTITUDE,
    EV_BARO,
    EV_GPS,
    EV_NAV,
    EV_PHASE,
    EV_PITOT,
    EV_PRESENT,
    N_ESTIMATE,
    N_ROW,
    N_VALUES,
    AirParams,
    FilterLevels,
    new_state,
    run,
)
from estimators.air_peaks import (
    APART,
    DEAD_WIND,
    GROSS_LN,
    MARGIN_ALL,
    MARGIN_ONE,
    MARGIN_SINGLE,
    MIN_SHIFT,
    NOISE,
    NOISE_RMS,
    PEAK,
)
from links.samples import Rows
from monitor.retune import Retuned, blend
from monitor.settings import Settings
from monitor.settings.air import AirSettings
from monitor.verdict import AIR_ESTIMATE, StepResult
from monitor.watch.air_bank_verdicts import verdict
from monitor.watch.air_horizon import Horizon, stage_levels
from monitor.watch.air_tests import VaneTests, bank_tests

__all__ = ["AirBankWatch", "params"]

FIXED = ("method", "gust_prior_m_s", "gust_tau_s", "horizon.horizon_s", "horizon.stage_s")
"""Settings that are in the state from its beginning, or that its arrays are made by."""

N_PITOTS = 3
DIFFERENTIAL_PRESSURE = 16
"""MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE."""


class _Events(NamedTuple):
    """Events of one stream; they are merged by (t_us, seq)."""

    t_us: NDArray[np.int64]
    seq: NDArray[np.int64]
    code: int
    instance: int
    value: NDArray[np.float64]


_PEAKS = {
    "air.margin_one": slice(MARGIN_ONE, MARGIN_ONE + 1),
    "air.margin_all": slice(MARGIN_ALL, MARGIN_ALL + 1),
    "air.margin_single": slice(MARGIN_SINGLE, MARGIN_SINGLE + 1),
    "air.min_shift": slice(MIN_SHIFT, MIN_SHIFT + 1),
    "air.reference_apart_m_s": slice(APART, APART + 1),
    "air.reference_noise_m_s": slice(NOISE, NOISE + 1),
    "air.gross_ln": slice(GROSS_LN, GROSS_LN + N_PITOTS),
    "air.noise_rms": slice(NOISE_RMS, NOISE_RMS + N_PITOTS),
    "air.dead_wind_m_s": slice(DEAD_WIND, DEAD_WIND + N_PITOTS),
}
"""Rows of the peaks that belong to each settings key."""


def params(settings: AirSettings) -> AirParams:
    """The kernels' parameters."""
    s = settings
    return AirParams(
        FilterLevels(
            wind_walk_m_s=s.wind_walk_m_s,
            wind_shear_m_s=s.wind_shear_m_s,
            gust_tau_s=s.gust_tau_s,
            scale_walk=s.scale_walk,
            scale_walk_shifted=s.scale_walk_shifted,
            wind_prior_m_s=s.wind_prior_m_s,
            vertical_walk_m_s=s.vertical_walk_m_s,
            vertical_prior_m_s=s.vertical_prior_m_s,
            scale_prior=s.scale_prior,
            yaw_prior_rad=s.yaw_prior_rad,
            gate=s.gate_sigma,
            jump_scale=s.jump_scale,
            jump_wind_m_s=s.jump_wind_m_s,
            spawn_s=s.spawn_s,
            age_max_s=s.age_max_s,
            learn_s=s.learn_s,
            reference_gap_s=s.reference_gap_s,
            reference_apart_m_s=s.reference_apart_m_s,
            reference_noise_m_s=s.reference_noise_m_s,
            reference_wait_s=s.reference_wait_s,
        ),
        NoiseLevels(
            gust_tau_s=s.gust_tau_s,
            gust_prior_m_s=s.gust_prior_m_s,
            gust_min_m_s=s.gust_min_m_s,
            gust_max_m_s=s.gust_max_m_s,
            sideslip_rad=s.sideslip_rad,
            timing_s=s.timing_s,
            pitot_common=s.pitot_common,
            pitot_own=s.pitot_own,
        ),
        CheckLimits(
            constant_s=s.constant_s,
            gross_ln=s.gross_ln,
            gross_s=s.gross_s,
            dead_wind_m_s=s.dead_wind_m_s,
            dead_s=s.dead_s,
            noise_rms=s.noise_rms,
            noise_ratio=s.noise_ratio,
            noise_s=s.noise_s,
            noise_tau_s=s.noise_tau_s,
        ),
        JudgeLimits(
            margin_one=s.margin_one,
            margin_all=s.margin_all,
            margin_single=s.margin_single,
            margin_wind=s.margin_wind,
            confirm_s=s.confirm_s,
            min_shift=s.min_shift,
            wind=WindBounds(
                s.wind_max_m_s, s.wind_down_max_m_s, s.wind_change_max_m_s, s.wind_change_base_s
            ),
            learnt_scale_std=s.learnt_scale_std,
            lost_scale_std=s.lost_scale_std,
            readmit_shift=s.readmit_shift,
            readmit_unlearnt=s.readmit_unlearnt_shift,
            readmit_s=s.readmit_s,
            suspect_clear_s=s.suspect_clear_s,
        ),
        stage_levels(s),
    )


def _events(rows: Mapping[str, Rows]) -> list[_Events]:
    """Events of every stream that the bank uses."""
    out = []
    for sensor, r in rows.items():
        if not len(r):
            continue
        quantity, index = sensor.rstrip("0123456789"), sensor[len(sensor.rstrip("0123456789")) :]
        i = int(index) if index else 0
        value = np.zeros((len(r), N_VALUES))
        keep: NDArray[np.bool_] = np.ones(len(r), np.bool_)
        if sensor == "attitude":
            code = EV_ATTITUDE
            value[:] = r["q_ned_from_frd"]
        elif quantity == "gps" and i < 2:
            code = EV_GPS
            value[:, :3] = r["vel_ned_m_s"]
            keep = np.isfinite(value[:, 0] + value[:, 1]) & (r["fix_type"] >= 3)
        elif sensor == "nav":
            code = EV_NAV
            value[:, :3] = r["vel_ned_m_s"]
            keep = np.isfinite(value[:, 0] + value[:, 1] + value[:, 2])
        elif quantity == "airspeed" and i < N_PITOTS:
            code = EV_PITOT
            value[:, 0] = r["cas_m_s"]
            keep = np.isfinite(value[:, 0])
        elif quantity == "baro":
            code = EV_BARO
            value[:, 0] = r["static_press_pa"]
            keep = value[:, 0] > 1000.0
        elif sensor == "phase":
            code = EV_PHASE
            value[:, 0] = r["flying"]
        elif sensor == "sys_status":
            code = EV_PRESENT
            value[:, 0] = (r["present"] & DIFFERENTIAL_PRESSURE) != 0
        else:
            continue
        out.append(_Events(r["t_us"][keep], r["seq"][keep], code, i, value[keep]))
    return out


class AirBankWatch:
    """Judges up to three pitots by GPS, attitude and each other; estimates wind and air data."""

    name = "air"
    quantities = frozenset({"attitude", "gps", "nav", "airspeed", "baro", "phase", "sys_status"})

    def __init__(self, settings: AirSettings) -> None:
        self._settings = settings
        self._params = params(settings)
        self._state = new_state(self._params)
        self._horizon = Horizon(settings)
        self._tested = np.empty((0, N_ROW))
        self._epoch_us: int | None = None
        self._said_s = -np.inf

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings (see :class:`monitor.verdict.Watch`)."""
        self._settings, done = blend(self._settings, settings.air, FIXED)
        self._params = params(self._settings)
        self._horizon.retune(self._settings)
        return done.under("air")

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        """Use the newly released rows (see :class:`monitor.verdict.Watch`)."""
        events = _events(rows)
        n = sum(len(e.t_us) for e in events)
        self._tested = np.empty((0, N_ROW))
        if n == 0:
            return StepResult()
        t_us = np.concatenate([e.t_us for e in events])
        order = np.lexsort((np.concatenate([e.seq for e in events]), t_us))
        code = np.concatenate([np.full(len(e.t_us), e.code, np.int64) for e in events])
        index = np.concatenate([np.full(len(e.t_us), e.instance, np.int64) for e in events])
        value = np.concatenate([e.value for e in events])
        t_us = t_us[order]
        if self._epoch_us is None:
            self._epoch_us = int(t_us[0])
        estimates = np.empty((n + 16, N_ESTIMATE))
        log = np.empty((3 * n + 64, N_LOG))
        tests = np.empty((2 * n + 32, N_ROW))
        events_in_order = (t_us - self._epoch_us) * 1e-6, code[order], index[order], value[order]
        k = n_estimates = n_log = n_tests = 0
        while k < n:
            k, more, said, tested = run(
                self._state,
                self._params,
                k,
                *events_in_order,
                estimates[n_estimates:],
                log[n_log:],
                tests[n_tests:],
            )
            n_estimates, n_log, n_tests = n_estimates + more, n_log + said, n_tests + tested
            said = self._horizon.decide(self._state, self._params, log[n_log:])
            if said:
                n_log, n_tests = n_log + said, self._horizon.tell(self._state, tests, n_tests)
        self._in_order(log[:n_log])
        result = StepResult([verdict(row, self._epoch_us) for row in log[:n_log]])
        if n_estimates:
            result.estimates["air"] = _air_rows(estimates[:n_estimates], self._epoch_us)
        self._tested = tests[:n_tests]
        if n_tests:
            result.estimates |= bank_tests(self._tested, self._epoch_us)
        return result

    def _in_order(self, log: NDArray[np.float64]) -> None:
        """Let no verdict be older than the one before: an epoch is judged after what follows it."""
        if len(log):
            t_s = log[:, G_T]
            np.maximum(np.maximum.accumulate(t_s), self._said_s, out=t_s)
            self._said_s = float(t_s[-1])

    def tests_beside(self, vanes: VaneTests) -> dict[str, Rows]:
        """Tables of tests of the last step, with those of vanes beside the pitots."""
        if self._epoch_us is None or not len(self._tested):
            return {}
        beside = vanes.take(self._tested, self._epoch_us)
        return bank_tests(self._tested, self._epoch_us, beside)

    def peaks(self) -> dict[str, float]:
        """Largest value that each test quantity reached while its pitot was judged and not faulty.

        Under the settings key of its limit and in its unit; a quantity that never had a meaning in
        this stream is left out.
        """
        reached = {key: self._state.peaks[rows, PEAK] for key, rows in _PEAKS.items()}
        return {
            key: max(float(values[np.isfinite(values)].max()), 0.0)
            for key, values in reached.items()
            if np.isfinite(values).any()
        } | self._horizon.reached.peaks()


def _air_rows(estimates: NDArray[np.float64], epoch_us: int) -> Rows:
    """Estimates as rows; a value known no better than its size is NaN."""
    out = np.zeros(len(estimates), AIR_ESTIMATE)
    out["t_us"] = epoch_us + np.round(estimates[:, 0] * 1e6).astype(np.int64)
    for column, (name, limit) in enumerate(
        (("cas", 0.25), ("tas", 0.25), ("aoa", np.inf), ("ssa", np.inf))
    ):
        unit = "rad" if name in ("aoa", "ssa") else "m_s"
        value, std = estimates[:, 1 + 2 * column], estimates[:, 2 + 2 * column]
        known = std < (limit * value if limit < np.inf else 0.25)
        out[f"{name}_{unit}"] = np.where(known, value, np.nan)
        out[f"{name}_std_{unit}"] = std
    out["wind_ned_m_s"] = estimates[:, 9:12]
    out["wind_std_ned_m_s"] = estimates[:, 12:15]
    return out
