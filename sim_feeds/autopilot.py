"""The autopilot's own idea of attitude and velocity, which other components must live with.

Either independent of the watched IMUs (truth plus slowly varying errors), or computed from one of
them as small autopilots do, so that a fault of that IMU spoils attitude and velocity as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from sim_feeds import earth
from sim_feeds.rotation import axis_matrix, quaternion_from_matrix, rotate
from sim_feeds.section import Strict
from sim_feeds.sensors import Series, markov, stream
from sim_feeds.trajectory import Truth

__all__ = ["Autopilot", "Navigation"]

Floats = NDArray[np.float64]

FILTER_HZ: Final = 50.0
"""The attitude filter works on IMU readings averaged down to this rate, or that of its messages."""


@dataclass(frozen=True, slots=True)
class Navigation:
    """The autopilot's solution on a time grid.

    Attributes
    ----------
    t_s : (n,)
    ned_from_frd : (n, 3, 3)
    rate_rad_s : (n, 3)
        Gyro rates less the learnt bias.
    vel_ned_m_s : (n, 3)
    """

    t_s: Floats
    ned_from_frd: Floats
    q_ned_from_frd: Floats
    rate_rad_s: Floats
    vel_ned_m_s: Floats


class Autopilot(Strict):
    """How the autopilot estimates attitude and velocity."""

    attitude_follows_imu: int | None = Field(
        None,
        ge=0,
        le=3,
        description="Number of the IMU whose faults spoil the attitude; without it, independent.",
    )
    tilt_std_deg: float = Field(0.3, ge=0.0, description="Slow error of roll and pitch.")
    yaw_std_deg: float = Field(1.0, ge=0.0, description="Slow error of the heading.")
    error_tau_s: float = Field(60.0, gt=0.0, description="Correlation time of the slow errors.")
    velocity_std_m_s: float = Field(0.1, ge=0.0, description="Slow error of velocity, per axis.")
    rate_noise_deg_s: float = Field(0.1, ge=0.0, description="Noise of the body rates.")
    tilt_gain_hz: float = Field(0.1, gt=0.0, description="Pull toward the accelerometers [1/s].")
    yaw_gain: float = Field(5.0, ge=0.0, description="Pull to the compass over pull to tilt.")
    bias_gain_hz2: float = Field(0.002, ge=0.0, description="Learning of the gyro bias [1/s^2].")
    velocity_tau_s: float = Field(0.5, gt=0.0, description="Time constant of the pull to GPS.")

    def estimate(
        self, truth: Truth, imu: Series | None, seed: int, rate_hz: float = FILTER_HZ
    ) -> Navigation:
        """The solution of a flight.

        Parameters
        ----------
        truth
            The flight.
        imu
            Readings of the IMU that attitude and velocity follow; unused when independent.
        seed
            Of the errors.
        rate_hz
            At least this many solutions per second, as far as the source has them.
        """
        rate_hz = max(rate_hz, FILTER_HZ)
        rng = stream(seed, "autopilot")
        if self.attitude_follows_imu is None or imu is None or len(imu.valid_s) < 2:
            step = max(1, round(1.0 / (rate_hz * truth.dt_s)))
            here = truth.every(step)
            t = here.t_s
            noise = radians(self.rate_noise_deg_s) * rng.standard_normal((len(t), 3))
            matrix, rate = here.ned_from_frd, here.rate_rad_s + noise
            velocity = here.vel_ned_m_s
        else:
            step = max(1, round(1.0 / (rate_hz * float(np.median(np.diff(imu.valid_s))))))
            n = len(imu.valid_s) // step
            t = imu.valid_s[: n * step].reshape(n, step).mean(1)
            here = truth.at(t)
            mean = imu.values[: n * step].reshape(n, step, 6).mean(1)
            matrix, bias, velocity = self._follow(here, mean)
            rate = mean[:, 3:] - bias
        tilt = radians(self.tilt_std_deg)
        errors = [
            markov(rng, t, std, self.error_tau_s) for std in (tilt, tilt, radians(self.yaw_std_deg))
        ]
        # Errors of tilt about the body's axes, of heading about the vertical.
        for axis, angle in zip((0, 1), errors[:2], strict=True):
            matrix = matrix @ axis_matrix(axis, angle)
        matrix = axis_matrix(2, errors[2]) @ matrix
        wander = np.column_stack([markov(rng, t, self.velocity_std_m_s, 5.0) for _ in "NED"])
        return Navigation(t, matrix, quaternion_from_matrix(matrix), rate, velocity + wander)

    def _follow(self, here: Truth, imu: Floats) -> tuple[Floats, Floats, Floats]:
        """Complementary filter on an IMU, aided by true acceleration and heading.

        The tilt is pulled until the measured specific force, turned to NED, points where the
        acceleration of the (healthy) GPS says; the velocity follows the IMU and is pulled to GPS.
        """
        n = len(here.t_s)
        spin = earth.earth_rate_ned(here.lat_rad) + earth.transport_rate_ned(
            here.lat_rad, here.height_m, here.vel_ned_m_s
        )
        force = rotate(here.ned_from_frd, here.specific_force_m_s2)
        size = np.linalg.norm(force, axis=1)
        dt = np.diff(here.t_s, prepend=2 * here.t_s[0] - here.t_s[1])
        ahead = here.ned_from_frd[:, :2, 0]
        R = here.ned_from_frd[0].copy()
        bias, dv = np.zeros(3), np.zeros(3)
        matrices, biases, velocities = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
        for k in range(n):
            h = dt[k]
            felt = R @ imu[k, :3]
            scale = max(float(np.sqrt(felt @ felt)) * size[k], 1.0)
            turn = np.array(
                [
                    felt[1] * force[k, 2] - felt[2] * force[k, 1],
                    felt[2] * force[k, 0] - felt[0] * force[k, 2],
                    0.0,
                ]
            ) / max(scale, STILL_M2_S4)
            turn[2] = self.yaw_gain * (R[0, 0] * ahead[k, 1] - R[1, 0] * ahead[k, 0])
            toward = R.T @ turn
            bias -= self.bias_gain_hz2 * h * toward
            rate = imu[k, 3:] - bias - R.T @ spin[k] + self.tilt_gain_hz * toward
            R = R @ _small_turn(rate * h)
            dv += h * (felt - force[k] - dv / self.velocity_tau_s)
            matrices[k], biases[k], velocities[k] = R, bias, dv
        return matrices, biases, here.vel_ned_m_s + velocities


STILL_M2_S4: Final = 25.0
"""Below this product of specific forces (about half a g each) the tilt is pulled less."""


def _small_turn(angle: Floats) -> Floats:
    """Rotation matrix of a rotation vector, (3, 3)."""
    x, y, z = angle.tolist()
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    a2 = x * x + y * y + z * z
    a = max(a2, 1e-18) ** 0.5
    return np.asarray(np.eye(3) + np.sin(a) / a * K + (1.0 - np.cos(a)) / (a * a) * (K @ K))
