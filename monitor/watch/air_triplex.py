"""Watch of two or three pitots and vanes: votes among them, and a bounded wind against them all."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimators.air_mhe_3d import WindLimits
from estimators.air_triplex_stream import (
    EV_AOA,
    EV_ATTITUDE,
    EV_BARO,
    EV_GPS,
    EV_IMU,
    EV_NAV,
    EV_PHASE,
    EV_PITOT,
    N_ESTIMATE,
    N_TEST,
    N_VALUES,
    StreamLimits,
    TriplexParams,
    new_stream,
    run,
)
from estimators.air_vote_record import LOG_SIZE, STAGE_S, VoteLimits
from links.samples import Rows
from monitor.retune import Retuned, blend
from monitor.settings import Settings
from monitor.settings.triplex import TriplexSettings
from monitor.verdict import AIR_ESTIMATE, StepResult
from monitor.watch.air_tests import vote_tests
from monitor.watch.air_triplex_words import verdict

__all__ = ["AirTriplexWatch", "params"]

Array = NDArray[np.float64]
N_SENSORS = 3


def params(settings: TriplexSettings) -> TriplexParams:
    """The kernels' parameters."""
    s = settings
    rad = math.radians
    return TriplexParams(
        WindLimits(
            walk_m_s=s.wind_walk_m_s,
            walk_down_m_s=s.wind_walk_down_m_s,
            down_tau_s=s.wind_down_tau_s,
            velocity_walk_m_s=s.velocity_walk_m_s,
            offset_walk_rad=rad(s.offset_walk_deg),
            bound_m_s=s.wind_bound_m_s,
            bound_down_m_s=s.wind_bound_down_m_s,
            gps_std_m_s=s.gps_std_m_s,
            cas_std_m_s=s.cas_std_m_s,
            aoa_std_rad=rad(s.aoa_std_deg),
            sideslip_std_rad=rad(s.sideslip_std_deg),
            offset_std_rad=rad(s.offset_std_deg),
            n_kappa=2,
            n_qp=2,
        ),
        VoteLimits(
            floor_aoa_rad=rad(s.aoa_threshold_deg),
            floor_cas_m_s=s.cas_threshold_m_s,
            floor_cas_share=s.cas_threshold_share,
            sigmas=s.learnt_sigmas,
            ragged_share=s.ragged_share,
            offset_aoa_rad=rad(s.offset_limit_deg),
            scale_cas=s.scale_limit,
            arm_m=s.lever_arm_m,
            common_aoa_rad=rad(s.common_aoa_deg),
            common_cas_m_s=s.common_cas_m_s,
            common_cas_share=s.common_cas_share,
            step_sigmas=s.step_sigmas,
            gust_m_s=s.gust_m_s,
            block_margin=s.block_margin,
            majority_margin=s.majority_margin,
            pair_margin=s.pair_margin,
            clear_share=s.clear_share,
            clear_s=s.clear_s,
            learn_s=s.learn_s,
            constant_s=s.constant_s,
            vote_wait_s=s.vote_wait_s,
            pair_wait_s=s.pair_wait_s,
            memory_s=s.memory_s,
        ),
        StreamLimits(
            change_m_s=s.wind_change_m_s,
            change_down_m_s=s.wind_change_down_m_s,
            change_base_s=s.wind_change_base_s,
            held_walk_m_s=s.held_walk_m_s,
            attitude_gap_s=s.attitude_gap_s,
            reference_gap_s=s.reference_gap_s,
            reference_apart_m_s=s.reference_apart_m_s,
            reference_wait_s=s.reference_wait_s,
            emit_s=s.emit_s,
            calibration_std=s.calibration_std,
            heading_std_rad=rad(s.heading_std_deg),
            alignment_std_rad=rad(s.alignment_std_deg),
        ),
    )


def _event(sensor: str, r: Rows) -> tuple[int, int, Array, NDArray[np.bool_]] | None:
    """Event code, instance, values and which rows count, of one stream; None if it is not used."""
    quantity = sensor.rstrip("0123456789")
    i = int(sensor[len(quantity) :] or 0)
    value = np.zeros((len(r), N_VALUES))
    match quantity:
        case "attitude":
            code, columns = EV_ATTITUDE, 4
            value[:, :4] = r["q_ned_from_frd"]
            value[:, 4:7] = r["rate_rad_s"]
        case "gps":
            code, columns = EV_GPS, 2
            value[:, :3] = r["vel_ned_m_s"]
            value[r["fix_type"] < 3, 0] = np.nan
        case "nav":
            code, columns = EV_NAV, 3
            value[:, :3] = r["vel_ned_m_s"]
        case "imu" if i == 0:
            code, columns = EV_IMU, 3
            value[:, :3] = r["acc_m_s2"]
        case "airspeed" if i < N_SENSORS:
            code, columns = EV_PITOT, 1
            value[:, 0] = r["cas_m_s"]
        case "aoa" if i < N_SENSORS:
            code, columns = EV_AOA, 1
            value[:, 0] = r["aoa_rad"]
        case "baro" if i == 0:
            code, columns = EV_BARO, 1
            value[:, 0] = np.where(r["static_press_pa"] > 1000.0, r["static_press_pa"], np.nan)
        case "phase":
            code, columns = EV_PHASE, 1
            value[:, 0] = r["flying"]
        case _:
            return None
    keep: NDArray[np.bool_] = np.asarray(np.isfinite(value[:, :columns]).all(axis=1))
    return code, i, value, keep


_HOLE_US = 3_000_000
"""No stages are run over more of a hole in the stream than this [us]."""


class AirTriplexWatch:
    """Judges two or three pitots and vanes each; estimates wind and air data."""

    name = "air"
    quantities = frozenset({"attitude", "gps", "nav", "imu", "airspeed", "aoa", "baro", "phase"})

    def __init__(self, settings: TriplexSettings) -> None:
        self._settings = settings
        self._params = params(settings)
        self._state = new_stream()
        self._epoch_us: int | None = None
        self._last_us = 0

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings (see :class:`monitor.verdict.Watch`)."""
        self._settings, done = blend(self._settings, settings.triplex)
        self._params = params(self._settings)
        return done.under("triplex")

    def peaks(self) -> dict[str, float]:
        """No key of it is learnt: its thresholds follow each flight's own scatter."""
        return {}

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        """Use the newly released rows (see :class:`monitor.verdict.Watch`)."""
        t_us, seq, code, index, value = [], [], [], [], []
        for sensor, r in rows.items():
            event = _event(sensor, r) if len(r) else None
            if event is None:
                continue
            kind, i, values, keep = event
            n = int(keep.sum())
            t_us.append(r["t_us"][keep])
            seq.append(r["seq"][keep])
            code.append(np.full(n, kind, np.int64))
            index.append(np.full(n, i, np.int64))
            value.append(values[keep])
        if not any(map(len, t_us)):
            return StepResult()
        t = np.concatenate(t_us)
        order = np.lexsort((np.concatenate(seq), t))
        t = t[order]
        if self._epoch_us is None:
            self._epoch_us = self._last_us = int(t[0])
        steps_us = np.minimum(np.diff(t, prepend=self._last_us), _HOLE_US)
        stages = int(steps_us.sum() * 1e-6 / STAGE_S) + 3
        self._last_us = int(t[-1])
        estimates = np.empty((stages, N_ESTIMATE))
        log = np.empty((6 * min(stages, 4096) + 12, LOG_SIZE))
        tests = np.empty((stages, N_TEST))
        n_estimates, n_log, n_tests = run(
            self._state,
            self._params,
            (t - self._epoch_us) * 1e-6,
            np.concatenate(code)[order],
            np.concatenate(index)[order],
            np.concatenate(value)[order],
            estimates,
            log,
            tests,
        )
        result = StepResult([verdict(row, self._epoch_us) for row in log[:n_log]])
        if n_estimates:
            result.estimates["air"] = _air_rows(estimates[:n_estimates], self._epoch_us)
        result.estimates |= vote_tests(tests[:n_tests], self._epoch_us)
        return result


def _air_rows(estimates: Array, epoch_us: int) -> Rows:
    """Estimates as rows of AIR_ESTIMATE."""
    out = np.zeros(len(estimates), AIR_ESTIMATE)
    out["t_us"] = epoch_us + np.round(estimates[:, 0] * 1e6).astype(np.int64)
    for column, name in enumerate((AIR_ESTIMATE.names or ())[1:9]):
        out[name] = estimates[:, 1 + column]
    out["wind_ned_m_s"] = estimates[:, 9:12]
    out["wind_std_ned_m_s"] = estimates[:, 12:15]
    return out
