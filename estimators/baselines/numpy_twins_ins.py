"""Plain-numpy twins of the filter bank's kernels: the same mathematics written with dense matrices.

They are the form in which a textbook would state it (Phi as one matrix, expm by its definition, the
Joseph form of the update) and share no code with :mod:`estimators.ins_bank_model`.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "interval_means",
    "rotation",
    "strapdown_step",
    "transition",
    "update",
]

Array = NDArray[np.float64]

EARTH_RATE_RAD_S = 7.292115e-5
EARTH_RADIUS_M = 6371000.0


def cross_matrix(v: Array) -> Array:
    """Matrix of ``v x``, (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation(r: Array) -> Array:
    """Exponential of a rotation vector [rad], by its Taylor series."""
    A, term, out = cross_matrix(r), np.eye(3), np.eye(3)
    for k in range(1, 25):
        term = term @ A / k
        out = out + term
    return out


def strapdown_step(
    v: Array, h: float, R: Array, u: Array, f: Array, lat: float, g: float, dt: float
) -> tuple[Array, float, Array, Array]:
    """One step of the mean: velocity, height, attitude, and the attitude at its middle.

    Parameters
    ----------
    v : (3,) float64 [m/s], h : float [m], R : (3, 3) float64
        State before.
    u, f : (6,) float64 [m/s^2, rad/s]
        Measured inputs and their supposed faults.
    lat, g, dt : float [rad, m/s^2, s]
    """
    earth = EARTH_RATE_RAD_S * np.array([np.cos(lat), 0.0, -np.sin(lat)])
    carried = np.array([v[1], -v[0], -v[1] * np.tan(lat)]) / EARTH_RADIUS_M
    turn = u[3:] - f[3:] - R.T @ (earth + carried)
    middle = R @ rotation(0.5 * dt * turn)
    after = R @ rotation(dt * turn)
    force = middle @ (u[:3] - f[:3])
    v_new = v + dt * (force + np.array([0.0, 0.0, g]) - np.cross(2.0 * earth + carried, v))
    return v_new, h - 0.5 * dt * (v[2] + v_new[2]), after, middle


def transition(T: float, S: Array, G: Array, B: Array, decay: Array) -> Array:
    """Phi of the whole error state over an interval, (17, 17).

    Parameters
    ----------
    T : float [s]
    S : (3,) float64 [m/s], G : (3, 3) float64 [s], B : (3, 3) float64 [m]
        Integrals of the specific force, of R, and of [a]x G.
    decay : (4,) float64
        Factors of the reference errors.
    """
    Phi = np.eye(17)
    v, phi, f_acc, f_gyro = slice(0, 3), slice(4, 7), slice(7, 10), slice(10, 13)
    Phi[v, phi] = -cross_matrix(S)
    Phi[v, f_gyro] = B
    Phi[v, f_acc] = -G
    Phi[phi, f_gyro] = -G
    before, after = np.eye(17)[2], Phi[2].copy()
    Phi[3] = np.eye(17)[3] - 0.5 * T * (before + after)
    Phi[13:17, 13:17] = np.diag(decay)
    return Phi


def update(
    x: Array, P: Array, F: Array, L: Array, y: Array, H: Array, nu: float, r: float
) -> tuple[Array, Array, Array, Array, Array]:
    """One scalar measurement, Joseph form, with one window's signature and information."""
    S = H @ P @ H + r
    K = P @ H / S
    A = np.eye(17) - np.outer(K, H)
    g = H @ F
    return (
        x + K * nu,
        A @ P @ A.T + r * np.outer(K, K),
        A @ F,
        L + np.outer(g, g) / S,
        y + g * nu / S,
    )


def interval_means(t_s: Array, u: Array, edges_s: Array) -> Array:
    """Means of a piecewise linear signal between edges, by integrating its interpolant densely.

    Parameters
    ----------
    t_s : (n,) float64 [s]
    u : (n, 6) float64
    edges_s : (m,) float64 [s]
        Inside the samples' span.

    Returns
    -------
    (m - 1, 6) float64
    """
    out = np.empty((len(edges_s) - 1, u.shape[1]))
    for i, (a, b) in enumerate(pairwise(edges_s)):
        knots = np.unique(np.concatenate([[a, b], t_s[(t_s > a) & (t_s < b)]]))
        values = np.column_stack([np.interp(knots, t_s, u[:, c]) for c in range(u.shape[1])])
        areas = 0.5 * np.diff(knots)[:, None] * (values[1:] + values[:-1])
        out[i] = areas.sum(axis=0) / (b - a)
    return out
