"""What the wing watch needs of a flight, on a fixed grid of time.

Every stream is taken linearly between its samples, so a tick waits until all streams have passed
it; a stream that is late by more than ``late_s`` is not waited for and its tick is blank. A pause
of all of them has :data:`GAP_S` of blank ticks. Which rows came in one step together changes
nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi, radians

import numpy as np
from numpy.typing import NDArray

from estimators.atmosphere import EXPONENT, LAPSE_K_M, P0_PA, R_AIR, RHO0_KG_M3, T0_K
from estimators.attitude import euler_rows_from_quaternion_rows
from estimators.wing_model import INPUTS, inputs_of
from links.samples import Rows, empty_rows
from monitor.settings.wing import SurfaceSettings, WingSettings, surfaces_of

__all__ = ["NEEDED", "Ticks", "WingInputs"]

Array = NDArray[np.float64]

NEEDED = ("attitude", "velocity", "servo outputs", "airspeed", "propeller speed")
"""What a tick can lack, in the order in which it is named."""
PITOTS = ("airspeed0", "airspeed1", "airspeed2")
RPM_RAD_S = 2.0 * pi / 60.0
GAP_S = 5.0
"""A pause of all streams longer than this is skipped over."""
MOST_TRIM_US = 2500.0


@dataclass(slots=True)
class _Track:
    """Samples of one stream that are still needed."""

    width: int
    t: Array = field(default_factory=lambda: np.empty(0))
    y: Array = field(default_factory=lambda: np.empty((0, 0)))

    def add(self, t: Array, y: Array) -> None:
        """Append samples; one that is not finite or no later than the one before is left out."""
        if not len(self.y):
            self.y = np.empty((0, self.width))
        last = self.t[-1] if len(self.t) else -np.inf
        newest = np.maximum.accumulate(np.concatenate(([last], t)))[:-1]
        keep = np.isfinite(y).all(axis=1) & (t > newest)
        self.t = np.concatenate((self.t, t[keep]))
        self.y = np.concatenate((self.y, y[keep]))

    def at(self, ticks: Array, gap_s: float) -> Array:
        """Values at the ticks (n, width), NaN outside the samples and in gaps."""
        out = np.full((len(ticks), self.width), np.nan)
        if len(self.t) < 2:
            return out
        after = np.searchsorted(self.t, ticks, side="right")
        inside = (after > 0) & (after < len(self.t))
        i = after[inside]
        t0, t1 = self.t[i - 1], self.t[i]
        share = (ticks[inside] - t0) / (t1 - t0)
        value = self.y[i - 1] + share[:, None] * (self.y[i] - self.y[i - 1])
        value[t1 - t0 > gap_s] = np.nan
        out[inside] = value
        return out

    def forget(self, before_s: float) -> None:
        """Drop what no later tick needs."""
        keep = max(int(np.searchsorted(self.t, before_s, side="right")) - 1, 0)
        if keep:
            self.t, self.y = self.t[keep:], self.y[keep:]


@dataclass(frozen=True, slots=True)
class Ticks:
    """Closed steps of the grid.

    Attributes
    ----------
    t_s : (n,) float64
    x : (n, INPUTS) float64
        Inputs of :func:`estimators.wing_model.inputs_of` without the wind; blank ticks have NaN.
    acc : (n, 3) float64 [m/s^2]
        Mean specific force of the step that ends at the tick, NaN without an IMU.
    lacks : (n,) int64
        Index into :data:`NEEDED` of the first thing missing, -1 where nothing is.
    """

    t_s: Array
    x: Array
    acc: Array
    lacks: NDArray[np.int64]


class WingInputs:
    """Streams in, ticks out."""

    def __init__(self, settings: WingSettings) -> None:
        self._settings, self._surfaces = settings, surfaces_of(settings)
        self._tracks = {
            "attitude": _Track(7),
            "nav": _Track(4),
            "servo": _Track(3),
            "throttle": _Track(1),
            "spool": _Track(1),
            "baro": _Track(1),
            "imu": _Track(3),
            **{name: _Track(1) for name in PITOTS},
        }
        self._trims: dict[int, float] = {}
        self._sum = np.zeros(3)
        self._imu_s, self._imu_acc = -np.inf, np.zeros(3)
        self._q: Array | None = None
        self._newest_s = -np.inf
        self._next: int | None = None
        self._pauses: list[tuple[int, int]] = []

    def take(self, rows: Mapping[str, Rows], epoch_us: int) -> Ticks:
        """Use newly released rows; return the ticks that they closed."""
        heard = [np.array([self._newest_s])]
        for sensor, new in rows.items():
            name = "spool" if sensor == f"spool{self._settings.spool}" else sensor
            name = {"baro0": "baro", "imu0": "imu"}.get(sensor, name)
            if name in self._tracks and len(new):
                t = (new["t_us"] - epoch_us) * 1e-6
                heard.append(t)
                if name == "imu":
                    self._integrate(t, new["acc_m_s2"])
                elif name != "servo":
                    self._tracks[name].add(t, self._values(name, new))
        self._servo(rows, epoch_us)
        self._pause(np.sort(np.concatenate(heard)))
        tick_s, late_s = self._settings.tick_s, self._settings.late_s
        seen = [track.t[-1] for track in self._tracks.values() if len(track.t)]
        if not seen:
            blank = np.empty((0, INPUTS))
            return Ticks(np.empty(0), blank, np.empty((0, 3)), np.empty(0, np.int64))
        # a sample at the tick itself has one more after it when the tick is inside
        ready = max(float(min(seen)), self._newest_s - late_s - tick_s)
        end = int(np.floor(ready / tick_s))
        if self._next is None:
            self._next = int(np.ceil(min(float(track.t[0]) for track in self._tracks.values()
                                         if len(track.t)) / tick_s))  # fmt: skip
        out = self._close(self._steps(self._next, end) * tick_s)
        self._next = max(end, self._next)
        for track in self._tracks.values():
            track.forget((self._next - 1) * tick_s)
        return out

    def _pause(self, t: Array) -> None:
        """Note long pauses between the times in order, the first of which was the newest before."""
        for k in np.flatnonzero(np.diff(t) > GAP_S):
            if np.isfinite(t[k]):
                first = int(np.floor((t[k] + GAP_S) / self._settings.tick_s)) + 1
                self._pauses.append((first, int(np.floor(t[k + 1] / self._settings.tick_s))))
        self._newest_s = float(t[-1])

    def _steps(self, start: int, end: int) -> Array:
        """Steps from start to before end, without those in pauses."""
        parts = []
        for first, after in self._pauses:
            parts.append(np.arange(start, min(first, end), dtype=np.float64))
            start = max(start, min(after, end))
        self._pauses = [pause for pause in self._pauses if pause[1] > end]
        return np.concatenate([*parts, np.arange(start, end, dtype=np.float64)])

    def _integrate(self, t: Array, acc: Array) -> None:
        """Specific force as its integral, of which ticks take differences: a mean, not a sample."""
        if not self._settings.use_imu:
            return
        sound = np.isfinite(acc).all(axis=1) & (
            t > np.maximum.accumulate(np.concatenate(([self._imu_s], t)))[:-1]
        )
        t, acc = t[sound], acc[sound]
        if not len(t):
            return
        if not np.isfinite(self._imu_s):
            self._imu_s, self._imu_acc = float(t[0]), acc[0].copy()
        before = np.concatenate((self._imu_acc[None], acc))
        steps = 0.5 * np.diff(t, prepend=self._imu_s)[:, None] * (before[1:] + before[:-1])
        # one after the other, so that where the stream is cut changes nothing
        total = np.cumsum(np.concatenate((self._sum[None], steps)), axis=0)[1:]
        self._tracks["imu"].add(t, total)
        self._sum, self._imu_s, self._imu_acc = total[-1].copy(), float(t[-1]), acc[-1].copy()

    def _values(self, name: str, rows: Rows) -> Array:
        if name == "attitude":
            return np.column_stack((self._aligned(rows["q_ned_from_frd"]), rows["rate_rad_s"]))
        if name == "nav":
            return np.column_stack((rows["vel_ned_m_s"], rows["alt_m"]))
        key = {"spool": "speed_rpm", "baro": "static_press_pa"}.get(name, "cas_m_s")
        return np.asarray(rows[key][:, None], dtype=np.float64)

    def _aligned(self, q: Array) -> Array:
        """Quaternions on one side of the sphere, so that what lies between two is a rotation."""
        before = q[:1] if self._q is None else self._q[None]
        chain = np.concatenate((before, q))
        dots = np.sum(chain[1:] * chain[:-1], axis=1)
        out = q * np.cumprod(np.where(dots < 0.0, -1.0, 1.0))[:, None]
        self._q = out[-1].copy()
        return np.asarray(out)

    def _servo(self, rows: Mapping[str, Rows], epoch_us: int) -> None:
        """Pulses as deflections [rad] and throttle; a trim counts from when it is heard.

        A trim that is no pulse is passed over.
        """
        new = rows.get("servo")
        if new is None:
            new = empty_rows("servo")
        heard = rows.get("param")
        for row in heard if heard is not None else ():
            name = bytes(row["name"])
            channel = name[5:-5]
            if name.startswith(b"SERVO") and name.endswith(b"_TRIM") and channel.isdigit():
                before = np.searchsorted(new["t_us"], row["t_us"], side="left")
                while before < len(new) and (
                    new["t_us"][before] == row["t_us"] and new["seq"][before] < row["seq"]
                ):
                    before += 1
                self._deflect(new[:before], epoch_us)
                new = new[before:]
                if 0.0 < row["value"] <= MOST_TRIM_US:
                    self._trims[int(channel)] = float(row["value"])
        self._deflect(new, epoch_us)

    def _deflect(self, new: Rows, epoch_us: int) -> None:
        if not len(new):
            return
        s = self._settings
        pwm = np.where(new["pwm_us"] > 0.0, new["pwm_us"], np.nan)
        surfaces = [self._deflection(pwm, one) for one in self._surfaces]
        t = (new["t_us"] - epoch_us) * 1e-6
        self._tracks["servo"].add(t, np.column_stack(surfaces))
        if s.thrust_from != "rpm":
            throttle = (pwm[:, [s.throttle_channel - 1]] - 1000.0) / 1000.0
            self._tracks["throttle"].add(t, np.clip(throttle, 0.0, 1.0))

    def _deflection(self, pwm: Array, surface: SurfaceSettings) -> Array:
        trim = surface.trim_us or self._trims.get(surface.channel, 1500.0)
        share = (pwm[:, surface.channel - 1] - trim) / surface.travel_us
        return (-1.0 if surface.reversed else 1.0) * radians(surface.travel_deg) * share

    def _close(self, ticks: Array) -> Ticks:
        s, gap = self._settings, self._settings.late_s
        tracks = {name: track.at(ticks, gap) for name, track in self._tracks.items()}
        attitude, nav, servo = tracks["attitude"], tracks["nav"], tracks["servo"]
        imu = self._tracks["imu"]
        acc = (tracks["imu"] - imu.at(ticks - s.tick_s, gap)) / s.tick_s
        height = nav[:, 3]
        temperature = T0_K - LAPSE_K_M * np.nan_to_num(height)
        pressure = tracks["baro"][:, 0]
        standard = P0_PA * (temperature / T0_K) ** EXPONENT
        pressure = np.where(np.isfinite(pressure), pressure, standard)
        density = pressure / (R_AIR * temperature)
        cas = _middle(np.column_stack([tracks[name][:, 0] for name in PITOTS]))
        tas = cas * np.sqrt(RHO0_KG_M3 / density)
        prop = RPM_RAD_S * s.spool_ratio * np.maximum(tracks["spool"][:, 0], 0.0)
        if s.thrust_from != "rpm":
            span = s.prop_full_rad_s - s.prop_idle_rad_s
            guess = s.prop_idle_rad_s + span * tracks["throttle"][:, 0] + s.prop_advance_rad_m * tas
            prop = guess if s.thrust_from == "throttle" else np.where(
                np.isfinite(prop), prop, guess)  # fmt: skip
        x = inputs_of(
            euler_rad=euler_rows_from_quaternion_rows(np.ascontiguousarray(attitude[:, :4])),
            vel_ned_m_s=nav[:, :3],
            rate_rad_s=attitude[:, 4:],
            surfaces_rad=servo[:, :3],
            prop_rad_s=prop,
            wind_ned_m_s=np.zeros((len(ticks), 3)),
            density_kg_m3=density,
            height_m=height,
            tas_m_s=tas,
        )
        needed = np.column_stack(
            [np.isfinite(attitude).all(axis=1), np.isfinite(nav).all(axis=1),
             np.isfinite(servo).all(axis=1), np.isfinite(tas), np.isfinite(prop)]
        )  # fmt: skip
        lacks = np.where(needed.all(axis=1), -1, np.argmin(needed, axis=1))
        x[lacks >= 0] = np.nan
        return Ticks(ticks, x, acc, lacks)


def _middle(cas: Array) -> Array:
    """Median of the pitots that there are, (n,); NaN where none is."""
    ordered = np.sort(cas, axis=1)  # NaN last
    count = np.isfinite(ordered).sum(axis=1)
    two = 0.5 * (ordered[:, 0] + ordered[:, 1])
    return np.where(count == 3, ordered[:, 1], np.where(count == 2, two, ordered[:, 0]))
