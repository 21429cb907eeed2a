"""Three airspeed and three angle-of-attack sensors judged against one constrained estimate.

===============  ====================================================  ===========  ============
symbol           meaning                                               shape        wan2018
===============  ====================================================  ===========  ============
r                residual of a sensor against the one-step prediction  (2, 3)       (17)
J                its rms over the last N_eval samples                  (2, 3)       (18)
J_th             threshold of J                                        (2,)         VI-B
n_D              samples of N_eval above J_th that confirm a fault                  below (18)
beta             weight of a sensor in the fused measurement           (2, 3)       (19)
M                rms of a sensor against the *remembered* wind         (2, 3)
W_ref            wind remembered from before the sensors parted        (2,)
configuration    I all, II no vanes, III no airspeed, IV neither                    Table I
===============  ====================================================  ===========  ============

Channel 0 is the angle of attack (its ally is W_z), channel 1 the calibrated airspeed (W_x).

Differs, each for a reason that a simulated flight shows:

* The fusion set is {J <= J_th and not latched}. When it is empty the channel is not used in that
  sample: three sensors that contradict the prediction together are confirmed within n_D samples.
  J has a floor, for a weight 1/J^2 must stay finite.
* A confirmed fault latches. Without a latch 20-45 kt on all three are flagged in 0.4 s and taken up
  by the wind after 10 s. A latched sensor comes back when for ``clear_s`` J has stayed below a
  share of J_th and it has read what the others read (:mod:`estimators.triplex_return`).
* When a whole channel is lost its wind component returns to its value before the onset and is held
  there (nothing observes it any more, and the barrier would pull it to mid-range), with a standard
  deviation that grows as this flight's wind has walked. Sensors come back when at least two agree
  with each other, their wind lies inside the bounds, they meet the held wind within 3 sigma and
  half of the largest residual since the latch, and they came by a jump if they left by one.
* Weights (19) let two sensors that err together vote the healthy third one out. When one side has
  jumped against the prediction and the other has not, the jump is wrong. When all crept, a sensor
  is confirmed only if it disagrees with the remembered wind more than the fused value does, and
  when the fused value disagrees far more, those who made it are confirmed.
* The same memory finds a step of all that are left, which a wind that may change by 15 kt/s takes
  up before J can tell: each has sprung, and stays away from the remembered wind.
* A sensor that repeats itself, or leaps to and fro, is found by that
  (:mod:`estimators.triplex_signs`).
* The wind is confined to a band about its value ``change_base_s`` ago, which gives the bound on its
  rate a time base.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_mhe import ROW_P, AirDataMHE, AirDataTuning
from estimators.triplex_run import (
    R_ALPHA,
    R_ALPHA_STD,
    R_CAS,
    R_CAS_STD,
    R_CONFIGURATION,
    R_J,
    R_LATCHED,
    R_SIZE,
    R_STATUS,
    R_X,
    fuse,
    residual_rms,
    triplex_run,
)
from estimators.triplex_signs import SIGNS
from estimators.triplex_tuning import TriplexRecord, TriplexTuning

__all__ = [
    "CONFIGURATIONS",
    "ESTIMATORS",
    "EstimatorName",
    "Triplex",
    "TriplexRecord",
    "TriplexTuning",
    "fuse",
    "residual_rms",
    "triplex_run",
]

Array = NDArray[np.float64]

CONFIGURATIONS = ("I", "II", "III", "IV")
EstimatorName = Literal["ekf", "unconstrained", "constrained"]
ESTIMATORS: tuple[EstimatorName, ...] = ("ekf", "unconstrained", "constrained")
"""Those of wan2018 section VI-A: any of them in the same fault logic."""


@dataclass
class Triplex:
    """Fault-tolerant estimation over blocks of samples; any cut into blocks gives the same.

    Parameters
    ----------
    estimator : AirDataMHE
        Started at the first sample's state.
    tuning : TriplexTuning
    history_s : float
        How long the wind's estimates are remembered.
    filtering : bool
        Whether an EKF takes the place of the horizon.
    """

    estimator: AirDataMHE
    tuning: TriplexTuning = field(default_factory=TriplexTuning)
    history_s: float = 120.0
    filtering: bool = False

    def __post_init__(self) -> None:
        t_s = self.estimator.tuning.t_s
        self._cov = np.diag(self.estimator.table[ROW_P])
        self._par = self.tuning.parameters(t_s)
        self._rings = np.zeros((5, 2, 3, self.tuning.N_eval))
        self._signs = np.zeros((2, 3, SIGNS))
        self._memory = np.zeros(61)
        self._winds = np.zeros((2, int(self.history_s / t_s)))

    @classmethod
    def start(
        cls,
        x0: Array,
        theta0: Array,
        mhe: AirDataTuning | None = None,
        tuning: TriplexTuning | None = None,
        estimator: EstimatorName | None = None,
    ) -> Triplex:
        """Begin at a state ``x0`` (4,) with parameters ``theta0`` (6,).

        ``estimator`` is one of :data:`ESTIMATORS`; the EKF takes P, Q, R and the sampling time of
        ``mhe`` and nothing else of it. Without it, ``mhe.constrained`` decides.
        """
        weights = mhe or AirDataTuning()
        if estimator is not None:
            weights = replace(weights, constrained=estimator == "constrained")
        filtering = estimator == "ekf"
        return cls(AirDataMHE(weights, x0, theta0), tuning or TriplexTuning(), filtering=filtering)

    def run(self, inertial: Array, vanes: Array, pitots: Array, theta: Array) -> TriplexRecord:
        """Take (T, ...) samples; the arrays are those of :func:`triplex_run`."""
        e, t = self.estimator, self.estimator.tuning
        record = np.empty((len(inertial), R_SIZE))
        triplex_run(
            t.model, t.t_s, e.table, self._par, 0.0 if t.converged else t.kappa, t.n_kappa, t.n_qp,
            t.sqp_iterations, t.N, e.window, e.work, self.filtering, self._cov, self._rings,
            self._signs, self._memory, self._winds, np.ascontiguousarray(inertial),
            np.ascontiguousarray(vanes), np.ascontiguousarray(pitots),
            np.ascontiguousarray(theta), record,
        )  # fmt: skip
        return TriplexRecord(
            x=record[:, R_X],
            J=record[:, R_J].reshape(-1, 2, 3),
            faulty=record[:, R_LATCHED].reshape(-1, 2, 3) == 1.0,
            configuration=record[:, R_CONFIGURATION].astype(np.int64),
            alpha=record[:, R_ALPHA],
            cas=record[:, R_CAS],
            alpha_std=record[:, R_ALPHA_STD],
            cas_std=record[:, R_CAS_STD],
            status=record[:, R_STATUS].astype(np.int64),
        )
