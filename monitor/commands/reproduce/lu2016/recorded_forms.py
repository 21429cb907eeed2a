"""The forms in which a recorded MAVLink flight gives lu2016's inputs, and the filter run on them.

A recording of a small autopilot is not the paper's: an IMU at 10 Hz with uneven intervals, an
attitude at 2.5 Hz, a receiver at 5 Hz whose message has no vertical velocity and is late. The forms
differ in how measurements meet the IMU:

=============  =====================================================================================
interpolated   measurements drawn as straight lines through all samples, read at the IMU's times:
               the paper's way, for a recording only
own times      each measurement used at the time at which it was valid, the IMU's step split there
               (:class:`estimators.two_stage_ekf.DelayedFilter`): what can be done in flight
pipeline       the monitor itself, with its two filters an IMU, tests and verdicts
=============  =====================================================================================

Differs
-------
vertical velocity
    The slope of the receiver's altitude, a parabola through five fixes.
inputs
    The mean of two IMU samples holds between them; the paper's intervals are ten times shorter.
Q
    From the monitor's settings and the jumps between samples before any fault; R likewise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.ins_bank_measure import NOISE_FRACTION
from estimators.two_stage_ekf import DelayedFilter, TwoStageFilter
from estimators.two_stage_ekf import Settings as FilterSettings
from links.samples import Batch, Rows
from links.vocabulary import GYRO_ACC_AXES
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.settings.imu import ImuSettings
from monitor.verdict import Verdict
from sim_feeds.faults import Fault
from sim_feeds.rotation import euler_from_matrix, matrix_from_quaternion

__all__ = ["Estimates", "Inputs", "faults_at", "filtered", "inputs", "piped"]

Floats = NDArray[np.float64]

FIXES: Final = 5
"""Through which the slope of the altitude is drawn."""


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a recording holds for the ground-speed model; times in s from the first record.

    Attributes
    ----------
    imu_s, um : (n,), (n, 6)
        IMU samples.
    velocity_s, velocity : (m,), (m, 3)
        NED ground velocity at its time of validity.
    angles_s, angles : (k,), (k, 3)
        Roll, pitch, yaw; unwrapped.
    latitude_rad, altitude_m
        In the middle of the flight.
    """

    imu_s: Floats
    um: Floats
    velocity_s: Floats
    velocity: Floats
    angles_s: Floats
    angles: Floats
    latitude_rad: float
    altitude_m: float

    def thinned(self, hz: float) -> Inputs:
        """With a receiver no faster than this."""
        every = max(1, round(1.0 / (hz * float(np.median(np.diff(self.velocity_s))))))
        return replace(
            self, velocity_s=self.velocity_s[::every], velocity=self.velocity[::every].copy()
        )

    def input_std(self, settings: ImuSettings, until_s: float) -> tuple[float, ...]:
        """Noise of one sample of each axis: the sensor's, and what its jumps show, (6,).

        A share of the rms difference of successive samples up to a time stands for vibration and
        for motion between the samples, as in the monitor's own filters.
        """
        early = self.um[self.imu_s < until_s]
        jumps = np.mean(np.diff(early, axis=0) ** 2, axis=0)
        acc, gyro = settings.acc_noise_m_s2_sqrt_hz, settings.gyro_noise_rad_s_sqrt_hz
        sensor = np.square([acc] * 3 + [gyro] * 3) / self.interval_s
        return tuple(float(v) for v in np.sqrt(sensor + NOISE_FRACTION**2 * jumps))

    @property
    def interval_s(self) -> float:
        """Of the IMU's samples, the median."""
        return float(np.median(np.diff(self.imu_s)))

    def interpolated(self) -> tuple[Floats, Floats]:
        """Times of the IMU within both measurements, and these drawn to them, (k, 6)."""
        first = max(self.velocity_s[0], self.angles_s[0])
        last = min(self.velocity_s[-1], self.angles_s[-1])
        t = self.imu_s[(self.imu_s >= first) & (self.imu_s <= last)]
        velocity = [np.interp(t, self.velocity_s, v) for v in self.velocity.T]
        angles = [np.interp(t, self.angles_s, a) for a in self.angles.T]
        return t, np.column_stack([*velocity, *angles])

    def in_order(self) -> tuple[Floats, Floats]:
        """All measurements at their own times, in order; NaN where a row has none, (k, 6)."""
        t = np.concatenate([self.velocity_s, self.angles_s])
        y = np.full((len(t), 6), np.nan)
        y[: len(self.velocity_s), :3] = self.velocity
        y[len(self.velocity_s) :, 3:] = self.angles
        order = np.argsort(t, kind="stable")
        return t[order], y[order]


@dataclass(frozen=True, slots=True)
class Estimates:
    """What one form says.

    Attributes
    ----------
    t_s : (n,)
    f : (n, 6)
        Fault estimates [m/s^2, rad/s].
    residual : (n, 6)
        Measured less estimated state, NaN where nothing was measured; None from the pipeline.
    verdicts
        Of the pipeline.
    """

    t_s: Floats
    f: Floats
    residual: Floats | None = None
    verdicts: Sequence[Verdict] = ()


def inputs(batch: Batch, first_us: int, gps_latency_s: float) -> Inputs:
    """Take imu0, gps0 and the attitude out of decoded rows."""

    def seconds(rows: Rows) -> Floats:
        return np.asarray((rows["t_us"] - first_us) * 1e-6)

    imu, gps, attitude = (batch.rows[s] for s in ("imu0", "gps0", "attitude"))
    gps_s = seconds(gps) - gps_latency_s
    level = gps["vel_ned_m_s"][:, :2]
    down = -_slope(gps_s, gps["alt_m"])
    euler = euler_from_matrix(matrix_from_quaternion(attitude["q_ned_from_frd"]))
    return Inputs(
        imu_s=seconds(imu),
        um=np.hstack([imu["acc_m_s2"], imu["gyro_rad_s"]]),
        velocity_s=gps_s,
        velocity=np.column_stack([level, down]),
        angles_s=seconds(attitude),
        angles=np.unwrap(euler, axis=0),
        latitude_rad=float(np.median(gps["lat_rad"])),
        altitude_m=float(np.median(gps["alt_m"])),
    )


def _slope(t: Floats, y: Floats) -> Floats:
    """Derivative of a parabola through the neighbours of each sample."""
    out = np.empty(len(t))
    reach = FIXES // 2
    for i in range(len(t)):
        near = slice(max(0, i - reach), i + reach + 1)
        out[i] = np.polyfit(t[near] - t[i], y[near], 2)[1]
    return out


def faults_at(faults: Sequence[Fault], t_s: Floats) -> Floats:
    """What additive faults of an IMU add at these times, (n, 6) float64 [m/s^2, rad/s]."""
    out = np.zeros((len(t_s), 6))
    for fault in faults:
        axis = GYRO_ACC_AXES.index(fault.sensor.partition(".")[2])
        out[:, axis] += fault.disturb(t_s, np.zeros_like(t_s), 0.0)
    return out


def filtered(
    given: Inputs,
    settings: Settings,
    input_std: tuple[float, ...],
    *,
    interpolate: bool,
    **constants: Any,
) -> Estimates:
    """The adaptive two-stage filter on the ground-speed model.

    Parameters
    ----------
    given
        The recording's.
    settings
        The monitor's: noise of the measurements.
    input_std
        Noise of one IMU sample.
    interpolate
        Measurements at the IMU's times, or at their own.
    constants
        Of :class:`estimators.two_stage_ekf.Settings`.
    """
    imu = settings.imu
    level, tilt = (imu.gps_std_m_s,) * 2, (imu.tilt_std_rad,) * 2
    tuning = FilterSettings(
        dt_s=given.interval_s,
        input_std=input_std,
        output_std=(*level, imu.gps_down_std_m_s, *tilt, imu.heading_std_rad),
        **constants,
    )
    t, y = given.interpolated() if interpolate else given.in_order()
    held = given.um.copy()
    held[:-1] = 0.5 * (given.um[:-1] + given.um[1:])
    one = DelayedFilter(TwoStageFilter(tuning), 0.0, capacity=len(t))
    place = given.latitude_rad, given.altitude_m
    used, track = one.feed(_us(given.imu_s), held, _us(t), y, *place)
    residual = y[: len(track)] - track["x"]
    residual[:, 3:] = (residual[:, 3:] + np.pi) % (2.0 * np.pi) - np.pi
    t_s = np.asarray((used - _START_US) * 1e-6)
    return Estimates(t_s, track["f"].copy(), residual)


_START_US: Final = 10_000_000
"""Added to the times, for a measurement that was valid before the log's first record."""


def _us(t_s: Floats) -> NDArray[np.int64]:
    return np.round(t_s * 1e6).astype(np.int64) + _START_US


def piped(batch: Batch, first_us: int, settings: Settings, *, own_attitude: bool) -> Estimates:
    """The monitor's pipeline over the flight: estimates and verdicts of imu0.

    Parameters
    ----------
    batch
        All rows of the flight.
    first_us
        Vehicle time of its first record.
    settings
        The monitor's.
    own_attitude
        Whether the monitor is told that the attitude has gyros of its own.
    """
    imu = settings.imu.model_copy(update={"attitude_independent": own_attitude})
    pipeline = Pipeline(settings.model_copy(update={"imu": imu}))
    results = [pipeline.feed(batch), pipeline.finish()]
    rows = np.concatenate([r.estimates["imu0"] for r in results if "imu0" in r.estimates])
    f = np.hstack([rows["acc_fault_m_s2"], rows["gyro_fault_rad_s"]])
    verdicts = [v for r in results for v in r.verdicts if v.sensor.startswith("imu")]
    return Estimates((rows["t_us"] - first_us) * 1e-6, f, None, verdicts)
