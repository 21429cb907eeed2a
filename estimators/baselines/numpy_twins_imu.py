"""Plain-numpy twins of the IMU kernels: the same equations, written for the eye.

The tests hold the compiled kernels against these line by line, and ``mavsentry bench`` measures
how much the kernels gain. Matrix products stand where the paper has matrix products; nothing here
is compiled, and nothing is slower than numpy makes it. The symbols are those of
:mod:`estimators.kinematics` and :mod:`estimators.two_stage_ekf`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.kinematics import ACC, ANGLES, AS, GS, GYRO, VELOCITY
from estimators.two_stage_ekf import Settings

__all__ = ["TwinTwoStage", "discretise", "linearise", "output", "output_jacobian", "rates"]

Array = NDArray[np.float64]
Earth = tuple[float, float, float, float]

EARTH_RATE = 7.2921e-5
EARTH_RADIUS = 6_367_000.0


def earth_terms(lat: float, alt: float) -> Earth:
    """(g, R_e + h, sin, cos of the latitude), lu2016 eq. (12)."""
    s, c = math.sin(lat), math.cos(lat)
    g = 9.780318 * (EARTH_RADIUS / (EARTH_RADIUS + alt)) ** 2
    return g * (1 + 5.3024e-3 * s**2 - 5.9e-6 * (2 * s * c) ** 2), EARTH_RADIUS + alt, s, c


def _trig(x: Array) -> tuple[float, float, float, float, float, float]:
    phi, theta, psi = x[3], x[4], x[5]
    return (
        math.sin(phi),
        math.cos(phi),
        math.sin(theta),
        math.cos(theta),
        math.sin(psi),
        math.cos(psi),
    )


def _euler_rate_matrix(sp: float, cp: float, st: float, ct: float) -> Array:
    """(phi', theta', psi') = W (p, q, r)."""
    tt = st / ct
    return np.array([[1.0, sp * tt, cp * tt], [0.0, cp, -sp], [0.0, sp / ct, cp / ct]])


def _ned_from_frd(sp: float, cp: float, st: float, ct: float, ss: float, cs: float) -> Array:
    return np.array(
        [
            [ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss],
            [ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs],
            [-st, sp * ct, cp * ct],
        ]
    )


def _skew(v: Array) -> Array:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rates(model: int, x: Array, u: Array, earth: Earth) -> Array:
    """Rates of change f(x, u), lu2016 eq. (11) corrected, (18)."""
    g, radius, sd, cd = earth
    sp, cp, st, ct, ss, cs = _trig(x)
    dx = np.empty(6)
    W = _euler_rate_matrix(sp, cp, st, ct)
    if model == AS:
        ua, va, wa = x[VELOCITY]
        p, q, r = u[GYRO]
        down = np.array([-st, sp * ct, cp * ct])
        turning = np.array([va * r - wa * q, wa * p - ua * r, ua * q - va * p])
        dx[VELOCITY] = u[ACC] + turning + g * down
        dx[ANGLES] = W @ u[GYRO]
        return dx
    R = _ned_from_frd(sp, cp, st, ct, ss, cs)
    UN, UE, UD = x[VELOCITY]
    td = sd / cd
    earth_n, earth_d = EARTH_RATE * cd, -EARTH_RATE * sd
    transport_n, transport_e, transport_d = UE / radius, -UN / radius, -UE * td / radius
    # Coriolis: -(2 w_earth + w_transport) x U, and gravity
    wn, we, wd = 2 * earth_n + transport_n, transport_e, 2 * earth_d + transport_d
    coriolis = np.array([wd * UE - we * UD, wn * UD - wd * UN, we * UN - wn * UE + g])
    dx[VELOCITY] = R @ u[ACC] + coriolis
    w_level = np.array([earth_n + transport_n, transport_e, earth_d + transport_d])
    dx[ANGLES] = W @ (u[GYRO] - R.T @ w_level)
    return dx


def linearise(model: int, x: Array, u: Array, earth: Earth) -> tuple[Array, Array]:
    """F = df/dx and G = -df/du, lu2016 eq. (34), (13), (19)."""
    g, radius, sd, cd = earth
    sp, cp, st, ct, ss, cs = _trig(x)
    tt = st / ct
    q, r = u[4:]
    F, G = np.zeros((6, 6)), np.zeros((6, 6))
    pitch_rate, side_rate = q * cp - r * sp, q * sp + r * cp
    F[ANGLES, ANGLES] = [
        [pitch_rate * tt, side_rate / ct**2, 0.0],
        [-side_rate, 0.0, 0.0],
        [pitch_rate / ct, side_rate * tt / ct, 0.0],
    ]
    G[ANGLES, GYRO] = -_euler_rate_matrix(sp, cp, st, ct)
    if model == AS:
        F[VELOCITY, VELOCITY] = -_skew(u[GYRO])
        F[VELOCITY, ANGLES] = [
            [0.0, -g * ct, 0.0],
            [g * ct * cp, -g * st * sp, 0.0],
            [-g * ct * sp, -g * st * cp, 0.0],
        ]
        G[VELOCITY, ACC] = -np.eye(3)
        G[VELOCITY, GYRO] = -_skew(x[VELOCITY])
        return F, G
    R = _ned_from_frd(sp, cp, st, ct, ss, cs)
    Ax, Ay, Az = u[ACC]
    UN, UE, UD = x[VELOCITY]
    td = sd / cd
    omega2 = 2 * EARTH_RATE
    side = sp * Ay + cp * Az
    a_n, a_e, _ = R @ u[ACC]
    F[VELOCITY, 3] = Ay * R[:, 2] - Az * R[:, 1]
    F[VELOCITY, 4] = [
        (ct * side - st * Ax) * cs,
        (ct * side - st * Ax) * ss,
        -ct * Ax - st * side,
    ]
    F[VELOCITY, 5] = [-a_e, a_n, 0.0]
    F[VELOCITY, VELOCITY] = [
        [UD / radius, -2 * UE * td / radius - omega2 * sd, UN / radius],
        [UE * td / radius + omega2 * sd, (UN * td + UD) / radius, UE / radius + omega2 * cd],
        [-2 * UN / radius, -2 * UE / radius - omega2 * cd, 0.0],
    ]
    w_n, w_e = UE / radius + EARTH_RATE * cd, UN / radius
    across, along = w_e * ss - w_n * cs, w_e * cs + w_n * ss
    F[ANGLES, VELOCITY] = [
        [ss / (radius * ct), -cs / (radius * ct), 0.0],
        [cs / radius, ss / radius, 0.0],
        [tt * ss / radius, (td - tt * cs) / radius, 0.0],
    ]
    F[ANGLES, ANGLES] += [
        [0.0, across * tt / ct, along / ct],
        [0.0, 0.0, -across],
        [0.0, across / ct**2, along * tt],
    ]
    G[VELOCITY, ACC] = -R
    return F, G


def output(model: int, x: Array) -> Array:
    """h(x), lu2016 eq. (14), (20)."""
    if model == GS:
        return x.copy()
    V = math.sqrt(x[VELOCITY] @ x[VELOCITY])
    return np.array([V, math.atan2(x[2], x[0]), math.asin(x[1] / V), *x[ANGLES]])


def output_jacobian(model: int, x: Array) -> Array:
    """H = dh/dx, lu2016 eq. (35)."""
    H = np.eye(6)
    if model == AS:
        ua, va, wa = x[VELOCITY]
        plane = math.hypot(ua, wa)
        V = math.hypot(plane, va)
        H[VELOCITY, VELOCITY] = [
            [ua / V, va / V, wa / V],
            [-wa / plane**2, 0.0, ua / plane**2],
            [-ua * va / (V**2 * plane), plane / V**2, -va * wa / (V**2 * plane)],
        ]
    return H


def discretise(F: Array, G: Array, dt: float) -> tuple[Array, Array]:
    """Phi and Gamma from the exponential of [[F, G], [0, 0]] dt, twelve terms, (33)-(34)."""
    A = np.zeros((12, 12))
    A[:6, :6], A[:6, 6:] = F * dt, G * dt
    term = np.eye(12)
    total = np.eye(12)
    for n in range(1, 13):
        term = term @ A / n
        total += term
    return total[:6, :6], total[:6, 6:]


def rk4(model: int, x: Array, u: Array, earth: Earth, dt: float) -> Array:
    """One classical Runge-Kutta step with a held input."""
    k1 = rates(model, x, u, earth)
    k2 = rates(model, x + 0.5 * dt * k1, u, earth)
    k3 = rates(model, x + 0.5 * dt * k2, u, earth)
    k4 = rates(model, x + dt * k3, u, earth)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _wrapped(innovation: Array) -> Array:
    innovation[ANGLES] -= 2 * math.pi * np.ceil((innovation[ANGLES] - math.pi) / (2 * math.pi))
    return innovation


@dataclass
class TwinTwoStage:
    """Adaptive two-stage EKF at a fixed rate, lu2016 eq. (31)-(58); see ``two_stage_ekf``.

    Only the fixed-rate form: every prediction is followed by a complete measurement.
    """

    model: int
    exact: bool
    adapt: bool
    divide_by_dt: bool
    detuning: float | None
    x: Array
    P: Array
    Pf: Array
    Qf: Array
    Q: Array
    R: Array
    N: int
    Qf_floor: float
    k: int = 0

    def __post_init__(self) -> None:
        self.f = np.zeros(6)
        self.xbar = self.x.copy()
        self.V = np.zeros((6, 6))
        self.window: deque[Array] = deque(maxlen=self.N)

    @classmethod
    def like(cls, settings: Settings, x: Array, P: Array) -> TwinTwoStage:
        """The twin of ``TwoStageFilter(settings, x, P)``."""
        t = settings.tuning()[0]
        return cls(
            model=settings.model,
            exact=settings.mode == "exact",
            adapt=settings.adapt,
            divide_by_dt=settings.divide_by_dt,
            detuning=settings.detuning,
            x=np.array(x),
            P=np.array(P),
            Pf=np.diag(settings.fault_var),
            Qf=np.diag(settings.fault_walk_var),
            Q=np.diag(t["Q"]),
            R=np.diag(t["R"]),
            N=settings.window,
            Qf_floor=settings.fault_walk_floor,
        )

    def predict(self, um: Array, env: Array, dt: float) -> None:
        """(31)-(34), (40)-(41), (45)-(49)."""
        earth = earth_terms(*env)
        at, u = (self.x, um - self.f) if self.exact else (self.xbar, um)
        F, G = linearise(self.model, at, u, earth)
        self.Phi, self.Gamma = discretise(F, G, dt)
        self.dt = dt
        self.Pf = self.Pf + self.Qf  # (41)
        Ubar = self.Phi @ self.V + self.Gamma  # (47)
        self.U = Ubar - Ubar @ self.Qf @ np.linalg.inv(self.Pf)  # (49)
        Qbar = self.Gamma @ self.Q @ self.Gamma.T + self.U @ self.Qf @ Ubar.T  # (46)
        self.P = self.Phi @ self.P @ self.Phi.T + Qbar  # (32)
        self.xbar = rk4(self.model, at, u, earth, dt)
        if self.exact:
            self.xbar = self.xbar - self.U @ self.f
        else:
            self.xbar = self.xbar + (Ubar - self.U) @ self.f  # (31), (45)
        self.x = self.xbar + self.U @ self.f

    def update(self, y: Array) -> None:
        """(35)-(39), (42)-(44), (48), (50)-(58)."""
        xp, P = self.xbar, self.P
        gamma = _wrapped(y - output(self.model, self.x))  # (54)
        eta = self.x if self.exact else xp
        for _ in range(20):
            H = output_jacobian(self.model, eta)
            M = H @ P @ H.T + self.R
            K = P @ H.T @ np.linalg.inv(M)  # (36)
            if self.exact:
                residual = gamma + H @ self.U @ self.f
                eta2 = xp + K @ residual
                break
            residual = _wrapped(y - output(self.model, eta)) - H @ (xp - eta)
            eta2 = xp + K @ residual
            change = np.linalg.norm(eta2 - eta) / np.linalg.norm(eta2)
            eta = eta2
            if self.k >= 10 or change <= 1e-8:
                break
        S = H @ self.U  # (48)
        first = residual if self.exact else _wrapped(y - output(self.model, xp))
        Kf = self.Pf @ S.T @ np.linalg.inv(M + S @ self.Pf @ S.T)  # (42)
        self.f = self.f + Kf @ (first - S @ self.f)  # (43)
        Pf = self.Pf - Kf @ S @ self.Pf  # (44)
        self.Pf = 0.5 * (Pf + Pf.T)
        IKH = np.eye(6) - K @ H
        self.xbar = eta2
        self.P = IKH @ P @ IKH.T + K @ self.R @ K.T  # (39)
        self.V = self.U - K @ S  # (50)
        self.x = self.xbar + self.V @ self.f  # (51)
        self.Px = self.P + self.V @ self.Pf @ self.V.T  # (52)
        self.gamma = gamma
        self.k += 1
        if self.adapt:
            self.match(H)

    def match(self, H: Array) -> None:
        """(53), (57), (58)."""
        self.window.append(self.gamma**2)
        HG = H @ self.Gamma
        noise = np.diag(HG @ self.Q @ HG.T) / (self.dt if self.divide_by_dt else 1.0)
        Qhat = np.mean(self.window, axis=0) - noise - np.diag(self.R)
        inverse = np.linalg.inv(HG)
        factor = self.dt**2 if self.detuning is None else self.detuning
        Qf = np.diag(inverse @ np.diag(np.maximum(Qhat, 0.0)) @ inverse.T) * factor
        self.Qf = np.diag(np.maximum(Qf, self.Qf_floor))
