"""What the IMU watch knows of every axis, and how it folds a called fault into the filters."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimators import imu_difference as difference
from estimators import ins_bank as bank
from estimators.detection import Latch, LatchRule, LatchState
from estimators.ins_bank_model import ATT, F_ACC, INS
from links.vocabulary import Kind, Reason, State
from monitor.settings.imu import ImuSettings
from monitor.verdict import Verdict
from monitor.watch import imu_words as words

__all__ = ["US", "Axis", "Pair", "Record", "Unit"]

Array = NDArray[np.float64]
US = 1_000_000

GRACE_S = 0.3
"""A test may fail for one tick without the confirmation starting again."""
JITTER = 0.25
"""Share of a tick that the confirmation forgives."""
BRIEF_S = 1.0
"""A difference that has been quiet for this long is not judged any more. It is confirmed in half
the time: no fix of the receiver takes part in it, and a median has waited already."""
REFERENCE_GAP_S = 1.5
"""A reference older than this is missing: GPS at 1 Hz is the slowest in use."""
SETTLEMENT = 6
"""Column of the ratios that is of the IMU rather than of an axis."""
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
    called
        Size of the fault when it was called by a difference [SI].
    test
        Which test called the fault, hence which one clears it.
    said
        State and reason last published.
    """

    latch: Latch
    base: float = 0.0
    called: float = 0.0
    test: str = ""
    said: tuple[State, Reason | None] | None = None

    @property
    def faulty(self) -> bool:
        """Whether a fault is called on it."""
        return self.latch.state is LatchState.FAULTY


@dataclass(slots=True)
class Unit:
    """One IMU: its axes, whether it ever spoke, since when a lone test of it has been loud."""

    axes: list[Axis]
    seen: bool = False
    loud_s: float = math.nan


@dataclass(slots=True)
class Pair:
    """Two IMUs that are compared: per axis the test, when they began to differ and were said to."""

    latches: list[Latch]
    said_us: list[int | None] = field(default_factory=lambda: [None] * 6)
    onset_s: list[float] = field(default_factory=lambda: [math.nan] * 6)

    def forget(self, k: int) -> None:
        """Start anew on an axis."""
        self.latches[k].reset()
        self.said_us[k] = None
        self.onset_s[k] = math.nan


def _sizes(settings: ImuSettings) -> Array:
    """Physical sizes below which nothing is a fault, (6,) [m/s^2, rad/s]."""
    return np.array([settings.acc_size_m_s2] * 3 + [settings.gyro_size_rad_s] * 3)


def _rules(settings: ImuSettings, tick_s: float) -> tuple[LatchRule, LatchRule]:
    """Times of a fault on an axis, and of a difference between two IMUs."""
    # A tick closes with the first sample after its edge: later now, sooner then.
    jitter_s = JITTER * tick_s
    confirm = round((settings.confirm_s - jitter_s) * US)
    shortly = round((0.5 * settings.confirm_s - jitter_s) * US)
    grace = round(GRACE_S * US)
    return (
        LatchRule(confirm, round(settings.clear_s * US), grace),
        LatchRule(shortly, round(BRIEF_S * US), grace),
    )


class Record:
    """All axes and pairs, and the filters in which called faults are kept.

    Attributes
    ----------
    bank
        The filters, stopped at a tick while a decision is taken.
    size : (6,) float64 [m/s^2, rad/s]
        Nothing smaller is called a fault.
    """

    def __init__(self, settings: ImuSettings, tuning: bank.Tuning, filters: bank.Bank) -> None:
        self.settings = settings
        self.tuning = tuning
        self.bank = filters
        self.size = _sizes(settings)
        rule, brief = _rules(settings, tuning.tick_s)
        n = bank.MAX_IMUS
        self.units = [Unit([Axis(Latch(rule)) for _ in range(6)]) for _ in range(n)]
        self.pairs = {
            (i, j): Pair([Latch(brief) for _ in range(6)])
            for i in range(n)
            for j in range(i + 1, n)
        }

    def retune(self, settings: ImuSettings, tuning: bank.Tuning) -> None:
        """Take new limits, times and noise; what is called, suspected or learnt stays so."""
        healthy = self.bank.qf == self.tuning.fault_density**2
        self.bank.qf[healthy] = np.broadcast_to(tuning.fault_density**2, healthy.shape)[healthy]
        self.settings, self.tuning, self.size = settings, tuning, _sizes(settings)
        rule, brief = _rules(settings, tuning.tick_s)
        for unit in self.units:
            for axis in unit.axes:
                axis.latch.rule = rule
        for pair in self.pairs.values():
            for latch in pair.latches:
                latch.rule = brief

    @property
    def now_s(self) -> float:
        """Vehicle time of the decision [s]."""
        return float(self.bank.clock[bank.C_NOW])

    @property
    def t_us(self) -> int:
        """Vehicle time of the decision [us]."""
        return round(self.now_s * US)

    @property
    def has_baro(self) -> bool:
        """Whether static pressure is among the references now."""
        return bool(self.now_s - self.bank.ref[bank.R_T_BARO] < REFERENCE_GAP_S)

    def filters(self, imu: int) -> Iterator[int]:
        """Filters of an IMU that are aligned."""
        for mode in (INS, ATT):
            if not math.isnan(self.bank.aligned_s[2 * imu + mode]):
                yield 2 * imu + mode

    def pairs_of(self, imu: int) -> Iterator[tuple[tuple[int, int], Pair]]:
        """Pairs with this IMU."""
        return ((key, pair) for key, pair in self.pairs.items() if imu in key)

    def fault(
        self,
        imu: int,
        k: int,
        kind: Kind,
        onset_s: float,
        size: float,
        score: tuple[float, float],
        estimator: str,
        evidence: str,
        detected_us: int | None = None,
    ) -> Verdict:
        """The verdict on a fault that has just been called; ``score`` is statistic, threshold."""
        self.units[imu].axes[k].said = (State.FAULTY, None)
        return Verdict(
            t_us=self.t_us,
            sensor=words.axis_name(imu, k),
            state=State.FAULTY,
            kind=kind,
            onset_t_us=min(round(onset_s * US), detected_us or self.t_us),
            magnitude=float(size),
            unit=words.unit_of(k),
            statistic=float(score[0]),
            threshold=float(score[1]),
            estimator=estimator,
            evidence=evidence,
            detected_t_us=None if detected_us == self.t_us else detected_us,
        )

    def fold(self, c: int, w: int, axes: list[int], prior: Array, prior_std: Array) -> None:
        """Take what window ``w`` of filter ``c`` says of the faults into its state."""
        chosen = np.zeros(6)
        chosen[axes] = 1.0
        bank.accept(self.bank, c, w, chosen, prior, prior_std, self.now_s)
        for k in axes:
            self.bank.qf[c, k] = RAISED_DENSITY[k] ** 2

    def hold(self, imu: int, k: int, ratio: float) -> None:
        """Let a statistic over its threshold count, if it is the largest of its axis this tick."""
        ratios = self.bank.ratios
        if not ratios[imu, k] >= ratio:
            ratios[imu, k] = ratio

    def settle(self, i: int, j: int, ratio: float) -> None:
        """Odds that a dispute is the fault of i over those that decide; of j they are opposite."""
        self.bank.ratios[i, SETTLEMENT], self.bank.ratios[j, SETTLEMENT] = ratio, -ratio

    def mark_called(self) -> None:
        """Tell the filters which axes are called faulty."""
        for unit, called in zip(self.units, self.bank.called, strict=True):
            if unit.seen:
                called[:] = [axis.faulty for axis in unit.axes]

    def release(self, imu: int, k: int) -> None:
        """An axis was re-admitted: its slow bias walks slowly again, baselines learn again."""
        self.units[imu].axes[k].test = ""
        for mode in (INS, ATT):
            self.bank.qf[2 * imu + mode, k] = self.tuning.fault_density[k] ** 2
        for (i, j), _ in self.pairs_of(imu):
            self.bank.pair[i, j, difference.D_HOLD, k] = 0.0

    def land(self) -> None:
        """The flight is over: nothing is faulty, suspected or undecided any more."""
        for unit in self.units:
            unit.loud_s = math.nan
            for k, axis in enumerate(unit.axes):
                axis.latch.reset()
                axis.test = ""
                for pair in self.pairs.values():
                    pair.forget(k)

    def slow_bias(self, imu: int, k: int) -> float:
        """What the filter without the vehicle's attitude believes of an axis now [SI]."""
        return float(self.bank.x[2 * imu, F_ACC + k])
