"""Differences between IMUs detect and name the axis; a vote or the filters say whose it is."""

from __future__ import annotations

import math

import numpy as np

from estimators import imu_difference as difference
from estimators import ins_bank as bank
from estimators.detection import LatchState
from estimators.imu_evidence import log_likelihood
from estimators.ins_bank_model import ATT, F_ACC, INS
from estimators.ins_bank_tests import short_of
from links.vocabulary import Kind
from monitor.verdict import Verdict
from monitor.watch import imu_words as words
from monitor.watch.imu_record import TRACK_STD, US, Array, Pair, Record

__all__ = ["PairTests"]

ESTIMATOR = "estimators.ins_bank"
SUSPICION_SIGMA = 3.5
"""A difference beyond this starts the window by which it will be judged."""
MARK_S = 10.0
"""A difference that began and came to nothing within this time is forgotten."""
RELEASE = 0.7
"""Differences below this share of the physical size are agreement."""
AGREE_SIGMA, AGREE_SHARE = 3.0, 0.5
"""So many standard deviations of a difference are noise, if they are below this share of the fault
that was called."""
HEADING_DOUBT = 2.0
"""Times the odds asked for gyro_z where the attitude is no independent witness: it shows in the
heading alone, and the little that the filters know of that comes from ATTITUDE, which follows one
of the two IMUs."""
_GYRO_Z = 5

Key = tuple[int, int]


class PairTests:
    """Tests of every two IMUs, and the arbitration between them."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._marked_s = -math.inf
        self._driven: Array | None = None

    @property
    def busy(self) -> bool:
        """Whether a difference is being followed."""
        return self._driven is not None or any(
            latch.state is not LatchState.OK
            for pair in self._record.pairs.values()
            for latch in pair.latches
        )

    def step(self, whole: list[int], trusted: set[int]) -> list[Verdict]:
        """Compare the IMUs that work; arbitrate among those whose references are trusted."""
        r = self._record
        alarms: dict[Key, list[int]] = {}
        fresh = False
        for key, pair in r.pairs.items():
            if key[0] in whole and key[1] in whole:
                loud, alarmed = self._test(key, pair)
                fresh = fresh or loud
                if alarmed:
                    alarms[key] = alarmed
        self._follow_course(whole, fresh)
        out: list[Verdict] = []
        for key, axes in alarms.items():
            out += self._blame(key, axes, whole, alarms, trusted)
        return out

    def quiet(self) -> bool:
        """Whether no two IMUs disagree."""
        return not self.busy

    def _test(self, key: Key, pair: Pair) -> tuple[bool, list[int]]:
        """Whether a difference has just begun, and the axes on which it is confirmed.

        One interval suffices to begin with: what the filters will be asked about starts there.
        """
        r = self._record
        s = r.bank.pair[key]
        z = s[difference.D_Z : difference.D_Z + 3]
        m = s[difference.D_MEAN : difference.D_MEAN + 3]
        known = s[difference.D_COUNT, 0] >= 3
        loudest = np.abs(z).argmax(axis=0)
        newest = s[difference.D_LAST] - s[difference.D_BASE]
        alone = SUSPICION_SIGMA * np.sqrt(s[difference.D_VAR])
        jumped = known & (np.abs(newest) > np.maximum(alone, 0.5 * r.size))
        fresh, alarmed = False, []
        for k in range(6):
            lag = int(loudest[k])
            sigma, size = abs(float(z[lag, k])), abs(float(m[lag, k]))
            owner = next((i for i in key if r.units[i].axes[k].faulty), None)
            if owner is not None:
                self._follow_fault(key, owner, k, float(newest[k]), m[1:, k], z[1:, k])
                continue
            loud = bool(known and sigma > SUSPICION_SIGMA and size > 0.5 * r.size[k])
            begun = loud or bool(jumped[k])
            if begun and math.isnan(pair.onset_s[k]):
                fresh = True
                ticks = 2 if jumped[k] else difference.LAGS[lag]
                pair.onset_s[k] = r.now_s - ticks * r.tuning.tick_s
            alarm = loud and sigma > r.settings.difference_sigma and size > r.size[k]
            state = pair.latches[k].step(r.t_us, alarm, not loud)
            if state is LatchState.FAULTY:
                alarmed.append(k)
                if pair.said_us[k] is None:
                    pair.said_us[k] = r.t_us
            elif state is LatchState.OK and not begun:
                pair.forget(k)
        return fresh, alarmed

    def _follow_course(self, whole: list[int], fresh: bool) -> None:
        """Suppose the difference of two IMUs, as it goes, to be the fault of either.

        The window of the arbitration starts when a difference begins, not while one is judged.
        """
        r = self._record
        pending = any(
            latch.state is LatchState.FAULTY for p in r.pairs.values() for latch in p.latches
        )
        if fresh and not pending:
            self._start_course()
        elif not pending and r.now_s - self._marked_s > MARK_S:
            self._driven = None
        elif self._driven is not None and self._lost_course(whole):
            self._start_course()
        if self._driven is not None and len(whole) == 2:
            i, j = whole
            s = r.bank.pair[i, j]
            d = s[difference.D_LAST] - s[difference.D_BASE]
            bank.drive(r.bank, i, d - self._driven)
            bank.drive(r.bank, j, self._driven - d)
            self._driven = d

    def _lost_course(self, whole: list[int]) -> bool:
        """Whether a filter was aligned anew since the window started: a hole in the samples."""
        b = self._record.bank
        return any(math.isnan(b.start_s[c, -1]) for i in whole for c in self._record.filters(i))

    def _start_course(self) -> None:
        bank.mark(self._record.bank, self._record.now_s)
        self._driven = np.zeros(6)
        self._marked_s = self._record.now_s

    def _blame(
        self,
        key: Key,
        axes: list[int],
        whole: list[int],
        alarms: dict[Key, list[int]],
        trusted: set[int],
    ) -> list[Verdict]:
        r = self._record
        i, j = key
        pair = r.pairs[key]
        z = r.bank.pair[i, j, difference.D_Z : difference.D_Z + 3]
        d = self._present(key, pair)
        out: list[Verdict] = []
        left = []
        for k in axes:
            if any(r.units[imu].axes[k].faulty for imu in key):
                continue  # the vote of another pair has just decided
            guilty = _voted(whole, key, k, alarms)
            if guilty is None:
                left.append(k)
            else:
                f = d if guilty == i else -d
                sigma = float(np.abs(z[:, k]).max())
                score = sigma, r.settings.difference_sigma
                out += self._call(guilty, None, [k], f, pair, score)
        if not left:
            return out
        odds = 0.0
        if len(whole) == 2 and trusted.issuperset(key) and self._driven is not None:
            odds = self._odds(i, j, left)
        limit = r.settings.arbitration_nats
        if _GYRO_Z in left and not r.settings.attitude_independent:
            limit *= HEADING_DOUBT
        large = float((np.abs(d[left]) / r.size[left]).min())
        if odds != 0.0:
            r.settle(i, j, math.copysign(short_of(abs(odds) / limit, large), odds))
        if abs(odds) > limit and bool((np.abs(d[left]) > r.size[left]).all()):
            guilty, other = (i, j) if odds > 0 else (j, i)
            f = d if guilty == i else -d
            out += self._call(guilty, other, left, f, pair, (abs(odds), limit))
        return out

    def _present(self, key: Key, pair: Pair) -> Array:
        """Difference of a pair now, over the last second but not before it began, (6,) [SI]."""
        r = self._record
        s = r.bank.pair[key]
        count = int(s[difference.D_COUNT, 0])
        d = np.empty(6)
        for k in range(6):
            age_s = r.now_s - pair.onset_s[k]
            bins = 1 if math.isnan(age_s) else int(age_s / r.tuning.tick_s) - 1
            rows = [(count - 1 - q) % 15 for q in range(min(max(bins, 1), 5, count))]
            ring = s[difference.D_RING : difference.D_RING + 15, k]
            d[k] = np.median(ring[rows]) - s[difference.D_BASE, k]
        return d

    def _odds(self, i: int, j: int, axes: list[int]) -> float:
        """Log likelihood of "their difference is the fault of i" against "of j".

        An IMU with called faults is a poor witness: then the other's filters alone are asked.
        """
        r = self._record
        b = r.bank
        whose = np.zeros(6)
        whose[axes] = 1.0
        clean = {k: not any(a.faulty for a in r.units[k].axes) for k in (i, j)}
        modes = (INS, ATT) if r.settings.attitude_independent else (INS,)
        scores = [0.0]
        for mode in modes:
            ci, cj = 2 * i + mode, 2 * j + mode
            if math.isnan(b.start_s[ci, -1]) or math.isnan(b.start_s[cj, -1]):
                return 0.0
            nis = min(b.start_nis[ci, -1], b.start_nis[cj, -1])
            of_i = log_likelihood(b.L[ci, -1], b.Y[ci, -1], whose, nis) if clean[i] else 0.0
            of_j = log_likelihood(b.L[cj, -1], b.Y[cj, -1], whose, nis) if clean[j] else 0.0
            scores.append(of_i - of_j)
        return max(scores, key=abs)

    def _call(
        self,
        imu: int,
        other: int | None,
        axes: list[int],
        f: Array,
        pair: Pair,
        score: tuple[float, float],
    ) -> list[Verdict]:
        r = self._record
        out = []
        onset_s = r.now_s
        for k in axes:
            axis = r.units[imu].axes[k]
            onset_s = pair.onset_s[k]
            if math.isnan(onset_s):
                onset_s = (pair.latches[k].since_us or r.t_us) / US
            detected_us = pair.said_us[k]
            axis.latch.force(r.t_us, round(onset_s * US))
            axis.test = "difference"
            axis.base = r.slow_bias(imu, k)
            axis.called = abs(float(f[k]))
            held_s = r.now_s - onset_s
            kind = self._kind(imu, k, held_s)
            size = float(f[k])
            text = (
                words.vote_sentence(imu, k, size, kind, held_s)
                if other is None
                else words.pair_sentence(
                    imu,
                    other,
                    k,
                    size,
                    kind,
                    held_s,
                    attitude=r.settings.attitude_independent,
                    baro=r.has_baro,
                )
            )
            out.append(r.fault(imu, k, kind, onset_s, size, score, ESTIMATOR, text, detected_us))
            for (p, q), each in r.pairs_of(imu):
                r.bank.pair[p, q, difference.D_HOLD, k] = 1.0
                each.forget(k)
        self._take(imu, axes, f, onset_s)
        self._start_course()  # what is still undecided on other axes is followed from here
        return out

    def _kind(self, imu: int, k: int, held_s: float) -> Kind:
        """Shape of a difference over its last three seconds."""
        r = self._record
        for (i, j), _ in r.pairs_of(imu):
            s = r.bank.pair[i, j]
            if s[difference.D_COUNT, 0] < difference.LAGS[2]:
                continue
            course = s[difference.D_RING : difference.D_RING + 15, k] - s[difference.D_BASE, k]
            clear = r.size[k] + 3.0 * math.sqrt(float(s[difference.D_VAR, k]))
            if course.max() > clear and course.min() < -clear:
                return Kind.OSCILLATION
            fast = abs(float(s[difference.D_MEAN + 1, k]))
            slow = abs(float(s[difference.D_MEAN + 2, k]))
            return Kind.DRIFT if held_s > 3.0 and fast > 1.15 * slow else Kind.BIAS
        return Kind.BIAS

    def _take(self, imu: int, axes: list[int], f: Array, onset_s: float) -> None:
        """Fold a called fault into the filters of its IMU, from the window nearest its onset."""
        r = self._record
        b = r.bank
        aligned = list(r.filters(imu))
        for c in (2 * imu + INS, 2 * imu + ATT):
            if c in aligned:
                before = np.where(b.start_s[c, :-1] <= onset_s, b.start_s[c, :-1], -math.inf)
                w = int(before.argmax()) if before.max() > -math.inf else 0
                r.fold(c, w, axes, np.ascontiguousarray(f), TRACK_STD)
            else:
                for k in axes:
                    b.x[c, F_ACC + k] += f[k]

    def _follow_fault(
        self, key: Key, owner: int, k: int, newest: float, means: Array, z: Array
    ) -> None:
        """Keep a faulty IMU's filters at what the other IMU says; clear when they agree again.

        In noise that hides agreement to the physical size, agreement within the noise will do, if
        it is well below what the fault was. ``means`` are over one and three seconds, ``z`` in
        their standard deviations, both (2,).
        """
        r = self._record
        axis = r.units[owner].axes[k]
        other = key[1] if owner == key[0] else key[0]
        if axis.test != "difference" or r.units[other].axes[k].faulty:
            return
        sign = 1.0 if owner == key[0] else -1.0
        for c in r.filters(owner):
            bank.observe_fault(r.bank, c, k, axis.base + sign * newest, float(TRACK_STD[k]))
        s = r.bank.pair[key]
        std = np.append(np.sqrt(s[difference.D_VAR, k]), np.abs(means / np.where(z, z, np.inf)))
        allowed = np.minimum(AGREE_SIGMA * std, (np.inf, *(AGREE_SHARE * axis.called,) * 2))
        share = np.abs((newest, *means)) / np.maximum(allowed, RELEASE * r.size[k])
        worst = float(share.max())
        r.hold(owner, k, worst)
        state = axis.latch.step(r.t_us, worst * RELEASE > 1.0, worst < 1.0)
        if state is LatchState.OK:
            r.release(owner, k)


def _voted(whole: list[int], key: Key, k: int, alarms: dict[Key, list[int]]) -> int | None:
    """The IMU that differs from all others while those agree; None without a majority."""
    if len(whole) < 3:
        return None
    for suspect in key:
        rest = [i for i in whole if i != suspect]
        alone = all(k in alarms.get((min(suspect, o), max(suspect, o)), []) for o in rest)
        agree = all(k not in alarms.get((a, c), []) for a in rest for c in rest if a < c)
        if alone and agree:
            return suspect
    return None
