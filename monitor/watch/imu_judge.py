"""Decides, tick by tick, which axis of which IMU is faulty, and says so when a state changes.

Three kinds of evidence, in this order:

1. what needs no reference (:mod:`~monitor.watch.imu_bare`): an IMU that reads zero, a value that
   stands still, an axis much noisier than its peers;
2. with two or more IMUs, their differences (:mod:`~monitor.watch.imu_pairs`) detect and name the
   axis; a vote (three IMUs) or the inertial filters (two) say whose it is. Until they do, both are
   suspect, *sensors disagree*; after a while without an answer, unmonitored. A contradiction that
   all IMUs share is the reference's fault;
3. a lone IMU (:mod:`~monitor.watch.imu_lone`) is tested by its own filters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from estimators import ins_bank as bank
from links.vocabulary import Kind, Reason, State
from monitor.settings.imu import ImuSettings
from monitor.verdict import Verdict
from monitor.watch import imu_words as words
from monitor.watch.imu_bare import BareTests
from monitor.watch.imu_lone import LoneTest
from monitor.watch.imu_pairs import PairTests
from monitor.watch.imu_record import REFERENCE_GAP_S, US, Record

__all__ = ["Judge"]

LIVE_S = 0.5
"""An IMU silent for longer takes no part in any comparison."""
SPIN_HOLD_S = 3.0
CONTRADICTION_HOLD_S = 5.0
"""How long nothing is judged after the aircraft spun, or the reference contradicted all IMUs."""


class Judge:
    """Turns the state of a filter bank into verdicts.

    :meth:`decide` is called with the bank stopped at a tick. ``busy`` says whether it wants to see
    every tick from here on.
    """

    def __init__(self, settings: ImuSettings, tuning: bank.Tuning, filters: bank.Bank) -> None:
        self._learn_s = settings.learn_s
        self._undecided_us = round(settings.undecided_s * US)
        self._record = Record(settings, tuning, filters)
        self._bare = BareTests(self._record)
        self._pairs = PairTests(self._record)
        self._lone = LoneTest(self._record)
        self._contradicted_s = -math.inf
        self.busy = True

    def retune(self, settings: ImuSettings, tuning: bank.Tuning) -> None:
        """Take new limits, times and noise."""
        self._learn_s = settings.learn_s
        self._undecided_us = round(settings.undecided_s * US)
        self._record.retune(settings, tuning)

    def decide(self) -> list[Verdict]:
        """Judge at the tick at which the bank stands."""
        r = self._record
        b, now = r.bank, r.now_s
        b.clock[bank.C_CHANGED] = 0.0
        for i, unit in enumerate(r.units):
            unit.seen = unit.seen or not math.isnan(b.sample[i, 0])
        found: list[Verdict] = []
        if b.clock[bank.C_FLYING] == 1.0:
            live = [i for i, u in enumerate(r.units) if u.seen and now - b.sample[i, 0] < LIVE_S]
            found += self._bare.step(live)
            whole = [i for i in live if not any(a.test == Kind.DROPOUT for a in r.units[i].axes)]
            trusted = {i for i in whole if self._reason(i) is None}
            found += self._pairs.step(whole, trusted)
            faulty = any(a.faulty for i in whole for a in r.units[i].axes)
            if len(whole) == 1 and trusted:
                found += self._lone.step(whole[0])
            peaceful = len(trusted) == len(whole) > 1 and self._pairs.quiet() and not faulty
            if peaceful and self._lone.shared(whole):
                self._contradicted_s = now
            reasons = {i: self._reason(i) for i in live}
        else:
            r.land()
            self._contradicted_s = -math.inf
            reasons = {i: Reason.ON_GROUND for i, u in enumerate(r.units) if u.seen}
        found += self._changes(reasons)
        b.clock[bank.C_JUDGED] = float(self._judged(reasons))
        if found:  # an axis is called, or free again, with a word
            r.mark_called()
        self.busy = self._pairs.busy or self._unsettled()
        return found

    def _reason(self, imu: int) -> Reason | None:
        """Why an IMU cannot be judged now; None when it can."""
        b, now = self._record.bank, self._record.now_s
        aligned = float(b.aligned_s[2 * imu])
        if now - b.clock[bank.C_SPIN_S] < SPIN_HOLD_S:
            return Reason.MANOEUVRE
        if now < b.clock[bank.C_GPS_BAD_S] or now - self._contradicted_s < CONTRADICTION_HOLD_S:
            return Reason.REFERENCE_NOT_TRUSTED
        fix, attitude = now - b.ref[bank.R_T_GPS], now - b.ref[bank.R_T_ATT]
        if not fix < REFERENCE_GAP_S or (math.isnan(aligned) and not attitude < REFERENCE_GAP_S):
            return Reason.REFERENCE_MISSING
        if math.isnan(aligned) or now - aligned < self._learn_s:
            return Reason.LEARNING
        return None

    def _judged(self, reasons: dict[int, Reason | None]) -> bool:
        """Whether every live IMU is judged and no axis is called faulty."""
        return (
            bool(reasons)
            and all(reason is None for reason in reasons.values())
            and not any(a.faulty for i in reasons for a in self._record.units[i].axes)
        )

    def _unsettled(self) -> bool:
        """Whether an axis is anything but plainly ok, or plainly on the ground."""
        ground = (State.UNMONITORED, Reason.ON_GROUND)
        return any(
            a.said != ground and (a.said != (State.OK, None) or a.latch.since_us is not None)
            for unit in self._record.units
            if unit.seen
            for a in unit.axes
        )

    def _changes(self, reasons: dict[int, Reason | None]) -> Iterator[Verdict]:
        """Changes of state that are no new faults."""
        r = self._record
        for i, reason in reasons.items():
            for k, axis in enumerate(r.units[i].axes):
                if axis.faulty:
                    continue
                said, evidence = self._standing(i, k, reason)
                if said != axis.said:
                    axis.said = said
                    yield Verdict(
                        r.t_us, words.axis_name(i, k), said[0], said[1], evidence=evidence
                    )

    def _standing(
        self, i: int, k: int, reason: Reason | None
    ) -> tuple[tuple[State, Reason | None], str]:
        """State and reason of an axis without a called fault, and the evidence."""
        if reason is not Reason.ON_GROUND:
            for (p, q), pair in self._record.pairs_of(i):
                said_us = pair.said_us[k]
                if said_us is not None:
                    waits = self._record.t_us - said_us < self._undecided_us
                    text = words.disagreement_sentence(p, q, k, undecided=not waits)
                    state = State.SUSPECT if waits else State.UNMONITORED
                    return (state, Reason.SENSORS_DISAGREE), text
        if reason is None:
            return (State.OK, None), ""
        text = words.contradiction_sentence() if reason is Reason.REFERENCE_NOT_TRUSTED else ""
        return (State.UNMONITORED, reason), text
