"""From residuals of healthy flights to the covariance, and from estimated faults to flags.

========  ==================================================================  ==========  =========
symbol    meaning                                                             shape       samar2006
========  ==================================================================  ==========  =========
y, S      residuals and signatures (:mod:`estimators.wing_residuals`)         (n,6)(n,6,4) (7)
Q         covariance used in the estimator                                    (6, 6)      (9)
f         estimated faults, %, order of :data:`estimators.wing_model.FAULTS`  (n, 4)      III-B
========  ==================================================================  ==========  =========

Residuals of a healthy aircraft are wind that is not known and coefficients that are not right. Wind
hits both wings: sideslip moves side force, roll and yaw in one fixed proportion, angle of attack
the other three, so that Q is nearly of rank two and says which combinations of residuals are wind.
:data:`EXTRA` of its diagonal is added lest the estimator trust the remaining ones without bound.

What is left of the wind after that looks like the same damage on both wings. A *difference* between
the wings is therefore believed at a fraction of the size at which a wing's own estimate is:
:class:`Thresholds`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "EXTRA",
    "Thresholds",
    "flagged",
    "lag_one",
    "level_std",
    "residual_covariance",
    "second_moment",
]

Array = NDArray[np.float64]

EXTRA = 0.1
"""Share of the second moments' diagonal that is added to them."""
LAM_PERCENT = 1.0
"""Mean growth of each fault from row to row, half a second."""
R_PERCENT2 = 1.0
"""Variance of a window's first point about the estimate of the window before."""
WINDOW = 50
"""Rows of the moving window; samar2006 IV-B."""


def second_moment(y: Array) -> Array:
    """Mean of y y' over healthy rows (n, 6): a constant error of the model counts as noise."""
    return np.asarray(y.T @ y / len(y))


def residual_covariance(y: Array, extra: float = EXTRA) -> Array:
    """Q of healthy residuals (n, 6): second moments plus a share of their diagonal."""
    Q = second_moment(y)
    return np.asarray(Q + extra * np.diag(np.diag(Q)))


def lag_one(y: Array) -> Array:
    """Correlation of each residual with the next row's, (6,)."""
    z = y - y.mean(axis=0)
    return np.asarray(np.sum(z[1:] * z[:-1], axis=0) / np.sum(z * z, axis=0))


def level_std(S: Array, Q: Array, noise: Array, correlation: float) -> Array:
    """Standard deviation of faults that are constant over a window, (4,) [%].

    Parameters
    ----------
    S : (N, 6, 4) float64
        Signatures of the window's rows.
    Q : (6, 6) float64
        Covariance that weights the rows.
    noise : (6, 6) float64
        Covariance that the rows have.
    correlation
        Of one row's noise with the next; the estimator takes it for zero, the result does not.
    """
    WS = np.linalg.solve(Q, S)
    information = np.einsum("kai,kaj->ij", S, WS)
    total = np.zeros((4, 4))
    past = np.zeros((6, 4))
    for row in WS:
        cross = row.T @ noise @ past
        total += row.T @ noise @ row + cross + cross.T
        past = correlation * (past + row)
        # past is the sum of correlation^(distance to the next row) times the earlier rows
    spread = np.linalg.solve(information, total)
    return np.asarray(np.sqrt(np.diag(np.linalg.solve(information, spread.T))))


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Estimates, in %, above which a wing is flagged.

    The defaults are 1.4 to 1.5 times the largest that ten healthy flights of the Aerosonde reached
    (wind of 20 to 25 % of the airspeed, known with 10 s) with the right coefficients and with
    three sets that were wrong by 15 %: lift 5.6, drag 19.8, apart 2.3 and 3.4.

    Attributes
    ----------
    lift, drag
        A wing's own estimate.
    lift_apart, drag_apart
        Its excess over the other wing's.
    leak
        Added to ``drag_apart`` for each percent by which the lifts differ. A percent of lift yaws
        2.3 times as much as a percent of drag; a model that is wrong there by 15 % takes a third
        of a percent of drag for it.
    """

    lift: float = 8.0
    drag: float = 28.0
    lift_apart: float = 3.5
    drag_apart: float = 5.0
    leak: float = 0.35


def flagged(f: Array, thresholds: Thresholds) -> NDArray[np.bool_]:
    """Which of the estimates f (n, 4) are flagged, (n, 4)."""
    t = thresholds
    apart = f - f[:, [2, 3, 0, 1]]
    lifts_apart = np.abs(apart[:, 0])
    of_drag = t.drag_apart + t.leak * lifts_apart
    of_lift = np.full(len(f), t.lift_apart)
    limits = np.column_stack([of_lift, of_drag, of_lift, of_drag])
    return np.asarray((f > np.array([t.lift, t.drag, t.lift, t.drag])) | (apart > limits))
