"""Adaptive two-stage extended Kalman filter: what a filter remembers, and its symbols.

============  ====================================================  =========  ==============
symbol        meaning                                               shape      lu2016
============  ====================================================  =========  ==============
x             state estimate, faults removed                        (6,)       (51)
xbar          state of the bias-free filter                         (6,)       (31), (38)
f             fault estimate, m/s^2 and rad/s                       (6,)       (43)
P, Pf         covariance of xbar, of f                              (6, 6)     (32), (39), (44)
V             blending matrix: x = xbar + V f. After a prediction   (6, 6)     (49), (50)
              U_k, after an update V_k; without an update K = 0,
              hence V_k = U_k
Phi, Gamma    transition and input matrix of one prediction         (6, 6)     (33), (34)
Gamma_T, Q_T  the same since the last measurement:                  (6, 6)
              Gamma_T <- Phi Gamma_T + Gamma,
              Q_T <- Phi Q_T Phi' + Gamma Q Gamma'
Q, R          variances of the input and of the measurement noise,  (6,)       (55), (56)
              diagonals
Qf            variances of the fault's random walk, diagonal        (6,)       (41), (57)
gamma         innovation y - h(x), angles wrapped                   (6,)       (54)
K, M          gain of the bias-free filter, H P H' + R              (6, 6)     (36)
S, C          H U, and M + S Pf S'                                  (6, 6)     (42), (48)
window        squares of the last N innovations                     (N, 6)     (53)
============  ====================================================  =========  ==============

With Q^xf = 0 (49) is ``U = Ubar (I - Qf Pf^-1)`` and (46) ``Gamma Q Gamma' + U Qf Ubar'``, which is
symmetric. The gain Kf never appears: with ``C = Lo Lo'`` and ``W = Lo^-1 S Pf``, (43) is
``f += W' Lo^-1 (residual - S f)`` and (44), symmetric to the last bit, ``Pf -= W' W``.

The compiled steps are in :mod:`estimators.two_stage_predict`, :mod:`estimators.two_stage_update`
and :mod:`estimators.two_stage_run`. What differs from the paper is told in
:mod:`estimators.two_stage_ekf`, whose classes own the rows that the kernels change in place.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["MAX_WINDOW", "MEMORY", "TRACK", "TUNING", "Array", "Ints", "Row", "Status", "lose"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Row = Any  # one row of MEMORY, TUNING or TRACK


class Status(IntEnum):
    """What became of a prediction or an update."""

    OK = 0
    """Used."""
    PARTIAL = 1
    """Used; some components of the measurement were missing (NaN)."""
    FROZEN = 2
    """Pitch beyond the limit: faults held until it is back and velocity and angles are measured."""
    WAITING = 3
    """No state yet, or a gap in the inputs: waiting for velocity and angles."""
    SINGULAR = 4
    """A covariance lost positive definiteness: restarted from the next measurements."""
    REJECTED = 5
    """Not finite: the input was replaced by the last good one, the measurement ignored."""
    LATE = 6
    """Older than what the filter has already used: ignored."""


OK, PARTIAL, FROZEN = int(Status.OK), int(Status.PARTIAL), int(Status.FROZEN)
WAITING, SINGULAR = int(Status.WAITING), int(Status.SINGULAR)
REJECTED, LATE = int(Status.REJECTED), int(Status.LATE)


MAX_WINDOW = 50
"""Longest window of (53) that a filter has room for."""

_SIX, _MATRIX = ("<f8", (6,)), ("<f8", (6, 6))

TUNING = np.dtype(
    [
        ("model", "<i8"),
        ("exact", "?"),
        ("adapt", "?"),
        ("divide_by_dt", "?"),
        ("detuning", "<f8"),  # 0: the printed dt_T^2
        ("Qf_floor", "<f8"),
        ("dt_s", "<f8"),  # interval to which Q (one sample) and the initial Qf belong
        ("pitch_limit_rad", "<f8"),
        ("pitch_return_rad", "<f8"),
        ("max_gap_s", "<f8"),
        ("N", "<i8"),
        ("Q", *_SIX),
        ("R", *_SIX),
    ],
    align=True,
)
"""Constants of a filter; see :class:`estimators.two_stage_ekf.Settings`."""

_SCRATCH_MATRICES = (
    *("F", "G", "Phi", "Gamma", "Ubar", "GQG"),
    *("H", "HP", "M", "K", "S", "L", "A", "B", "C"),
)
_SCRATCH_VECTORS = ("u", "q", "moved", "mask", "r", "eta", "residual", "first", "e")

MEMORY = np.dtype(
    [
        ("x", *_SIX),
        ("xbar", *_SIX),
        ("f", *_SIX),
        ("P", *_MATRIX),
        ("Pf", *_MATRIX),
        ("V", *_MATRIX),
        ("Qf", *_SIX),
        ("Qf_interval_s", "<f8", (2,)),  # to which the Qf of each block belongs
        ("gamma", *_SIX),
        ("nis", "<f8"),
        ("um", *_SIX),  # the last good input
        # of two: since the velocity, since the angles were measured
        ("Gamma_T", "<f8", (2, 6, 6)),
        ("Q_T", "<f8", (2, 6, 6)),
        ("since_s", "<f8", (2,)),
        ("window", "<f8", (MAX_WINDOW, 6)),
        ("filled", "<i8", (2,)),  # innovations in the window
        ("head", "<i8", (2,)),  # where the next one goes
        ("seen", "<i8", (2,)),  # measured since the state was lost
        ("updates", "<i8"),
        ("state", "<i8"),  # OK, or the Status that tells why there is no state to work with
        ("started", "?"),
        ("now_us", "<i8"),
        # scratch
        *((name, *_MATRIX) for name in _SCRATCH_MATRICES),
        *((name, *_SIX) for name in _SCRATCH_VECTORS),
        ("k", "<f8", (5, 6)),
    ],
    align=True,
)
"""Everything that a filter remembers, in one row that the kernels change in place."""

TRACK = np.dtype(
    [
        ("f", *_SIX),
        ("f_var", *_SIX),
        ("x", *_SIX),
        ("x_var", *_SIX),
        ("Qf", *_SIX),
        ("gamma", *_SIX),
        ("nis", "<f8"),
        ("status", "<i8"),
    ]
)
"""What a run leaves behind: one row per measurement, symbols as in the table above."""


@kernel
def lose(s: Row, reason: int) -> int:
    """Give the state up until both blocks are measured again; faults and Pf are held."""
    s.state = reason
    s.seen[0] = 0
    s.seen[1] = 0
    return reason
