"""An exact longitudinal flight: inertial motion and wind are given, everything else follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.atmosphere import cas_from_tas, pressure, temperature

KT = 0.514444
G = 9.80665


@dataclass
class Flight:
    """Arrays of one flight; sensors carry noise, ``alpha`` and ``cas`` are the truth."""

    t: np.ndarray
    alpha: np.ndarray
    cas: np.ndarray
    wind: np.ndarray
    inertial: np.ndarray
    vanes: np.ndarray
    pitots: np.ndarray
    theta: np.ndarray

    @property
    def x0(self):
        return np.array([self.alpha[0], self.inertial[0, 0], *self.wind[0]])


def _smooth_noise(rng, n, std, tau_s, t_s):
    a = np.exp(-t_s / tau_s)
    out = np.zeros(n)
    for k in range(1, n):
        out[k] = a * out[k - 1] + np.sqrt(1 - a * a) * std * rng.normal()
    return out


def fly(seconds=60.0, seed=0, speed=110.0, gust_std=1.0, shear=3.0, t_s=0.048, altitude=1500.0):
    """Speed and climb changes over some tens of seconds, a wind that swings and gusts."""
    rng = np.random.default_rng(seed)
    n = int(seconds / t_s)
    t = np.arange(n + 1) * t_s
    phase = rng.uniform(0, 2 * np.pi, 4)
    W_x = shear * np.sin(2 * np.pi * t / 47 + phase[0]) + _smooth_noise(
        rng, n + 1, gust_std, 3, t_s
    )
    W_z = 0.3 * shear * np.sin(2 * np.pi * t / 31 + phase[1])
    W_z += _smooth_noise(rng, n + 1, 0.5 * gust_std, 3, t_s)
    north = speed + 4.0 * np.sin(2 * np.pi * t / 40 + phase[2])
    down = 3.0 * np.sin(2 * np.pi * t / 25 + phase[3])
    alpha_i = (
        0.05 + 0.015 * np.sin(2 * np.pi * t / 17) + 0.002 * np.cumsum(rng.normal(size=n + 1)) * t_s
    )
    gamma = -np.arctan2(down, north)
    pitch = gamma + alpha_i
    accel = np.gradient(np.column_stack([north, down]), t_s, axis=0)
    f_n, f_d = accel[:, 0], accel[:, 1] - G
    A_x = f_n * np.cos(pitch) - f_d * np.sin(pitch)
    A_z = f_n * np.sin(pitch) + f_d * np.cos(pitch)
    q = np.gradient(pitch, t_s)
    a_n, a_d = north - W_x, down - W_z
    V_t = np.hypot(a_n, a_d)
    alpha = pitch + np.arctan2(a_d, a_n)
    z = altitude - np.concatenate([[0], np.cumsum(down[:-1] * t_s)])
    cas = np.array(
        [cas_from_tas(v, pressure(h), temperature(h)) for v, h in zip(V_t, z, strict=True)]
    )
    noise = rng.normal(size=(n + 1, 8))
    V_g = np.hypot(north, down)
    theta = np.column_stack([V_g + 0.1 * noise[:, 6], pitch, q, A_x, A_z, z])
    return Flight(
        t=t,
        alpha=alpha,
        cas=cas,
        wind=np.column_stack([W_x, W_z]),
        inertial=np.column_stack([theta[:, 0], down + 0.1 * noise[:, 7]]),
        vanes=alpha[:, None] + np.radians(0.2) * noise[:, :3],
        pitots=cas[:, None] + 0.4 * noise[:, 3:6],
        theta=theta,
    )
