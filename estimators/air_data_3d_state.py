"""Parameters and memory of the deployed air-data monitor.

All memory is in arrays, held together by named tuples, so that the kernels keep it in place and a
stream may be cut anywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import CheckLimits, new_check
from estimators.air_data_3d import N_PITOTS
from estimators.air_data_3d_bank import Bank, new_bank
from estimators.air_data_3d_judge import Judge, JudgeLimits, new_judge
from estimators.air_data_3d_noise import NoiseLevels, new_noise
from estimators.air_data_3d_rows import QUEUE, Rings, new_rings
from estimators.air_horizon_stage import Gathering, StageLevels, new_gathering
from estimators.air_peaks import new_peaks
from estimators.air_swings import new_swings
from estimators.air_tests import new_tests
from estimators.atmosphere import P0_PA

__all__ = ["AirParams", "AirState", "FilterLevels", "new_state"]

Array = NDArray[np.float64]

# Scalars that the stream remembers.
(
    FLYING,
    FLYING_SINCE,
    STARTED,
    T_EPOCH,
    T_STEP,
    T_SPAWN,
    T_QUEUED,
    QUEUED_VN,
    QUEUED_VE,
    T_GPS,
    PRESSURE,
    START_PRESSURE,
    PRESENT,
    TRUSTED,
    TRUST_FROM,
    SPEED,
    LN_N_STD,
    HEAD,
    TAIL,
) = range(19)
N_MEMORY = 19


class FilterLevels(NamedTuple):
    """Model of the filters; the settings of the same names say what each value rests on."""

    wind_walk_m_s: float
    wind_shear_m_s: float
    gust_tau_s: float
    scale_walk: float
    scale_walk_shifted: float
    wind_prior_m_s: float
    vertical_walk_m_s: float
    vertical_prior_m_s: float
    scale_prior: float
    yaw_prior_rad: float
    gate: float
    jump_scale: float
    jump_wind_m_s: float
    spawn_s: float
    age_max_s: float
    learn_s: float
    reference_gap_s: float
    reference_apart_m_s: float
    reference_noise_m_s: float
    reference_wait_s: float


class AirParams(NamedTuple):
    """All parameters of the monitor."""

    levels: FilterLevels
    noise: NoiseLevels
    checks: CheckLimits
    limits: JudgeLimits
    stage: StageLevels


class AirState(NamedTuple):
    """All memory of the monitor; arrays are changed in place.

    Attributes
    ----------
    memory : (19,) float64
    pending : (16, 4) float64 [s, m/s]
        GPS epochs that wait.
    noise : (30,) float64
    check : (3, 18) float64
    swing : (3, 12) float64
    peaks : (15, 3) float64
        How near to the limits the flight came, see :mod:`estimators.air_peaks`.
    tests : (7,) float64
        How near each pitot came to a verdict since the last row, see :mod:`estimators.air_tests`.
    stages
        Epochs on their way to the long horizon (:mod:`estimators.air_horizon_judge`).
    """

    memory: Array
    pending: Array
    rings: Rings
    noise: Array
    check: Array
    swing: Array
    bank: Bank
    judge: Judge
    peaks: Array
    tests: Array
    stages: Gathering


def new_state(params: AirParams) -> AirState:
    """State before the first event: on the ground, nothing known."""
    memory = np.zeros(N_MEMORY)
    memory[[T_EPOCH, T_STEP, T_SPAWN, T_QUEUED, T_GPS, QUEUED_VN, QUEUED_VE]] = -np.inf
    memory[[PRESSURE, START_PRESSURE]] = P0_PA
    memory[TRUSTED], memory[LN_N_STD] = 1.0, np.nan
    return AirState(
        memory=memory,
        pending=np.zeros((QUEUE, 4)),
        rings=new_rings(),
        noise=new_noise(params.noise),
        check=np.stack([new_check() for _ in range(N_PITOTS)]),
        swing=new_swings(),
        bank=new_bank(),
        judge=new_judge(),
        peaks=new_peaks(),
        tests=new_tests(),
        stages=new_gathering(),
    )
