"""Vanes against vanes, pitots against pitots, and all against a remembered wind, in 3D.

==========  ===================================================================  ========
symbol      meaning                                                              shape
==========  ===================================================================  ========
c           reading freed of the offset (vane) or scale (pitot) learnt of it     (2, 3)
T           trusted: sends data, is not latched                                  (2, 3)
r           c minus the median of T (three), minus the other one (two), minus    (2, 3)
            the horizon's prediction (one)
m, J        mean and rms of r over the last second                               (2, 3)
M           rms of c minus what the *remembered* wind predicts, last second      (2, 3)
e           fused value of T minus the bounded horizon's prediction              (2,)
sigma_g     learnt rms of the median against the remembered wind: gusts          (2,)
==========  ===================================================================  ========

Channel 0 is the angle of attack [rad], channel 1 the calibrated airspeed [m/s]. The logic is that
of :mod:`estimators.triplex` with three differences that a turning aircraft asks for: sensors of one
kind are compared with each other first (gusts and manoeuvres are common to them, so the threshold
can be ten times closer than against a model); offsets and scales are learnt while all agree; and
every threshold follows the rms that was learnt while all was well, within bounds. Two against the
third are not believed when both jumped, or stand still (:mod:`estimators.air_vote_signs`).

A stage is a tenth of a second of vehicle time. Whatever is counted is counted in stages.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_vote_record import (
    ALONE,
    BOUND,
    CONFIRM,
    CONSTANT,
    DISAGREE,
    GROUND,
    L_MAGNITUDE,
    L_STATISTIC,
    L_THRESHOLD,
    LEARNING,
    LONG,
    MEMORY,
    MISSING,
    NO_REASON,
    OK,
    PAIR,
    RAGGED,
    SHORT,
    STAGE_S,
    SUSPECT,
    UNMONITORED,
    VOTE,
    VoteLimits,
    Votes,
    convict,
    lower,
    mean_rms,
    raised,
    write,
)
from estimators.air_vote_signs import (
    JUMPED,
    OTHERS,
    believe_the_rest,
    has_no_vote,
    learn_usual,
    note,
    who_jumped,
)
from estimators.air_vote_tests import hold_all, hold_vote
from estimators.jit import kernel

__all__ = ["judge"]

Array = NDArray[np.float64]


@kernel
def _median(c: Array, use: Array) -> float:
    """Median of the entries in use: the middle of three, the mean of two."""
    lo, hi, total, n = np.inf, -np.inf, 0.0, 0
    for i in range(3):
        if use[i] == 1.0:
            lo = min(lo, c[i])
            hi = max(hi, c[i])
            total += c[i]
            n += 1
    if n == 3:
        return total - lo - hi
    return total / max(n, 1)


@kernel
def _stay_or_come_back(
    z: Votes, p: VoteLimits, ch: int, i: int, limit: float, reference: float, newest: int,
    friends: int, walk: float, before: bool,
) -> None:  # fmt: skip
    """Count the stages that a latched sensor agrees; release it after ``clear_s``.

    ``before``: it was latched before this stage.

    A sensor of a channel that was lost whole must also agree with a second one, and come back by
    half of the largest residual since the latch: what merely drifts along with a held wind stays.
    """
    value = (
        z.value[ch, i] * (1.0 - z.offset[ch, i]) if ch == 1 else z.value[ch, i] - z.offset[ch, i]
    )
    z.ring_r[ch, i, newest % LONG] = value - reference
    mean, rms = mean_rms(z.ring_r[ch, i], newest, SHORT)
    z.peak[ch, i] = max(z.peak[ch, i], rms)
    level = p.clear_share * limit
    good = abs(mean) <= level and rms <= level
    if z.lost[ch] > 0.0:
        level = min(level + 3.0 * walk, 0.5 * z.peak[ch, i])
        good = rms <= level and friends > 0
    if z.same[ch, i] >= p.constant_s or z.age[ch, i] > SHORT:
        good = False
    if before:
        apart = max(abs(mean), rms) / max(level, 1e-9)
        hold_vote(z, ch, i, apart if good else max(apart, 1.0))
    z.calm[ch, i] = z.calm[ch, i] + 1.0 if good else 0.0
    if z.calm[ch, i] * STAGE_S >= p.clear_s:
        z.latched[ch, i] = 0.0
        lower(z.flags[ch, i])


@kernel
def judge(
    z: Votes, p: VoteLimits, t_s: float, flying: bool, model: bool, predicted: Array,
    remembered: Array, speed_m_s: float, rate_rad_s: float, walk: Array, log: Array, row: int,
    fused: Array, spread: Array,
) -> int:  # fmt: skip
    """Judge one stage; returns the next free log row.

    Parameters
    ----------
    z : Votes
        ``value``, ``age`` and ``same`` must be those of this stage.
    t_s : float
        Time of the stage [s].
    flying, model : bool
        Whether to judge at all, and whether the two predictions can be used.
    predicted, remembered : (2,) float64 [rad], [m/s]
        Of the bounded horizon before it saw this stage, and of the remembered wind.
    speed_m_s, rate_rad_s : float
        Airspeed, and the roll and yaw rates' size, which set vanes on two wings apart.
    walk : (2,) float64
        Standard deviation by which a held wind has walked, as alpha and CAS.
    log : (n, 17) float64, written
    fused : (2, 2) float64, written
        Value of the channel for the horizon, and 1 when it may be used.
    spread : (2,) float64, written
        Largest disagreement among the trusted over the last second, as a share of the threshold.
    """
    now = int(z.counters[0])
    z.counters[0] += 1.0
    z.counters[1] = z.counters[1] + 1.0 if flying else 0.0
    z.counters[2] = z.counters[2] + 1.0 if model else 0.0
    learning = z.counters[1] * STAGE_S < p.learn_s
    slot = now % SHORT
    c = np.empty(3)
    T = np.empty(3)
    m = np.zeros(3)
    J = np.zeros(3)
    M = np.zeros(3)
    out = np.zeros(3)
    was = np.empty(3)
    for ch in range(2):
        n_T = 0
        n_present = 0
        for i in range(3):
            v = z.value[ch, i]
            c[i] = v * (1.0 - z.offset[ch, i]) if ch == 1 else v - z.offset[ch, i]
            here = z.age[ch, i] <= SHORT
            n_present += 1 if here else 0
            was[i] = z.latched[ch, i]
            T[i] = 1.0 if here and z.latched[ch, i] == 0.0 else 0.0
            n_T += int(T[i])
        fused[ch, 0] = 0.0
        fused[ch, 1] = 0.0
        spread[ch] = 0.0
        z.turned[ch] = 0.0
        if n_present == 0:
            continue
        if not flying:
            for i in range(3):
                if z.age[ch, i] <= SHORT:
                    z.latched[ch, i] = 0.0
                    for j in range(4):
                        lower(z.flags[ch, j])
                    row = write(log, row, z, t_s, ch, i, UNMONITORED, GROUND)
            z.lost[ch] = 0.0
            z.split[ch] = 0.0
            continue

        middle = _median(c, T) if n_T > 0 else predicted[ch]
        # thresholds: physical floor, more in a roll or at a speed where the airflow is ragged
        if ch == 0:
            floor = p.floor_aoa_rad + p.arm_m * rate_rad_s / max(speed_m_s, 5.0)
            common = p.common_aoa_rad
            gust_floor = max(0.5 * p.gust_m_s / max(speed_m_s, 5.0), math.radians(0.6))
        else:
            floor = max(p.floor_cas_m_s, p.floor_cas_share * speed_m_s) + p.arm_m * rate_rad_s
            common = max(p.common_cas_m_s, p.common_cas_share * speed_m_s)
            gust_floor = p.gust_m_s
        sigma2 = max(z.gust[ch], gust_floor * gust_floor)

        worst = 0.0
        n_quiet = 0
        for i in range(3):
            z.ring_m[ch, i, now % LONG] = c[i] - remembered[ch] if model else 0.0
            note(z, ch, i, now, learning)
            if T[i] == 0.0:
                continue
            if n_T == 3:
                r = c[i] - middle
            elif n_T == 2:
                r = 2.0 * (c[i] - middle)
            else:
                r = c[i] - predicted[ch] if model else 0.0
            z.ring_r[ch, i, now % LONG] = r
            count = min(now + 1, SHORT)
            m[i], J[i] = mean_rms(z.ring_r[ch, i], now, count)
            _, M[i] = mean_rms(z.ring_m[ch, i], now, count)
            limit = common if n_T == 1 else floor
            limit_m = min(max(limit, p.sigmas * math.sqrt(z.var_m[ch, i])), 3.0 * limit)
            limit_J = min(
                max(p.ragged_share * limit, 0.55 * p.sigmas * math.sqrt(z.var_r[ch, i])),
                3.0 * limit,
            )
            share = max(abs(m[i]) / limit_m, J[i] / limit_J)
            out[i] = share
            if n_T > 1 and not learning:
                hold_vote(z, ch, i, share)
            worst = max(worst, share)
            if share < 0.5:
                n_quiet += 1
            z.flags[ch, i, slot] = 1.0 if share > 1.0 else 0.0
        z.ring_fused[ch, now % LONG] = middle - remembered[ch] if model and n_T > 0 else 0.0
        _, M_mid = mean_rms(z.ring_fused[ch], now, min(now + 1, SHORT))
        spread[ch] = worst if n_T > 1 else 0.0

        # a reading that stands still while the others move
        n_all = n_T
        for i in range(3):
            if z.same[ch, i] == 0.0 or z.age[ch, i] > SHORT:
                z.same_low[ch, i] = np.inf
                z.same_high[ch, i] = -np.inf
            else:
                others = 0.0
                n_others = 0
                for j in range(3):
                    if j != i and T[j] == 1.0 and z.same[ch, j] < 0.5:
                        others += c[j]
                        n_others += 1
                if n_others > 0:
                    others /= n_others
                    z.same_low[ch, i] = min(z.same_low[ch, i], others)
                    z.same_high[ch, i] = max(z.same_high[ch, i], others)
                moved = n_others > 0 and z.same_high[ch, i] - z.same_low[ch, i] > 0.35 * floor
                if n_others == 0 and has_no_vote(z, ch, i):
                    # no trusted one moves: one that is not trusted will do
                    for j in range(3):
                        if z.age[ch, j] <= SHORT and z.latched[ch, j] == 1.0:
                            moved = moved or not has_no_vote(z, ch, j)
                if T[i] == 1.0 and not learning and moved:
                    hold_vote(z, ch, i, z.same[ch, i] / p.constant_s)
                if T[i] == 1.0 and not learning and z.same[ch, i] >= p.constant_s and moved:
                    row = convict(
                        log, row, z, t_s, ch, i, z.ring_r[ch, i], now, z.same[ch, i], p.constant_s,
                        CONSTANT,
                    )  # fmt: skip
                    T[i] = 0.0
                    n_T -= 1

        # two that stood still were the majority
        turned = n_all == 3 and n_T == 1

        confirmed = np.zeros(3)
        n_confirmed = 0
        for i in range(3):
            if T[i] == 1.0 and raised(z.flags[ch, i]) >= CONFIRM:
                confirmed[i] = 1.0
                n_confirmed += 1

        # the votes
        n_before = n_T
        if not learning and n_T == 3 and n_confirmed > 0:
            z.split[ch] += 1.0
            waited = z.split[ch] * STAGE_S > p.vote_wait_s
            for i in range(3):
                if confirmed[i] == 0.0 or T[i] == 0.0:
                    continue
                llr = (M[i] * M[i] - M_mid * M_mid) / (2.0 * sigma2) if model else 1.0
                silent = 0
                for j in range(3):
                    if j != i and has_no_vote(z, ch, j):
                        silent += 1
                jumped = who_jumped(z, ch, i, T, floor)
                if n_confirmed > 1 and model and llr < 0.0:
                    continue
                if silent == 2 and jumped != OTHERS:
                    continue
                wrong = llr > 1.0 or (waited and llr > -p.block_margin) or not model
                if jumped == JUMPED or (wrong and jumped != OTHERS):
                    row = convict(
                        log, row, z, t_s, ch, i, z.ring_r[ch, i], now, out[i] * floor, floor, VOTE
                    )
                    T[i] = 0.0
                    n_T -= 1
                elif llr < -p.majority_margin or (jumped == OTHERS and not has_no_vote(z, ch, i)):
                    turned = True
                    for j in range(3):
                        if j != i and T[j] == 1.0:
                            hold_vote(z, ch, j, M[j] / max(floor, M[j]))
                            row = convict(
                                log,
                                row,
                                z,
                                t_s,
                                ch,
                                j,
                                z.ring_m[ch, j],
                                now,
                                M[j],
                                max(floor, M[j]),
                                MEMORY,
                            )
                            T[j] = 0.0
                            n_T -= 1
        elif not learning and n_T == 2 and n_confirmed == 2:
            z.split[ch] += 1.0
            a = 0 if T[0] == 1.0 else 1
            b = 2 if T[2] == 1.0 else 1
            ragged_a = math.sqrt(max(J[a] * J[a] - m[a] * m[a], 0.0))
            guilty = -1
            cause = PAIR
            if model:
                llr = (M[a] * M[a] - M[b] * M[b]) / (2.0 * sigma2)
                mean_a, _ = mean_rms(z.ring_m[ch, a], now, SHORT)
                mean_b, _ = mean_rms(z.ring_m[ch, b], now, SHORT)
                fine_a = math.sqrt(max(M[a] * M[a] - mean_a * mean_a, 0.0))
                fine_b = math.sqrt(max(M[b] * M[b] - mean_b * mean_b, 0.0))
                if ragged_a > 0.7 * abs(m[a]) and max(fine_a, fine_b) > 2.5 * min(fine_a, fine_b):
                    guilty = a if fine_a > fine_b else b
                    cause = RAGGED
                elif abs(llr) > p.pair_margin:
                    guilty = a if llr > 0.0 else b
            if guilty >= 0:
                row = convict(
                    log, row, z, t_s, ch, guilty, z.ring_m[ch, guilty], now, out[guilty] * floor,
                    floor, cause,
                )  # fmt: skip
                T[guilty] = 0.0
                n_T -= 1
                z.split[ch] = 0.0
        elif worst < 0.6 or n_T < 2:
            z.split[ch] = 0.0

        if n_T < n_before:
            z.split[ch] = 0.0
        if turned:
            believe_the_rest(z, ch)

        # all of them against the bounded wind
        n_good = 0
        middle = 0.0
        for i in range(3):
            if T[i] == 1.0 and (out[i] <= 1.0 or n_T == 1):
                middle += c[i]
                n_good += 1
        if n_good > 0:
            fused[ch, 0] = middle / n_good
            fused[ch, 1] = 1.0
        e = fused[ch, 0] - predicted[ch] if model and n_good > 0 else 0.0
        z.ring_e[ch, now % LONG] = e
        mean_e, J_e = mean_rms(z.ring_e[ch], now, min(now + 1, SHORT))
        limit_e = min(max(common, p.sigmas * math.sqrt(z.var_e[ch])), 2.0 * common)
        # a step that the wind takes up at once is still apart from the wind of a moment ago
        mean_f, J_f = mean_rms(z.ring_fused[ch], now, min(now + 1, SHORT))
        limit_f = max(common, p.step_sigmas * math.sqrt(sigma2))
        bounded = J_e > limit_e and abs(mean_e) > 0.7 * limit_e
        stepped = J_f > limit_f and abs(mean_f) > 0.7 * limit_f and worst < 1.0
        z.flags[ch, 3, slot] = 1.0 if bounded or stepped else 0.0
        if not learning and model and n_good > 0:
            hold_all(z, ch, T, J_e, mean_e, limit_e, 0.7)
            if worst < 1.0:
                hold_all(z, ch, T, J_f, mean_f, limit_f, 0.7)
        if not learning and model and n_good > 0 and raised(z.flags[ch, 3]) >= CONFIRM:
            for i in range(3):
                if T[i] == 1.0:
                    cause = BOUND if n_T > 1 else ALONE
                    if abs(mean_f) > abs(mean_e):
                        row = convict(
                            log, row, z, t_s, ch, i, z.ring_fused[ch], now, J_f, limit_f, cause
                        )
                    else:
                        row = convict(
                            log, row, z, t_s, ch, i, z.ring_e[ch], now, J_e, limit_e, cause
                        )
                    T[i] = 0.0
            n_T = 0
            fused[ch, 1] = 0.0
            lower(z.flags[ch, 3])
        z.lost[ch] = z.lost[ch] + 1.0 if n_T == 0 else 0.0

        # learn while all is well
        if model and n_good > 0:
            gain = 1.0 / 300.0
            if J_e < 0.5 * limit_e:
                z.var_e[ch] += gain * (J_e * J_e - z.var_e[ch])
            if n_T > 1 and worst < 0.5:
                learn_usual(z, ch, now)
                z.gust[ch] += gain * (M_mid * M_mid - z.gust[ch])
        if n_T > 1 and (n_quiet >= n_T or learning):
            total = 0.0
            for i in range(3):
                total += c[i] * T[i]
            for i in range(3):
                if T[i] == 0.0:
                    continue
                z.learnt[ch, i] = min(z.learnt[ch, i] + 1.0, p.memory_s / STAGE_S)
                gain = 1.0 / z.learnt[ch, i]
                apart = c[i] - total / n_T
                if ch == 1:
                    apart /= max(c[i], 5.0)
                bound = p.offset_aoa_rad if ch == 0 else p.scale_cas
                z.offset[ch, i] = min(max(z.offset[ch, i] + gain * apart, -bound), bound)
                if not learning:
                    slow = max(gain, 1.0 / 300.0)
                    z.var_m[ch, i] += slow * (m[i] * m[i] - z.var_m[ch, i])
                    z.var_r[ch, i] += slow * (J[i] * J[i] - z.var_r[ch, i])

        # those who are latched
        for i in range(3):
            if z.latched[ch, i] == 0.0 or z.age[ch, i] > SHORT:
                continue
            friends = 0
            for j in range(3):
                if j != i and z.age[ch, j] <= SHORT and abs(c[i] - c[j]) < p.clear_share * floor:
                    friends += 1
            if n_present == 1:
                friends = 1
            reference = fused[ch, 0] if fused[ch, 1] == 1.0 else predicted[ch]
            limit = floor if n_T > 0 else common
            if n_T > 0 or model:
                _stay_or_come_back(
                    z, p, ch, i, limit, reference, now, friends, walk[ch], was[i] == 1.0
                )

        # what is published
        for i in range(3):
            if z.age[ch, i] > SHORT:
                continue
            if z.latched[ch, i] == 1.0:
                continue
            if learning and z.state[ch, i] != OK:
                row = write(log, row, z, t_s, ch, i, UNMONITORED, LEARNING)
            elif n_T == 1 and not model:
                row = write(log, row, z, t_s, ch, i, UNMONITORED, MISSING)
            elif n_T == 2 and z.split[ch] * STAGE_S > p.pair_wait_s:
                before = row
                row = write(log, row, z, t_s, ch, i, SUSPECT, DISAGREE)
                if row > before:
                    log[before, L_MAGNITUDE] = m[i]
                    log[before, L_STATISTIC] = abs(m[i])
                    log[before, L_THRESHOLD] = floor
            elif n_T != 2 or z.split[ch] == 0.0:
                row = write(log, row, z, t_s, ch, i, OK, NO_REASON)
    return row
