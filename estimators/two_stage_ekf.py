"""Reconstruct the six faults of an IMU: the adaptive two-stage EKF of Lu et al. (2016).

The IMU drives a kinematic model, velocity and attitude correct it, and what must be subtracted
from the IMU for the two to agree are its faults. The filter is the augmented twelve-state EKF,
split in a bias-free filter of the state and a filter of the faults; symbols and equations stand in
:mod:`estimators.two_stage_memory`, the models in :mod:`estimators.kinematics`.

Two modes: `paper` linearises and integrates at xbar with the measured input, as (31)-(34) are
printed; `exact` does so at x with the faults removed, which is the extended Kalman filter proper
and differs once faults are large.

Three ways to feed it: :meth:`TwoStageFilter.predict` and :meth:`~TwoStageFilter.update` by hand,
:meth:`TwoStageFilter.run` over a recording at a fixed rate, and :class:`DelayedFilter` for what a
vehicle sends: an IMU at its rate, attitude and GPS at theirs, each valid at a time of its own.

Differs
-------
(11)
    The last row's sign, see :mod:`estimators.kinematics`.
(44)
    Symmetric form; (39) as printed.
(53)
    The division by dt contradicts (46), and is off unless `divide_by_dt`.
(54)
    The innovation is ``y - h(x_k|k-1)`` with the predicted state (the printed Phi x + Gamma f drops
    the measured input), its angles wrapped.
(57)
    The printed ``(dt)^2`` multiplies a Gamma that is already discrete: in SI it makes Qf 1e-4 of
    what covariance matching asks for at 100 Hz, and the estimates 50 times quieter (standard
    deviation of a healthy f_Ax .013 m/s^2 with it, .72 without). It is kept as what it is, a tuning
    factor: `detuning`, None for the printed dt_T^2.
slow measurements
    Between measurements the gain is zero: V = U and Pf grows. (53) and (57) then use Gamma_T and
    dt_T, accumulated since the last measurement, and Q_T = sum Phi Gamma Q Gamma' Phi' in place of
    Gamma Q Gamma'; Qf is spread evenly over the predictions. A measurement of velocity or of angles
    alone adapts its own three faults.
steep pitch
    Euler angles fail at 90 degrees (the condition of G is 7.6 at 75, 115 at 89). Beyond
    `pitch_limit_rad` faults and covariances are frozen; the state restarts from measurements.

Source: P. Lu, E. van Kampen, C. C. de Visser, Q. P. Chu, Control Engineering Practice 49 (2016)
112-128, docs/references ``lu2016``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators import two_stage_run as kernels
from estimators.kinematics import AS, GS
from estimators.two_stage_memory import MAX_WINDOW, MEMORY, TRACK, TUNING, Status

__all__ = ["AS", "GS", "DelayedFilter", "Settings", "Status", "TwoStageFilter"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.void]

_MDEG = math.radians(0.01)
_TABLE_1_INPUT_STD = (0.01, 0.01, 0.01, _MDEG, _MDEG, _MDEG)
_TABLE_1_OUTPUT_STD = {
    GS: (0.01, 0.01, 0.01, _MDEG, _MDEG, _MDEG),
    AS: (0.1, 10 * _MDEG, 10 * _MDEG, _MDEG, _MDEG, _MDEG),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Constants of a filter; the defaults are lu2016's.

    Attributes
    ----------
    model
        :data:`GS` (velocity over the ground) or :data:`AS` (through the air).
    mode
        ``"paper"`` or ``"exact"``, see the module.
    adapt
        Match Qf to the innovations, (53)-(58); otherwise it stays at `fault_walk_var`.
    dt_s
        The IMU's sampling interval [s], to which `input_std` and `fault_walk_var` belong.
    input_std, output_std
        Noise of one IMU sample and of one measurement [units of u and y]; None: Table 1.
    fault_var, fault_walk_var
        Initial Pf and Qf, diagonals [squared units of u]. The paper does not print them.
    window
        N of (53), in measurements.
    divide_by_dt
        Divide in (53) as printed.
    detuning
        Factor of (57); None: the printed dt_T^2 [s^2].
    fault_walk_floor
        Smallest Qf [squared units of u].
    pitch_limit_rad, pitch_return_rad
        Freeze beyond the first, restart within the second.
    max_gap_s
        Inputs further apart than this are not bridged; the state restarts.
    """

    model: int = GS
    mode: Literal["paper", "exact"] = "exact"
    adapt: bool = True
    dt_s: float = 0.01
    input_std: tuple[float, ...] = _TABLE_1_INPUT_STD
    output_std: tuple[float, ...] | None = None
    fault_var: tuple[float, ...] = (1e-2, 1e-2, 1e-2, 1e-4, 1e-4, 1e-4)
    fault_walk_var: tuple[float, ...] = (1e-4, 1e-4, 1e-4, 1e-7, 1e-7, 1e-7)
    window: int = 10
    divide_by_dt: bool = False
    detuning: float | None = None
    fault_walk_floor: float = 1e-14
    pitch_limit_rad: float = math.radians(75.0)
    pitch_return_rad: float = math.radians(70.0)
    max_gap_s: float = 0.5

    def tuning(self) -> Rows:
        """The same as a row of ``two_stage_memory.TUNING``, in an array of one."""
        if not 1 <= self.window <= MAX_WINDOW:
            raise ValueError(f"window is {self.window}, not from 1 to {MAX_WINDOW}")
        t = np.zeros(1, TUNING)
        t["model"], t["exact"], t["adapt"] = self.model, self.mode == "exact", self.adapt
        t["divide_by_dt"], t["detuning"] = self.divide_by_dt, self.detuning or 0.0
        t["Qf_floor"], t["dt_s"], t["N"] = self.fault_walk_floor, self.dt_s, self.window
        t["pitch_limit_rad"] = self.pitch_limit_rad
        t["pitch_return_rad"] = self.pitch_return_rad
        t["max_gap_s"] = self.max_gap_s
        t["Q"] = np.square(self.input_std)
        t["R"] = np.square(self.output_std or _TABLE_1_OUTPUT_STD[self.model])
        return t


def _six_columns(values: ArrayLike) -> Array:
    """C-contiguous float64 (n, 6)."""
    return np.ascontiguousarray(values, dtype=np.float64).reshape(-1, 6)


class TwoStageFilter:
    """State and faults of one IMU.

    Parameters
    ----------
    settings
        Constants of the filter.
    x : (6,) float64 [m/s, rad], optional
        Initial state. Without one the filter waits for its first velocity and angles.
    x_var : (6,) or (6, 6) float64, optional
        Its variances or covariance; by default those of the measurements.
    """

    def __init__(
        self, settings: Settings, x: ArrayLike | None = None, x_var: ArrayLike | None = None
    ) -> None:
        self.settings = settings
        self.tuning = settings.tuning()
        self.memory: Rows = np.zeros(1, MEMORY)
        s = self.memory[0]
        s["Pf"] = np.diag(settings.fault_var)
        s["Qf"] = settings.fault_walk_var
        s["Qf_interval_s"] = settings.dt_s
        s["nis"] = np.nan
        s["state"] = Status.WAITING
        if x is not None:
            s["x"] = s["xbar"] = np.asarray(x, dtype=np.float64)
            P = np.asarray(self.tuning["R"][0] if x_var is None else x_var, dtype=np.float64)
            s["P"] = P if P.ndim == 2 else np.diag(P)
            s["state"] = Status.OK

    @property
    def state(self) -> Array:
        """State estimate x, faults removed, (6,) float64 [m/s, rad]; yaw is not wrapped."""
        return self._copy("x")

    @property
    def state_cov(self) -> Array:
        """Covariance of the state estimate, (6, 6) float64. Source: lu2016 eq. (52)."""
        V = self._copy("V")
        return self._copy("P") + V @ self._copy("Pf") @ V.T

    @property
    def fault(self) -> Array:
        """Fault estimate, measured minus true, (6,) float64 [m/s^2, rad/s]."""
        return self._copy("f")

    @property
    def fault_cov(self) -> Array:
        """Covariance of the fault estimate, (6, 6) float64."""
        return self._copy("Pf")

    @property
    def innovation(self) -> Array:
        """Innovation of the last measurement, (6,) float64 [m/s, rad]."""
        return self._copy("gamma")

    @property
    def nis(self) -> float:
        """Its normalised square, chi-square with as many degrees as rows were measured."""
        return float(self.memory["nis"][0])

    def _copy(self, name: str) -> Array:
        return np.array(self.memory[name][0], dtype=np.float64)

    def predict(self, um: ArrayLike, latitude_rad: float, altitude_m: float, dt_s: float) -> Status:
        """Carry the estimates over `dt_s` seconds with the measured input held.

        Parameters
        ----------
        um : (6,) float64 [m/s^2, rad/s]
            Specific force and rates as measured.
        latitude_rad, altitude_m, dt_s
            Where the vehicle is, and for how long.

        Returns
        -------
        Status
            OK; REJECTED when `um` was not finite and the last good input stood in; otherwise why
            there is no state (the next measurements will give one).
        """
        u = np.ascontiguousarray(um, dtype=np.float64)
        place = float(latitude_rad), float(altitude_m)
        return Status(kernels.predict_once(self.memory, self.tuning, u, *place, float(dt_s)))

    def update(self, y: ArrayLike) -> Status:
        """Use a measurement taken now.

        Parameters
        ----------
        y : (6,) float64 [m/s, rad]
            NaN where nothing was measured.

        Returns
        -------
        Status
            OK, PARTIAL; REJECTED when nothing was finite; otherwise why there is no state yet.
        """
        row = np.ascontiguousarray(y, dtype=np.float64)
        return Status(kernels.update_once(self.memory, self.tuning, row))

    def run(self, um: ArrayLike, y: ArrayLike, env: ArrayLike) -> Rows:
        """Predict and update row by row at the settings' interval.

        Parameters
        ----------
        um : (n, 6) float64 [m/s^2, rad/s]
            Inputs; row k holds from measurement k - 1 to measurement k.
        y : (n, 6) float64 [m/s, rad]
            Measurements at the ends of these intervals; NaN where nothing was measured.
        env : (n, 2) float64 [rad, m]
            Latitude and altitude at their starts.

        Returns
        -------
        (n,) rows of ``two_stage_memory.TRACK``
        """
        inputs, outputs = _six_columns(um), _six_columns(y)
        places = np.ascontiguousarray(env, dtype=np.float64).reshape(-1, 2)
        if not len(inputs) == len(outputs) == len(places):
            raise ValueError(f"{len(inputs)} inputs, {len(outputs)} outputs, {len(places)} places")
        out = np.empty(len(inputs), TRACK)
        dt_s = self.settings.dt_s
        kernels.run_fixed_rate(self.memory, self.tuning, inputs, outputs, places, dt_s, out)
        return out


@dataclass(slots=True)
class DelayedFilter:
    """A filter that lives a fixed delay behind the newest IMU sample.

    Measurements carry the time at which they were *valid*; a GPS velocity is 0.1 to 0.2 s old when
    it arrives. Used at its arrival it would pass for a fault of latency times the derivative of the
    acceleration. Here inputs and measurements wait until the newest input is `delay_s` ahead, and
    are then used in the order of their times: the step of the IMU is split where a measurement
    falls inside it. Estimates come out with that delay.

    A row that is older than what has been used is dropped and counted. As long as none is, any
    split of the stream into calls gives the same estimates to the last bit.

    Attributes
    ----------
    filter
        Does the work; without an initial state it starts at the first velocity and angles.
    delay_s
        At least the largest latency [s].
    capacity
        Most measurements that wait; beyond it, while no input comes, the oldest are dropped.
    late, dropped
        Measurements that came too late, and that found no room.
    """

    filter: TwoStageFilter
    delay_s: float
    capacity: int = 4096
    late: int = 0
    dropped: int = 0
    _imu_t: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    _um: Array = field(default_factory=lambda: np.empty((0, 6)))
    _meas_t: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    _y: Array = field(default_factory=lambda: np.empty((0, 6)))

    def feed(
        self,
        imu_t_us: ArrayLike,
        um: ArrayLike,
        meas_t_us: ArrayLike,
        y: ArrayLike,
        latitude_rad: float,
        altitude_m: float,
    ) -> tuple[Ints, Rows]:
        """Take rows as they come, use those that have waited long enough.

        Parameters
        ----------
        imu_t_us : (n,) int64 [us]
            Times of the inputs, ascending; each input holds until the next.
        um : (n, 6) float64 [m/s^2, rad/s]
        meas_t_us : (m,) int64 [us]
            Times at which the measurements were valid, in any order.
        y : (m, 6) float64 [m/s, rad]
            NaN where nothing was measured: a velocity alone, angles alone, or both.
        latitude_rad, altitude_m
            Where the vehicle is.

        Returns
        -------
        t_us : (k,) int64 [us]
            Times of the measurements used now.
        track : (k,) rows of ``two_stage_memory.TRACK``
            Estimates at these times.
        """
        self._imu_t = np.concatenate([self._imu_t, np.asarray(imu_t_us, dtype=np.int64)])
        self._um = np.concatenate([self._um, _six_columns(um)])
        meas_t = np.concatenate([self._meas_t, np.asarray(meas_t_us, dtype=np.int64)])
        order = np.argsort(meas_t, kind="stable")
        self._meas_t = meas_t[order]
        self._y = np.concatenate([self._y, _six_columns(y)])[order]

        until = self._imu_t[-1] - round(self.delay_s * 1e6) if len(self._imu_t) else np.int64(-1)
        due = int(np.searchsorted(self._meas_t, until, side="right"))
        out = np.empty(due, TRACK)
        inputs, used = kernels.run_rows(
            self.filter.memory,
            self.filter.tuning,
            self._imu_t,
            self._um,
            self._meas_t,
            self._y,
            np.array([latitude_rad, altitude_m], dtype=np.float64),
            int(until),
            out,
        )
        times = self._meas_t[:used]
        self._imu_t, self._um = self._imu_t[inputs:], self._um[inputs:]
        excess = max(len(self._meas_t) - used - self.capacity, 0)
        self._meas_t, self._y = self._meas_t[used + excess :], self._y[used + excess :]
        self.late += int(np.count_nonzero(out["status"] == Status.LATE))
        self.dropped += excess
        return times, out
