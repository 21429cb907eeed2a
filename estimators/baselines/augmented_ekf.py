"""The same estimation problem without two stages: filterpy's EKF on the twelve augmented states.

z = [x, f]: the state is carried by the kinematic model with the input freed of f, the faults walk.
The two-stage filter of lu2016 is algebraically this filter; the tests hold the two together to
1e-12, and ``mavsentry bench`` compares their speed. Model, Phi, Gamma and propagation are those of
the numpy twin, as a user of filterpy would write them, or the compiled ones, so that only the
filters differ.

filterpy is imported when a filter is made: nothing that runs in flight needs it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators import kinematics
from estimators.baselines import numpy_twins_imu as twins
from estimators.kinematics import ANGLES, Earth
from estimators.two_stage_ekf import Settings
from estimators.two_stage_predict import discretise, runge_kutta

__all__ = ["AugmentedEKF"]

Array = NDArray[np.float64]

STATE, FAULT = slice(0, 6), slice(6, 12)


class AugmentedEKF:
    """State and faults of one IMU by filterpy's ``ExtendedKalmanFilter``, Qf fixed.

    Parameters
    ----------
    settings
        As for the two-stage filter; `mode`, `adapt` and what belongs to them are not used.
    x : (6,) float64 [m/s, rad]
        Initial state.
    P : (6, 6) float64
        Its covariance.
    compiled
        Take the model from the compiled kernels, not from the numpy twin.

    Raises
    ------
    ImportError
        When filterpy is not installed (extra ``compare``).
    """

    def __init__(self, settings: Settings, x: Array, P: Array, *, compiled: bool = False) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        self.settings = settings
        self.compiled = compiled
        tuning = settings.tuning()[0]
        self._Q: Array = tuning["Q"]
        self._Qf: Array = np.diag(settings.fault_walk_var)
        self.ekf: Any = ExtendedKalmanFilter(dim_x=12, dim_z=6)
        self.ekf.x = np.concatenate([x, np.zeros(6)])
        self.ekf.P[STATE, STATE] = P
        self.ekf.P[FAULT, FAULT] = np.diag(settings.fault_var)
        self.ekf.P[STATE, FAULT] = self.ekf.P[FAULT, STATE] = 0.0
        self.ekf.R = np.diag(tuning["R"])
        self._scratch = np.zeros((6, 6, 6))
        self._k = np.zeros((5, 6))

    @property
    def state(self) -> Array:
        """State estimate, (6,) float64 [m/s, rad]."""
        return np.array(self.ekf.x[STATE])

    @property
    def fault(self) -> Array:
        """Fault estimate, (6,) float64 [m/s^2, rad/s]."""
        return np.array(self.ekf.x[FAULT])

    @property
    def state_cov(self) -> Array:
        """Covariance of the state, (6, 6) float64."""
        return np.array(self.ekf.P[STATE, STATE])

    @property
    def fault_cov(self) -> Array:
        """Covariance of the faults, (6, 6) float64."""
        return np.array(self.ekf.P[FAULT, FAULT])

    def predict(self, um: Array, latitude_rad: float, altitude_m: float, dt_s: float) -> None:
        """Carry state and faults over one held input."""
        ekf = self.ekf
        x, u = np.array(ekf.x[STATE]), um - ekf.x[FAULT]
        Phi, Gamma, moved = self._step(x, u, (latitude_rad, altitude_m), dt_s)
        ekf.F = np.eye(12)
        ekf.F[STATE, STATE], ekf.F[STATE, FAULT] = Phi, Gamma
        ekf.Q = np.zeros((12, 12))
        ekf.Q[STATE, STATE] = Gamma @ np.diag(self._Q) @ Gamma.T
        ekf.Q[FAULT, FAULT] = self._Qf
        moved_z = np.concatenate([moved, ekf.x[FAULT]])
        ekf.predict()
        ekf.x = moved_z

    def update(self, y: Array) -> None:
        """Use a complete measurement."""
        self.ekf.update(y, self._jacobian, self._output, residual=_residual)

    def _step(
        self, x: Array, u: Array, place: tuple[float, float], dt_s: float
    ) -> tuple[Array, Array, Array]:
        """Phi, Gamma and the propagated state."""
        model = self.settings.model
        if not self.compiled:
            earth = twins.earth_terms(*place)
            Phi, Gamma = twins.discretise(*twins.linearise(model, x, u, earth), dt_s)
            return Phi, Gamma, twins.rk4(model, x, u, earth, dt_s)
        compiled_earth: Earth = kinematics.earth_terms(float(place[0]), float(place[1]))
        F, G, Phi, Gamma, psi, tmp = self._scratch
        kinematics.linearise(model, x, u, compiled_earth, F, G)
        discretise(F, G, dt_s, Phi, Gamma, psi, tmp)
        moved = np.empty(6)
        runge_kutta(model, x, u, compiled_earth, dt_s, self._k, moved)
        return Phi, Gamma, moved

    def _jacobian(self, z: Array) -> Array:
        H = np.zeros((6, 12))
        H[:, STATE] = twins.output_jacobian(self.settings.model, z[STATE])
        return H

    def _output(self, z: Array) -> Array:
        return twins.output(self.settings.model, z[STATE])


def _residual(y: Array, h: Array) -> Array:
    out: Array = y - h
    out[ANGLES] = (out[ANGLES] + np.pi) % (2 * np.pi) - np.pi
    return out
