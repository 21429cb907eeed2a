"""An autopilot's attitude that follows the injected fault of the IMU it is computed from.

A recorded attitude came from healthy gyros. To see what the autopilot would have said with the
faulty ones, the deviation that a first-order complementary filter makes of the injected fault is
laid over the record:

==========  =====================================================  ======  ====================
symbol      meaning                                                unit    equation
==========  =====================================================  ======  ====================
psi         deviation of the attitude, rotation vector in NED      rad     (1)
R           recorded attitude, ned_from_frd                        1
dw, da      injected fault of the gyros, of the accelerometers     SI      faulty less healthy
tau         time constant: tilt (N, E), heading (D)                s
g           9.80665                                                m/s^2
==========  =====================================================  ======  ====================

    d psi / dt = R dw - (psi - psi_a) / tau                                                (1)
    psi_a      = (-(R da)_E, (R da)_N, 0) / g                                              (2)
    R'         = exp([psi]x) R,    rates' = rates + dw                                     (3)

(1) is the error equation of the complementary filter of mahony2008, without its gyro-bias
integrator: the gyros drive the attitude, and the accelerometers pull the tilt toward where a
false specific force seems to hang (2), the compass the heading. A constant gyro fault ends in a
tilt of ``tau dw``. Over a step in which the fault stands, (1) is solved exactly:
``psi <- a psi + (1 - a) (tau R dw + psi_a)``, ``a = exp(-dt / tau)``.

The default time constant is 5 s: ArduPilot's AHRS_RP_P and AHRS_YAW_P and PX4's ATT_W_ACC are
0.2 per second as shipped.

Differs: to first order in psi; an EKF that learns the gyro's bias would return to the truth after
a minute, this filter does not; velocity and position (GLOBAL_POSITION_INT) stay as recorded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from sim_feeds.rotation import matrix_from_quaternion

__all__ = ["AttitudeFollower", "AttitudeFollows"]

Floats = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
LONGEST_STEP_S = 1.0
"""After a longer silence of the IMU the filter goes on from here [s]."""
NEGLIGIBLE_RAD = 1e-9
"""A deviation this small is none."""
_FIRST = np.iinfo(np.int64).min


@dataclass(frozen=True, slots=True)
class AttitudeFollows:
    """Which IMU the attitude follows, and the filter's time constants.

    Attributes
    ----------
    imu
        Number of the IMU.
    tilt_s, heading_s
        Time constants of the pull to the accelerometers and to the compass [s].
    """

    imu: int = 0
    tilt_s: float = 5.0
    heading_s: float = 5.0


class AttitudeFollower:
    """Runs the filter over the rows of an IMU and of the attitude, in arrival order.

    Parameters
    ----------
    follows
        The filter's constants.
    """

    def __init__(self, follows: AttitudeFollows) -> None:
        self._tau = (follows.tilt_s, follows.tilt_s, follows.heading_s)
        self._psi = (0.0, 0.0, 0.0)
        self._drive = (0.0, 0.0, 0.0)  # tau R dw + psi_a, where psi tends to
        self._rate: Floats = np.zeros(3)  # dw of the last IMU row
        self._R: Floats = np.eye(3)
        self._t_us: int | None = None

    def step(self, healthy: Rows, faulty: Rows, attitude: Rows) -> Rows:
        """The attitude rows as the autopilot would have sent them.

        Parameters
        ----------
        healthy, faulty
            Rows of the IMU before and after the injection, the same in number.
        attitude
            Recorded rows between them, told apart by ``seq``.
        """
        dw = faulty["gyro_rad_s"] - healthy["gyro_rad_s"]
        da = faulty["acc_m_s2"] - healthy["acc_m_s2"]
        out = attitude.copy()
        first = 0
        if not self._live:
            acts = dw.any(axis=1) | da.any(axis=1)
            first = int(np.argmax(acts)) if acts.any() else len(healthy)
        later = attitude["seq"] > (healthy["seq"][first - 1] if first else _FIRST)
        self._rest(healthy[:first], attitude[~later])
        matrices = matrix_from_quaternion(attitude["q_ned_from_frd"])
        psi = np.zeros((len(attitude), 3))
        start = len(attitude) - int(later.sum())
        for k, is_imu in _merge(healthy["seq"][first:], attitude["seq"][start:]):
            if is_imu:
                k += first
                self._advance(int(healthy["t_us"][k]))
                self._drive_by(dw[k], da[k])
            else:
                k += start
                self._R = matrices[k]
                psi[k] = self._at(int(attitude["t_us"][k]))
                out["rate_rad_s"][k] += self._rate
        out["q_ned_from_frd"] = _turned(psi, attitude["q_ned_from_frd"])
        return out

    @property
    def _live(self) -> bool:
        return any((*self._psi, *self._drive, *self._rate))

    def _rest(self, imu: Rows, attitude: Rows) -> None:
        """Nothing is injected: only remember where the stream stands."""
        if len(imu):
            self._t_us = int(imu["t_us"][-1])
        if len(attitude):
            self._R = matrix_from_quaternion(attitude["q_ned_from_frd"][-1:])[0]

    def _at(self, t_us: int) -> tuple[float, float, float]:
        """Deviation at ``t_us``, (1)."""
        if self._t_us is None:
            return self._psi
        dt = min(max((t_us - self._t_us) * 1e-6, 0.0), LONGEST_STEP_S)
        keep = [float(np.exp(-dt / tau)) for tau in self._tau]
        n, e, d = (
            a * psi + (1.0 - a) * to
            for a, psi, to in zip(keep, self._psi, self._drive, strict=True)
        )
        return n, e, d

    def _advance(self, t_us: int) -> None:
        self._psi = self._at(t_us)
        self._t_us = t_us if self._t_us is None else max(t_us, self._t_us)

    def _drive_by(self, dw: Floats, da: Floats) -> None:
        """Where the fault of one reading drives the filter, (1) and (2)."""
        self._rate = dw
        turn, pull = self._R @ dw, self._R @ da / STANDARD_GRAVITY
        tilt, _, heading = self._tau
        self._drive = (
            float(tilt * turn[0] - pull[1]),
            float(tilt * turn[1] + pull[0]),
            float(heading * turn[2]),
        )
        if max(map(abs, (*self._psi, *self._drive))) < NEGLIGIBLE_RAD:
            self._psi = (0.0, 0.0, 0.0)


def _merge(first: NDArray[np.int64], second: NDArray[np.int64]) -> Iterator[tuple[int, bool]]:
    """(index, whether of the first) of two ascending sequences, merged."""
    order = np.argsort(np.concatenate([first, second]), kind="stable")
    n = len(first)
    for k in order.tolist():
        yield (k, True) if k < n else (k - n, False)


def _turned(psi: Floats, q: Floats) -> Floats:
    """Quaternions of ``exp([psi]x) R``: (n, 4)."""
    angle = np.linalg.norm(psi, axis=1)
    share = 0.5 * np.sinc(angle / (2.0 * np.pi))  # sin(angle / 2) / angle
    a = np.cos(0.5 * angle)
    b, c, d = (psi * share[:, None]).T
    w, x, y, z = q.T
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )
