"""Plain numpy twins of the air data kernels: the equations as the paper writes them.

Nothing here is compiled and no care is taken of speed; the tests hold every kernel of
:mod:`estimators.air_data_2d`, :mod:`estimators.mhe` and :mod:`estimators.air_data_mhe` to these.
Symbols are those of the kernels' modules.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "barrier_qp",
    "fuse",
    "kkt_step",
    "linearise",
    "mhe_step",
    "outputs",
    "residual_rms",
    "transition",
]

Array = NDArray[np.float64]

G0, R_AIR, GAMMA, T0, LAPSE = 9.80665, 287.05287, 1.4, 288.15, -6.5e-3


def calibrated_airspeed(V_t: Any, z: float) -> Any:
    """(16) in the standard atmosphere."""
    T = T0 + LAPSE * z
    p_bar = (1.0 + LAPSE / T0 * z) ** (G0 / (-R_AIR * LAPSE))
    rho = ((1.0 + V_t**2 / (5.0 * GAMMA * R_AIR * T)) ** 3.5 - 1.0) * p_bar + 1.0
    return np.sqrt(5.0 * GAMMA * R_AIR * T0) * np.sqrt(rho ** (1.0 / 3.5) - 1.0)


def true_airspeed(model: int, x: Array, theta: Array) -> Any:
    """(10), or (11) for the approximate model."""
    s, c = np.sin(x[0] - theta[1]), np.cos(x[0] - theta[1])
    a, b = x[2] * c + x[3] * s, x[2] * s - x[3] * c
    return theta[0] - a if model == 0 else np.sqrt(theta[0] ** 2 - b**2) - a


def outputs(model: int, x: Array, theta: Array) -> Array:
    """(20d): [V_g, V_z, alpha, V_c]."""
    V_t = true_airspeed(model, x, theta)
    s = np.sin(x[0] - theta[1])
    along = theta[0] if model == 0 else V_t
    return np.array([x[1], along * s + x[3], x[0], calibrated_airspeed(V_t, theta[5])])


def transition(model: int, x: Array, u: Array, theta: Array, t_s: float) -> Any:
    """(20a)-(20c), with (13)-(14) or (8)-(9)."""
    V_g, pitch, q, A_x, A_z, _ = theta
    alpha, _, W_x, W_z = x

    def f_alpha(angle: Any) -> Any:
        return -A_x * np.sin(angle) + A_z * np.cos(angle) + G0 * np.cos(angle - pitch)

    def f_v(angle: Any) -> Any:
        return A_x * np.cos(angle) + A_z * np.sin(angle) + G0 * np.sin(angle - pitch)

    if model == 0:
        rate = np.array([f_alpha(alpha) / V_g + q, f_v(alpha), 0.0, 0.0])
    else:
        s, c = np.sin(alpha - pitch), np.cos(alpha - pitch)
        V_t = true_airspeed(model, x, theta)
        alpha_g = alpha - np.arcsin((W_x * s - W_z * c) / V_g)
        own_wind = (u[2] * s - u[3] * c) / V_t
        rate = np.array([f_alpha(alpha) / V_t + q + own_wind, f_v(alpha_g), 0.0, 0.0])
    return x + t_s * (rate + u)


def linearise(
    model: int, x: Array, u: Array, theta: Array, t_s: float
) -> tuple[Array, Array, Array, Array, Array]:
    """F, A, B, h, C by complex steps of 1e-30: exact to rounding without any differentiation."""
    d = 1e-30j
    eye = np.eye(4)

    def F(x: Any, u: Any) -> Any:
        return transition(model, x, u, theta, t_s)

    A = np.column_stack([F(x + d * e, u + 0j).imag / 1e-30 for e in eye])
    B = np.column_stack([F(x + 0j, u + d * e).imag / 1e-30 for e in eye])
    C = np.column_stack([outputs(model, x + d * e, theta).imag / 1e-30 for e in eye])
    return F(x, u), A, B, outputs(model, x, theta), C


def kkt_step(
    P: Array, Q: Array, R: Array, A: Array, B: Array, C: Array, f: Array, rx: Array, ru: Array,
    ry: Array, x: Array, u: Array, gx: Array, Dx: Array, gu: Array, Du: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Algorithm 2 with (46), line by line.

    A barrier row whose second derivative is zero is left out; so is an unused measurement's row.
    """
    N, n = x.shape
    P_hat = P
    rp = np.array([-f[i] - A[i] @ x[i] - B[i] @ u[i] + x[i + 1] for i in range(N - 1)])
    Q_bar = [np.diag(1.0 / (1.0 / Q + Du[i])) for i in range(N - 1)]
    keep = []
    d_hat = rx - x[0]
    for i in range(N):
        on = Dx[i] > 0.0
        L = np.sqrt(Dx[i][on])
        C_bar = np.vstack([C[i], np.diag(np.sqrt(Dx[i]))[on]])
        r_bar = np.concatenate([ry[i] - C[i] @ x[i], -gx[i][on] / L])
        R_bar = np.diag(np.concatenate([R, np.ones(on.sum())]))
        Pi = C_bar @ P_hat
        Xi = np.linalg.inv(R_bar + Pi @ C_bar.T)
        Omega = C_bar.T @ Xi
        K = P_hat @ Omega
        P_f = P_hat - K @ Pi
        r = r_bar - C_bar @ d_hat
        d_prime = d_hat + K @ r
        keep.append((Omega, Pi, P_f, r, d_prime))
        if i < N - 1:
            P_hat = A[i] @ P_f @ A[i].T + B[i] @ Q_bar[i] @ B[i].T
            u_prime = Q_bar[i] @ ((ru[i] - u[i]) / Q - gu[i])
            d_hat = -rp[i] + A[i] @ d_prime + B[i] @ u_prime
    dx, du = np.zeros((N, n)), np.zeros((N - 1, Q.size))
    Omega, Pi, P_f, r, d_prime = keep[-1]
    dx[-1] = d_prime
    lam = -Omega @ r
    for i in range(N - 2, -1, -1):
        Omega, Pi, P_f, r, d_prime = keep[i]
        xi = A[i].T @ lam
        u_prime = Q_bar[i] @ ((ru[i] - u[i]) / Q - gu[i])
        du[i] = u_prime - Q_bar[i] @ B[i].T @ lam
        dx[i] = d_prime - P_f @ xi
        lam = xi - Omega @ (r + Pi @ xi)
    return dx, du


def barrier_qp(
    P: Array, Q: Array, R: Array, A: Array, B: Array, C: Array, f: Array, rx: Array, ru: Array,
    ry: Array, xl: Array, xu: Array, ul: Array, uu: Array, kappa: float, n_kappa: int, n_qp: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Algorithm 1 from a start strictly inside the bounds."""
    x, u = np.zeros(xl.shape), np.zeros(ul.shape)

    def inside(x: Array, u: Array) -> bool:
        return bool((xl < x).all() and (x < xu).all() and (ul < u).all() and (u < uu).all())

    for j in range(n_kappa * n_qp):
        gx = kappa * (1.0 / (xu - x) - 1.0 / (x - xl))
        Dx = kappa * (1.0 / (xu - x) ** 2 + 1.0 / (x - xl) ** 2)
        gu = kappa * (1.0 / (uu - u) - 1.0 / (u - ul))
        Du = kappa * (1.0 / (uu - u) ** 2 + 1.0 / (u - ul) ** 2)
        dx, du = kkt_step(P, Q, R, A, B, C, f, rx, ru, ry, x, u, gx, Dx, gu, Du)
        s = 1.0
        while not inside(x + s * dx, u + s * du):
            s *= 0.5
            if s < 2.0**-30:
                return x, u
        x, u = x + s * dx, u + s * du
        if (j + 1) % n_qp == 0:
            kappa *= 0.1
    return x, u


def mhe_step(
    model: int, t_s: float, tuning: Array, kappa: float, n_kappa: int, n_qp: int, x_prior: Array,
    x: Array, u: Array, y: Array, use: Array, theta: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """One SQP iteration (42) of a horizon; the improved x and u."""
    N = len(x)
    P, Q, R, xl, xu, ul, uu = tuning
    stages = [linearise(model, x[i], u[min(i, N - 2)], theta[i], t_s) for i in range(N)]
    f = np.array([stages[i][0] - x[i + 1] for i in range(N - 1)])
    A = np.array([s[1] for s in stages[:-1]])
    B = np.array([s[2] for s in stages[:-1]])
    ry = use * (y - np.array([s[3] for s in stages]))
    C = use[:, :, None] * np.array([s[4] for s in stages])
    dx, du = barrier_qp(
        np.diag(P), Q, R, A, B, C, f, x_prior - x[0], -u, ry,
        xl - x, xu - x, ul - u, uu - u, kappa, n_kappa, n_qp,
    )  # fmt: skip
    return x + dx, u + du


def residual_rms(residuals: Array) -> float:
    """(18) over the residuals given."""
    return float(np.sqrt(np.mean(residuals**2)))


def fuse(value: Array, J: Array, use: Array, M: Array) -> tuple[float, float, bool]:
    """(19) over the sensors in use: fused value, equally weighted M, whether there is any."""
    on = use == 1.0
    if not on.any():
        return 0.0, 0.0, False
    beta = 1.0 / J[on] ** 2
    beta /= beta.sum()
    return float(beta @ value[on]), float(beta @ M[on]), True
