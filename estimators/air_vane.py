"""One vane beside the pitot bank: its angle against attitude, ground velocity and wind.

A lone vane has no second one to be compared with. But attitude says where the nose points and the
bank how the air comes, so that the angle of attack is known to within the vertical wind. That is
the one other explanation of every difference, and the reason for what is asked before a vane is
blamed: more than an updraft of ``updraft_m_s`` over its onset, against a gust model whose size the
bank gives with each estimate.

==========  =======================================================  =======  ==================
symbol      meaning                                                  shape    unit
==========  =======================================================  =======  ==================
a           angle of attack without vertical wind, from the bank:    1        rad
            atan2(w, u) of R_BI (V - W)
sigma       its standard deviation: vertical wind and gust over      1        rad
            airspeed, slow error of the attitude
r           vane less a                                              1        rad
b, s        offset of the vane, and what its place in the flow       1        rad, 1
            makes of a: it shows ``(1 + s) a + b``
g           what vertical gusts add, first order, time constant tau  1        rad
x, P        state [b, s, g] and its covariance                       (3,),
                                                                     (3, 3)
L           log-likelihood of "b jumped at a past moment" over       (10,)    nat
            "nothing happened"
e           vane less a less b, sample by sample                     1        rad
==========  =======================================================  =======  ==================

    r = b + s a + g + noise,   b' = u_b,   g' = -g / tau + u_g

s is considered, not estimated (Schmidt's filter): it stays zero and its variance counts wherever a
changes. The aircraft answers gusts with its pitch, which moves a against them, and a filter that
learns takes that for s: on synthetic flights -0.7 in place of 0.

The explanations start at past moments whose ages double up to :data:`OLDEST_S`. Beside them run the
checks of a vane that stands still while a moves, that scatters or swings, or that is far off.

Estimates come late by the time that the bank waits for attitudes, so that samples of later moments
may have been pushed before them. Whatever is decided falls at an estimate and looks at samples up
to its moment only, or at the silence of the estimates of :data:`LATEST_S` ago: how a stream is cut
changes nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import held
from estimators.air_tests import short_of
from estimators.air_vane_filter import OFFSET, vane_update
from estimators.jit import kernel

__all__ = [
    "EV_AIR",
    "EV_PHASE",
    "EV_VANE",
    "N_LOG",
    "N_TEST",
    "N_VANES",
    "VaneLimits",
    "Vanes",
    "new_vanes",
    "run",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

EV_VANE, EV_AIR, EV_PHASE = range(3)
N_VANES = 3
N_AGES = 10
YOUNGEST_S = 0.2
OLDEST_S = YOUNGEST_S * 2.0**N_AGES
RING = 1024
BACK_S = 5.0
"""Samples older than this at an estimate are not looked at."""
LATEST_S = 2.0
"""Estimates of so long ago have all come."""
SILENCE_S = 2.5
"""Estimates that fail to come for so long are missing."""
BESIDE_S = 0.1
"""Samples so near to an estimate's moment are its vane reading."""
SILENT_S, GAP_S = 0.5, 2.5
"""A vane that sends less often is silent; a reading repeated after a gap was not held."""
JUMP_S = 0.45
RAGGED = 0.25
"""A jump takes so long at most, since the readings beside an estimate may straddle it, and has this
share of its size left to go on."""
EARLY_S = 3.0
"""A step shows its size by this age, a drift does not."""
LONG = 5.0
"""So many times ``constant_s`` even a vane in still air does not stand to the last bit."""
AGREE_S = 5.0
"""Averaging time of the residual by which a faulty vane recovers."""

UNMONITORED, OK, FAULTY = 0.0, 1.0, 2.0
LEARNING, ON_GROUND, MISSING = 0.0, 1.0, 2.0
SHIFT, CONSTANT, SCATTER, GROSS = 0.0, 1.0, 2.0, 3.0

# Columns of the log.
(
    G_T, G_VANE, G_STATUS, G_REASON, G_CAUSE, G_ONSET, G_STAT, G_LIMIT, G_SHOWN, G_EXPECT,
    G_EARLY, G_ROUGH, G_TAS, G_AGAIN,
) = range(14)  # fmt: skip
N_LOG = 14

# Columns of a row of tests, three vanes each: statistic over threshold, what the vane should show.
(V_T, V_RATIO, V_EXPECT, V_STD) = (0, 1, 4, 7)
N_TEST = 10

# Scalars of one vane.
(
    STATUS, REASON, SINCE, N_USED, SAME, SAME_SINCE, LOW, HIGH, MEAN, VAR, STEP2, LAST_E, T_E,
    HELD_SHIFT, HELD_SCATTER, HELD_GROSS, HELD_AGREE, AGREE, READMITTED, SEEN, CAUSE,
) = range(21)  # fmt: skip
N_SCALARS = 21

# Scalars of all.
FLYING, T_AIR, A_AIR, T_SPAWN, N_AIR = range(5)
_TIMES = 5
N_TIMES = 32
N_MEMORY = _TIMES + N_TIMES


class VaneLimits(NamedTuple):
    """Model and limits; the settings of the same names say what each rests on. SI, rad."""

    offset_prior_rad: float
    scale_prior: float
    offset_walk_rad: float
    shifted_walk_rad: float
    gust_tau_s: float
    noise_rad: float
    timing_s: float
    jump_rad: float
    margin: float
    confirm_s: float
    least_rad: float
    updraft_m_s: float
    learn_s: float
    learnt_rad: float
    constant_s: float
    moved_rad: float
    scatter_rad: float
    scatter_ratio: float
    scatter_s: float
    scatter_hold_s: float
    gross_rad: float
    gross_s: float
    readmit_s: float


class Vanes(NamedTuple):
    """All memory; arrays are changed in place.

    Attributes
    ----------
    ring : (3, 1024, 2) float64 [s, rad]
        Last samples; ``pushed`` and ``used`` (3,) count those that came and that were looked at.
    x, P : (3, 11, 3), (3, 11, 3, 3) float64
        Filters: 0 believes that nothing happened, 1 + k that b jumped at ``born[k]``.
    L, born, ref, early : (3, 10) float64 [nat], [s], [rad], [rad]
        Log-likelihood over filter 0, start, b then, and b some seconds later.
    s : (3, 21) float64
    memory : (37,) float64
    """

    ring: Array
    pushed: Ints
    used: Ints
    x: Array
    P: Array
    L: Array
    born: Array
    ref: Array
    early: Array
    s: Array
    memory: Array


def new_vanes() -> Vanes:
    """Nothing seen, on the ground."""
    z = np.zeros
    v = Vanes(
        z((N_VANES, RING, 2)), z(N_VANES, np.int64), z(N_VANES, np.int64),
        z((N_VANES, 1 + N_AGES, 3)), z((N_VANES, 1 + N_AGES, 3, 3)),
        z((N_VANES, N_AGES)), np.full((N_VANES, N_AGES), np.nan), z((N_VANES, N_AGES)),
        z((N_VANES, N_AGES)), z((N_VANES, N_SCALARS)), z(N_MEMORY),
    )  # fmt: skip
    v.s[:, REASON] = ON_GROUND
    v.memory[[T_AIR, T_SPAWN]] = -np.inf
    v.memory[_TIMES:] = -np.inf
    return v


@kernel
def _copy(v: Vanes, i: int, k_from: int, k_to: int) -> None:
    for a in range(3):
        v.x[i, k_to, a] = v.x[i, k_from, a]
        for b in range(3):
            v.P[i, k_to, a, b] = v.P[i, k_from, a, b]


@kernel
def _forget_shifts(v: Vanes, i: int) -> None:
    for k in range(N_AGES):
        v.born[i, k] = np.nan
        v.L[i, k] = -np.inf


@kernel
def _begin(v: Vanes, p: VaneLimits, i: int, sigma: float) -> None:
    """Forget what was learnt: priors."""
    for a in range(3):
        v.x[i, 0, a] = 0.0
        for b in range(3):
            v.P[i, 0, a, b] = 0.0
    v.P[i, 0, 0, 0] = p.offset_prior_rad**2
    v.P[i, 0, 1, 1] = p.scale_prior**2
    v.P[i, 0, 2, 2] = sigma * sigma
    v.s[i, N_USED] = 0.0


@kernel
def _spawn(v: Vanes, p: VaneLimits, i: int, t: float) -> None:
    """Start "b jumps now"; an older start moves on as its age doubles, where it meets a worse one.

    One starts with every estimate: of a step, only what starts between the two readings that it
    parts explains it at once, and of two that meet the better one stays.
    """
    for k in range(N_AGES - 1, -1, -1):
        if np.isnan(v.born[i, k]) or t - v.born[i, k] < YOUNGEST_S * 2.0**k:
            continue
        j = k + 1
        if j < N_AGES and not (v.born[i, j] <= t and v.L[i, j] > v.L[i, k]):
            _copy(v, i, 1 + k, 1 + j)
            v.L[i, j], v.born[i, j] = v.L[i, k], v.born[i, k]
            v.ref[i, j], v.early[i, j] = v.ref[i, k], v.early[i, k]
        v.born[i, k] = np.nan
    _copy(v, i, 0, 1)
    v.P[i, 1, OFFSET, OFFSET] += p.jump_rad**2
    v.L[i, 0], v.born[i, 0] = 0.0, t
    v.ref[i, 0] = v.early[i, 0] = v.x[i, 0, OFFSET]


@kernel
def _samples(v: Vanes, p: VaneLimits, i: int, t: float, a: float) -> float:
    """Look at the samples up to an estimate at t; return the mean of those beside it, or NaN."""
    s, x, memory = v.s[i], v.x[i, 0], v.memory
    t0, a0 = memory[T_AIR], memory[A_AIR]
    slope = (a - a0) / (t - t0) if t - t0 < 1.0 else 0.0
    first = max(v.used[i], v.pushed[i] - RING)
    for k in range(first, v.pushed[i]):
        row = v.ring[i, k % RING]
        if row[0] > t:
            break
        v.used[i] = k + 1
        if row[0] < t - BACK_S:
            continue
        here = a + slope * (row[0] - t)
        if row[1] != s[SAME] or row[0] - s[T_E] > GAP_S:
            s[SAME], s[SAME_SINCE] = row[1], row[0]
            s[LOW] = s[HIGH] = here
        s[LOW], s[HIGH] = min(s[LOW], here), max(s[HIGH], here)
        e = row[1] - here - x[0]
        dt = min(max(row[0] - s[T_E], 0.0), 0.5)
        weight = min(dt / p.scatter_s, 1.0)
        if not np.isnan(s[LAST_E]) and t - t0 < 1.0:
            s[MEAN] += weight * (e - s[MEAN])
            s[VAR] += weight * ((e - s[MEAN]) ** 2 - s[VAR])
            s[STEP2] += weight * ((e - s[LAST_E]) ** 2 - s[STEP2])
        else:
            s[MEAN], s[VAR], s[STEP2] = e, 0.0, 0.0
        s[LAST_E], s[T_E] = e, row[0]
    total, n = 0.0, 0
    for back in range(1, min(v.pushed[i], RING) + 1):
        row = v.ring[i, (v.pushed[i] - back) % RING]
        if row[0] < t - BESIDE_S:
            break
        if row[0] <= t + BESIDE_S:
            total += row[1]
            n += 1
    return total / n if n > 0 else math.nan


@kernel
def _say(v: Vanes, log: Array, row: int, t: float, i: int, status: float, reason: float) -> int:
    """Log a change of state; returns the next row."""
    s = v.s[i]
    if s[STATUS] == status and (status != UNMONITORED or s[REASON] == reason) and s[SEEN] > 1.5:
        return row
    g = log[row]
    for k in range(N_LOG):
        g[k] = np.nan
    g[G_T], g[G_VANE], g[G_STATUS], g[G_REASON] = t, i, status, reason
    g[G_AGAIN] = 1.0 if s[STATUS] == FAULTY else 0.0
    s[STATUS], s[REASON], s[SEEN] = status, reason, 2.0
    return row + 1


@kernel
def _blame(
    v: Vanes, log: Array, row: int, t: float, i: int, cause: float, onset: float, stat: float,
    limit: float, shown: float, expect: float, early: float, tas: float,
) -> int:  # fmt: skip
    """Log that a vane is faulty; returns the next row."""
    s = v.s[i]
    rough = s[STEP2] / s[VAR] if s[VAR] > 0.0 else 0.0
    row = _say(v, log, row, t, i, FAULTY, LEARNING)
    g = log[row - 1]
    g[G_CAUSE], g[G_ONSET], g[G_STAT], g[G_LIMIT] = cause, onset, stat, limit
    g[G_SHOWN], g[G_EXPECT], g[G_EARLY] = shown, expect, early
    g[G_ROUGH], g[G_TAS] = rough, tas
    s[CAUSE] = cause
    s[HELD_AGREE] = np.nan
    s[AGREE] = shown - expect
    return row


@kernel
def _estimate(
    v: Vanes, p: VaneLimits, t: float, a: float, sigma: float, tas: float, log: Array, row: int,
    i: int, test: Array,
) -> int:  # fmt: skip
    """Judge one vane at an estimate of the bank; returns the next log row.

    ``test`` (10,) receives how near it came to a verdict, or while it is faulty how far it is from
    agreement: the largest statistic over its threshold.
    """
    s, memory = v.s[i], v.memory
    m = _samples(v, p, i, t, a)
    if math.isnan(m) or s[SEEN] == 0.0:
        return row
    if math.isnan(s[SINCE]):
        if s[REASON] != MISSING:
            _begin(v, p, i, sigma)
        s[SINCE], s[LAST_E] = t, np.nan
        s[N_USED] = min(s[N_USED], p.learn_s - AGREE_S)
        _forget_shifts(v, i)
        s[HELD_SHIFT] = s[HELD_SCATTER] = s[HELD_GROSS] = np.nan
        row = _say(v, log, row, t, i, UNMONITORED, LEARNING)
    dt = min(max(t - memory[T_AIR], 0.01), 2.0)
    phi = math.exp(-dt / p.gust_tau_s)
    rate = (a - memory[A_AIR]) / dt
    R = p.noise_rad**2 + (p.timing_s * rate) ** 2
    r = m - a
    x = v.x[i, 0]
    expect = a + x[0]
    still_s = min(t, s[T_E] + SILENT_S) - s[SAME_SINCE]
    moved = s[HIGH] - s[LOW]
    least = max(p.least_rad, math.atan(p.updraft_m_s / max(tas, 5.0)))
    scatter_limit = max(p.scatter_rad, p.scatter_ratio * sigma)
    # What changes from sample to sample no gust explains: half as much of it is enough.
    scatter = max(math.sqrt(s[VAR]), 2.0 * math.sqrt(0.5 * s[STEP2]))
    still_limit = p.constant_s if moved > p.moved_rad else LONG * p.constant_s
    stands = still_s > still_limit
    scatters = scatter > scatter_limit
    P = v.P[i, 0]
    if s[N_USED] >= p.learn_s:
        var = P[0, 0] + 2.0 * a * P[0, 1] + a * a * P[1, 1] + sigma * sigma
        test[V_EXPECT + i], test[V_STD + i] = expect, math.sqrt(max(var, 0.0))
    if s[STATUS] == FAULTY:
        s[AGREE] += min(dt / AGREE_S, 1.0) * (m - expect - s[AGREE])
        test[V_RATIO + i] = max(abs(s[AGREE]) / (0.5 * least), scatter / (0.5 * scatter_limit),
                                still_s)  # fmt: skip
        well = abs(s[AGREE]) < 0.5 * least and scatter < 0.5 * scatter_limit and still_s < 1.0
        wait_s = p.readmit_s * 2.0 ** min(s[READMITTED], 6.0)
        if held(s, HELD_AGREE, well, t) >= wait_s:
            s[READMITTED] += 1.0
            v.P[i, 0, 2, 2] = sigma * sigma
            v.P[i, 0, 0, 0] += (0.25 * least) ** 2
            _forget_shifts(v, i)
            s[HELD_SHIFT] = s[HELD_SCATTER] = s[HELD_GROSS] = np.nan
            row = _say(v, log, row, t, i, OK, LEARNING)
        return row
    far = held(s, HELD_GROSS, abs(r - x[0]) > p.gross_rad + 3.0 * sigma, t)
    ragged = held(s, HELD_SCATTER, scatters, t)
    ratio = max(still_s / still_limit, abs(r - x[0]) / (p.gross_rad + 3.0 * sigma))
    if s[STATUS] == OK:
        ratio = max(ratio, scatter / scatter_limit)
    test[V_RATIO + i] = ratio
    if stands:
        return _blame(v, log, row, t, i, CONSTANT, s[SAME_SINCE], still_s, p.constant_s, m, expect,
                      m - expect, tas)  # fmt: skip
    if far > p.gross_s:
        return _blame(v, log, row, t, i, GROSS, s[HELD_GROSS], abs(r - x[0]), p.gross_rad, m,
                      expect, m - expect, tas)  # fmt: skip
    if s[STATUS] == OK and ragged > p.scatter_hold_s:
        return _blame(v, log, row, t, i, SCATTER, s[HELD_SCATTER], scatter, scatter_limit, m,
                      expect, m - expect, tas)  # fmt: skip
    if not np.isnan(s[HELD_GROSS]) or scatters:
        return row  # the checks look at it; the filters would learn from it
    q_g = sigma * sigma * (1.0 - phi * phi)
    null = vane_update(x, v.P[i, 0], a, r, R, phi, p.offset_walk_rad**2 * dt, q_g)
    s[N_USED] += dt
    best, shift = -1, 0.0
    for k in range(N_AGES):
        if np.isnan(v.born[i, k]):
            continue
        y = v.x[i, 1 + k]
        q_b = p.shifted_walk_rad**2 * dt
        if t - v.born[i, k] <= JUMP_S:
            q_b += (RAGGED * p.jump_rad) ** 2
        like = vane_update(y, v.P[i, 1 + k], a, r, R, phi, q_b, q_g)
        v.L[i, k] += like - null
        if t - v.born[i, k] <= EARLY_S or v.early[i, k] == v.ref[i, k]:
            v.early[i, k] = y[0]
        if best < 0 or v.L[i, k] > v.L[i, best]:
            best = k
    if s[STATUS] != OK:
        std = math.sqrt(max(P[0, 0] + 2.0 * a * P[0, 1] + a * a * P[1, 1], 0.0))
        if s[N_USED] < p.learn_s or std > p.learnt_rad:
            return row
        row = _say(v, log, row, t, i, OK, LEARNING)
    convicts = False
    if best >= 0:
        shift = v.x[i, 1 + best, OFFSET] - v.ref[i, best]
        now = math.copysign(1.0, shift) * (s[MEAN] + x[OFFSET] - v.ref[i, best])
        convicts = v.L[i, best] > p.margin and abs(shift) > least and now > 0.5 * abs(shift)
        rest = min(abs(shift) / least, now / max(0.5 * abs(shift), 1e-9))
        test[V_RATIO + i] = max(ratio, short_of(v.L[i, best] / p.margin, rest))
    if held(s, HELD_SHIFT, convicts, t) >= p.confirm_s:
        x[OFFSET] = v.ref[i, best]  # as it was before the shift
        return _blame(v, log, row, t, i, SHIFT, v.born[i, best], v.L[i, best], p.margin,
                      a + x[OFFSET] + shift, a + x[OFFSET], v.early[i, best] - v.ref[i, best],
                      tas)  # fmt: skip
    _spawn(v, p, i, t)
    return row


@kernel
def _silent(memory: Array, t: float) -> bool:
    """Whether the estimates that must have come by t were missing then."""
    last = -np.inf
    for k in range(N_TIMES):
        if memory[_TIMES + k] <= t - LATEST_S:
            last = max(last, memory[_TIMES + k])
    return bool(t - last > LATEST_S + SILENCE_S)


@kernel
def run(
    v: Vanes, p: VaneLimits, t: Array, code: Ints, index: Ints, value: Array, log: Array,
    tests: Array,
) -> tuple[int, int]:  # fmt: skip
    """Use events; return how many rows of ``log`` and of ``tests`` were written.

    Parameters
    ----------
    t : (n,) float64 [s]
        Of the sample, estimate or phase. In order, but that estimates may come late.
    code, index : (n,) int64
        EV_VANE of vane ``index``, EV_AIR or EV_PHASE.
    value : (n, 3) float64
        Angle [rad]; a, sigma [rad] and true airspeed [m/s]; 1 from take-off and 0 from landing on.
    log : (3 n + 8, 14) float64
        Columns G_*.
    tests : (n, 10) float64
        Columns V_*, a row for each estimate.
    """
    memory = v.memory
    row, n_tests = 0 * t.size, 0 * t.size
    for k in range(t.size):
        now = t[k]
        if code[k] == EV_VANE:
            i = index[k]
            s = v.s[i]
            slot = v.ring[i, v.pushed[i] % RING]
            slot[0], slot[1] = now, value[k, 0]
            v.pushed[i] += 1
            if s[SEEN] == 0.0:
                s[SEEN], s[SINCE] = 1.0, np.nan
                row = _say(v, log, row, now, i, UNMONITORED,
                           LEARNING if memory[FLYING] > 0.5 else ON_GROUND)  # fmt: skip
            elif memory[FLYING] > 0.5 and s[STATUS] == OK and _silent(memory, now):
                row = _say(v, log, row, now, i, UNMONITORED, MISSING)
                s[SINCE] = np.nan
        elif code[k] == EV_PHASE:
            memory[FLYING] = value[k, 0]
            memory[T_AIR] = memory[T_SPAWN] = -np.inf
            for i in range(N_VANES):
                v.s[i, SINCE] = np.nan
                v.used[i] = v.pushed[i]
                if v.s[i, SEEN] > 0.5:
                    row = _say(v, log, row, now, i, UNMONITORED,
                               LEARNING if value[k, 0] > 0.5 else ON_GROUND)  # fmt: skip
        elif memory[FLYING] > 0.5 and now > memory[T_AIR]:
            test = tests[n_tests]
            for i in range(N_TEST):
                test[i] = np.nan
            test[V_T] = now
            n_tests += 1
            for i in range(N_VANES):
                row = _estimate(v, p, now, value[k, 0], value[k, 1], value[k, 2], log, row, i, test)
            memory[T_AIR], memory[A_AIR] = now, value[k, 0]
            memory[_TIMES + int(memory[N_AIR]) % N_TIMES] = now
            memory[N_AIR] += 1.0
    return row, n_tests
