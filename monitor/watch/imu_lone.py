"""A lone IMU, tested by its own filters against satellite velocity and static pressure.

The vehicle's attitude is a third reference: fully where it is independent of the IMU, otherwise
only for the gyro and only in agreement with satellite velocity (:meth:`LoneTest._usable`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimators import ins_bank as bank
from estimators.detection import LatchState
from estimators.imu_evidence import log_likelihood, single_axis
from estimators.ins_bank_model import ATT, F_ACC, INS
from estimators.ins_bank_tests import short_of
from links.vocabulary import Kind
from monitor.verdict import Verdict
from monitor.watch import imu_words as words
from monitor.watch.imu_record import US, Array, Record

__all__ = ["Found", "LoneTest"]

ESTIMATOR = "estimators.ins_bank"
MARGIN_NATS = 3.0
MARGIN_WAIT_S = 3.0
"""The best axis must beat its rival by this, or the best is named, with its pair, after a wait."""
FAINT = 1.1
"""Evidence not yet this much beyond its threshold waits as long: in gusts it hovers there."""
PAIRS = {0: 4, 4: 0, 1: 3, 3: 1}
"""Without an independent attitude a force that is off along an axis looks, for a while, like a rate
that tips that axis out of the horizontal: acc_x like gyro_y, acc_y like gyro_x."""
PAIR_SHARE = 0.67
"""Both are named when the pair's z is at least this share: it then explains half as much."""
SECOND_FAULT = 1.5
"""A lone IMU with a called fault is a poorer model: a second one must be this much clearer."""
SAME_FAULT = 0.75
"""That a called fault changes, or ends, needs less than that it exists."""
LASTING = 0.5
"""A gyro disagrees with the attitude by at least this share of its fault in most intervals."""
SWING = "swing"
SWING_S = 8.0
SWING_QUIET = 3.0
"""What swings has done so over the last eight seconds or so, and is free again when the energy of
its windows is this small."""
RELEASE = 0.9
"""Estimate plus one sigma below this share of the physical size is agreement."""

NO_PRIOR = np.zeros(6)
NO_PRIOR_STD = np.full(6, np.inf)


@dataclass(frozen=True, slots=True)
class Found:
    """The single-axis fault that explains a filter's innovations best, and the next best axis.

    Attributes
    ----------
    window, axis
        Window, hence supposed onset, and axis.
    fault, z
        Its estimate [SI] and statistic [sigma].
    rival, margin
        The axis that explains nearly as much, and by how much less (log likelihood).
    pair
        Whether the axis that looks alike (:data:`PAIRS`) explains at least half as much.
    loud
        How far beyond its threshold, or its size, the greater of the two is.
    """

    window: int
    axis: int
    fault: float
    z: float
    rival: int
    margin: float
    pair: bool
    loud: float


class LoneTest:
    """Tests of one IMU's filters."""

    def __init__(self, record: Record) -> None:
        self._record = record

    def shared(self, whole: list[int]) -> bool:
        """Whether every filter of every IMU contradicts the references."""
        limit = np.full(6, self._record.settings.single_sigma)
        return all(
            self._loudest(2 * i + mode, limit) is not None for i in whole for mode in (INS, ATT)
        )

    def step(self, imu: int) -> list[Verdict]:
        """Judge the only IMU that works; its references are trusted."""
        r = self._record
        unit = r.units[imu]
        self._settle(imu)
        limit = np.full(6, r.settings.single_sigma)
        called = [a.faulty for a in unit.axes]
        if any(called):
            limit *= np.where(called, SAME_FAULT, SECOND_FAULT)
        held, sharp = np.zeros(6), np.zeros(6)
        mode, found = INS, self._loudest(2 * imu + INS, limit, held)
        if r.settings.attitude_independent or found is None:
            sharper = self._loudest(2 * imu + ATT, limit, sharp)
            if sharper is not None and self._usable(imu, sharper):
                mode, found = ATT, sharper
                held[found.axis] = max(held[found.axis], sharp[found.axis])
        if r.settings.attitude_independent:
            held = np.maximum(held, sharp)
        for k, axis in enumerate(unit.axes):
            if not axis.faulty:
                r.hold(imu, k, float(held[k]))
        if found is None:
            unit.loud_s = math.nan
        elif math.isnan(unit.loud_s):
            unit.loud_s = r.now_s
        close = found is not None and found.margin < MARGIN_NATS
        weak = close or (found is not None and found.loud < FAINT)
        if weak and r.now_s - unit.loud_s < MARGIN_WAIT_S:
            return []
        for k, axis in enumerate(unit.axes):
            if not axis.faulty and axis.test == "" and (found is None or k != found.axis):
                axis.latch.step(r.t_us, False, True)
        swung = self._swing(imu)
        if found is None or swung:
            return swung
        axis = unit.axes[found.axis]
        if axis.test == SWING:
            return []
        if axis.faulty:
            self._fold(imu, found)
        elif axis.latch.step(r.t_us, True, False) is LatchState.FAULTY:
            return [self._call(imu, mode, found, self._other_name(found, close=close))]
        return []

    def _swing(self, imu: int) -> list[Verdict]:
        """Judge rates that swing to and fro, each half too short for a step to be called."""
        r = self._record
        out = []
        for k in range(3, 6):
            axis = r.units[imu].axes[k]
            swings = bank.swings(r.bank, r.tuning, imu, k)
            z2, f2 = (float(v) for v in r.bank.swing[2 * imu + ATT, :, k])
            if r.settings.attitude_independent and not axis.faulty:
                r.hold(imu, k, short_of(z2 / bank.SWING_Z2, math.sqrt(2.0 * f2) / r.size[k]))
            if axis.test == SWING and axis.faulty:
                r.hold(imu, k, z2 / SWING_QUIET)
                if axis.latch.step(r.t_us, swings, z2 < SWING_QUIET) is LatchState.OK:
                    r.release(imu, k)
            elif swings and not axis.faulty:
                axis.test = SWING
                onset_s = r.now_s - SWING_S
                axis.latch.force(r.t_us, round(onset_s * US))
                size = math.sqrt(2.0 * f2)
                text, score = words.swing_sentence(imu, k, size), (z2, bank.SWING_Z2)
                out.append(r.fault(imu, k, Kind.OSCILLATION, onset_s, size, score, ESTIMATOR, text))
        return out

    def _other_name(self, found: Found, *, close: bool) -> int | None:
        """The axis that may be the faulty one instead; None when there is no doubt."""
        if found.pair and not self._record.settings.attitude_independent:
            return PAIRS[found.axis]
        return found.rival if close else None

    def _usable(self, imu: int, found: Found) -> bool:
        """Whether what the vehicle's attitude says of this IMU counts.

        An attitude computed from this very gyro cannot turn otherwise than the gyro says, except
        where the autopilot corrects it: towards its accelerometer, to a new heading, after a gyro
        fault that it had learnt; and where it jumps it has not turned. So an attitude that is not
        known to be independent is heard on the gyro alone, if the disagreement lasts from sample
        to sample, and if satellite velocity on its own takes its side by the odds that settle any
        other dispute between two sensors.
        """
        r = self._record
        if r.settings.attitude_independent:
            return True
        c, w, k = 2 * imu + INS, found.window, found.axis
        if k < 3 or math.isnan(r.bank.aligned_s[c]):
            return False
        f = np.zeros(6)
        f[k] = found.fault
        b = r.bank
        error = bank.usual_error(b.turns[imu], float(b.start_s[c + ATT, w]))[k - 3]
        if error / found.fault < LASTING:
            return False
        odds = log_likelihood(b.L[c, w], b.Y[c, w], f, float(b.start_nis[c, w]))
        return odds > r.settings.arbitration_nats

    def _loudest(self, c: int, limit: Array, held: Array | None = None) -> Found | None:
        """The loudest single-axis fault of a filter, over all windows: all possible onsets.

        Where an axis explains the innovations best by something too small to be a fault, no other
        axis is blamed for it. ``held`` (6,) receives how near each axis is to its limit and size.
        """
        r = self._record
        b = r.bank
        if math.isnan(b.aligned_s[c]):
            return None
        f, z = single_axis(b.L[c, :-1], b.Y[c, :-1], b.start_nis[c, :-1])
        size = np.array([bank.physical_size(r.size, b.diff2[c // 2], k) for k in range(6)])
        z[r.now_s - b.start_s[c, :-1] < bank.JUDGED_AGE_S] = 0.0
        score = np.abs(z) / limit
        loud = np.where(np.abs(f) > size, score, 0.0)
        if held is not None:
            held[:] = np.where(loud > 0.0, score, np.minimum(score, np.abs(f) / size)).max(axis=0)
        k, rival = (int(i) for i in np.argsort(-loud.max(axis=0))[:2])
        w = int(loud[:, k].argmax())
        v, best = np.unravel_index(int(score.argmax()), score.shape)
        if loud[w, k] <= 1.0 or (best != k and abs(f[v, best]) < r.size[best]):
            return None
        margin = 0.5 * float(z[w, k] ** 2 - (z[:, rival] ** 2).max())
        like = PAIRS.get(k)
        pair = like is not None and bool(np.abs(z[:, like]).max() >= PAIR_SHARE * abs(z[w, k]))
        clear = max(float(loud[w, k]), abs(float(f[w, k])) / size[k])
        return Found(w, k, float(f[w, k]), float(z[w, k]), rival, margin, pair, clear)

    def _call(self, imu: int, mode: int, found: Found, rival: int | None) -> Verdict:
        r = self._record
        k = found.axis
        axis = r.units[imu].axes[k]
        axis.test = "lone"
        axis.base = r.slow_bias(imu, k)
        since_s = (axis.latch.since_us or r.t_us) / US
        onset_s = min(float(r.bank.start_s[2 * imu + mode, found.window]), since_s)
        text = words.lone_sentence(
            imu,
            k,
            found.fault,
            r.now_s - onset_s,
            rival,
            attitude=mode == ATT,
            baro=r.has_baro,
        )
        score = abs(found.z), r.settings.single_sigma
        verdict = r.fault(imu, k, Kind.BIAS, onset_s, found.fault, score, ESTIMATOR, text)
        self._fold(imu, found)
        return verdict

    def _fold(self, imu: int, found: Found) -> None:
        r = self._record
        for c in r.filters(imu):
            if r.bank.L[c, found.window, found.axis, found.axis] > 0.0:
                r.fold(c, found.window, [found.axis], NO_PRIOR, NO_PRIOR_STD)

    def _settle(self, imu: int) -> None:
        """Clear a fault once the IMU's own filter says that it is gone."""
        r = self._record
        for k, axis in enumerate(r.units[imu].axes):
            if axis.test not in ("lone", "difference") or not axis.faulty:
                continue
            c = 2 * imu + (ATT if r.settings.attitude_independent else INS)
            left = abs(float(r.bank.x[c, F_ACC + k]) - axis.base)
            std = math.sqrt(float(r.bank.P[c, F_ACC + k, F_ACC + k]))
            r.hold(imu, k, (left + std) / (RELEASE * r.size[k]))
            state = axis.latch.step(r.t_us, left > r.size[k], left + std < RELEASE * r.size[k])
            if state is LatchState.OK:
                r.release(imu, k)
