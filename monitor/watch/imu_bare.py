"""What needs no reference: an IMU that reads zero, a value that stands still, a noisy axis."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from estimators import imu_difference as difference
from estimators.detection import LatchState
from links.vocabulary import Kind
from monitor.verdict import Verdict
from monitor.watch import imu_words as words
from monitor.watch.imu_record import Array, Record

__all__ = ["BareTests"]

ESTIMATOR = "estimators.imu_difference"
CALM = 0.5
"""Share of the limit, as a logarithm, below which an axis' noise is its usual one."""
_RETURNS = (Kind.DROPOUT, Kind.STUCK)
SIXTH = 1.0 / 6.0
"""Mean square second difference of white noise is six times its variance."""


class BareTests:
    """Tests of each IMU's samples alone, or against how its peers' noise has changed."""

    def __init__(self, record: Record) -> None:
        self._record = record

    def step(self, live: list[int]) -> Iterator[Verdict]:
        """Judge the live IMUs; yields new faults."""
        r = self._record
        noise = r.bank.noise
        known = [i for i in live if noise[i, difference.N_SEEN, 0] >= difference.KNOWN_SAMPLES]
        peers = np.zeros(len(r.units))
        peers[known] = 1.0
        limit = math.log(r.settings.noise_ratio)
        for i in known:
            rises = [difference.noise_rise(noise, i, k) for k in range(6)]
            zero_s = float(r.bank.sample[i, 0] - noise[i, difference.N_ZERO_S, 0])
            still = noise[i, difference.N_SAME].max() >= difference.REST_SAMPLES
            for k, axis in enumerate(r.units[i].axes):
                rest = difference.improbable_rest(noise, i, k, r.now_s) if still else 0.0
                if axis.faulty and axis.test in _RETURNS:
                    r.hold(i, k, zero_s / difference.ZERO_S if axis.test == Kind.DROPOUT else rest)
                if zero_s > difference.ZERO_S:
                    yield from self._dead(i, k, Kind.DROPOUT, zero_s, zero_s)
                elif rest > 1.0:
                    held_s = r.now_s - float(noise[i, difference.N_SAME_S, k])
                    yield from self._dead(i, k, Kind.STUCK, rest, held_s)
                elif axis.test in (Kind.DROPOUT, Kind.STUCK):
                    if axis.latch.step(r.t_us, False, True) is LatchState.OK:
                        r.release(i, k)
                elif rises[k] > CALM * limit or axis.test == Kind.NOISE:
                    yield from self._noise(i, k, peers, limit)

    def _noise(self, i: int, k: int, peers: Array, limit: float) -> Iterator[Verdict]:
        """An axis is noisy when neither its peers nor the other IMUs' same axis are."""
        r = self._record
        axis = r.units[i].axes[k]
        if axis.faulty and axis.test != Kind.NOISE:
            return
        excess = difference.noise_excess(r.bank.noise, i, k, peers)
        if axis.faulty:
            r.hold(i, k, max(excess, 0.0) / (CALM * limit))
        others = [j for j in range(len(r.units)) if j != i and peers[j] > 0.0]
        before = axis.faulty
        axis.test = Kind.NOISE
        state = axis.latch.step(r.t_us, excess > limit, excess < CALM * limit)
        if state is LatchState.OK:
            axis.test = ""
        elif axis.faulty and not before:
            rms = math.sqrt(SIXTH * float(r.bank.noise[i, difference.N_DIFF2, k]))
            text = words.noise_sentence(i, k, math.exp(excess), others[0] if others else None)
            onset_s = r.now_s - difference.NOISE_S
            yield r.fault(i, k, Kind.NOISE, onset_s, rms, (excess, limit), ESTIMATOR, text)

    def _dead(self, i: int, k: int, kind: Kind, z: float, held_s: float) -> Iterator[Verdict]:
        r = self._record
        axis = r.units[i].axes[k]
        if axis.faulty:
            if axis.test == kind:
                axis.latch.step(r.t_us, True, False)
            return
        axis.test = kind
        onset_s = r.now_s - held_s
        axis.latch.force(r.t_us, round(onset_s * 1e6))
        if kind is Kind.DROPOUT:
            text, limit = words.dropout_sentence(i, held_s), difference.ZERO_S
        else:
            text = words.stuck_sentence(i, k, float(r.bank.sample[i, 1 + k]), held_s)
            limit = 1.0
        yield r.fault(i, k, kind, onset_s, math.nan, (z, limit), ESTIMATOR, text)
