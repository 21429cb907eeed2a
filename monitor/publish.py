"""What goes out over MAVLink, and when: states and estimates in, messages out.

No clock and no socket here. The host's monotonic time only paces what is sent; every stamp inside a
message is vehicle time. :class:`Publisher` gives messages by MAVLink name and fields; who sends
them encodes them (``links.mavlink.Encoder``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, hypot, isfinite, nan
from typing import Any

import numpy as np

from links.samples import Rows
from links.vocabulary import State
from monitor.announce import Announcer
from monitor.masks import FAULT, MONITORED, masks, stopped_engines
from monitor.settings.publish import PublishSettings
from monitor.verdict import StepResult

__all__ = ["RECONSTRUCTED_ID", "Message", "Publisher"]

RECONSTRUCTED_ID = 9
"""Instance of AIRSPEED, and first instance of HIGHRES_IMU, that carries reconstructed values."""

HEARTBEAT_US = 1_000_000

_MONITORED = frozenset({State.OK, State.SUSPECT, State.FAULTY})
_G0_M_S2 = 9.80665
_MAV_TYPE_ONBOARD_CONTROLLER = 18
_MAV_AUTOPILOT_INVALID = 8
_ACTIVE, _CRITICAL, _EMERGENCY = 4, 5, 6
_HIGHRES_ACC_GYRO = 0x3F
_INT16_MAX = 32767


@dataclass(frozen=True, slots=True)
class Message:
    """A MAVLink message by name and fields, not yet encoded.

    Attributes
    ----------
    link
        Number of the only link that it goes out on; None for every output.
    """

    name: str
    fields: Mapping[str, Any]
    link: int | None = None


class _Every:
    """True once per period of host time, and at the first question."""

    def __init__(self, period_us: float) -> None:
        self._period_us = period_us
        self._next_us: float | None = None

    def __call__(self, now_us: int) -> bool:
        if self._next_us is None:
            self._next_us = now_us + self._period_us
            return True
        if now_us < self._next_us:
            return False
        self._next_us = max(self._next_us + self._period_us, now_us + self._period_us / 2)
        return True


class Publisher:
    """Turns what the pipeline says into messages, each at its rate and at once where it matters.

    Parameters
    ----------
    settings
        Rates and choices.
    has_message
        Says whether the dialect has a message of this name; those it lacks are left out.
    """

    def __init__(
        self, settings: PublishSettings, has_message: Callable[[str], bool] = lambda name: True
    ) -> None:
        self._settings = settings
        self._has = has_message
        self._states: dict[str, State] = {}
        self._announcer = Announcer(settings.text_burst, settings.text_interval_s)
        self._newest: dict[str, np.void] = {}
        self._sent_t_us: dict[str, int] = {}
        self._sent_faults: dict[str, int] = {}
        self._heartbeat = _Every(HEARTBEAT_US)
        self._masks = _Every(1e6 / settings.mask_rate_hz)
        self._values = _Every(1e6 / settings.value_rate_hz) if settings.value_rate_hz else None

    def note(self, result: StepResult) -> None:
        """Take what one step of the pipeline gave."""
        for verdict in result.verdicts:
            self._states[verdict.sensor] = verdict.state
            self._announcer.note(verdict)
        for name, rows in result.estimates.items():
            if len(rows):
                self._newest[name] = rows[-1].copy()

    def due(self, now_us: int, t_us: int | None, silent: bool) -> list[Message]:
        """Messages to send now, in the order in which they should leave.

        Parameters
        ----------
        now_us
            Host monotonic time [us].
        t_us
            Newest vehicle time heard [us], None before any.
        silent
            The vehicle's link has fallen silent: the heartbeat says so and values stop.
        """
        out: list[Message] = []
        if t_us is not None:
            out += self._fault_masks(now_us, t_us)
            if self._settings.text:
                out += [
                    Message("STATUSTEXT", {"severity": t.severity, "text": t.text})
                    for t in self._announcer.due(now_us, t_us)
                ]
            if not silent and self._values is not None and self._values(now_us):
                out += self._reconstructed(t_us)
        if self._heartbeat(now_us):
            out.append(self._heartbeat_message(silent or t_us is None))
        return out

    def _heartbeat_message(self, silent: bool) -> Message:
        grave = not {State.FAULTY, State.STOPPED}.isdisjoint(self._states.values())
        return Message(
            "HEARTBEAT",
            {
                "type": _MAV_TYPE_ONBOARD_CONTROLLER,
                "autopilot": _MAV_AUTOPILOT_INVALID,
                "base_mode": 0,
                "custom_mode": 0,
                "system_status": _EMERGENCY if silent else _CRITICAL if grave else _ACTIVE,
                "mavlink_version": 3,
            },
        )

    def _fault_masks(self, now_us: int, t_us: int) -> list[Message]:
        faults = {FAULT + k: bits for k, bits in masks(self._states, {State.FAULTY}).items()}
        faults |= stopped_engines(self._states)
        periodic = self._masks(now_us)
        out = [
            _named(t_us, name, bits)
            for name, bits in faults.items()
            if periodic or bits != self._sent_faults.get(name, 0)
        ]
        self._sent_faults = faults
        if periodic:
            monitored = masks(self._states, _MONITORED)
            out += [_named(t_us, MONITORED + name, bits) for name, bits in monitored.items()]
        return out

    def _reconstructed(self, t_us: int) -> list[Message]:
        """Values of every estimate that is new since it was last sent and not too old."""
        out: list[Message] = []
        oldest_us = t_us - round(self._settings.value_age_max_s * 1e6)
        for name, row in self._newest.items():
            row_t_us = int(row["t_us"])
            if row_t_us < oldest_us or row_t_us == self._sent_t_us.get(name):
                continue
            self._sent_t_us[name] = row_t_us
            if name == "air":
                out += self._air(row)
            elif name.startswith("imu") and name[3:].isdigit():
                out += self._imu(int(name[3:]), row)
            elif self._settings.values_named and name == "engine":
                out += self._engine(row)
            elif self._settings.values_named and name == "wing":
                out += self._wing(row)
        return [m for m in out if self._has(m.name)]

    def _air(self, row: np.void) -> list[Message]:
        t_us = int(row["t_us"])
        wind = row["wind_ned_m_s"]
        wind_std = row["wind_std_ned_m_s"]
        out: list[Message] = []
        if self._settings.values_named:
            shown = {
                "R_CAS": float(row["cas_m_s"]),
                "R_TAS": float(row["tas_m_s"]),
                "R_AOA": degrees(row["aoa_rad"]),
                "R_SSA": degrees(row["ssa_rad"]),
                "R_WN": float(wind[0]),
                "R_WE": float(wind[1]),
                "R_WD": float(wind[2]),
            }
            out += [_named(t_us, name, value) for name, value in shown.items() if isfinite(value)]
        if not self._settings.values_standard:
            return out
        if isfinite(row["cas_m_s"]):
            fields = {
                "id": RECONSTRUCTED_ID,
                "airspeed": float(row["cas_m_s"]),
                "temperature": _INT16_MAX,
                "raw_press": nan,
                "flags": 0,
            }
            out.append(Message("AIRSPEED", fields))
        if isfinite(row["aoa_rad"]):
            fields = {
                "time_usec": t_us,
                "AOA": degrees(row["aoa_rad"]),
                "SSA": degrees(row["ssa_rad"]),
            }
            out.append(Message("AOA_SSA", fields))
        if np.isfinite(wind[:2]).all():
            horizontal_std = hypot(float(wind_std[0]), float(wind_std[1]))
            fields = {
                "time_usec": t_us,
                "wind_x": float(wind[0]),
                "wind_y": float(wind[1]),
                "wind_z": float(wind[2]),
                "var_horiz": horizontal_std**2,
                "var_vert": float(wind_std[2]) ** 2,
                "wind_alt": nan,
                "horiz_accuracy": nan,
                "vert_accuracy": nan,
            }
            out.append(Message("WIND_COV", fields))
        return out

    def _engine(self, row: np.void) -> list[Message]:
        t_us, speeds_rpm = int(row["t_us"]), row["speed_rpm"]
        return [
            _named(t_us, f"R_N{i + 1}", float(speed))
            for i, speed in enumerate(speeds_rpm)
            if isfinite(speed)
        ]

    def _wing(self, row: np.void) -> list[Message]:
        """``WL_LIFT``, ``WL_DRAG``, ``WR_LIFT``, ``WR_DRAG``: loss of lift, gain of drag [%]."""
        return [
            _named(
                int(row["t_us"]),
                f"W{side[0].upper()}_{what.upper()}",
                float(row[f"{side}_{what}_percent"]),
            )
            for side in ("left", "right")
            for what in ("lift", "drag")
        ]

    def _imu(self, instance: int, row: np.void) -> list[Message]:
        out: list[Message] = []
        if self._settings.imu_faults:
            data = [0.0] * 58
            data[0:3] = row["acc_fault_m_s2"].tolist()
            data[3:6] = row["gyro_fault_rad_s"].tolist()
            data[6:9] = row["acc_fault_std_m_s2"].tolist()
            data[9:12] = row["gyro_fault_std_rad_s"].tolist()
            fields = {
                "time_usec": int(row["t_us"]),
                "name": "IMU_FLT",
                "array_id": instance,
                "data": data,
            }
            out.append(Message("DEBUG_FLOAT_ARRAY", fields))
        reconstructed = np.concatenate([row["acc_m_s2"], row["gyro_rad_s"]])
        if self._settings.imu_reconstructed != "off" and np.isfinite(reconstructed).all():
            out.append(self._imu_message(instance, int(row["t_us"]), reconstructed))
        return out

    def _imu_message(self, instance: int, t_us: int, values: Rows) -> Message:
        """Freed specific force and rates (6,) [m/s^2, rad/s] in the message that was chosen."""
        names = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")
        if self._settings.imu_reconstructed == "HIGHRES_IMU":
            blank = ("xmag", "ymag", "zmag", "abs_pressure", "diff_pressure", "pressure_alt")
            return Message(
                "HIGHRES_IMU",
                {
                    "time_usec": t_us,
                    **dict(zip(names, values.tolist(), strict=True)),
                    **dict.fromkeys((*blank, "temperature"), 0.0),
                    "fields_updated": _HIGHRES_ACC_GYRO,
                    "id": RECONSTRUCTED_ID + instance,
                },
            )
        scale = np.array([1e3 / _G0_M_S2] * 3 + [1e3] * 3)  # mG and mrad/s
        counts = np.clip(np.rint(values * scale), -_INT16_MAX, _INT16_MAX).astype(int)
        return Message(
            "SCALED_IMU" if instance == 0 else f"SCALED_IMU{instance + 1}",
            {
                "time_boot_ms": _boot_ms(t_us),
                **dict(zip(names, counts.tolist(), strict=True)),
                "xmag": 0,
                "ymag": 0,
                "zmag": 0,
            },
        )

    @property
    def states(self) -> Mapping[str, State]:
        """State of every sensor that a verdict was heard on."""
        return self._states


def _boot_ms(t_us: int) -> int:
    return (t_us // 1000) & 0xFFFFFFFF


def _named(t_us: int, name: str, value: float) -> Message:
    return Message(
        "NAMED_VALUE_FLOAT",
        {"time_boot_ms": _boot_ms(t_us), "name": name, "value": float(value)},
    )
