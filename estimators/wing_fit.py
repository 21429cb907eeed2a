"""Coefficients of an airframe from healthy flights: equation-error least squares.

========  ==================================================================  ==========  =========
symbol    meaning                                                             shape       unit
========  ==================================================================  ==========  =========
y         residuals of the accelerations, filtered by F_a(s), whitened        (n, 6)
A         what one unit of each coefficient would add to y, whitened          (n, 6, k)
dc        correction of the coefficients                                      (k,)
D         prior deviation of the coefficients                                 (k,)
s2        variance of the whitened residuals that are left                    1
kappa     rows per independent row, (1 + r) / (1 - r), r their lag-one        1
          correlation
P         covariance of dc: (A'A / (s2 kappa) + D^-2)^-1                      (k, k)
========  ==================================================================  ==========  =========

The accelerations are nearly linear in the coefficients, so that two rounds settle. A coefficient is
*identified* when the flights leave it at most :data:`IDENTIFIED` of its prior deviation; the others
keep their value, and the identified ones are fitted again with these fixed.

Rows are whitened by the covariance of what gusts and attitude errors do to them, the coefficients
taken for right (:mod:`estimators.wing_noise`): a gust that moves side force, roll and yaw together
teaches nothing about any of them.

Source: Klein and Morelli, Aircraft System Identification, chapter 5 (equation error).
Differs: a prior stands behind every coefficient; the accelerations are low-passed, not
differentiated pointwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from estimators.linalg import cholesky
from estimators.wing_model import AERODYNAMIC, AXES, FAULTS, Airframe, predict_rows
from estimators.wing_noise import noise_row
from estimators.wing_residuals import WingResiduals, low_passed
from estimators.wing_stream import WingTuning
from estimators.wing_wind import WIND_STATE, own_wind

__all__ = ["IDENTIFIED", "LEARN_TIME_S", "AirframeFit", "fit_airframe"]

Array = NDArray[np.float64]

IDENTIFIED = 0.5
"""Share of the prior deviation that a coefficient may keep to count as identified."""
LEARN_TIME_S = 1.0
"""tau_a of the fit: short, for what the controls do in a second is what teaches."""
GUST_SHARE = 1.25
"""Unknown wind that so short a filter keeps, against the watch's. Less of it draws the derivatives
by angle of attack towards zero, more makes them too large."""
UNSEEN = ("CYbeta", "Clbeta", "Cnbeta")
"""Never fitted: without a vane sideslip is known from attitude and a slow wind, with an error as
large as itself, which would draw these towards zero."""
ROUNDS = 2
SETTLED = 5.0
"""Time constants after which a flight's residuals are used."""
LEAST_STD_SHARE = 0.05
"""No coefficient is known better: errors of the angles, which least squares does not count, bias
them by several times what the scatter promises."""
NAMES = tuple(field.name for field in fields(Airframe))


@dataclass(frozen=True, slots=True)
class AirframeFit:
    """What the flights say.

    Attributes
    ----------
    airframe
        With the coefficients that were identified.
    std : (41,) float64
        Deviation of each number, as of :class:`estimators.wing_stream.WingTuning`.
    identified
        Their names.
    kept
        Coefficients that the flights could not tell, and what is left of their prior deviation.
    rows
        Independent rows that the fit rests on.
    scatter
        Root mean square of the whitened residuals before and after.
    """

    airframe: Airframe
    std: Array
    identified: tuple[str, ...]
    kept: dict[str, float]
    rows: float
    scatter: tuple[float, float]


def fit_airframe(
    airframe: Airframe, tuning: WingTuning, flights: Sequence[tuple[Array, Array]]
) -> AirframeFit:
    """Refine an airframe's coefficients.

    Parameters
    ----------
    airframe
        To start from.
    tuning
        Of the watch; its ``coefficient_std`` is the prior.
    flights
        (t_s (n,), x (n, INPUTS)) of healthy flights, wind not filled in; rows without inputs are
        NaN.

    Raises
    ------
    ValueError
        No row can be used.
    """
    prior = {n: float(tuning.coefficient_std[NAMES.index(n)]) for n in AERODYNAMIC}
    prior = {n: deviation for n, deviation in prior.items() if deviation > 0.0}
    told = [n for n in prior if n not in UNSEEN]
    first, before, _ = _solve(airframe, airframe, tuning, flights, told, prior)
    shares = {n: first[n][1] / prior[n] for n in told} | {n: 1.0 for n in UNSEEN if n in prior}
    identified = [n for n in told if shares[n] <= IDENTIFIED]
    now, after, rows = airframe, before, 0.0
    solved: dict[str, tuple[float, float]] = {}
    for _ in range(ROUNDS if identified else 0):
        solved, _, rows = _solve(now, airframe, tuning, flights, identified, prior)
        now = replace(airframe, **{n: value for n, (value, _) in solved.items()})
    if identified:
        after = _solve(now, airframe, tuning, flights, identified, prior)[1]
    std = tuning.coefficient_std.copy()
    for n, (value, deviation) in solved.items():
        std[NAMES.index(n)] = max(deviation, LEAST_STD_SHARE * abs(value))
    kept = {n: shares[n] for n in prior if n not in solved}
    return AirframeFit(now, std, tuple(identified), kept, rows, (before, after))


def _solve(
    now: Airframe,
    start: Airframe,
    tuning: WingTuning,
    flights: Sequence[tuple[Array, Array]],
    names: Sequence[str],
    prior: dict[str, float],
) -> tuple[dict[str, tuple[float, float]], float, float]:
    """One round about ``now``: value and deviation per name, scatter before it, rows."""
    parts = [_rows(now, tuning, t, x, names, prior) for t, x in flights]
    y = np.concatenate([p[0] for p in parts])
    A = np.concatenate([p[1] for p in parts])
    if not len(y):
        raise ValueError(
            "the flights have no stretch with all inputs of the wing watch that is long enough"
        )
    off = np.array([(getattr(start, n) - getattr(now, n)) / prior[n] for n in names])
    flat, b = A.reshape(-1, len(names)), y.ravel()
    s2 = kappa = 1.0
    P = np.eye(len(names))
    dc = np.zeros(len(names))
    for _ in range(3):
        weight = 1.0 / (s2 * kappa)
        P = np.linalg.inv(weight * flat.T @ flat + np.eye(len(names)))
        dc = P @ (weight * flat.T @ b + off)
        left = y - A @ dc
        s2 = float(np.mean(left * left))
        r = float(np.sum(left[1:] * left[:-1]) / np.sum(left * left))
        kappa = (1.0 + r) / max(1.0 - r, 0.01)
    out = {
        n: (getattr(now, n) + prior[n] * float(dc[i]), prior[n] * float(np.sqrt(P[i, i])))
        for i, n in enumerate(names)
    }
    return out, float(np.sqrt(np.mean(y * y))), len(y) / kappa


def _rows(
    airframe: Airframe,
    tuning: WingTuning,
    t_s: Array,
    inputs: Array,
    names: Sequence[str],
    prior: dict[str, float],
) -> tuple[Array, Array]:
    """Whitened residuals and regressors of one flight, in units of the prior deviations."""
    c = airframe.row()
    sound = np.isfinite(inputs).all(axis=1)
    t, x = np.ascontiguousarray(t_s[sound]), np.array(inputs[sound], order="C")
    if len(t) < 2:
        return np.empty((0, AXES)), np.empty((0, AXES, len(names)))
    own_wind(c, t, x, tuning.tau_wind_s, np.zeros(WIND_STATE))
    source = WingResiduals(airframe, tau_a_s=LEARN_TIME_S, period_s=tuning.period_s)
    at, y, _ = source.run(t, x)
    if not len(at):
        return np.empty((0, AXES)), np.empty((0, AXES, len(names)))
    index = np.searchsorted(t, at)
    none = np.zeros((len(t), len(FAULTS)))
    phi, moved, filtered = (np.empty((len(t), AXES)) for _ in range(3))
    predict_rows(c, x, none, phi)
    A = np.empty((len(at), AXES, len(names)))
    for k, name in enumerate(names):
        cc = c.copy()
        cc[NAMES.index(name)] += prior[name]
        predict_rows(cc, x, none, moved)
        change = moved - phi
        change[1:] = 0.5 * (change[1:] + change[:-1])
        low_passed(t, change, LEARN_TIME_S, filtered)
        A[:, :, k] = filtered[index]
    keep = at > at[0] + max(SETTLED * LEARN_TIME_S, tuning.tau_wind_s)
    known = np.zeros(len(c))
    y, A, index = y[keep], A[keep], index[keep]
    Q, L = np.empty((AXES, AXES)), np.empty((AXES, AXES))
    for row, i in enumerate(index):
        noise_row(
            c, known, x[i], GUST_SHARE * tuning.gust_m_s, tuning.tas_std_m_s, tuning.tilt_std_rad,
            tuning.share, tuning.floor, Q,
        )  # fmt: skip
        if not cholesky(Q, L):
            raise ValueError("the airframe's model is not finite in these flights")
        factor = np.tril(L, -1) + np.diag(1.0 / np.diag(L))
        y[row] = np.linalg.solve(factor, y[row])
        A[row] = np.linalg.solve(factor, A[row])
    return y, A
