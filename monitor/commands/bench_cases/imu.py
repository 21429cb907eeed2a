"""The IMU estimators: one step of the adaptive two-stage EKF."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from math import radians

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.augmented_ekf import AugmentedEKF
from estimators.baselines.numpy_twins_imu import TwinTwoStage, rates
from estimators.kinematics import GS, earth_terms
from estimators.two_stage_ekf import Settings, TwoStageFilter
from monitor.commands.bench_cases import BenchCase

__all__ = ["cases"]

Array = NDArray[np.float64]

STEPS = 2000
PEER_STEPS = 100
DT_S = 0.01


def cases() -> list[BenchCase]:
    """Cases that need no recording."""
    return [_atsekf_step()]


def _atsekf_step() -> BenchCase:
    settings = Settings(model=GS, mode="exact", adapt=True, dt_s=DT_S)
    um, y, env = _flight(STEPS)
    P = np.diag(settings.tuning()["R"][0])

    def ours() -> None:
        TwoStageFilter(settings, y[0], P).run(um, y[1:], env)

    def numpy_twin() -> None:
        twin = TwinTwoStage.like(settings, y[0], P)
        for k in range(PEER_STEPS):
            twin.predict(um[k], env[k], DT_S)
            twin.update(y[k + 1])

    peers: dict[str, Callable[[], object]] = {"numpy": numpy_twin}
    missing: tuple[str, ...] = ("filterpy",)
    if importlib.util.find_spec("filterpy"):

        def filterpy() -> None:
            ekf = AugmentedEKF(settings, y[0], P)
            for k in range(PEER_STEPS):
                ekf.predict(um[k], env[k, 0], env[k, 1], DT_S)
                ekf.update(y[k + 1])

        peers["filterpy"] = filterpy
        missing = ()
    return BenchCase(
        "atsekf_step",
        run=ours,
        calls=STEPS,
        peers=peers,
        peer_calls=dict.fromkeys(peers, PEER_STEPS),
        missing=missing,
        note="one prediction and one update with adaptation, in a run over 20 s at 100 Hz; "
        "filterpy's twelve-state filter has no adaptation, its model is the numpy twin's",
    )


def _flight(steps: int) -> tuple[Array, Array, Array]:
    """Inputs, measurements and places of a gently rolling and pitching flight at 100 m/s."""
    rng = np.random.default_rng(1)
    lat, alt = radians(52.0), 1000.0
    t = DT_S * np.arange(steps)
    u = np.column_stack(
        [
            0.5 + 0.2 * np.sin(0.4 * t),
            0.3 * np.sin(0.7 * t),
            -9.8 + 0.5 * np.sin(0.5 * t),
            radians(3.0) * np.cos(0.7 * t),
            radians(1.0) * np.cos(0.5 * t),
            radians(2.0) * np.cos(0.3 * t),
        ]
    )
    x = np.empty((steps + 1, 6))
    x[0] = [95.0, 30.0, 0.0, 0.0, 0.05, 0.3]
    earth = earth_terms(lat, alt)
    for k in range(steps):
        middle = x[k] + 0.5 * DT_S * rates(GS, x[k], u[k], earth)
        x[k + 1] = x[k] + DT_S * rates(GS, middle, u[k], earth)
    std = np.array([0.01] * 3 + [radians(0.01)] * 3)
    noisy = u + std * rng.standard_normal(u.shape)
    return noisy, x + std * rng.standard_normal(x.shape), np.tile([lat, alt], (steps, 1))
