"""What goes into the triplex fault logic and what comes out: thresholds, times, the record.

=============  =========================================================  =====  ==========
symbol         meaning                                                    unit   wan2018
=============  =========================================================  =====  ==========
J_th           threshold of the residual rms: vanes, pitots               rad,   VI-B
                                                                          m/s
N_eval, n_D    length of the evaluation, samples of it that confirm       1      (18)
P_*            index of a parameter; times there are in samples
=============  =========================================================  =====  ==========
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_mhe import KT

__all__ = ["TriplexRecord", "TriplexTuning"]

Array = NDArray[np.float64]

# indices of the parameter array
P_N_EVAL, P_N_D, P_FLOOR, P_CLEAR_SHARE, P_CLEAR, P_LATCH, P_BASE, P_CHANGE_X, P_CHANGE_Z = range(9)
P_WALK, P_GUST_X, P_GUST_Z, P_MARGIN, P_REF_DELAY, P_REF_MEAN, P_SPREAD, P_TH_A, P_TH_V = range(
    9, 18
)
P_MARGIN_ONE, P_MEMORY, P_NOISY = 18, 19, 20
P_SIZE = 21


@dataclass(frozen=True)
class TriplexTuning:
    """Thresholds and times of the fault logic.

    ``latch``, ``memory`` and a finite ``noisy`` are what this logic adds to the paper's: a found
    sensor stays found, the remembered wind and jumps decide between sensors, and a sensor's own
    noise or standstill is a sign. :meth:`as_printed` has none of them.

    ``J_th``, ``N_eval`` are the paper's; ``n_D`` and the rest were chosen on synthetic longitudinal
    flights in wind ramps and turbulence of up to 3.5 m/s rms. The remembered wind walks by
    0.1 m/s/sqrt(s) (the figure of recorded flights) on top of the gusts.
    """

    N_eval: int = 10
    n_D: int = 8
    alpha_threshold_rad: float = math.radians(2.9)
    cas_threshold_m_s: float = 12 * KT
    floor_share: float = 0.02
    clear_share: float = 0.6
    clear_s: float = 3.0
    latch: bool = True
    change_base_s: float = 5.0
    wind_change_m_s: tuple[float, float] = (45 * KT, 45 * KT)
    wind_walk_m_s_sqrt_s: float = 0.1
    gust_std_m_s: tuple[float, float] = (3.5, 2.0)
    margin: float = 3.0
    margin_one: float = 1.0
    reference_delay_s: float = 0.5
    reference_mean_s: float = 1.0
    spread_share: float = 0.2
    memory: bool = True
    noisy: float = 3.0

    @classmethod
    def as_printed(cls) -> TriplexTuning:
        """The paper's own logic: flags follow (18) alone, and the wind has no band."""
        free = (math.inf, math.inf)
        return cls(latch=False, memory=False, noisy=math.inf, wind_change_m_s=free)

    def parameters(self, t_s: float) -> Array:
        """The kernel's parameter array; times in samples of ``t_s``."""
        out = np.empty(P_SIZE)
        out[P_N_EVAL], out[P_N_D] = self.N_eval, self.n_D
        out[P_FLOOR], out[P_CLEAR_SHARE] = self.floor_share, self.clear_share
        out[P_CLEAR], out[P_LATCH] = round(self.clear_s / t_s), self.latch
        out[P_BASE] = round(self.change_base_s / t_s)
        out[P_CHANGE_X], out[P_CHANGE_Z] = self.wind_change_m_s
        out[P_WALK] = self.wind_walk_m_s_sqrt_s * math.sqrt(t_s)
        out[P_GUST_X], out[P_GUST_Z] = self.gust_std_m_s
        out[P_MARGIN], out[P_MARGIN_ONE] = self.margin, self.margin_one
        out[P_REF_DELAY] = round(self.reference_delay_s / t_s)
        out[P_REF_MEAN] = round(self.reference_mean_s / t_s)
        out[P_SPREAD] = self.spread_share
        out[P_MEMORY], out[P_NOISY] = self.memory, self.noisy
        out[P_TH_A], out[P_TH_V] = self.alpha_threshold_rad, self.cas_threshold_m_s
        return out


@dataclass
class TriplexRecord:
    """What :class:`estimators.triplex.Triplex` says of each sample.

    Attributes
    ----------
    x : (T, 4) float64
        [alpha, V_g, W_x, W_z] [rad, m/s].
    J : (T, 2, 3) float64 [rad, m/s]
        Residual rms; channel 0 the vanes, 1 the pitots.
    faulty : (T, 2, 3) bool
    configuration : (T,) int
        Index into :data:`estimators.triplex.CONFIGURATIONS`.
    alpha, cas, alpha_std, cas_std : (T,) float64 [rad, m/s]
        Reconstructed values; while a channel is lost the deviation carries the held wind's.
    status : (T,) int
        Of the solver, :mod:`estimators.mhe`.
    """

    x: Array
    J: Array
    faulty: NDArray[np.bool_]
    configuration: NDArray[np.int64]
    alpha: Array
    cas: Array
    alpha_std: Array
    cas_std: Array
    status: NDArray[np.int64]
