"""What a sensor betrays by itself, whatever the air does: it stands still, or it has become noisy.

==========  ==================================================================  =====
symbol      meaning                                                             shape
==========  ==================================================================  =====
v           reading
d           its second difference v_k - 2 v_{k-1} + v_{k-2}: noise, not motion
level       d's usual size, learnt while the sensor was quiet
run         samples for which the reading has been the same to the last bit
longest     the longest such run of a good sensor (a coarse one has long ones)
signs       what is remembered of a sensor, columns ``S_*``                     (9,)
==========  ==================================================================  =====

A jammed sensor is no worse than its distance from the truth, and near it no residual shows the jam
(wan2018 Fig. 6a: 19 s); but it repeats itself, which a good one does not. A noisy sensor is found
by residuals only when its rms happens to pass the threshold; but its readings leap to and fro.

The size of d is its rms over the evaluation window. One wild reading touches three second
differences and a jump two, and neither is noise: each square counts only so much that three alone
do not make the window noisy.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["NOISY", "NO_SIGN", "SIGNS", "STANDS_STILL", "own_sign", "quiet"]

Array = NDArray[np.float64]

NO_SIGN, STANDS_STILL, NOISY = range(3)

S_SEEN, S_LAST, S_BEFORE, S_LEVEL, S_RUN, S_LONGEST, S_ROUGH, S_SIZE, S_STILL = range(9)
SIGNS = 9

REPEATS = 4.0
"""How many times longer than ever before a reading must repeat."""
CONFIRM = 4.0
"""Samples in a row that must be noisy."""
ONE_WILD = 0.95 / 3.0
"""Share of a noisy window that a wild reading's three differences may not fill by one each."""
LEVEL_SAMPLES = 600.0
"""Over how many samples the usual size is averaged."""
MATTERS_SHARE = 0.25
"""Noise below this share of the residual's threshold is nobody's concern."""
ROOT_6 = math.sqrt(6.0)
"""Size of the second differences of noise of unit variance."""
QUIET = 2.0
"""Times the usual size above which no sensor comes back."""


@kernel
def own_sign(v: float, share: float, J_th: float, ring: Array, signs: Array) -> int:
    """Take one reading; NO_SIGN, STANDS_STILL or NOISY.

    Parameters
    ----------
    v : float
        Finite.
    share : float
        Noisy is what is this many times the usual size; inf switches both signs off.
    J_th : float
        Threshold of the residual rms: noise matters from a quarter of it.
    ring : (N_eval,) float64, updated
        The last second differences, squared.
    signs : (SIGNS,) float64, updated
    """
    n_eval = ring.size
    n = signs[S_SEEN]
    learning = n < 10.0 * n_eval
    signs[S_SEEN] += 1.0

    enough = max(float(n_eval - 1), REPEATS * signs[S_LONGEST])
    run = signs[S_RUN] + 1.0
    if n == 0.0 or v != signs[S_LAST]:
        if learning or signs[S_RUN] < enough:
            signs[S_LONGEST] = max(signs[S_LONGEST], signs[S_RUN])
        run = 0.0
    signs[S_RUN] = run
    still = not learning and run >= enough and share < np.inf
    signs[S_STILL] = 1.0 if still else 0.0

    d = v - 2.0 * signs[S_LAST] + signs[S_BEFORE] if n >= 2.0 else 0.0
    signs[S_BEFORE] = signs[S_LAST]
    signs[S_LAST] = v
    noisy = max(share * signs[S_LEVEL], MATTERS_SHARE * ROOT_6 * J_th)
    most = np.inf if learning else ONE_WILD * n_eval * noisy * noisy
    ring[int(n) % n_eval] = min(d * d, most)
    total = 0.0
    for e in range(n_eval):
        total += ring[e]
    size = math.sqrt(total / n_eval)
    signs[S_SIZE] = size
    if learning or (1.5 * size < noisy and run <= signs[S_LONGEST]):
        gain = 1.0 / (min(n, LEVEL_SAMPLES) + 1.0)
        var = signs[S_LEVEL] * signs[S_LEVEL]
        signs[S_LEVEL] = math.sqrt(var + gain * (size * size - var))
    signs[S_ROUGH] = signs[S_ROUGH] + 1.0 if not learning and size > noisy else 0.0
    if still:
        return STANDS_STILL
    return NOISY if signs[S_ROUGH] >= CONFIRM else NO_SIGN


@kernel
def quiet(J_th: float, signs: Array) -> bool:
    """Whether the last readings moved, and leapt no more than usual."""
    usual = max(signs[S_LEVEL], 0.5 * MATTERS_SHARE * ROOT_6 * J_th)
    calm: bool = signs[S_STILL] == 0.0 and signs[S_SIZE] <= QUIET * usual
    return calm
