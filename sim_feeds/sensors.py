"""What the instruments deliver: noise, bias, lag and rate on top of truth, and when it arrives.

Every instrument is a section of a scenario. ``sample`` gives a :class:`Series`: when each reading
was valid, the stamp the vehicle gives it, when it is sent, and its values. Each instrument draws
from a random stream of its own name, so that another sensor, fault or rate changes nothing in it.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from links.vocabulary import GYRO_ACC_AXES
from sim_feeds import earth
from sim_feeds.faults import Fault, FaultKind, apply_all, plumbing
from sim_feeds.section import Strict
from sim_feeds.trajectory import Truth

__all__ = [
    "Airspeed",
    "Aoa",
    "Baro",
    "Gps",
    "Imu",
    "Instrument",
    "Series",
    "markov",
    "stream",
]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Series:
    """Readings of one sensor.

    Attributes
    ----------
    valid_s, stamp_s, sent_s : (n,)
        When the quantity had this value, what the vehicle writes as its time, when it goes out.
    values : (n, k)
        The columns are the sensor's; see its ``sample``.
    """

    valid_s: Floats
    stamp_s: Floats
    sent_s: Floats
    values: Floats

    def kept(self, keep: NDArray[np.bool_]) -> Series:
        """The rows where ``keep`` holds."""
        return Series(self.valid_s[keep], self.stamp_s[keep], self.sent_s[keep], self.values[keep])


def stream(seed: int, name: str) -> np.random.Generator:
    """Random stream of one sensor: depends on the seed and the name alone."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def markov(rng: np.random.Generator, t_s: Floats, std: float, tau_s: float) -> Floats:
    """First-order Gauss-Markov process at ascending times, stationary, (n,)."""
    n = len(t_s)
    kick = rng.standard_normal(n)
    if not n or std == 0.0:
        return np.zeros(n)
    keep = np.exp(-np.diff(t_s) / tau_s)
    kick[1:] *= np.sqrt(-np.expm1(-2.0 * np.diff(t_s) / tau_s))
    out = [x := float(kick[0])]
    for k, e in zip(keep.tolist(), kick[1:].tolist(), strict=True):
        out.append(x := k * x + e)
    return std * np.array(out)


def walk(rng: np.random.Generator, t_s: Floats, rate: float) -> Floats:
    """Random walk from zero that spreads by ``rate`` per square root of a second, (n,)."""
    steps = rate * np.sqrt(np.diff(t_s, prepend=t_s[:1])) * rng.standard_normal(len(t_s))
    return np.asarray(np.cumsum(steps))


def quantised(x: Floats, quantum: float) -> Floats:
    """Rounded to multiples of ``quantum``; 0 leaves x as it is."""
    return np.round(x / quantum) * quantum if quantum > 0.0 else x


def lagged(x: Floats, dt_s: float, lag_s: float) -> Floats:
    """First-order lag of a history on an even grid, settled in its first value."""
    if lag_s <= 0.0:
        return x
    keep = float(np.exp(-dt_s / lag_s))
    out = [y := float(x[0])]
    for value in x[1:].tolist():
        out.append(y := value + keep * (y - value))
    return np.array(out)


class Instrument(Strict):
    """When an instrument measures and when its reading arrives."""

    count: int = Field(1, ge=0, le=5, description="How many of them the aircraft carries.")
    rate_hz: float = Field(10.0, gt=0.0, le=400.0, description="Readings per second.")
    jitter_s: float = Field(0.0005, ge=0.0, description="Std of the sampling time.")
    latency_s: float = Field(0.003, ge=0.0, description="From validity to transmission.")
    latency_jitter_s: float = Field(0.002, ge=0.0, description="Mean of an added exponential.")
    stamp_delay_s: float = Field(0.0, ge=0.0, description="Stamp minus time of validity.")
    loss: float = Field(0.0, ge=0.0, lt=1.0, description="Share of readings lost at random.")

    def times(self, end_s: float, rng: np.random.Generator) -> Series:
        """Sampling times within [0, end_s], without values."""
        start = rng.uniform(0.0, 1.0 / self.rate_hz)
        n = int((end_s - start) * self.rate_hz)
        nominal = start + np.arange(n) / self.rate_hz
        spread = np.clip(self.jitter_s * rng.standard_normal(n), -0.4 / self.rate_hz, None)
        valid = np.clip(nominal + np.minimum(spread, 0.4 / self.rate_hz), 0.0, end_s)
        sent = valid + self.latency_s + self.latency_jitter_s * rng.exponential(size=n)
        keep = rng.random(n) >= self.loss
        out = Series(valid, valid + self.stamp_delay_s, np.maximum.accumulate(sent), valid[:, None])
        return out.kept(keep)


def broken(
    faults: Sequence[Fault], channel: str, t_s: Floats, x: Floats, rng: np.random.Generator
) -> Floats:
    """Readings of one channel after its faults; a dropout reads NaN."""
    return apply_all([f for f in faults if f.sensor == channel], t_s, x, rng)


class Imu(Instrument):
    """Accelerometers and gyros."""

    count: int = Field(2, ge=1, le=4, description="How many of them the aircraft carries.")
    rate_hz: float = Field(50.0, gt=0.0, le=200.0, description="Readings per second.")
    acc_noise_m_s2: float = Field(
        0.08, ge=0.0, description="White noise of a reading, with vibration."
    )
    gyro_noise_deg_s: float = Field(0.15, ge=0.0, description="White noise of a reading.")
    acc_bias_m_s2: float = Field(0.03, ge=0.0, description="Std of the turn-on bias per axis.")
    gyro_bias_deg_s: float = Field(0.05, ge=0.0, description="Std of the turn-on bias per axis.")
    acc_walk_m_s2: float = Field(
        0.0005, ge=0.0, description="Bias walk per square root of a second."
    )
    gyro_walk_deg_s: float = Field(
        0.0005, ge=0.0, description="Bias walk per square root of a second."
    )
    acc_quantum_m_s2: float = Field(
        0.0, ge=0.0, description="Resolution; the message adds its own."
    )
    gyro_quantum_deg_s: float = Field(0.0, ge=0.0, description="Resolution.")

    def sample(self, truth: Truth, index: int, faults: Sequence[Fault], seed: int) -> Series:
        """Columns acc_x acc_y acc_z [m/s^2], gyro_x gyro_y gyro_z [rad/s]."""
        name = f"imu{index}"
        rng = stream(seed, name)
        when = self.times(truth.t_s[-1], rng)
        t = when.valid_s
        here = truth.at(t)
        clean = np.column_stack([here.specific_force_m_s2, here.rate_rad_s])
        level = np.repeat([self.acc_noise_m_s2, radians(self.gyro_noise_deg_s)], 3)
        bias = np.repeat([self.acc_bias_m_s2, radians(self.gyro_bias_deg_s)], 3)
        drift = np.repeat([self.acc_walk_m_s2, radians(self.gyro_walk_deg_s)], 3)
        quantum = np.repeat([self.acc_quantum_m_s2, radians(self.gyro_quantum_deg_s)], 3)
        values = clean + bias * rng.standard_normal(6) + level * rng.standard_normal(clean.shape)
        for k, axis in enumerate(GYRO_ACC_AXES):
            own = stream(seed, f"{name}.{axis}")
            x = values[:, k] + walk(own, t, float(drift[k]))
            x = broken(faults, f"{name}.{axis}", t, x, own)
            values[:, k] = quantised(x, float(quantum[k]))
        return _without(faults, name, Series(t, when.stamp_s, when.sent_s, values))


class Airspeed(Instrument):
    """Pitot tubes; each has its own pneumatic lag, zero offset and calibration error."""

    noise_pa: float = Field(2.0, ge=0.0, description="White noise of the differential pressure.")
    offset_pa: float = Field(1.0, ge=0.0, description="Std of the zero offset.")
    scale_error: float = Field(0.01, ge=0.0, description="Std of the airspeed's calibration error.")
    lag_s: float = Field(0.08, ge=0.0, description="Pneumatic lag.")
    ratio: float = Field(2.0, gt=0.0, description="ARSPD_RATIO: CAS squared over pressure.")

    def sample(self, truth: Truth, index: int, faults: Sequence[Fault], seed: int) -> Series:
        """Columns calibrated airspeed [m/s], differential pressure as the autopilot reads it [Pa].

        The autopilot's pressure is CAS^2 / ratio, signed: its ratio stands for the whole
        calibration, so that both columns say the same airspeed.
        """
        name = f"airspeed{index}"
        rng = stream(seed, name)
        when = self.times(truth.t_s[-1], rng)
        own = [f for f in faults if f.sensor == name]
        impact, _ = plumbing(own, truth.t_s, truth.impact_pa, truth.static_pa)
        scale = 1.0 + self.scale_error * rng.standard_normal()
        offset = self.offset_pa * rng.standard_normal()
        t = when.valid_s
        pressure = np.interp(t, truth.t_s, lagged(impact, truth.dt_s, self.lag_s)) * scale**2
        pressure += offset + self.noise_pa * rng.standard_normal(len(t))
        cas = np.sign(pressure) * earth.calibrated_airspeed(np.abs(pressure))
        cas = broken(own, name, t, cas, rng)
        values = np.column_stack([np.maximum(cas, 0.0), np.sign(cas) * cas**2 / self.ratio])
        return _without(faults, name, Series(t, when.stamp_s, when.sent_s, values))


class Aoa(Instrument):
    """Angle of attack vanes."""

    count: int = Field(0, ge=0, le=3, description="How many of them the aircraft carries.")
    noise_deg: float = Field(0.2, ge=0.0, description="White noise of a reading.")
    bias_deg: float = Field(0.2, ge=0.0, description="Std of the alignment error.")
    lag_s: float = Field(0.03, ge=0.0, description="Lag of the vane.")

    def sample(self, truth: Truth, index: int, faults: Sequence[Fault], seed: int) -> Series:
        """Column angle of attack [rad]."""
        name = f"aoa{index}"
        rng = stream(seed, name)
        when = self.times(truth.t_s[-1], rng)
        bias = radians(self.bias_deg) * rng.standard_normal()
        t = when.valid_s
        # Without a flow from ahead the vane rests where it hangs.
        flow = np.where(truth.air_frd_m_s[:, 0] > VANE_FLOW_M_S, truth.aoa_rad, 0.0)
        angle = np.interp(t, truth.t_s, lagged(flow, truth.dt_s, self.lag_s)) + bias
        angle += radians(self.noise_deg) * rng.standard_normal(len(t))
        angle = broken(faults, name, t, angle, rng)
        return _without(faults, name, Series(t, when.stamp_s, when.sent_s, angle[:, None]))


VANE_FLOW_M_S: Final = 5.0


class Baro(Instrument):
    """Static pressure; shares the static port of the airspeed with the same number."""

    noise_pa: float = Field(3.0, ge=0.0, description="White noise of a reading.")
    offset_pa: float = Field(20.0, ge=0.0, description="Std of the constant error.")
    temperature_c: float = Field(20.0, ge=0.0, description="How much warmer the board is.")

    def sample(self, truth: Truth, index: int, faults: Sequence[Fault], seed: int) -> Series:
        """Columns static pressure [Pa], temperature of the sensor [K]."""
        name = f"baro{index}"
        rng = stream(seed, name)
        when = self.times(truth.t_s[-1], rng)
        port = [f for f in faults if f.sensor in (name, f"airspeed{index}")]
        port = [f for f in port if f.kind is FaultKind.STATIC_BLOCKED]
        _, static = plumbing(port, truth.t_s, truth.impact_pa, truth.static_pa)
        t = when.valid_s
        pressure = np.interp(t, truth.t_s, static) + self.offset_pa * rng.standard_normal()
        pressure += self.noise_pa * rng.standard_normal(len(t))
        pressure = broken(faults, name, t, pressure, rng)
        warm = np.interp(t, truth.t_s, truth.temperature_k) + self.temperature_c
        values = np.column_stack([pressure, warm])
        return _without(faults, name, Series(t, when.stamp_s, when.sent_s, values))


class Gps(Instrument):
    """Satellite receiver: late, with slowly varying position error.

    Its stamp is when the autopilot received the solution, ``stamp_delay_s`` after it was valid; the
    message follows ``latency_s`` after validity. In an outage ArduPilot goes on sending: without a
    fix, with a frozen stamp and position, and with a velocity that wanders.
    """

    rate_hz: float = Field(5.0, gt=0.0, le=20.0, description="Solutions per second.")
    jitter_s: float = Field(0.0, ge=0.0, description="Std of the sampling time.")
    latency_s: float = Field(0.17, ge=0.0, description="From validity to transmission.")
    latency_jitter_s: float = Field(0.01, ge=0.0, description="Mean of an added exponential.")
    stamp_delay_s: float = Field(0.07, ge=0.0, description="Stamp minus time of validity.")
    position_std_m: float = Field(1.2, ge=0.0, description="Slow horizontal error, per axis.")
    height_std_m: float = Field(2.0, ge=0.0, description="Slow vertical error.")
    velocity_std_m_s: float = Field(0.08, ge=0.0, description="White velocity noise, per axis.")
    slow_velocity_std_m_s: float = Field(0.05, ge=0.0, description="Slow velocity error, per axis.")
    satellites: int = Field(16, ge=0, le=60, description="Number used.")

    def sample(self, truth: Truth, index: int, faults: Sequence[Fault], seed: int) -> Series:
        """Columns latitude, longitude [rad], height [m], velocity N E D [m/s], 1 with a fix."""
        name = f"gps{index}"
        rng = stream(seed, name)
        when = self.times(truth.t_s[-1], rng)
        t = when.valid_s
        here = truth.at(t)
        error = np.column_stack(
            [
                markov(rng, t, std, SLOW_GPS_S)
                for std in (self.position_std_m, self.position_std_m, self.height_std_m)
            ]
        )
        slow = np.column_stack([markov(rng, t, self.slow_velocity_std_m_s, 10.0) for _ in "NED"])
        vel = here.vel_ned_m_s + slow + self.velocity_std_m_s * rng.standard_normal((len(t), 3))
        for k, axis in enumerate(GPS_AXES):
            vel[:, k] = broken(
                faults, f"{name}.{axis}", t, vel[:, k], stream(seed, f"{name}.{axis}")
            )
        radius = earth.EARTH_RADIUS_M + here.height_m
        values = np.column_stack(
            [
                here.lat_rad + error[:, 0] / radius,
                here.lon_rad + error[:, 1] / (radius * np.cos(here.lat_rad)),
                here.height_m + error[:, 2],
                vel,
                np.ones(len(t)),
            ]
        )
        stamp = when.stamp_s.copy()
        for fault in faults:
            on = np.flatnonzero(fault.active(t))
            if fault.sensor == name and fault.kind is FaultKind.OUTAGE and len(on):
                last = max(on[0] - 1, 0)
                stamp[on], values[on, :3] = stamp[last], values[last, :3]
                values[on, 3:6] += OUTAGE_WANDER_M_S * rng.standard_normal((len(on), 3))
                values[on, 6] = 0.0
        return _without(faults, name, Series(t, stamp, when.sent_s, values))


SLOW_GPS_S: Final = 60.0
OUTAGE_WANDER_M_S: Final = 2.0
GPS_AXES: Final = ("vel_n", "vel_e", "vel_d")


def _without(faults: Sequence[Fault], name: str, series: Series) -> Series:
    """The series without the rows that a dropout of the sensor or one of its axes takes away."""
    gone = np.asarray(~np.isfinite(series.values).all(axis=1))
    for fault in faults:
        if fault.sensor == name and fault.kind is FaultKind.DROPOUT:
            gone |= fault.active(series.valid_s)
    return series.kept(np.logical_not(gone))
