"""Decides, tick by tick, which axis of which IMU is faulty, and says so when a state changes.

Three kinds of evidence, in this order:

1. what needs no reference: an IMU that reads zero, a value that stands still, an axis much noisier
   than its peers;
2. with two or more IMUs, their differences detect and name the axis; a vote (three IMUs) or the
   inertial filters (two) say whose it is, and while they cannot the axis is unmonitored, *sensors
   disagree*. A contradiction that all IMUs share is the reference's fault;
3. a lone IMU is tested by its own filters against satellite velocity and static pressure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimators import imu_difference as difference
from estimators import ins_bank as bank
from estimators.detection import Latch, LatchRule, LatchState
from estimators.imu_evidence import log_likelihood, single_axis
from estimators.ins_bank_model import ATT, F_ACC, INS
from links.vocabulary import Kind, Reason, State
from monitor.settings.imu import ImuSettings
from monitor.verdict import Verdict
from monitor.watch import imu_words as words

__all__ = ["Judge"]

Array = NDArray[np.float64]
US = 1_000_000

BRIEF_S = 1.0
"""A difference that has been quiet for this long is not judged any more."""
MARK_S = 10.0
"""A difference that began and came to nothing within this time is forgotten."""
LIVE_S = 0.5
"""An IMU silent for longer takes no part in any comparison."""
SUSPICION_SIGMA = 3.5
"""Differences beyond this start the window by which they will be judged."""
REFERENCE_GAP_S = 1.5
SPIN_HOLD_S = 3.0
CONTRADICTION_HOLD_S = 5.0
YOUNG_S = 0.8
"""A window younger than this has seen too few fixes to name an axis."""
SECOND_FAULT = 1.5
"""A lone IMU with a called fault is a poorer model: a second one must be this much clearer."""
SAME_FAULT = 0.75
"""That a called fault changes, or ends, needs less than that it exists."""
MARGIN_NATS = 3.0
MARGIN_WAIT_S = 3.0
"""The best axis must beat its rival by this, or the best is named, with its pair, after a wait."""
RECTIFIED = 0.1
"""Vibration and gusts that the samples alias can leave a mean of this share of their sample-to-
sample rms (rectification): a lone IMU is not blamed for less. Real flights shake by 1 m/s^2."""
TRACK_STD = np.array([0.1, 0.1, 0.1, 0.003, 0.003, 0.003])
"""How exactly another IMU says what a faulty one measures [m/s^2, rad/s]."""
RAISED_DENSITY = np.array([0.03, 0.03, 0.03, 0.001, 0.001, 0.001])
"""Walk of a fault that was called, for as long as it lasts [m/s^2.5, rad/s^1.5]."""


@dataclass(slots=True)
class Axis:
    """What is known of one axis.

    Attributes
    ----------
    latch
        Of the evidence in force.
    base
        Slow bias when the fault was called: what the axis must come back to [SI].
    test
        Which test called the fault, hence which one clears it.
    said
        State and reason last published.
    """

    latch: Latch
    base: float = 0.0
    test: str = ""
    said: tuple[State, Reason | None] | None = None


@dataclass(slots=True)
class Unit:
    """One IMU."""

    axes: list[Axis]
    seen: bool = False
    since_s: float = math.nan


@dataclass(slots=True)
class Pair:
    """Two IMUs that are compared."""

    latches: list[Latch]
    undecided: list[bool] = field(default_factory=lambda: [False] * 6)
    onset_s: list[float] = field(default_factory=lambda: [math.nan] * 6)


@dataclass(frozen=True, slots=True)
class Found:
    """A single-axis fault that explains a lone IMU's innovations best, and the next best axis."""

    window: int
    axis: int
    fault: float
    z: float
    rival: int
    margin: float


class Judge:
    """Turns the state of a filter bank into verdicts.

    :meth:`decide` is called with the bank stopped at a tick. ``busy`` says whether it wants to see
    every tick from here on.
    """

    def __init__(self, settings: ImuSettings, tuning: bank.Tuning) -> None:
        self._set = settings
        self._tuning = tuning
        self._size = np.array([settings.acc_size_m_s2] * 3 + [settings.gyro_size_rad_s] * 3)
        confirm, clear = round(settings.confirm_s * US), round(settings.clear_s * US)
        self._rule = LatchRule(confirm, clear, round(0.3 * US))
        brief = LatchRule(confirm, round(BRIEF_S * US), round(0.3 * US))
        n = bank.MAX_IMUS
        self._units = [Unit([Axis(Latch(self._rule)) for _ in range(6)]) for _ in range(n)]
        self._pairs = {
            (i, j): Pair([Latch(brief) for _ in range(6)])
            for i in range(n)
            for j in range(i + 1, n)
        }
        self._contradicted_s = -math.inf
        self._marked_s = -math.inf
        self._driven: Array | None = None
        self.busy = True

    def decide(self, b: bank.Bank) -> list[Verdict]:
        """Judge at the tick at which the bank stands."""
        now = float(b.clock[bank.C_NOW])
        b.clock[bank.C_CHANGED] = 0.0
        for i, unit in enumerate(self._units):
            unit.seen = unit.seen or not math.isnan(b.sample[i, 0])
        found: list[Verdict] = []
        if b.clock[bank.C_FLYING] == 1.0:
            live = [
                i for i, u in enumerate(self._units) if u.seen and now - b.sample[i, 0] < LIVE_S
            ]
            found += self._bare(b, live, now)
            whole = [i for i in live if not self._dead(i)]
            reasons = {i: self._reason(b, i, now) for i in live}
            found += self._compare(b, whole, reasons, now)
            if len(whole) == 1 and reasons[whole[0]] is None:
                found += self._lone(b, whole[0], now)
            elif len(whole) > 1:
                self._shared(b, whole, now)
            reasons = {i: self._reason(b, i, now) for i in live}
        else:
            self._land()
            reasons = {i: Reason.ON_GROUND for i, u in enumerate(self._units) if u.seen}
        found += self._states(reasons, now)
        self.busy = self._wants_more()
        return found

    # -- reasons not to judge ----------------------------------------------------------------------

    def _reason(self, b: bank.Bank, imu: int, now: float) -> Reason | None:
        aligned = float(b.aligned_s[2 * imu])
        if now - b.clock[bank.C_SPIN_S] < SPIN_HOLD_S:
            return Reason.MANOEUVRE
        if now < b.clock[bank.C_GPS_BAD_S] or now - self._contradicted_s < CONTRADICTION_HOLD_S:
            return Reason.REFERENCE_NOT_TRUSTED
        fix, attitude = now - b.ref[bank.R_T_GPS], now - b.ref[bank.R_T_ATT]
        if not fix < REFERENCE_GAP_S or (math.isnan(aligned) and not attitude < REFERENCE_GAP_S):
            return Reason.REFERENCE_MISSING
        if math.isnan(aligned) or now - aligned < self._set.learn_s:
            return Reason.LEARNING
        return None

    def _dead(self, imu: int) -> bool:
        return any(
            a.latch.state is LatchState.FAULTY and a.test == "dropout"
            for a in self._units[imu].axes
        )

    def _land(self) -> None:
        for unit in self._units:
            for axis in unit.axes:
                axis.latch.reset()
        for pair in self._pairs.values():
            for k in range(6):
                pair.latches[k].reset()
                pair.undecided[k] = False
        self._contradicted_s = -math.inf

    def _wants_more(self) -> bool:
        return (
            self._driven is not None
            or any(
                a.latch.state is not LatchState.OK or (u.seen and a.said != (State.OK, None))
                for u in self._units
                for a in u.axes
                if not (a.said is not None and a.said[1] is Reason.ON_GROUND)
            )
            or any(
                latch.state is not LatchState.OK
                for p in self._pairs.values()
                for latch in p.latches
            )
        )

    # -- 1: what needs no reference ----------------------------------------------------------------

    def _bare(self, b: bank.Bank, live: list[int], now: float) -> Iterator[Verdict]:
        for i in live:
            s = b.noise[i]
            if s[difference.N_SEEN, 0] < 50:
                continue
            zero_s = now - float(s[difference.N_ZERO_S, 0])
            for k, axis in enumerate(self._units[i].axes):
                rest = difference.improbable_rest(b.noise, i, k, now)
                if zero_s > difference.ZERO_S:
                    yield from self._plain(b, i, k, now, "dropout", Kind.DROPOUT, zero_s, zero_s)
                elif rest > 1.0:
                    held_s = now - float(s[difference.N_SAME_S, k])
                    yield from self._plain(b, i, k, now, "stuck", Kind.STUCK, rest, held_s)
                elif axis.test in ("dropout", "stuck"):
                    axis.latch.step(round(now * US), False, True)
                else:
                    yield from self._noise(b, live, i, k, now)

    def _noise(
        self, b: bank.Bank, live: list[int], i: int, k: int, now: float
    ) -> Iterator[Verdict]:
        axis = self._units[i].axes[k]

        def level(imu: int, channel: int) -> float:
            s = b.noise[imu]
            h = math.log(max(s[difference.N_DIFF2, channel], 1e-12))
            return 0.5 * (h - float(s[difference.N_LOG_BASE, channel]))

        peers = [c for c in range(6) if c != k and c // 3 == k // 3]
        own = level(i, k)
        rise = own - max(level(i, c) for c in peers)
        others = [j for j in live if j != i]
        if others:
            rise = min(rise, own - max(level(j, k) for j in others))
        limit = math.log(self._set.noise_ratio)
        if axis.test not in ("", "noise") and axis.latch.state is LatchState.FAULTY:
            return
        was = axis.latch.state
        if rise > limit or axis.test == "noise":
            axis.test = "noise"
            axis.latch.step(round(now * US), rise > limit, rise < 0.5 * limit)
            if axis.latch.state is LatchState.OK:
                axis.test = ""
        if was is not LatchState.FAULTY and axis.latch.state is LatchState.FAULTY:
            rms = math.sqrt(float(b.noise[i, difference.N_DIFF2, k]) / 6.0)
            other = others[0] if others else None
            yield self._fault(
                now,
                i,
                k,
                Kind.NOISE,
                now - 2.0,
                rms,
                rise,
                limit,
                words.noise_sentence(i, k, math.exp(rise), other),
                "estimators.imu_difference",
            )

    def _plain(
        self, b: bank.Bank, i: int, k: int, now: float, test: str, kind: Kind, z: float, held: float
    ) -> Iterator[Verdict]:
        axis = self._units[i].axes[k]
        if axis.latch.state is LatchState.FAULTY and axis.test == test:
            axis.latch.step(round(now * US), True, False)
            return
        news = axis.latch.state is not LatchState.FAULTY
        axis.test = test
        axis.latch.force(round(now * US), round((now - held) * US))
        if news:
            value = float(b.sample[i, 1 + k])
            text = (
                words.dropout_sentence(i, held)
                if kind is Kind.DROPOUT
                else words.stuck_sentence(i, k, value, held)
            )
            limit = difference.ZERO_S if kind is Kind.DROPOUT else 1.0
            yield self._fault(
                now, i, k, kind, now - held, math.nan, z, limit, text, "estimators.imu_difference"
            )

    # -- 2: differences ----------------------------------------------------------------------------

    def _compare(
        self, b: bank.Bank, whole: list[int], reasons: dict[int, Reason | None], now: float
    ) -> list[Verdict]:
        out: list[Verdict] = []
        alarms: dict[tuple[int, int], list[int]] = {}
        fresh = False
        for pair_key, pair in self._pairs.items():
            i, j = pair_key
            if i not in whole or j not in whole:
                continue
            s = b.pair[i, j]
            z = s[difference.D_Z : difference.D_Z + 3]
            m = s[difference.D_MEAN : difference.D_MEAN + 3]
            early = s[difference.D_COUNT, 0] < 3
            for k in range(6):
                lag = int(np.argmax(np.abs(z[:, k])))
                owner = self._owner(i, j, k)
                if owner is not None:
                    self._follow(b, owner, (i, j), k, float(m[0, k]), float(m[1, k]), now)
                    continue
                sigma = abs(float(z[lag, k]))
                loud = sigma > SUSPICION_SIGMA and abs(m[lag, k]) > 0.5 * self._size[k]
                fresh = fresh or (loud and not early and math.isnan(pair.onset_s[k]))
                if loud and math.isnan(pair.onset_s[k]):
                    width = difference.LAGS[lag] * self._tuning.tick_s
                    pair.onset_s[k] = now - max(width, 2.0 * self._tuning.tick_s)
                alarm = (
                    not early
                    and sigma > self._set.difference_sigma
                    and abs(float(m[lag, k])) > self._size[k]
                )
                latch = pair.latches[k]
                latch.step(round(now * US), alarm, not loud)
                if latch.state is LatchState.FAULTY:
                    alarms.setdefault(pair_key, []).append(k)
                elif latch.state is LatchState.OK:
                    pair.undecided[k] = False
                    if not loud:
                        pair.onset_s[k] = math.nan
        self._mark(b, whole, fresh, now)
        for pair_key, axes in alarms.items():
            out += self._blame(b, whole, pair_key, axes, alarms, reasons, now)
        return out

    def _owner(self, i: int, j: int, k: int) -> int | None:
        """Whichever of two IMUs has a called fault on the axis."""
        for imu in (i, j):
            if self._units[imu].axes[k].latch.state is LatchState.FAULTY:
                return imu
        return None

    def _mark(self, b: bank.Bank, whole: list[int], fresh: bool, now: float) -> None:
        """Suppose the difference of two IMUs, as it goes, to be the fault of either.

        The window of the arbitration starts when a difference begins, not while one is judged.
        """
        pending = any(
            latch.state is LatchState.FAULTY for p in self._pairs.values() for latch in p.latches
        )
        if fresh and not pending:
            bank.mark(b, now)
            self._driven = np.zeros(6)
            self._marked_s = now
        elif not pending and now - self._marked_s > MARK_S:
            self._driven = None
        if self._driven is None or len(whole) != 2:
            return
        i, j = whole
        d = b.pair[i, j, difference.D_MEAN].copy()
        bank.drive(b, i, d - self._driven)
        bank.drive(b, j, self._driven - d)
        self._driven = d

    def _blame(
        self,
        b: bank.Bank,
        whole: list[int],
        key: tuple[int, int],
        axes: list[int],
        alarms: dict[tuple[int, int], list[int]],
        reasons: dict[int, Reason | None],
        now: float,
    ) -> list[Verdict]:
        i, j = key
        pair = self._pairs[key]
        m = b.pair[i, j, difference.D_MEAN : difference.D_MEAN + 3]
        z = b.pair[i, j, difference.D_Z : difference.D_Z + 3]
        size = np.zeros(6)
        for k in axes:
            size[k] = m[int(np.argmax(np.abs(z[:, k]))), k]
        out: list[Verdict] = []
        left = []
        for k in axes:
            guilty = self._vote(whole, key, k, alarms)
            if guilty is None:
                left.append(k)
                continue
            sign = 1.0 if guilty == i else -1.0
            out += self._call(
                b,
                guilty,
                [k],
                sign * size,
                now,
                pair,
                abs(float(np.abs(z[:, k]).max())),
                self._set.difference_sigma,
                vote=True,
                other=-1,
            )
        if not left or len(whole) > 2:
            return out
        f = np.zeros(6)
        f[left] = size[left]
        score = 0.0
        if reasons.get(i) is None and reasons.get(j) is None and self._driven is not None:
            score = self._score(b, i, j, left)
        limit = self._set.arbitration_nats
        if abs(score) > limit and (np.abs(f[left]) > self._size[left]).all():
            guilty, other = (i, j) if score > 0 else (j, i)
            sign = 1.0 if guilty == i else -1.0
            out += self._call(
                b, guilty, left, sign * f, now, pair, abs(score), limit, vote=False, other=other
            )
        else:
            for k in left:
                since = pair.latches[k].since_us or 0
                wait = (self._set.undecided_s + self._set.confirm_s) * US
                pair.undecided[k] = round(now * US) - since > wait
        return out

    def _vote(
        self,
        whole: list[int],
        key: tuple[int, int],
        k: int,
        alarms: dict[tuple[int, int], list[int]],
    ) -> int | None:
        """The IMU that differs from all others while those agree."""
        if len(whole) < 3:
            return None
        for suspect in key:
            rest = [i for i in whole if i != suspect]
            alone = all(k in alarms.get((min(suspect, o), max(suspect, o)), []) for o in rest)
            agree = all(k not in alarms.get((a, c), []) for a in rest for c in rest if a < c)
            if alone and agree:
                return suspect
        return None

    def _score(self, b: bank.Bank, i: int, j: int, axes: list[int]) -> float:
        """Log likelihood of "their difference is the fault of i" against "of j"."""
        whose = np.zeros(6)
        whose[axes] = 1.0
        modes = (INS, ATT) if self._set.attitude_independent else (INS,)
        best = 0.0
        for mode in modes:
            score = 0.0
            for imu, sign in ((i, 1.0), (j, -1.0)):
                c = 2 * imu + mode
                if math.isnan(b.start_s[c, -1]):
                    return 0.0
                nis = min(b.start_nis[2 * i + mode, -1], b.start_nis[2 * j + mode, -1])
                score += sign * log_likelihood(b.L[c, -1], b.Y[c, -1], whose, nis)
            if abs(score) > abs(best):
                best = score
        return best

    def _call(
        self,
        b: bank.Bank,
        imu: int,
        axes: list[int],
        f: Array,
        now: float,
        pair: Pair,
        statistic: float,
        threshold: float,
        *,
        vote: bool,
        other: int,
    ) -> list[Verdict]:
        out = []
        baro = now - b.ref[bank.R_T_BARO] < REFERENCE_GAP_S
        onset_s = now
        for k in axes:
            axis = self._units[imu].axes[k]
            since = pair.latches[k].since_us or round(now * US)
            onset_s = pair.onset_s[k]
            if math.isnan(onset_s):
                onset_s = since / US
            axis.latch.force(round(now * US), round(onset_s * US))
            axis.test = "difference"
            axis.base = float(b.x[2 * imu, F_ACC + k])
            kind = self._kind(b, imu, k, now - onset_s)
            held_s = now - onset_s
            text = (
                words.vote_sentence(imu, k, f[k], kind, held_s)
                if vote
                else words.pair_sentence(
                    imu,
                    other,
                    k,
                    f[k],
                    kind,
                    held_s,
                    attitude=self._set.attitude_independent,
                    baro=baro,
                )
            )
            out.append(
                self._fault(
                    now,
                    imu,
                    k,
                    kind,
                    onset_s,
                    f[k],
                    statistic,
                    threshold,
                    text,
                    "estimators.ins_bank",
                )
            )
            for (p, q), each in self._pairs.items():
                if imu in (p, q):
                    b.pair[p, q, difference.D_HOLD, k] = 1.0
                    each.latches[k].reset()
                    each.undecided[k] = False
                    each.onset_s[k] = math.nan
        self._take(b, imu, axes, f, onset_s, now)
        return out

    def _kind(self, b: bank.Bank, imu: int, k: int, age_s: float) -> Kind:
        """Shape of a difference over its last three seconds."""
        for i, j in self._pairs:
            if imu in (i, j) and b.pair[i, j, difference.D_COUNT, 0] >= 15:
                s = b.pair[i, j]
                ring = s[difference.D_RING : difference.D_RING + 15, k] - s[difference.D_BASE, k]
                clear = self._size[k] + 3.0 * math.sqrt(float(s[difference.D_VAR, k]))
                if ring.max() > clear and ring.min() < -clear:
                    return Kind.OSCILLATION
                fast = abs(float(s[difference.D_MEAN + 1, k]))
                slow = abs(float(s[difference.D_MEAN + 2, k]))
                return Kind.DRIFT if age_s > 3.0 and fast > 1.15 * slow else Kind.BIAS
        return Kind.BIAS

    def _take(
        self, b: bank.Bank, imu: int, axes: list[int], f: Array, onset_s: float, now: float
    ) -> None:
        """Fold a called fault into both filters of its IMU."""
        chosen = np.zeros(6)
        chosen[axes] = 1.0
        for mode in (INS, ATT):
            c = 2 * imu + mode
            if math.isnan(b.aligned_s[c]):
                b.x[c, F_ACC : F_ACC + 6] += chosen * f
                continue
            before = np.where(b.start_s[c, :-1] <= onset_s, b.start_s[c, :-1], -math.inf)
            w = int(np.argmax(before)) if before.max() > -math.inf else 0
            bank.accept(b, c, w, chosen, f, TRACK_STD, now)
            for k in axes:
                b.qf[c, k] = RAISED_DENSITY[k] ** 2

    def _follow(
        self,
        b: bank.Bank,
        owner: int,
        key: tuple[int, int],
        k: int,
        fast: float,
        slow: float,
        now: float,
    ) -> None:
        """Keep a faulty IMU's filters at what the other IMU says; clear when they agree again."""
        axis = self._units[owner].axes[k]
        if axis.test != "difference":
            return
        other = key[1] if owner == key[0] else key[0]
        if self._units[other].axes[k].latch.state is LatchState.FAULTY:
            return
        sign = 1.0 if owner == key[0] else -1.0
        for mode in (INS, ATT):
            c = 2 * owner + mode
            if not math.isnan(b.aligned_s[c]):
                bank.observe_fault(b, c, k, axis.base + sign * fast, float(TRACK_STD[k]))
        worst = max(abs(fast), abs(slow))
        axis.latch.step(round(now * US), worst > self._size[k], worst < 0.7 * self._size[k])
        if axis.latch.state is LatchState.OK:
            self._release(b, owner, k)

    def _release(self, b: bank.Bank, imu: int, k: int) -> None:
        self._units[imu].axes[k].test = ""
        for mode in (INS, ATT):
            b.qf[2 * imu + mode, k] = self._tuning.fault_density[k] ** 2
        for i, j in self._pairs:
            if imu in (i, j):
                b.pair[i, j, difference.D_HOLD, k] = 0.0

    def _shared(self, b: bank.Bank, whole: list[int], now: float) -> None:
        """All IMUs contradict the reference in the same way while they agree with each other."""
        latches = [latch for p in self._pairs.values() for latch in p.latches]
        if any(latch.state is not LatchState.OK for latch in latches):
            return
        if any(a.latch.state is LatchState.FAULTY for i in whole for a in self._units[i].axes):
            return
        limit = np.full(6, self._set.single_sigma)
        alarmed = (self._alarm(b, 2 * i + m, limit, now) for i in whole for m in (INS, ATT))
        if all(a is not None for a in alarmed):
            self._contradicted_s = now

    # -- 3: a lone IMU -----------------------------------------------------------------------------

    def _alarm(self, b: bank.Bank, c: int, limit: Array, now: float) -> Found | None:
        """The loudest single-axis fault of a filter, over all windows: all possible onsets."""
        if math.isnan(b.aligned_s[c]):
            return None
        f, z = single_axis(b.L[c, :-1], b.Y[c, :-1], b.start_nis[c, :-1])
        rms = np.sqrt(b.diff2[c // 2])
        shaken = np.repeat([math.hypot(*rms[:3]), math.hypot(*rms[3:])], 3)
        size = np.maximum(self._size, RECTIFIED * shaken)
        loud = np.where(np.abs(f) > size, np.abs(z) / limit, 0.0)
        loud[now - b.start_s[c, :-1] < YOUNG_S] = 0.0
        by_axis = loud.max(axis=0)
        order = np.argsort(-by_axis)
        k, rival = int(order[0]), int(order[1])
        w = int(np.argmax(loud[:, k]))
        if loud[w, k] <= 1.0:
            return None
        second = float(np.abs(z[:, rival]).max())
        margin = 0.5 * float(z[w, k] ** 2 - second**2)
        return Found(w, k, float(f[w, k]), float(z[w, k]), rival, margin)

    def _lone(self, b: bank.Bank, imu: int, now: float) -> list[Verdict]:
        unit = self._units[imu]
        self._settle(b, imu, now)
        limit = np.full(6, self._set.single_sigma)
        called = [a.latch.state is LatchState.FAULTY for a in unit.axes]
        if any(called):
            limit *= np.where(called, SAME_FAULT, SECOND_FAULT)
        mode, found = INS, self._alarm(b, 2 * imu + INS, limit, now)
        by_attitude = self._alarm(b, 2 * imu + ATT, limit, now)
        if by_attitude is not None and self._set.attitude_independent:
            mode, found = ATT, by_attitude
        t_us = round(now * US)
        named = None if found is None else found.axis
        if found is None:
            unit.since_s = math.nan
        elif math.isnan(unit.since_s):
            unit.since_s = now
        rival: int | None = None
        if found is not None and found.margin < MARGIN_NATS:
            rival = found.rival
            if now - unit.since_s < MARGIN_WAIT_S:
                return []
        for k, axis in enumerate(unit.axes):
            if k != named and axis.latch.state is not LatchState.FAULTY:
                axis.latch.step(t_us, False, True)
        if found is None or named is None:
            return []
        axis = unit.axes[named]
        if axis.latch.state is LatchState.FAULTY:
            self._fold(b, imu, mode, found, now)
            return []
        if axis.latch.step(t_us, True, False) is not LatchState.FAULTY:
            return []
        return self._call_lone(b, imu, mode, found, rival, now)

    def _call_lone(
        self,
        b: bank.Bank,
        imu: int,
        mode: int,
        found: Found,
        rival: int | None,
        now: float,
    ) -> list[Verdict]:
        w, k, size, z = found.window, found.axis, found.fault, found.z
        axis = self._units[imu].axes[k]
        axis.test = "lone"
        axis.base = float(b.x[2 * imu, F_ACC + k])
        onset_s = min(float(b.start_s[2 * imu + mode, w]), (axis.latch.since_us or 0) / US)
        text = words.lone_sentence(
            imu,
            k,
            size,
            now - onset_s,
            rival,
            attitude=mode == ATT,
            baro=now - b.ref[bank.R_T_BARO] < REFERENCE_GAP_S,
        )
        verdict = self._fault(
            now,
            imu,
            k,
            Kind.BIAS,
            onset_s,
            size,
            abs(z),
            self._set.single_sigma,
            text,
            "estimators.ins_bank",
        )
        self._fold(b, imu, mode, found, now)
        return [verdict]

    def _fold(self, b: bank.Bank, imu: int, mode: int, found: Found, now: float) -> None:
        w, k = found.window, found.axis
        chosen = np.zeros(6)
        chosen[k] = 1.0
        for m in (INS, ATT):
            c = 2 * imu + m
            if not math.isnan(b.aligned_s[c]) and b.L[c, w, k, k] > 0.0:
                bank.accept(b, c, w, chosen, np.zeros(6), np.full(6, np.inf), now)
                b.qf[c, k] = RAISED_DENSITY[k] ** 2

    def _settle(self, b: bank.Bank, imu: int, now: float) -> None:
        """Clear a lone IMU's fault once its own filter says that it is gone."""
        for k, axis in enumerate(self._units[imu].axes):
            if axis.test != "lone" or axis.latch.state is not LatchState.FAULTY:
                continue
            mode = ATT if self._set.attitude_independent else INS
            c = 2 * imu + mode
            gone = abs(float(b.x[c, F_ACC + k]) - axis.base)
            std = math.sqrt(float(b.P[c, F_ACC + k, F_ACC + k]))
            axis.latch.step(round(now * US), gone > self._size[k], gone + std < 0.9 * self._size[k])
            if axis.latch.state is LatchState.OK:
                self._release(b, imu, k)

    # -- what is said ------------------------------------------------------------------------------

    def _fault(
        self,
        now: float,
        imu: int,
        k: int,
        kind: Kind,
        onset_s: float,
        size: float,
        statistic: float,
        threshold: float,
        evidence: str,
        estimator: str,
    ) -> Verdict:
        self._units[imu].axes[k].said = (State.FAULTY, None)
        return Verdict(
            t_us=round(now * US),
            sensor=words.axis_name(imu, k),
            state=State.FAULTY,
            kind=kind,
            onset_t_us=min(round(onset_s * US), round(now * US)),
            magnitude=float(size),
            unit=words.unit_of(k),
            statistic=float(statistic),
            threshold=float(threshold),
            estimator=estimator,
            evidence=evidence,
        )

    def _states(self, reasons: dict[int, Reason | None], now: float) -> Iterator[Verdict]:
        """Changes of state that are no new faults."""
        for i, reason in reasons.items():
            for k, axis in enumerate(self._units[i].axes):
                if axis.latch.state is LatchState.FAULTY:
                    continue
                said, evidence = self._standing(i, k, reason)
                if said != axis.said:
                    axis.said = said
                    yield Verdict(
                        round(now * US), words.axis_name(i, k), said[0], said[1], evidence=evidence
                    )

    def _standing(
        self, i: int, k: int, reason: Reason | None
    ) -> tuple[tuple[State, Reason | None], str]:
        if reason is Reason.ON_GROUND:
            return (State.UNMONITORED, reason), ""
        for (p, q), pair in self._pairs.items():
            if i in (p, q) and pair.undecided[k]:
                text = f"imu{p} and imu{q} disagree on {words.axis_name(i, k).split('.')[1]}"
                return (State.UNMONITORED, Reason.SENSORS_DISAGREE), text
        if reason is not None:
            return (State.UNMONITORED, reason), ""
        return (State.OK, None), ""
