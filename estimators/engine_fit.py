"""The single-shaft engine model from healthy flights: output-error least squares.

The model's own speed, driven by throttle and airspeed alone, is fitted to the readings; a fit of
one step ahead would learn that a speed is like the speed before and little of the throttle. For a
time constant tau the inputs phi pass a lag of first order, and the coefficients c follow linearly;
tau is searched. What is left over is split by its memory: white noise of the channel, and the
model's error that lasts.

=======  ================================================================  =========  =====
symbol   meaning                                                           shape      unit
=======  ================================================================  =========  =====
phi      inputs of :func:`estimators.engine_model.features`                (K, 5)
c        coefficients                                                      (5,)       rpm
e        reading less model                                                           rpm
g_k      autocovariance of e, k readings apart                                        rpm^2
=======  ================================================================  =========  =====

With e = error + noise, the error of memory T: g_0 = sigma^2 + r, g_k = sigma^2 exp(-k dt / T), so
that g_1 and g_2 give sigma and T, and g_0 the rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.engine_model import N_FEATURES, features
from estimators.jit import kernel

__all__ = ["Fit", "Record", "fit_single_shaft", "simulate"]

Array = NDArray[np.float64]

TIME_CONSTANTS_S = np.geomspace(0.03, 8.0, 25)
CHOICES = ((0, 1), (0, 1, 2), (0, 1, 3), (0, 1, 2, 3), (0, 1, 2, 3, 4))
"""Sets of inputs that are tried, simplest first; a richer one must predict other flights better."""
GAIN = 0.97
"""By so much its error must be smaller."""
HUBER = 3.0
TAIL = 0.995
TAIL_SIGMAS = 3.0
"""Errors have longer tails than a normal distribution: their 99.5 % is taken for so many sigma."""
SHORTEST_S, LONGEST_S = 0.3, 30.0


@dataclass(frozen=True, slots=True)
class Record:
    """One shaft on one flight, at the steps of a grid.

    Attributes
    ----------
    throttle, airspeed_m_s : (K,) float64 [1], [m/s]
    y : (K, m) float64 [rpm]
        Readings of its channels, NaN where none came.
    """

    throttle: Array
    airspeed_m_s: Array
    y: Array


@dataclass(frozen=True, slots=True)
class Fit:
    """What the flights say.

    Attributes
    ----------
    time_constant_s, coefficients
        tau [s] and c (5,).
    error_rpm, error_time_s
        sigma [rpm] and T [s] of the model's error.
    noise_rpm : (m,) float64
        Of each channel [rpm].
    rms_rpm
        Error of the model on its own [rpm].
    explained
        Share of the readings' variance that it explains.
    crossed_rpm
        The same on flights that it was not fitted to; NaN with one flight.
    """

    time_constant_s: float
    coefficients: tuple[float, ...]
    error_rpm: float
    error_time_s: float
    noise_rpm: Array
    rms_rpm: float
    explained: float
    crossed_rpm: float


@kernel
def lag(phi: Array, alpha: float) -> Array:
    """First-order lag of each column, beginning settled; NaN inputs hold the last finite ones."""
    out = np.empty_like(phi)
    for i in range(phi.shape[1]):
        last, state = np.nan, np.nan
        for k in range(phi.shape[0]):
            if math.isfinite(phi[k, i]):
                last = phi[k, i]
            state = last if math.isnan(state) else alpha * state + (1.0 - alpha) * last
            out[k, i] = state
    return out


def simulate(record: Record, time_constant_s: float, coefficients: Array, tick_s: float) -> Array:
    """The model's speed at each step, (K,) float64 [rpm]; readings are not used."""
    phi = features(record.throttle, record.airspeed_m_s)
    return np.asarray(lag(phi, math.exp(-tick_s / time_constant_s)) @ coefficients)


def fit_single_shaft(records: Sequence[Record], tick_s: float) -> Fit:
    """Fit the model to the shafts of one kind of engine.

    Parameters
    ----------
    records
        Of healthy flights, all with the same channels.
    tick_s
        Step of the records [s].

    Raises
    ------
    ValueError
        There are too few readings, or the throttle hardly moves.
    """
    readings = sum(int(np.isfinite(r.y).sum()) for r in records)
    if readings < 20 * N_FEATURES:
        raise ValueError(f"{readings} readings of engine speed in flight are too few")
    throttle = np.concatenate([r.throttle for r in records])
    if np.nanstd(throttle) < 0.02:
        raise ValueError("the throttle hardly moves in these flights")
    chosen = _choose(records, tick_s)
    tau, c = _fit(records, tick_s, chosen)
    errors = [_errors(r, tau, c, tick_s) for r in records]
    y = np.concatenate([r.y[np.isfinite(r.y)] for r in records])
    e = np.concatenate([x[np.isfinite(x)] for x in errors])
    sigma, memory_s, noise = _split(errors, tick_s)
    return Fit(
        tau,
        tuple(float(v) for v in c),
        sigma,
        memory_s,
        noise,
        float(np.sqrt(np.mean(e * e))),
        float(1.0 - np.var(e) / np.var(y)),
        _crossed(records, tick_s, chosen),
    )


def _errors(record: Record, tau: float, c: Array, tick_s: float) -> Array:
    """Reading less model, (K, m)."""
    return record.y - simulate(record, tau, c, tick_s)[:, None]


def _choose(records: Sequence[Record], tick_s: float) -> tuple[int, ...]:
    """Inputs that predict what was not fitted; half flights where there is one alone."""
    if len(records) == 1:
        half = len(records[0].y) // 2
        r = records[0]
        records = [
            Record(r.throttle[part], r.airspeed_m_s[part], r.y[part])
            for part in (slice(None, half), slice(half, None))
        ]
    best: tuple[int, ...] = CHOICES[0]
    least = math.inf
    for chosen in CHOICES:
        error = _crossed(records, tick_s, chosen)
        if error < GAIN * least:
            best, least = chosen, error
    return best


def _crossed(records: Sequence[Record], tick_s: float, chosen: tuple[int, ...]) -> float:
    """Root mean square error on each record of the model fitted to the others [rpm]."""
    if len(records) < 2:
        return math.nan
    total, n = 0.0, 0
    for i, left in enumerate(records):
        tau, c = _fit([r for k, r in enumerate(records) if k != i], tick_s, chosen)
        e = _errors(left, tau, c, tick_s)
        e = e[np.isfinite(e)]
        total, n = total + float(e @ e), n + len(e)
    return math.sqrt(total / max(n, 1))


def _fit(records: Sequence[Record], tick_s: float, chosen: tuple[int, ...]) -> tuple[float, Array]:
    """The best tau, and c over all inputs with zeros for those not chosen."""
    columns = list(chosen)
    best = (math.inf, TIME_CONSTANTS_S[0], np.zeros(N_FEATURES))
    inputs = [features(r.throttle, r.airspeed_m_s)[:, columns] for r in records]
    for tau in TIME_CONSTANTS_S:
        rows, targets = [], []
        for record, phi in zip(records, inputs, strict=True):
            slow = lag(np.ascontiguousarray(phi), math.exp(-tick_s / tau))
            for y in record.y.T:
                there = np.isfinite(y) & np.isfinite(slow).all(axis=1)
                rows.append(slow[there])
                targets.append(y[there])
        A, y = np.concatenate(rows), np.concatenate(targets)
        if len(y) < N_FEATURES:
            raise ValueError(
                "engine speeds come with throttle and airspeed in a part of these flights only"
            )
        scale = np.maximum(np.abs(A).max(axis=0), 1e-9)
        weight = np.ones(len(y))
        for _ in range(3):
            root = np.sqrt(weight)[:, None]
            c = np.linalg.lstsq(root * A / scale, root[:, 0] * y, rcond=1e-8)[0] / scale
            e = y - A @ c
            limit = HUBER * 1.4826 * float(np.median(np.abs(e))) + 1e-9
            weight = np.minimum(1.0, limit / np.maximum(np.abs(e), 1e-12))
        cost = float(np.sum(np.where(np.abs(e) < limit, e * e, limit * (2.0 * abs(e) - limit))))
        if cost < best[0]:
            full = np.zeros(N_FEATURES)
            full[columns] = c
            best = (cost, float(tau), full)
    return best[1], best[2]


def _split(errors: Sequence[Array], tick_s: float) -> tuple[float, float, Array]:
    """Sigma and T of the model's error, noise of each channel."""
    g = np.zeros((3, errors[0].shape[1]))
    n = np.zeros_like(g)
    spacing: list[float] = []
    for e in errors:
        for i in range(e.shape[1]):
            at = np.flatnonzero(np.isfinite(e[:, i]))
            spacing += [float(np.median(np.diff(at))) * tick_s] if len(at) > 2 else []
            x = e[at, i]
            for k in range(3):
                g[k, i] += float(x[k:] @ x[: len(x) - k])
                n[k, i] += len(x) - k
    g /= np.maximum(n, 1.0)
    dt = float(np.median(spacing))
    shared = g.mean(axis=1)
    rho = shared[2] / shared[1] if shared[1] > 0.0 else 0.0
    rho = min(max(rho, math.exp(-dt / SHORTEST_S)), math.exp(-dt / LONGEST_S))
    memory_s = -dt / math.log(rho)
    sigma2 = max(shared[1] / rho, 0.0)
    floor = 1e-3 * float(np.nanmax(np.sqrt(g[0]))) ** 2
    noise = np.sqrt(np.maximum(g[0] - sigma2, floor))
    e = np.concatenate([x[np.isfinite(x)] for x in errors])
    tail = float(np.quantile(np.abs(e - np.median(e)), TAIL)) / TAIL_SIGMAS
    return max(math.sqrt(sigma2), tail), memory_s, noise
