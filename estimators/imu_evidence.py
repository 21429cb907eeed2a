"""Which axis, which IMU: what the windows of the inertial filters say of a fault.

=========  ==============================================================  ======  =====
symbol     meaning                                                         shape   unit
=========  ==============================================================  ======  =====
L, y       information on a step of the six faults, right-hand side        (6, 6)  1/SI^2
f_i        best single-axis fault, ``y_i / L_ii``                          scalar  SI
z_i        ``y_i / sqrt(L_ii)``: standard normal without a fault           scalar  1
l(f)       log likelihood of the fault f against none, ``y f - f L f / 2`` scalar  1
=========  ==============================================================  ======  =====

With a single faulty axis the largest z names it, over all windows: each is one hypothesis of the
onset (the generalised likelihood ratio). Of two IMUs that differ by d, either the one has the
fault d or the other has -d: the difference of the two log likelihoods decides, or says that
nothing is known yet.

Source: Willsky and Jones 1976 (generalised likelihood ratio); lu2016 eq. (45)-(52) give y and L.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["log_likelihood", "single_axis"]

Array = NDArray[np.float64]


def single_axis(L: Array, y: Array, normaliser: float | Array = 1.0) -> tuple[Array, Array]:
    """Single-axis faults and their statistics.

    Parameters
    ----------
    L : (..., 6, 6) float64
    y : (..., 6) float64
    normaliser : float or (...) float64
        Normalised innovation squared of the healthy filter: model error makes it exceed 1.

    Returns
    -------
    f, z : (..., 6) float64
        Zero where the window has no information.
    """
    info = np.einsum("...kk->...k", L)
    known = info > 1e-12
    safe = np.where(known, info, 1.0)
    f = np.where(known, y / safe, 0.0)
    scale = np.asarray(normaliser, dtype=float)[..., None]
    return f, f * np.sqrt(safe / scale)


def log_likelihood(L: Array, y: Array, f: Array, normaliser: float) -> float:
    """Log likelihood ratio of "this fault since the window's start" to "no fault".

    Parameters
    ----------
    L : (6, 6), y : (6,) float64
    f : (6,) float64 [m/s^2, rad/s]
    normaliser : float
    """
    value = (float(y @ f) - 0.5 * float(f @ L @ f)) / normaliser
    return value if math.isfinite(value) else 0.0
