"""Tests that need no aircraft model: differences between IMUs, noise, values that stand still.

IMUs are compared by their *mean over equal intervals* of a common time grid, each mean taken from
its own samples by trapezoids that end exactly at the grid's edges: no pairing of samples by index,
any two rates, no sensitivity to jitter.

=========  ==============================================================  ======  ==========
symbol     meaning                                                         shape   unit
=========  ==============================================================  ======  ==========
d          difference of two IMUs' means over one interval                 (6,)    SI
b          its baseline over the last minute (turn-on biases)              (6,)    SI
v          variance of d from interval to interval, half the mean square   (6,)    SI^2
           of its first difference
m_n        mean of d - b over the last n intervals; n = 3: their median    (6,)    SI
e          scatter of d about now: median of the last second differences,  (6,)    SI
           as a standard deviation
s_n        standard deviation of m_n, ``sqrt(max(v, r a, e^2) / n,        (6,)    SI
           M_n) + s_0^2 + (k |u|)^2)``
M_n        mean square of m_n over the last minute                         (6,)    SI^2
a          variance of d if all that the samples alias showed in it        (6,)    SI^2
r          share of a that does show, learnt                               (6,)    1
z_n        ``m_n / s_n``                                                   (6,)    1
k |u|      misalignment and scale: grows with what the manoeuvre demands   scalar  SI
h          mean square second difference of an IMU's samples over 2 s      (6,)    SI^2
=========  ==============================================================  ======  ==========

Three lags see an abrupt fault at once and a small one later. The threshold grows with the noise of
the differences themselves, so that turbulence that the samples alias does not look like a fault:
a single wild interval moves neither a median of three nor the median scatter, a burst of them moves
the scatter, and a step, however large, moves it not.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "EDGES",
    "LAGS",
    "PAIR_ROWS",
    "close_bins",
    "fill_bins",
    "improbable_rest",
    "noise_excess",
    "noise_rise",
    "odd_noise",
    "resume_noise",
    "watch_noise",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

EDGES = 16
"""Edges of the grid kept per IMU."""

LAGS = (3, 5, 15)
"""Intervals over which differences are averaged; of the first, the median is taken."""
MEDIAN_VARIANCE = 1.35
"""Variance of the median of three over that of their mean."""
SCATTER_BINS = 9
"""Intervals whose second differences tell the scatter about now, at least."""
SCATTER_SIGMA = 1.652
"""Median size of a second difference of white noise, in its standard deviations."""

D_BASE, D_VAR, D_LAST, D_COUNT, D_PEAK, D_HOLD = 0, 1, 2, 3, 4, 5
D_Z, D_MEAN, D_MS, D_ALIAS, D_RING, D_BEFORE = 6, 9, 12, 15, 16, 31
PAIR_ROWS = D_BEFORE + 4
"""Rows of a pair's state: b, v, last d, intervals seen, recent magnitude of the signal (acc in
column 0, gyro in 3), hold flags (1: the baseline stands still on that axis, a fault is called),
z per lag (3), m per lag (3), mean square of m per lag (3), mean of a, the last 15 d, the largest z
and the size of it at the last two intervals (what has held for three counts as a peak)."""

BASELINE_S = 60.0
VARIANCE_S = 20.0
PEAK_S = 2.0
QUIET_SIGMA = 2.5
SLOWER = 0.1
"""The baseline learns ten times slower beyond 2.5 sigma (deployed form's figures)."""

CALIBRATION = 0.01
"""Misalignment and scale mismatch between two IMUs, as a fraction of the signal."""

FLOOR_ACC_M_S2 = 0.02
FLOOR_GYRO_RAD_S = 0.001
"""Wander of the difference that is no noise: the resolution of RAW_IMU is 1 mg and 1 mrad/s."""

BURST = 1.5
"""A burst of aliasing may show by this much more in the differences than the last minute's did."""

ALIAS = 0.3
"""Share of the rms first difference that does not cancel between two IMUs sampled apart."""

STANDARD_GRAVITY = 9.80665

N_DIFF2, N_LOG_BASE, N_SLOPE, N_SAME_S, N_SAME, N_REPEAT, N_ZERO_S, N_SEEN = range(8)
"""Rows of an IMU's noise state: h, its baseline logarithm, last first difference, since when the
value has not moved, for how many samples, learnt share of repeated values, since when all six are
zero (the first such sample: what lies before it may be a hole), samples seen."""

KNOWN_SAMPLES = 200.0
"""Samples in flight before an IMU's usual noise is known."""

ZERO_S = 0.3
LOG_NOISE = 1.5
REST_NATS = 40.0
REST_S = 1.0
REST_SAMPLES = 10.0
LEAST_SHARE = 1e-3
"""All six exactly zero for this long: no data. Rms above e^1.5 of its usual: worth a look. A value
that has not moved although it used to, with odds of e^40, for a second and ten samples: stuck."""

HOLE, LEAST_HOLE_S, USUAL_S = 2.5, 0.05, 5.0
"""Samples further apart than so many times their usual distance, and than this, leave a hole; the
usual distance is averaged over 5 s."""

NOISE_BASELINE_S = 60.0
NOISE_S = 2.0


@kernel
def fill_bins(
    edge: Array,
    edge_at: Ints,
    integral: Array,
    imu: int,
    t0: float,
    t1: float,
    u0: Array,
    u1: Array,
    usual_s: Array,
    tick_s: float,
) -> None:
    """Carry an IMU's running integral to its new sample, noting it at the grid's edges between.

    Parameters
    ----------
    edge : (I, EDGES, 6) float64 [m/s, rad]
    edge_at : (I, EDGES) int64
        Which edge of the grid each slot holds.
    integral : (I, 6) float64 [m/s, rad]
    imu : int
    t0, t1 : float [s]
        Times of the last and of the new sample.
    u0, u1 : (6,) float64 [m/s^2, rad/s]
        Their values.
    usual_s : (I,) float64 [s]
        Usual time between samples; changed in place.
    tick_s : float [s]
        Width of the grid.
    """
    dt = t1 - t0
    usual = usual_s[imu]
    if usual == 0.0:
        usual = dt
    hole = dt > max(HOLE * usual, LEAST_HOLE_S)
    usual_s[imu] = usual + min(1.0, dt / USUAL_S) * (min(dt, 2.0 * usual) - usual)
    k = math.floor(t0 / tick_s) + 1
    if hole:
        # What two IMUs felt between samples that one of them lost is no difference of theirs.
        edge_at[imu, (k - 1) % EDGES] = -1
    while k * tick_s <= t1:
        a = (k * tick_s - t0) / dt
        slot = k % EDGES
        for i in range(6):
            at_edge = u0[i] + a * (u1[i] - u0[i])
            edge[imu, slot, i] = integral[imu, i] + 0.5 * a * dt * (u0[i] + at_edge)
        edge_at[imu, slot] = -1 if hole else k
        k += 1
    for i in range(6):
        integral[imu, i] += 0.5 * dt * (u0[i] + u1[i])


@kernel
def close_bins(
    edge: Array, edge_at: Ints, pair: Array, alias: Array, k: int, tick_s: float
) -> bool:
    """Compare all IMUs over the interval that ends at edge ``k``.

    Parameters
    ----------
    edge, edge_at
        See :func:`fill_bins`.
    pair : (I, I, PAIR_ROWS, 6) float64
        State of the pair (i, j), i < j; changed in place.
    alias : (I, 6) float64 [SI^2]
        Mean square first difference of each IMU's samples times its sampling interval: what its
        mean over an interval may owe to aliasing, times that interval.
    k : int
        The edge that all IMUs have passed.
    tick_s : float [s]

    Returns
    -------
    bool
        Whether any z is beyond 2.5.
    """
    n = edge.shape[0]
    odd = False
    d = np.empty(6)
    var = np.empty(6)
    for i in range(n):
        for j in range(i + 1, n):
            a, b = k % EDGES, (k - 1) % EDGES
            whole = edge_at[i, a] == k and edge_at[j, a] == k
            if not (whole and edge_at[i, b] == k - 1 and edge_at[j, b] == k - 1):
                continue
            acc2, gyro2 = 0.0, 0.0
            for c in range(6):
                mean_i = (edge[i, a, c] - edge[i, b, c]) / tick_s
                mean_j = (edge[j, a, c] - edge[j, b, c]) / tick_s
                d[c] = mean_i - mean_j
                smaller = min(abs(mean_i), abs(mean_j))
                if c < 3:
                    acc2 += smaller * smaller
                else:
                    gyro2 += smaller * smaller
            for c in range(6):
                var[c] = ALIAS**2 * (alias[i, c] + alias[j, c]) / tick_s
            odd = _compare(pair[i, j], d, var, math.sqrt(acc2), math.sqrt(gyro2), tick_s) or odd
    return odd


@kernel
def _median_of_three(s: Array, c: int, count: int) -> float:
    """Median of the last three intervals of an axis; of fewer, the last."""
    a = s[D_RING + count % 15, c]
    if count < 2:
        return float(a)
    b, d = s[D_RING + (count - 1) % 15, c], s[D_RING + (count - 2) % 15, c]
    return float(max(min(a, b), min(max(a, b), d)))


@kernel
def _scatter(s: Array, c: int, count: int, bins: int) -> float:
    """Scatter of an axis over its last intervals: no step and no ramp shows in it."""
    n = min(bins, count + 1) - 2
    if n < 3:
        return 0.0
    bend = np.empty(n)
    for q in range(n):
        newest, middle = s[D_RING + (count - q) % 15, c], s[D_RING + (count - q - 1) % 15, c]
        bend[q] = abs(newest - 2.0 * middle + s[D_RING + (count - q - 2) % 15, c])
    bend.sort()
    return float(0.5 * (bend[(n - 1) // 2] + bend[n // 2]) / SCATTER_SIGMA)


@kernel
def _compare(s: Array, d: Array, var: Array, acc: float, gyro: float, tick_s: float) -> bool:
    """Use one difference of a pair; say whether any statistic is beyond 2.5."""
    count = s[D_COUNT, 0]
    fade = math.exp(-tick_s / PEAK_S)
    s[D_PEAK, 0] = max(abs(acc - STANDARD_GRAVITY), fade * s[D_PEAK, 0])
    s[D_PEAK, 3] = max(gyro, fade * s[D_PEAK, 3])
    beyond = False
    for c in range(6):
        floor = FLOOR_ACC_M_S2 if c < 3 else FLOOR_GYRO_RAD_S
        peak = s[D_PEAK, 0] if c < 3 else s[D_PEAK, 3]
        step = 0.5 * (d[c] - s[D_LAST, c]) ** 2
        if count == 0.0:
            s[D_BASE, c] = d[c]
            s[D_VAR, c] = s[D_ALIAS, c] = var[c] + (5.0 * floor) ** 2
        # How much of the aliasing shows in the differences is learnt; bursts scale with it.
        share = min(1.0, s[D_VAR, c] / s[D_ALIAS, c])
        v_now = max(s[D_VAR, c], BURST * share * var[c])
        if count > 0.0:
            gain = max(1.0 / (count + 5.0), tick_s / VARIANCE_S)
            s[D_VAR, c] += gain * (min(step, 9.0 * (v_now + floor * floor)) - s[D_VAR, c])
            s[D_ALIAS, c] += gain * (var[c] + floor * floor - s[D_ALIAS, c])
        s[D_LAST, c] = d[c]
        s[D_RING + int(count) % 15, c] = d[c]
        worst = 0.0
        for lag in range(3):
            n = min(LAGS[lag], int(count) + 1)
            if lag == 0:
                m = _median_of_three(s, c, int(count)) - s[D_BASE, c]
                share = MEDIAN_VARIANCE / n if n == 3 else 1.0
            else:
                m = 0.0
                for q in range(n):
                    m += s[D_RING + (int(count) - q) % 15, c]
                m = m / n - s[D_BASE, c]
                share = 1.0 / n
            v = max(v_now * share, s[D_MS + lag, c])
            wander = floor * floor + (CALIBRATION * peak) ** 2
            if abs(m) > QUIET_SIGMA * math.sqrt(v + wander):
                v = max(v, share * _scatter(s, c, int(count), max(n, SCATTER_BINS)) ** 2)
            std = math.sqrt(v + wander)
            s[D_MEAN + lag, c] = m
            s[D_Z + lag, c] = m / std
            worst = max(worst, abs(m / std))
            if count > 25.0 and s[D_HOLD, c] == 0.0:
                usual = min(m * m, 9.0 * std * std)
                slow = max(1.0 / count, tick_s / BASELINE_S)
                slow *= SLOWER if abs(m) > QUIET_SIGMA * std else 1.0
                s[D_MS + lag, c] += slow * (usual - s[D_MS + lag, c])
        if s[D_HOLD, c] == 0.0:
            gain = max(1.0 / (count + 1.0), tick_s / BASELINE_S)
            if worst > QUIET_SIGMA and count > 25.0:
                gain *= SLOWER
            s[D_BASE, c] += gain * (d[c] - s[D_BASE, c])
        beyond = beyond or worst > QUIET_SIGMA
    s[D_COUNT, 0] = count + 1.0
    return beyond


@kernel
def watch_noise(
    noise: Array, imu: int, t: float, dt: float, last: Array, u: Array, learn: bool
) -> None:
    """Noise of an IMU's samples, and for how long each value has not moved.

    Parameters
    ----------
    noise : (I, 8, 6) float64
        Changed in place; rows ``N_*``.
    imu : int
    t, dt : float [s]
        Time of the new sample, and since the last.
    last, u : (6,) float64 [m/s^2, rad/s]
        Last and new sample.
    learn : bool
        Whether baselines move: in flight only.
    """
    s = noise[imu]
    seen = s[N_SEEN, 0]
    gain = max(1.0 / (seen + 20.0), min(1.0, dt / NOISE_BASELINE_S))
    zero, began = True, False
    for c in range(6):
        slope = u[c] - last[c]
        bend = slope - s[N_SLOPE, c]
        s[N_SLOPE, c] = slope
        if s[N_DIFF2, c] == 0.0:
            s[N_DIFF2, c] = bend * bend
        s[N_DIFF2, c] += min(1.0, dt / NOISE_S) * (bend * bend - s[N_DIFF2, c])
        same = u[c] == last[c]
        if not same:
            s[N_SAME, c] = 0.0
            s[N_SAME_S, c] = t
        else:
            s[N_SAME, c] += 1.0
        if learn:
            # A rest that is becoming improbable teaches nothing: else a stuck value would excuse
            # itself.
            share = min(max(s[N_REPEAT, c], LEAST_SHARE), 1.0)
            if not same or -s[N_SAME, c] * math.log(share) < 0.5 * REST_NATS:
                s[N_REPEAT, c] += gain * ((1.0 if same else 0.0) - s[N_REPEAT, c])
            level = math.log(max(s[N_DIFF2, c], 1e-12))
            if seen == 0.0:
                s[N_LOG_BASE, c] = level
            loud = seen >= KNOWN_SAMPLES and level - s[N_LOG_BASE, c] > 2.0 * LOG_NOISE
            s[N_LOG_BASE, c] += (SLOWER * gain if loud else gain) * (level - s[N_LOG_BASE, c])
            s[N_SEEN, c] = seen + 1.0
        zero = zero and u[c] == 0.0
        began = began or last[c] != 0.0
    if not zero or began:
        s[N_ZERO_S, 0] = t


@kernel
def resume_noise(noise: Array, imu: int, t: float) -> None:
    """The first sample after a gap [s]: no value stood still, and none was zero, meanwhile."""
    s = noise[imu]
    s[N_ZERO_S, 0] = t
    for c in range(6):
        s[N_SAME, c] = 0.0
        s[N_SAME_S, c] = t


@kernel
def odd_noise(noise: Array, imu: int, now: float) -> bool:
    """Whether an IMU's noise, or a value that stands still, deserves a decision."""
    s = noise[imu]
    if s[N_SEEN, 0] < KNOWN_SAMPLES:
        return False
    odd = now - s[N_ZERO_S, 0] > ZERO_S
    for c in range(6):
        level = math.log(max(s[N_DIFF2, c], 1e-12)) - s[N_LOG_BASE, c]
        odd = odd or level > 2.0 * LOG_NOISE or improbable_rest(noise, imu, c, now) > 1.0
    return bool(odd)


@kernel
def noise_rise(noise: Array, imu: int, axis: int) -> float:
    """Logarithm of an axis' rms second difference over its usual one."""
    s = noise[imu]
    return 0.5 * float(math.log(max(s[N_DIFF2, axis], 1e-12)) - s[N_LOG_BASE, axis])


@kernel
def noise_excess(noise: Array, imu: int, axis: int, known: Array) -> float:
    """By how much more an axis' noise has risen than its peers': logarithm of the ratio.

    Parameters
    ----------
    noise : (I, 8, 6) float64
    imu, axis : int
    known : (I,) float64
        1 for every IMU that works and whose usual noise is known: its same axis is a peer, as are
        the axes of the same three of this IMU.
    """
    own = noise_rise(noise, imu, axis)
    first = 3 * (axis // 3)
    usual = -math.inf
    for c in range(first, first + 3):
        if c != axis:
            usual = max(usual, noise_rise(noise, imu, c))
    others = -math.inf
    for i in range(noise.shape[0]):
        if i != imu and known[i] > 0.0:
            others = max(others, noise_rise(noise, i, axis))
    return own - max(usual, others)


@kernel
def improbable_rest(noise: Array, imu: int, axis: int, now: float) -> float:
    """How improbable it is that a healthy value has not moved for so long; stuck above 1."""
    s = noise[imu]
    if now - s[N_SAME_S, axis] < REST_S or s[N_SAME, axis] < REST_SAMPLES:
        return 0.0
    share = min(max(s[N_REPEAT, axis], LEAST_SHARE), 1.0)
    return float(-s[N_SAME, axis] * math.log(share) / REST_NATS)
