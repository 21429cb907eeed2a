"""IMU watch: samples of IMUs and their references to verdicts on each axis.

The rows of all sensors become one time-ordered stream for :mod:`estimators.ins_bank`; whenever that
stops at a tick that deserves a decision, :class:`monitor.watch.imu_judge.Judge` takes it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimators import ins_bank as bank
from estimators.atmosphere import altitude_from_pressure
from estimators.ins_bank_events import merge, within
from links.samples import Rows, quantity_of
from monitor.retune import Retuned, blend
from monitor.settings import Settings
from monitor.settings.imu import ImuSettings
from monitor.verdict import IMU_ESTIMATE, IMU_TESTS, StepResult
from monitor.watch.imu_judge import Judge

__all__ = ["ImuWatch", "tuning_of"]

TICK_S = 0.2
INTEREST_SIGMA = 4.5
"""Windows louder than this are looked at; below every threshold that a verdict needs."""

FIXED = ("window_s",)
"""Settings that the filters' arrays are made by."""

REPEATED_US = 5_000_000
"""A fix no newer than the newest is one sent again; this far behind, the receiver's clock was set
[us]."""

_RATIOS = slice(19, bank.TICK_WIDTH)
"""Columns of a tick's row that are statistics over thresholds."""

_LIMIT_ACC_M_S2 = 500.0
_LIMIT_GYRO_RAD_S = 60.0

_PEAKS = {
    "imu.difference_sigma": bank.P_PAIR,
    "imu.single_sigma": bank.P_LONE,
    "imu.noise_ratio": bank.P_NOISE,
    "imu.acc_size_m_s2": bank.P_ACC,
    "imu.gyro_size_rad_s": bank.P_GYRO,
}
"""Settings key -> peak. What settles a dispute has no healthy value: it is not learnt."""


def tuning_of(s: ImuSettings) -> bank.Tuning:
    """The settings as the arrays that the filters read."""

    def six(acc: float, gyro: float) -> NDArray[np.float64]:
        return np.array([acc] * 3 + [gyro] * 3)

    return bank.Tuning(
        noise_density=six(s.acc_noise_m_s2_sqrt_hz, s.gyro_noise_rad_s_sqrt_hz),
        scale_error=six(s.scale_error, s.scale_error),
        fault_density=six(s.acc_walk_m_s2_sqrt_s, s.gyro_walk_rad_s_sqrt_s),
        turn_on_std=six(s.acc_turn_on_m_s2, s.gyro_turn_on_rad_s),
        ref_std=np.array(
            [
                [s.wind_std_m_s, s.wind_std_m_s, 4.0 * s.heading_error_rad, s.baro_error_m],
                [s.tilt_error_rad, s.tilt_error_rad, s.heading_error_rad, s.baro_error_m],
            ]
        ),
        ref_tau=np.array([[300.0, 300.0, 60.0, 40.0], [30.0, 30.0, 60.0, 40.0]]),
        gps_std_m_s=s.gps_std_m_s,
        gps_down_std_m_s=s.gps_down_std_m_s,
        baro_std_m=s.baro_std_m,
        tilt_std_rad=s.tilt_std_rad,
        heading_std_rad=s.heading_std_rad,
        slip_std_rad=s.slip_std_rad,
        gust_std_m_s=s.gust_std_m_s,
        window_s=np.array(s.window_s),
        tick_s=TICK_S,
        max_rate_rad_s=s.max_rate_rad_s,
        interest_sigma=min(INTEREST_SIGMA, s.single_sigma),
        interest_size=0.5 * six(s.acc_size_m_s2, s.gyro_size_rad_s),
        difference_sigma=s.difference_sigma,
        single_sigma=s.single_sigma,
        noise_ln=math.log(s.noise_ratio),
        attitude_independent=s.attitude_independent,
    )


class ImuWatch:
    """Judges the axes of up to five IMUs."""

    name = "imu"
    quantities = frozenset({"imu", "attitude", "gps", "nav", "baro"})

    def __init__(self, settings: ImuSettings) -> None:
        self._settings = settings
        self._tuning = tuning_of(settings)
        self._bank = bank.make_bank(bank.MAX_IMUS, self._tuning)
        self._judge = Judge(settings, self._tuning, self._bank)
        self._gps: str | None = None
        self._fix_us = 0
        self._alive: set[str] = set()

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings (see :class:`monitor.verdict.Watch`)."""
        self._settings, done = blend(self._settings, settings.imu, FIXED)
        self._tuning = tuning_of(self._settings)
        self._judge.retune(self._settings, self._tuning)
        return done.under("imu")

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        """Use the newly released rows (see :class:`monitor.verdict.Watch`)."""
        result = StepResult()
        events = self._events(rows)
        if events is None:
            return result
        t_s, kind, values = events
        room = min(int((t_s[-1] - t_s[0]) / TICK_S) + 3, len(t_s))  # a row closes one at most
        ticks = np.zeros((room, bank.MAX_IMUS, bank.TICK_WIDTH))
        used = np.zeros(1, dtype=np.int64)
        at = 0
        while at < len(t_s):
            at = bank.run(
                self._bank, self._tuning, t_s, kind, values, at, ticks, used, self._judge.busy
            )
            if self._bank.clock[bank.C_STOPPED] == 1.0:
                self._bank.clock[bank.C_STOPPED] = 0.0
                result.verdicts += self._judge.decide()
                ticks[used[0] - 1, :, _RATIOS] = self._bank.ratios
                bank.roll(self._bank, self._tuning)
        self._estimate(ticks[: int(used[0])], result)
        return result

    def peaks(self) -> dict[str, float]:
        """Largest value, while all was judged and nothing faulty, of what each key is held to.

        A statistic counts where its size is at least half of what makes a fault, a size where its
        statistic alone would. Sizes are physical: a flight that shows less does not lower them.
        """
        return {key: float(self._bank.peaks[at]) for key, at in _PEAKS.items()}

    def _events(
        self, rows: Mapping[str, Rows]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]] | None:
        """One stream in (time, arrival) order of all rows that the filters use.

        The pipeline hands over each sensor's rows in that order.
        """
        parts = []
        for sensor, new in rows.items():
            if len(new) == 0:
                continue
            part = self._part(sensor, new)
            if part is not None and len(part[0]):
                parts.append(part)
        if not parts:
            return None
        t_us = np.concatenate([p[0]["t_us"] for p in parts])
        seq = np.concatenate([p[0]["seq"] for p in parts])
        values = np.concatenate([p[2] for p in parts])
        edge = np.cumsum([0, *(len(p[0]) for p in parts)])
        return merge(t_us, seq, values, edge, np.array([p[1] for p in parts]))

    def _part(self, sensor: str, new: Rows) -> tuple[Rows, int, NDArray[np.float64]] | None:
        if sensor == "phase":
            return new, bank.PHASE, _wide(new["flying"].astype(float)[:, None])
        quantity = quantity_of(sensor)
        if quantity == "imu":
            imu = int(sensor[3:])
            return None if imu >= bank.MAX_IMUS else self._imu_part(sensor, imu, new)
        if sensor == "attitude":
            new = new[np.isfinite(new["q_ned_from_frd"]).all(axis=1)]
            return new, bank.ATTITUDE, _wide(new["q_ned_from_frd"])
        if quantity == "gps":
            return self._gps_part(sensor, new)
        if sensor == "baro0":
            new = new[(new["static_press_pa"] > 1e3) & (new["static_press_pa"] < 1.2e5)]
            return new, bank.BARO, _wide(_heights(new["static_press_pa"]))
        return None

    def _imu_part(
        self, sensor: str, imu: int, new: Rows
    ) -> tuple[Rows, int, NDArray[np.float64]] | None:
        values = np.zeros((len(new), bank.EVENT_WIDTH))
        values[:, :3], values[:, 3:6] = new["acc_m_s2"], new["gyro_rad_s"]
        good = within(values, _LIMIT_ACC_M_S2, _LIMIT_GYRO_RAD_S)
        if sensor not in self._alive:
            nonzero = np.flatnonzero((values != 0.0).any(axis=1))
            if len(nonzero) == 0:
                return None
            self._alive.add(sensor)
            good[: nonzero[0]] = False
        return (new, imu, values) if good.all() else (new[good], imu, values[good])

    def _gps_part(self, sensor: str, new: Rows) -> tuple[Rows, int, NDArray[np.float64]] | None:
        no_fix = new["fix_type"] < 3
        good = ~no_fix & ((new["lat_rad"] != 0.0) | (new["lon_rad"] != 0.0))
        good &= np.isfinite(new["vel_ned_m_s"][:, :2]).all(axis=1)
        if self._gps is None and good.any():
            self._gps = sensor
        if sensor != self._gps:
            return None
        # An autopilot that sends faster than its receiver measures repeats a fix.
        fix_us = new["stamp_us"]
        newest_us = np.maximum.accumulate(np.concatenate(([self._fix_us], fix_us)))
        behind_us = newest_us[:-1] - fix_us
        good &= (fix_us == 0) | (behind_us < 0) | (behind_us > REPEATED_US)
        self._fix_us = int(newest_us[-1])
        used = good | no_fix
        new, no_fix = new[used], no_fix[used]
        std = new["vel_std_m_s"]
        values = np.column_stack(
            [
                np.where(no_fix[:, None], np.nan, new["vel_ned_m_s"]),
                new["lat_rad"],
                np.nan_to_num(new["alt_m"]),
                new["lon_rad"],
                np.nan_to_num(std),
            ]
        )
        return new, bank.GPS, _wide(values)

    def _estimate(self, ticks: NDArray[np.float64], result: StepResult) -> None:
        if len(ticks) == 0:
            return
        for i in range(bank.MAX_IMUS):
            if f"imu{i}" not in self._alive:
                continue
            tested = ticks[np.isfinite(ticks[:, i, _RATIOS]).any(axis=1), i]
            if len(tested):
                result.estimates[f"imu{i}_tests"] = _tests(tested)
            own = ticks[np.isfinite(ticks[:, i, 1])][:, i]
            if len(own) == 0:
                continue
            out = np.zeros(len(own), dtype=IMU_ESTIMATE)
            out["t_us"] = np.round(own[:, 0] * 1e6).astype(np.int64)
            out["acc_fault_m_s2"], out["gyro_fault_rad_s"] = own[:, 1:4], own[:, 4:7]
            std = np.sqrt(np.maximum(own[:, 7:13], 0.0))
            out["acc_fault_std_m_s2"], out["gyro_fault_std_rad_s"] = std[:, :3], std[:, 3:]
            out["acc_m_s2"] = own[:, 13:16] - own[:, 1:4]
            out["gyro_rad_s"] = own[:, 16:19] - own[:, 4:7]
            result.estimates[f"imu{i}"] = out


def _tests(ticks: NDArray[np.float64]) -> Rows:
    """Ratios as rows."""
    out = np.zeros(len(ticks), dtype=IMU_TESTS)
    out["t_us"] = np.round(ticks[:, 0] * 1e6).astype(np.int64)
    for name, ratio in zip((IMU_TESTS.names or ())[1:], ticks[:, _RATIOS].T, strict=True):
        out[name] = ratio
    return out


def _wide(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values as the columns of an event."""
    out = np.zeros((len(values), bank.EVENT_WIDTH))
    out[:, : values.shape[1]] = values
    return out


def _heights(pressures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pressure heights, as a column."""
    return np.array([[altitude_from_pressure(p)] for p in pressures])
