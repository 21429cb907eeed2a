"""The filters of one hypothesis side by side: one instruction advances several generations.

All filters of the bank see the same epoch and the same noises; only their states differ. Kept with
the generations in the last axis, a *lane* each, a step runs over all lanes at once in the
processor's vector registers, and every lane comes out as :mod:`estimators.air_data_3d` has it: the
same operations in the same order, those with a zero left out. (The loops over lanes ask the arrays
for their number: a constant would have them unrolled before they are turned into vectors.)

==========  =================================================================  ================
symbol      meaning                                                            shape
==========  =================================================================  ================
x, P        states and covariances; of P only the part j >= i is kept          (10, LANES),
                                                                               (10, 10, LANES)
H, PH       derivative of a measurement by the state, and P H                  (10, LANES)
rows        bit mask of the states whose derivative is not zero                int
lane        generation of the bank; those that run none are computed and       LANES
            never looked at, which costs less than to leave them out
==========  =================================================================  ================
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import GUST, N_MIN_M_S, N_PITOTS, NX, SCALE, YAW
from estimators.jit import kernel

__all__ = [
    "LANES",
    "Lanes",
    "lateral_lanes",
    "new_lanes",
    "pitot_lanes",
    "predict_lanes",
    "update_lanes",
]

Array = NDArray[np.float64]

LANES = 16
"""A multiple of the numbers that fit a vector register (4, or 8), not below the generations."""

_GUST0, _GUST1, _SCALE0 = GUST.start, GUST.stop, SCALE.start
_AIR_ROWS = 0b111111
_LATERAL_ROWS = _AIR_ROWS | 1 << YAW
_LN_2PI = 2.0 * math.pi


class Lanes(NamedTuple):
    """Room to work in.

    Attributes
    ----------
    H, PH : (10, LANES) float64
    e, S, n : (LANES,) float64
        Innovation, its variance, and the length of d.
    ln, lateral : (LANES,) float64 [nat]
        Log-likelihood of what was used, and that of the lateral measurement kept aside.
    """

    H: Array
    PH: Array
    e: Array
    S: Array
    n: Array
    ln: Array
    lateral: Array


def new_lanes() -> Lanes:
    """Room for one hypothesis."""
    z = np.zeros
    return Lanes(z((NX, LANES)), z((NX, LANES)), *(z(LANES) for _ in range(5)))


@kernel
def predict_lanes(x: Array, P: Array, phi: float, q: Array) -> None:
    """Time update in place, see :func:`estimators.air_data_3d.predict`."""
    lanes = x.shape[1]
    for i in range(_GUST0, _GUST1):
        for g in range(lanes):
            x[i, g] *= phi
    for i in range(_GUST1):
        for j in range(max(i, _GUST0), _GUST1 if i < _GUST0 else NX):
            for g in range(lanes):
                P[i, j, g] *= phi
            if i >= _GUST0 and j < _GUST1:
                for g in range(lanes):
                    P[i, j, g] *= phi
    for i in range(NX):
        for g in range(lanes):
            P[i, i, g] += q[i]


@kernel
def update_lanes(
    x: Array,
    P: Array,
    H: Array,
    PH: Array,
    e: Array,
    S: Array,
    ln: Array,
    rows: int,
    R: float,
    gate: float,
) -> None:
    """Use one scalar measurement in place, see :func:`estimators.air_data_3d.scalar_update`.

    Parameters
    ----------
    PH : (10, lanes) float64, written
    e : (lanes,) float64
        Innovation.
    S : (lanes,) float64, written
        One over the innovation's variance; beyond the gate, of Huber's.
    ln : (lanes,) float64 [nat]
        The log-likelihood is added to it.
    """
    lanes = e.size
    for i in range(NX):
        for g in range(lanes):
            PH[i, g] = 0.0
        for j in range(NX):
            if (rows >> j) & 1:
                a, b = min(i, j), max(i, j)
                for g in range(lanes):
                    PH[i, g] += P[a, b, g] * H[j, g]
    for g in range(lanes):
        S[g] = R
    for i in range(NX):
        if (rows >> i) & 1:
            for g in range(lanes):
                S[g] += H[i, g] * PH[i, g]
    for g in range(lanes):
        nu = abs(e[g]) / math.sqrt(S[g])
        ln_likelihood = -0.5 * math.log(_LN_2PI * S[g])
        if nu > gate:
            ln_likelihood -= gate * (nu - 0.5 * gate)
            S[g] *= nu / gate
        else:
            ln_likelihood -= 0.5 * nu * nu
        ln[g] += ln_likelihood
    for g in range(lanes):
        S[g] = 1.0 / S[g]
    for i in range(NX):
        for g in range(lanes):
            x[i, g] += PH[i, g] * S[g] * e[g]
        for j in range(i, NX):
            for g in range(lanes):
                P[i, j, g] -= PH[i, g] * PH[j, g] * S[g]


@kernel
def lateral_lanes(
    room: Lanes, x: Array, P: Array, V: Array, e_y: Array, R: float, gate: float
) -> None:
    """Use ``e_y' d - n b = 0``, see :func:`estimators.air_data_3d.lateral_update`.

    Parameters
    ----------
    room
        ``ln`` receives the log-likelihoods.
    """
    H, e = room.H, room.e
    lanes = e.size
    for g in range(lanes):
        d0 = V[0] - x[0, g] - x[_GUST0, g]
        d1 = V[1] - x[1, g] - x[_GUST0 + 1, g]
        d2 = V[2] - x[2, g] - x[_GUST0 + 2, g]
        n = max(math.sqrt(d0 * d0 + d1 * d1 + d2 * d2), N_MIN_M_S)
        b = x[YAW, g]
        H[0, g] = -e_y[0] + b * d0 / n
        H[1, g] = -e_y[1] + b * d1 / n
        H[2, g] = -e_y[2] + b * d2 / n
        H[YAW, g] = -n
        e[g] = -(-n * b + e_y[0] * d0 + e_y[1] * d1 + e_y[2] * d2)
        room.ln[g] = 0.0
    for i in range(3):
        for g in range(lanes):
            H[_GUST0 + i, g] = H[i, g]
    update_lanes(x, P, H, room.PH, e, room.S, room.ln, _LATERAL_ROWS, R, gate)


@kernel
def pitot_lanes(
    room: Lanes,
    x: Array,
    P: Array,
    V: Array,
    y: Array,
    use: int,
    ln_sigma: float,
    R_common: float,
    R_own: float,
    gate: float,
) -> None:
    """Use the pitots as mean and contrasts, see :func:`estimators.air_data_3d.pitot_update`.

    Parameters
    ----------
    room
        ``ln`` receives the log-likelihoods.
    """
    H, e, n = room.H, room.e, room.n
    lanes = e.size
    for g in range(lanes):
        room.ln[g] = 0.0
    m = 0
    for i in range(N_PITOTS):
        m += (use >> i) & 1
    if m == 0:
        return
    for g in range(lanes):
        w0, w1, w2 = V[0] - x[0, g], V[1] - x[1, g], V[2] - x[2, g]
        d0, d1, d2 = w0 - x[_GUST0, g], w1 - x[_GUST0 + 1, g], w2 - x[_GUST0 + 2, g]
        n[g] = max(math.sqrt(d0 * d0 + d1 * d1 + d2 * d2), N_MIN_M_S)
        m2 = max(w0 * w0 + w1 * w1 + w2 * w2, N_MIN_M_S**2)
        H[0, g] = -w0 / m2
        H[1, g] = -w1 / m2
        H[2, g] = -w2 / m2
        e[g] = 0.0
    for i in range(3):
        for g in range(lanes):
            H[_GUST0 + i, g] = H[i, g]
    for g in range(lanes):
        n[g] = ln_sigma + math.log(n[g])
    for i in range(N_PITOTS):
        if (use >> i) & 1:
            for g in range(lanes):
                H[_SCALE0 + i, g] = -1.0 / m
                e[g] += (y[i] - n[g] + x[_SCALE0 + i, g]) / m
    rows = _AIR_ROWS | use << _SCALE0
    update_lanes(x, P, H, room.PH, e, room.S, room.ln, rows, R_common + R_own / m, gate)
    # Contrast j sets pitot j against the mean of those before it; ln(sigma_rho n) drops out.
    j, rows = 0, 0
    for last in range(N_PITOTS):
        if not (use >> last) & 1:
            continue
        rows |= 1 << (_SCALE0 + last)
        if j > 0:
            a = 1.0 / math.sqrt(j * (j + 1.0))
            for g in range(lanes):
                e[g] = 0.0
            for i in range(last + 1):
                if (use >> i) & 1:
                    c = a if i < last else -j * a
                    for g in range(lanes):
                        H[_SCALE0 + i, g] = -c
                        e[g] += c * (y[i] + x[_SCALE0 + i, g])
            update_lanes(x, P, H, room.PH, e, room.S, room.ln, rows, R_own, gate)
        j += 1
