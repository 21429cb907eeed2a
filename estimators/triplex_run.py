"""One kernel: fusion, estimation and the fault logic of wan2018 over the rows of a flight.

Symbols and reasons are those of :mod:`estimators.triplex`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import air_outside, linearise
from estimators.air_data_mhe import (
    mhe_advance,
    mhe_solve,
    window_views,
)
from estimators.jit import kernel
from estimators.mhe import SOLVED
from estimators.triplex_ekf import ekf_predict_covariance, ekf_update, forget
from estimators.triplex_return import like_the_others, met_the_held_wind
from estimators.triplex_signs import NO_SIGN, own_sign, quiet
from estimators.triplex_tuning import (
    P_BASE,
    P_CHANGE_X,
    P_CHANGE_Z,
    P_CLEAR,
    P_CLEAR_SHARE,
    P_FLOOR,
    P_GUST_X,
    P_GUST_Z,
    P_LATCH,
    P_MARGIN,
    P_MARGIN_ONE,
    P_MEMORY,
    P_N_D,
    P_N_EVAL,
    P_NOISY,
    P_REF_DELAY,
    P_REF_MEAN,
    P_SPREAD,
    P_TH_A,
    P_TH_V,
    P_WALK,
)
from estimators.wind_memory import against_remembered_wind, extrapolated, roll_back, trend

__all__ = [
    "R_ALPHA",
    "R_ALPHA_STD",
    "R_CAS",
    "R_CAS_STD",
    "R_CONFIGURATION",
    "R_J",
    "R_LATCHED",
    "R_SIZE",
    "R_STATUS",
    "R_X",
    "fuse",
    "residual_rms",
    "triplex_run",
]

Array = NDArray[np.float64]

JUMP_S, BACK_S = 10.0, 3.0
"""Time in which the jump with which a sensor left, or came back, is forgotten [s]."""
ESTIMATE_LAG_S = 1.0
"""Time by which the horizon's wind lags behind a ramp at the paper's weights [s]."""
WALK_BASE_S, WALK_MEAN_S = 10.0, 60.0
"""Base of the changes of wind from which its walk is learnt, and time over which, s."""
FROZEN_VAR = 1e-12
"""Arrival and process variance of a held wind component [m^2/s^2]: it does not move."""

# columns of a record row
R_X = slice(0, 4)
R_J = slice(4, 10)
R_LATCHED = slice(10, 16)
R_CONFIGURATION, R_ALPHA, R_CAS, R_ALPHA_STD, R_CAS_STD, R_STATUS = range(16, 22)
R_SIZE = 22


@kernel
def residual_rms(ring: Array, count: int) -> float:
    """Root mean square of the first ``count`` residuals of a ring. Source: wan2018 (18)."""
    total = 0.0
    for k in range(count):
        total += ring[k] * ring[k]
    return math.sqrt(total / max(count, 1))


@kernel
def leap_of(ring: Array, k: int) -> float:
    """Mean of a ring's last three values less that of the three before; ``k`` is the newest."""
    n = ring.size
    leap = 0.0
    for e in range(3):
        leap += (ring[(k - e) % n] - ring[(k - 3 - e) % n]) / 3.0
    return leap


@kernel
def fuse(value: Array, J: Array, use: Array, M: Array) -> tuple[float, float, bool]:
    """Weighted mean of the sensors in use, their weighted ``M``, and whether there is any.

    ``value``, ``J``, ``use`` (1 or 0) and ``M`` are (3,); J must not be zero.

    Source: wan2018 (19).
    """
    total = 0.0
    fused = 0.0
    M_fused = 0.0
    for i in range(3):
        if use[i] == 1.0:
            beta = 1.0 / (J[i] * J[i])
            total += beta
            fused += beta * value[i]
            M_fused += beta * M[i]
    if total == 0.0:
        return 0.0, 0.0, False
    return fused / total, M_fused / total, True


@kernel
def triplex_run(
    model: int, t_s: float, tuning: Array, par: Array, kappa: float, n_kappa: int, n_qp: int,
    n_sqp: int, N: int, window: Array, work: Array, filtering: bool, cov: Array, rings: Array,
    signs: Array, memory: Array, winds: Array, inertial: Array, vanes: Array, pitots: Array,
    theta_rows: Array, record: Array,
) -> None:  # fmt: skip
    """Run fusion, estimation and fault logic over the rows of a flight.

    Parameters
    ----------
    model .. n_sqp, N, window, work
        As in :func:`estimators.air_data_mhe.mhe_step`.
    par : (21,) float64
        :meth:`TriplexTuning.parameters`.
    filtering : bool
        Whether an EKF with covariance ``cov`` (4, 4) takes the place of the horizon.
    rings : (5, 2, 3, N_eval) float64, updated
        Residuals against the prediction, against the remembered wind, raised flags, squared
        second differences, and readings.
    signs : (2, 3, SIGNS) float64, updated
        See :mod:`estimators.triplex_signs`.
    memory : (61,) float64, updated
        Counters, latches and held winds; see the slices below.
    winds : (2, S) float64, updated
        Ring of the wind estimate (W_x, W_z), one column per sample.
    inertial : (T, 2) float64 [m/s]
        V_g and V_z (down).
    vanes, pitots : (T, 3) float64 [rad], [m/s]
        NaN where a sensor gave nothing.
    theta_rows : (T, 6) float64
    record : (T, 22) float64, written
        Columns ``R_*``.

    Source: wan2018 section III-A, Table I.
    """
    n_eval = int(par[P_N_EVAL])
    count = memory[0:1]  # samples so far
    latched = memory[1:7].reshape(2, 3)
    calm = memory[7:13].reshape(2, 3)  # samples since J was last above the clearing level
    peak = memory[13:19].reshape(2, 3)  # largest rms since the latch
    lost = memory[19:21]  # 1 while all three of the channel are latched
    since = memory[21:23]  # samples since then
    held = memory[23:25]  # (W_x, W_z) held
    W_ref = memory[25:27]  # (W_x, W_z) remembered
    rate = memory[27:29]  # its trend
    rate_var = memory[29:31]  # the trends' variance
    parted_s = memory[31:33]  # time since the sensors parted, per wind component
    jump = memory[33:39].reshape(2, 3)  # largest jump of the last seconds
    left = memory[39:45].reshape(2, 3)  # the jump with which a latched one left
    walk_var = memory[45:47]  # variance of the wind's change per sample, learnt
    back = memory[47:53].reshape(2, 3)  # largest jump of the last seconds since it was latched
    sprung = memory[53:59].reshape(2, 3)  # largest jump of the reading itself
    stepped = memory[59:61]  # samples for which all that are left have been away by a jump
    W_now = np.empty(2)
    J = np.empty((2, 3))
    M = np.empty((2, 3))
    use_sensor = np.empty((2, 3))
    value = np.empty((2, 3))
    table = tuning.copy()
    confine = np.empty((2, 2))
    air = np.empty(2)
    y_new = np.zeros(4)
    use_new = np.zeros(4)
    F = np.empty(4)
    h = np.empty(4)
    jac = np.empty((3, 4, 4))
    zero = np.zeros(4)
    threshold = par[P_TH_A : P_TH_V + 1]
    x_prior, x, u, y, use, _, _ = window_views(window, N)
    S = winds.shape[1]

    for row in range(inertial.shape[0]):
        k = int(count[0])
        slot = k % n_eval
        seen = min(k + 1, n_eval)
        th = theta_rows[row]
        air_outside(th[5], 0.0, air)
        if k == 0:
            W_ref[0] = x[N - 1, 2]
            W_ref[1] = x[N - 1, 3]
            walk_var[0] = walk_var[1] = par[P_WALK] * par[P_WALK]
        y_new[0] = inertial[row, 0]
        y_new[1] = inertial[row, 1]
        use_new[0] = use_new[1] = 1.0
        mhe_advance(model, t_s, N, window, y_new, use_new, th, 0.0, work)
        if filtering:
            # the advance left A and B of the last state in the scratch array
            A, B = work[:16].reshape(4, 4), work[16:32].reshape(4, 4)
            ekf_predict_covariance(A, B, table[1], cov)
        # the predicted outputs with their air
        linearise(model, x[N - 1], zero, th, air, t_s, F, jac[0], jac[1], h, jac[2])
        lag_s = (par[P_REF_DELAY] + par[P_REF_MEAN]) * t_s + ESTIMATE_LAG_S
        for c in range(2):
            W_now[c] = extrapolated(W_ref[c], rate[c], lag_s + parted_s[c])
        ref_alpha, ref_cas = against_remembered_wind(th, inertial[row, 1], W_now, air)

        for ch in range(2):
            limit = threshold[ch]
            predicted = h[2 + ch]
            remembered = ref_alpha if ch == 0 else ref_cas
            parted = -np.inf
            together = np.inf
            for i in range(3):
                v = vanes[row, i] if ch == 0 else pitots[row, i]
                value[ch, i] = v
                silent = not np.isfinite(v)
                rings[0, ch, i, slot] = 2.0 * limit if silent else v - predicted
                rings[1, ch, i, slot] = 2.0 * limit if silent else v - remembered
                rings[4, ch, i, slot] = 0.0 if silent else v
                J[ch, i] = max(residual_rms(rings[0, ch, i], seen), par[P_FLOOR] * limit)
                M[ch, i] = residual_rms(rings[1, ch, i], seen)
                above = J[ch, i] > limit
                jump[ch, i] *= 1.0 - t_s / JUMP_S
                if k >= 6:
                    leap = leap_of(rings[0, ch, i], k)
                    jump[ch, i] = max(jump[ch, i], abs(leap))
                    back[ch, i] = max((1.0 - t_s / BACK_S) * back[ch, i], abs(leap))
                    leap = leap_of(rings[4, ch, i], k)
                    sprung[ch, i] = max((1.0 - t_s / BACK_S) * sprung[ch, i], abs(leap))
                rings[2, ch, i, slot] = 1.0 if above else 0.0
                if not silent:
                    sign = own_sign(v, par[P_NOISY], limit, rings[3, ch, i], signs[ch, i])
                    if sign != NO_SIGN and not latched[ch, i]:
                        latched[ch, i] = 1.0
                        peak[ch, i] = J[ch, i]
                        left[ch, i] = 0.0
                        calm[ch, i] = back[ch, i] = 0.0
                use_sensor[ch, i] = 0.0 if above or silent or latched[ch, i] else 1.0
                if not latched[ch, i]:
                    mean = 0.0
                    for e in range(seen):
                        mean += rings[0, ch, i, e] / seen
                    parted = max(parted, mean)
                    together = min(together, mean)
            # (19), and the fused value's own distance from the remembered wind
            fused, M_fused, any_used = fuse(value[ch], J[ch], use_sensor[ch], M[ch])
            y_new[2 + ch] = fused
            use_new[2 + ch] = 1.0 if any_used else 0.0

            # confirm, and find out whether the majority is the culprit
            gust = par[P_GUST_Z] / max(th[0], 1.0) if ch == 0 else par[P_GUST_X]
            two_var = 2.0 * gust * gust if any_used else 0.0
            majority_wrong = False
            leapt = np.inf if any_used else 0.0
            for i in range(3):
                if use_sensor[ch, i] == 1.0:
                    leapt = min(leapt, jump[ch, i])
            for i in range(3):
                raised = 0.0
                for e in range(seen):
                    raised += rings[2, ch, i, e]
                if raised >= par[P_N_D] and not latched[ch, i]:
                    llr = M[ch, i] * M[ch, i] - M_fused * M_fused
                    # who jumped is wrong; when all crept the memory has the word
                    own = jump[ch, i]
                    if par[P_MEMORY] == 0.0 or (own > 0.5 * limit and own > 2.0 * leapt):
                        guilty = True
                    elif leapt > 0.5 * limit and leapt > 2.0 * own:
                        guilty = False
                        majority_wrong = True
                    else:
                        guilty = llr >= par[P_MARGIN_ONE] * two_var
                        majority_wrong = majority_wrong or -llr > par[P_MARGIN] * two_var
                    if guilty:
                        latched[ch, i] = 1.0
                        peak[ch, i] = J[ch, i]
                        left[ch, i] = own
                        calm[ch, i] = back[ch, i] = 0.0
            # a step of all that are left, which the wind may have taken up before J could tell
            away = par[P_MEMORY] == 1.0
            n_left = 0
            for i in range(3):
                if not latched[ch, i]:
                    n_left += 1
                    away = away and M[ch, i] > limit and sprung[ch, i] > 0.5 * limit
            stepped[ch] = stepped[ch] + 1.0 if away and n_left > 0 else 0.0
            if stepped[ch] >= par[P_N_D]:
                for i in range(3):
                    if not latched[ch, i]:
                        latched[ch, i] = 1.0
                        peak[ch, i] = M[ch, i]
                        left[ch, i] = sprung[ch, i]
                        calm[ch, i] = back[ch, i] = 0.0
            if majority_wrong:
                # the wind that the others ask for, from the last samples against the memory
                w = 3 - ch
                apart = 0.0
                others = 0.0
                for i in range(3):
                    if use_sensor[ch, i] == 1.0:
                        latched[ch, i] = 1.0
                        peak[ch, i] = M[ch, i]
                        left[ch, i] = jump[ch, i]
                        calm[ch, i] = back[ch, i] = 0.0
                        rings[0, ch, i, :] = rings[1, ch, i, :]
                    elif not latched[ch, i]:
                        others += 1.0
                        for e in range(seen):
                            apart += rings[1, ch, i, e] / seen
                        rings[0, ch, i, :] = 0.0
                        rings[2, ch, i, :] = 0.0
                use_new[2 + ch] = 0.0
                apart /= max(others, 1.0)
                seed = W_now[1 - ch] - (apart if ch == 1 else apart * th[0])
                for j in range(N):
                    x[j, w] = seed
                x_prior[w] = seed
                u[:, w] = 0.0
                forget(cov, w, par[P_GUST_X if ch == 1 else P_GUST_Z] ** 2)

            # come back one by one, or, after a whole channel was lost, in agreement
            faulty = latched[ch, 0] + latched[ch, 1] + latched[ch, 2]
            w = 3 - ch
            sigma = 0.0
            if lost[ch] == 1.0:
                since[ch] += 1.0
                sigma = math.sqrt(walk_var[1 - ch] * since[ch])
                if ch == 0:
                    sigma /= max(th[0], 1.0)
            share = par[P_CLEAR_SHARE]
            for i in range(3):
                if not latched[ch, i]:
                    continue
                peak[ch, i] = max(peak[ch, i], J[ch, i])
                if lost[ch] == 1.0:
                    offset = -(value[ch, i] - h[2 + ch])  # wind that would explain it
                    if ch == 0:
                        offset *= -th[0]
                    wind = held[1 - ch] + offset
                    good = tuning[3, w] < wind < tuning[4, w] and met_the_held_wind(
                        i, J[ch], value[ch], limit, share, sigma, peak[ch, i], left[ch, i],
                        back[ch, i], calm[ch, i] > 0.0,
                    )  # fmt: skip
                else:
                    good = like_the_others(
                        i, J[ch], use_sensor[ch], rings[0, ch], seen, limit, share
                    )
                good = good and quiet(limit, signs[ch, i])
                calm[ch, i] = calm[ch, i] + 1.0 if good else 0.0
                if calm[ch, i] >= par[P_CLEAR] or par[P_LATCH] == 0.0:
                    raised = 0.0
                    for e in range(seen):
                        raised += rings[2, ch, i, e]
                    if par[P_LATCH] == 1.0 or raised < par[P_N_D]:
                        latched[ch, i] = 0.0
                        faulty -= 1.0
                        if par[P_LATCH] == 1.0:
                            rings[2, ch, i, :] = 0.0
            if faulty == 3.0 and lost[ch] == 0.0:
                lost[ch] = 1.0
                since[ch] = 0.0
                if par[P_LATCH] == 1.0:
                    newest = (k - 1) % S
                    before = x[0, w]
                    if k > 0:
                        bound = min(tuning[4, w], 1e6)
                        change = par[P_CHANGE_X] if ch == 1 else par[P_CHANGE_Z]
                        before = roll_back(
                            winds[1 - ch], newest, min(k, S), t_s, bound, int(par[P_BASE]), change
                        )
                    held[1 - ch] = before
                    for j in range(N):
                        x[j, w] = before
                    x_prior[w] = before
                    u[:, w] = 0.0
                    forget(cov, w, FROZEN_VAR)
                else:
                    held[1 - ch] = x[N - 1, w]
            elif faulty < 3.0:
                if lost[ch] == 1.0:
                    calm_var = par[P_GUST_X if ch == 1 else P_GUST_Z] ** 2
                    forget(cov, w, calm_var + walk_var[1 - ch] * since[ch])
                lost[ch] = 0.0
            if lost[ch] == 1.0:
                use_new[2 + ch] = 0.0
            for a in range(3):
                table[a, w] = tuning[a, w]
            table[3, w] = tuning[3, w]
            table[4, w] = tuning[4, w]
            if lost[ch] == 1.0 and par[P_LATCH] == 1.0:
                table[0, w] = FROZEN_VAR
                table[1, w] = FROZEN_VAR
                table[3, w] = -np.inf
                table[4, w] = np.inf
            # remember the wind and its trend while the sensors agree
            if parted - together < par[P_SPREAD] * limit and lost[ch] == 0.0:
                delay = int(par[P_REF_DELAY])
                parted_s[1 - ch] = 0.0
                if k > delay:
                    at = k - 1 - delay
                    W_ref[1 - ch] += (winds[1 - ch, at % S] - W_ref[1 - ch]) / par[P_REF_MEAN]
                    rate[1 - ch], rate_var[1 - ch] = trend(
                        winds[1 - ch], at, min(at + 1, S), t_s, rate_var[1 - ch]
                    )
                walk_base = int(WALK_BASE_S / t_s)
                if k > walk_base:
                    change = winds[1 - ch, (k - 1) % S] - winds[1 - ch, (k - 1 - walk_base) % S]
                    gain = t_s / WALK_MEAN_S
                    walk_var[1 - ch] += gain * (change * change / walk_base - walk_var[1 - ch])
                    walk_var[1 - ch] = max(walk_var[1 - ch], par[P_WALK] * par[P_WALK])
            else:
                parted_s[1 - ch] += t_s
                if lost[ch] == 1.0:
                    W_ref[1 - ch] = held[1 - ch]
                    rate[1 - ch] = 0.0
            # band about the wind of change_base_s ago
            base = int(par[P_BASE])
            confine[1, 1 - ch] = np.inf
            confine[0, 1 - ch] = 0.0
            if k > base and lost[ch] == 0.0 and tuning[4, w] < np.inf:
                confine[0, 1 - ch] = winds[1 - ch, (k - 1 - base) % S]
                confine[1, 1 - ch] = par[P_CHANGE_X] if ch == 1 else par[P_CHANGE_Z]

        for a in range(4):
            y[N - 1, a] = y_new[a]
            use[N - 1, a] = use_new[a]
        if filtering:
            status = SOLVED
            ekf_update(model, t_s, table[2], th, air, y_new, use_new, x[N - 1], cov)
        else:
            status, _ = mhe_solve(
                model, t_s, table, confine, kappa, n_kappa, n_qp, n_sqp, N, window, work
            )
        winds[0, k % S] = x[N - 1, 2]
        winds[1, k % S] = x[N - 1, 3]
        count[0] += 1.0

        out = record[row]
        for a in range(4):
            out[a] = x[N - 1, a]
        for ch in range(2):
            for i in range(3):
                out[4 + 3 * ch + i] = J[ch, i]
                out[10 + 3 * ch + i] = latched[ch, i]
        out[R_CONFIGURATION] = lost[0] + 2.0 * lost[1]
        linearise(model, x[N - 1], zero, th, air, t_s, F, jac[0], jac[1], h, jac[2])
        out[R_ALPHA] = h[2]
        out[R_CAS] = h[3]
        wx = wz = 0.0
        if lost[0] == 1.0:
            wz = math.hypot(par[P_GUST_Z], math.sqrt(walk_var[1] * since[0]))
        if lost[1] == 1.0:
            wx = math.hypot(par[P_GUST_X], math.sqrt(walk_var[0] * since[1]))
        out[R_ALPHA_STD] = math.hypot(math.sqrt(tuning[2, 2]), wz / max(th[0], 1.0))
        out[R_CAS_STD] = math.hypot(math.sqrt(tuning[2, 3]), wx)
        out[R_STATUS] = status
