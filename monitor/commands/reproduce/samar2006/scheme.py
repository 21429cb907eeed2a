"""The paper's scheme put together: a flight and a belief about the aircraft in, faults out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.monotone_map import CONTINUED, MapTuning, MonotoneMap, Run
from estimators.wing_faults import (
    EXTRA,
    LAM_PERCENT,
    R_PERCENT2,
    WINDOW,
    residual_covariance,
)
from estimators.wing_model import AERODYNAMIC, Airframe, inputs_of
from estimators.wing_residuals import WingResiduals, low_passed
from links.airframes import load_airframe
from sim_feeds.papers.samar2006 import fly, plan, wrong_numbers
from sim_feeds.sixdof import SixDofFlight

__all__ = [
    "ALARM_MODELS",
    "MODELS",
    "RIGHT",
    "Residuals",
    "Scheme",
    "airframe",
    "covariance_rows",
    "estimate",
    "inputs_from",
    "residuals_of",
    "tuned",
]

Array = NDArray[np.float64]

RIGHT: Final = "right"
"""The prediction model with the coefficients that the aircraft has."""
MODELS: Final = (RIGHT, *(str(seed) for seed in plan().models["reported"]))
ALARM_MODELS: Final = (RIGHT, *(str(seed) for seed in plan().models["alarm"]))
SETTLED_S: Final = 8.0
"""Two time constants of F_a: earlier rows are not used."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """Settings of the scheme; the defaults are the paper's, but for the prior and Q.

    Attributes
    ----------
    tau_wind_s, tau_acc_s
        Of F(s) and F_a(s).
    period_s, N
        Rows: their spacing and how many the window holds.
    extra
        Share of Q's diagonal that is added; None keeps nothing but the diagonal.
    lam_percent, R_percent2, prior
        Of the monotone estimator.
    frozen
        Signatures as they are when the window is first full, kept for the flight.
    airspeed
        True airspeed is measured, without error.
    """

    tau_wind_s: float = 10.0
    tau_acc_s: float = 4.0
    period_s: float = 0.5
    N: int = WINDOW
    extra: float | None = EXTRA
    lam_percent: float = LAM_PERCENT
    R_percent2: float = R_PERCENT2
    prior: int = CONTINUED
    frozen: bool = False
    airspeed: bool = False


@dataclass(frozen=True, slots=True)
class Residuals:
    """Rows of one flight: t_s (n,), y (n, 6), S (n, 6, 4)."""

    t_s: Array
    y: Array
    S: Array


@cache
def airframe(model: str) -> Airframe:
    """The aircraft as a model believes it to be."""
    seed = None if model == RIGHT else int(model)
    return Airframe.of(wrong_numbers(load_airframe("aerosonde"), AERODYNAMIC, seed))


def inputs_from(flight: SixDofFlight, wind_ned_m_s: Array, scheme: Scheme) -> Array:
    """Input rows of the prediction model for a flight, with the wind as it is known."""
    return inputs_of(
        euler_rad=flight.euler_rad,
        vel_ned_m_s=flight.vel_ned_m_s,
        rate_rad_s=flight.rate_rad_s,
        surfaces_rad=np.column_stack([flight.elevator_rad, flight.aileron_rad, flight.rudder_rad]),
        prop_rad_s=flight.prop_rad_s,
        wind_ned_m_s=wind_ned_m_s,
        density_kg_m3=flight.density_kg_m3,
        height_m=flight.height_m,
        tas_m_s=flight.tas_m_s if scheme.airspeed else None,
    )


def residuals_of(flight: SixDofFlight, model: str, scheme: Scheme) -> Residuals:
    """Residuals and signatures of a flight."""
    wind = np.empty_like(flight.wind_ned_m_s)
    low_passed(flight.t_s, flight.wind_ned_m_s, scheme.tau_wind_s, wind)
    source = WingResiduals(airframe(model), tau_a_s=scheme.tau_acc_s, period_s=scheme.period_s)
    t, y, S = source.run(flight.t_s, inputs_from(flight, wind, scheme))
    keep = t > SETTLED_S
    return Residuals(t[keep], y[keep], S[keep])


@cache
def covariance_rows(model: str, scheme: Scheme) -> Array:
    """Residuals of the healthy flights that Q is taken from, one below the other."""
    seeds = plan().seeds["covariance"]
    return np.vstack([residuals_of(fly(seed), model, scheme).y for seed in seeds])


def tuned(model: str, scheme: Scheme) -> MapTuning:
    """The estimator's tuning for a model."""
    data = replace(
        Scheme(),
        tau_wind_s=scheme.tau_wind_s,
        tau_acc_s=scheme.tau_acc_s,
        period_s=scheme.period_s,
        airspeed=scheme.airspeed,
    )
    Q = residual_covariance(covariance_rows(model, data), scheme.extra or 0.0)
    if scheme.extra is None:
        Q = np.diag(np.diag(Q))
    four = np.full(4, scheme.lam_percent)
    return MapTuning(Q, four, scheme.R_percent2 * np.eye(4), scheme.N, scheme.prior)


def estimate(rows: Residuals, model: str, scheme: Scheme) -> Run:
    """Faults at each row, in %."""
    S = rows.S
    if scheme.frozen:
        S = np.broadcast_to(S[min(scheme.N, len(S) - 1)], S.shape)
    return MonotoneMap(tuned(model, scheme)).run(rows.y, S)
