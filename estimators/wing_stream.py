"""Wing faults of a flight as it comes: input rows to estimates with their deviations.

The chain of samar2006 on a stream: slow wind (:mod:`estimators.wing_wind`), residuals and
signatures (:mod:`estimators.wing_residuals`) with the accelerometers' word where there is one
(:mod:`estimators.wing_force`), their covariance (:mod:`estimators.wing_noise`), the
monotone moving horizon on whitened rows (:mod:`estimators.monotone_map`) and the deviations of what
it says (:mod:`estimators.wing_spread`); beside it, whether the airframe is this aircraft's at all
(:mod:`estimators.wing_misfit`). Where the stream is cut changes nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.monotone_map import MapTuning, MonotoneMap
from estimators.wing_force import FORCE_STATE, T_LAST, force_rows
from estimators.wing_misfit import unlike_rows
from estimators.wing_model import AXES, FAULTS, Airframe
from estimators.wing_noise import whiten_rows
from estimators.wing_residuals import WingResiduals
from estimators.wing_spread import spread_rows
from estimators.wing_wind import WIND_STATE, own_wind

__all__ = ["WingRun", "WingStream", "WingTuning"]

Array = NDArray[np.float64]

P = len(FAULTS)


@dataclass(frozen=True, slots=True)
class WingTuning:
    """What the chain is told.

    Attributes
    ----------
    coefficient_std : (41,) float64
        d of :mod:`estimators.wing_noise`.
    gust_m_s, tas_std_m_s, tilt_std_rad, share, floor
        See :func:`estimators.wing_noise.noise_row`.
    tau_wind_s, tau_acc_s, period_s
        tau_w, tau_a and the spacing of estimates.
    contradiction_m_s2
        Largest d of :mod:`estimators.wing_force` at which a row is believed.
    N, lam_percent, R_percent2
        Of the moving horizon.
    """

    coefficient_std: Array
    gust_m_s: float
    tas_std_m_s: float
    tilt_std_rad: float
    share: float
    floor: Array
    tau_wind_s: float
    tau_acc_s: float
    period_s: float
    contradiction_m_s2: float
    N: int
    lam_percent: float
    R_percent2: float


@dataclass(frozen=True, slots=True)
class WingRun:
    """Rows of estimates.

    Attributes
    ----------
    t_s : (n,) float64
    f : (n, 4) float64 [%]
        Order of :data:`estimators.wing_model.FAULTS`.
    std : (n, 6) float64 [%]
        Of the four, and of right minus left: lift, drag. Of what changes from row to row alone.
    lasting : (n, 2) float64 [%]
        Deviation of these differences from coefficients that are off: it does not average out.
    trusted : (n,) bool
        Accelerometers and velocity agree; the other rows have not been used.
    unlike : (n,) float64
        Residual that no difference between the wings explains (:mod:`estimators.wing_misfit`); NaN
        in a row that was not used.
    """

    t_s: Array
    f: Array
    std: Array
    lasting: Array
    trusted: NDArray[np.bool_]
    unlike: Array


class WingStream:
    """One flight's estimate of four wing faults.

    Parameters
    ----------
    airframe, tuning
    """

    def __init__(self, airframe: Airframe, tuning: WingTuning) -> None:
        self._c, self._tuning = airframe.row(), tuning
        self._residuals = WingResiduals(
            airframe, tau_a_s=tuning.tau_acc_s, period_s=tuning.period_s
        )
        self._wind = np.zeros(WIND_STATE)
        self._force = np.zeros(FORCE_STATE)
        self._force[T_LAST] = np.nan
        self._map = MonotoneMap(
            MapTuning(
                np.eye(AXES),
                np.full(P, tuning.lam_percent),
                tuning.R_percent2 * np.eye(P),
                tuning.N,
            )
        )
        r = math.exp(-tuning.period_s / tuning.tau_acc_s)
        self._kappa = (1.0 + r) / (1.0 - r)
        self._ring, self._count = np.zeros((tuning.N, P, P)), np.zeros(1)
        self._first_s = math.nan

    def run(self, t_s: Array, x: Array, acc: Array) -> WingRun:
        """Take input rows in order; the wind's columns are filled in.

        Parameters
        ----------
        t_s : (n,) float64
        x : (n, INPUTS) float64
            See :func:`estimators.wing_model.inputs_of`; a row without an airspeed is passed over.
        acc : (n, 3) float64 [m/s^2]
            Mean specific force since the row before, NaN where none is measured.
        """
        tuning = self._tuning
        t, x = np.ascontiguousarray(t_s), np.array(x, order="C")
        own_wind(self._c, t, x, tuning.tau_wind_s, self._wind)
        x[np.isnan(x[:, 17]), 0] = np.nan
        at, y, S = self._residuals.run(t, x)
        d = np.empty((len(t), 3))
        force_rows(t, x, np.ascontiguousarray(acc), tuning.tau_acc_s, self._force, d)
        index = np.searchsorted(t, at)
        y[:, :3] += d[index]
        trusted = np.abs(d[index]).max(axis=1, initial=0.0) <= tuning.contradiction_m_s2
        inputs = np.ascontiguousarray(x[index])
        lasting = np.empty((len(at), 2))
        whiten_rows(
            self._c, tuning.coefficient_std, inputs, tuning.gust_m_s, tuning.tas_std_m_s,
            tuning.tilt_std_rad, tuning.share, tuning.floor, y, S, lasting,
        )  # fmt: skip
        # what the horizon does not use must not narrow the deviations either
        unused = ~(trusted & np.isfinite(y).all(axis=1))
        y[unused], S[unused] = np.nan, np.nan
        if len(at) and math.isnan(self._first_s):
            self._first_s = float(at[0])
        # residuals and signatures begin at zero and the wind with the first row's: left out
        keep = at >= self._first_s + 2.0 * max(tuning.tau_acc_s, tuning.tau_wind_s)
        at, trusted, lasting, y, S = (
            at[keep],
            trusted[keep],
            lasting[keep],
            np.ascontiguousarray(y[keep]),
            np.ascontiguousarray(S[keep]),
        )
        std = np.empty((len(at), P + 2))
        spread_rows(S, self._kappa, self._ring, self._count, std)
        unlike = np.empty(len(at))
        unlike_rows(y, S, unlike)
        f = self._map.run(y, S).f if len(at) else np.empty((0, P))
        return WingRun(at, f, std, lasting, trusted, unlike)
