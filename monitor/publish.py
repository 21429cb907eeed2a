"""What goes out over MAVLink, and when: states and estimates in, messages out.

No clock and no socket here. The host's monotonic time only paces what is sent; every stamp inside a
message is vehicle time. :class:`Publisher` gives messages by MAVLink name and fields; who sends
them encodes them (``links.mavlink.Encoder``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, hypot, isfinite, nan
from typing import Any, ClassVar

import numpy as np

from links.mavlink import OUTPUT_MESSAGES
from links.samples import Rows
from links.vocabulary import State
from monitor.announce import Announcer
from monitor.masks import FAULT, MONITORED, masks, stopped_engines
from monitor.pacing import STOPPED, Every, OwnIntervals
from monitor.retune import Retuned, blend
from monitor.settings import Settings
from monitor.settings.publish import PublishSettings
from monitor.verdict import StepResult

__all__ = ["RECONSTRUCTED_ID", "Message", "Publisher"]

RECONSTRUCTED_ID = 9
"""Instance of AIRSPEED, and first instance of HIGHRES_IMU, that carries reconstructed values."""

HEARTBEAT_US = 1_000_000

PERIODIC = frozenset(OUTPUT_MESSAGES) - {"HEARTBEAT", "STATUSTEXT"}
"""Messages whose interval may be asked for."""

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


class Publisher:
    """Turns what the pipeline says into messages, each at its rate and at once where it matters.

    Parameters
    ----------
    settings
        Rates and choices.
    has_message
        Says whether the dialect has a message of this name; those it lacks are left out.
    """

    fleeting: ClassVar = (
        "_settings",
        "_has",
        "_heartbeat",
        "_masks",
        "_values",
        "_own",
        "_silent",
        "_t_us",
        "_text",
    )
    """Of this process, not of what was said: see :mod:`monitor.checkpoint.graph`."""

    def __init__(
        self, settings: PublishSettings, has_message: Callable[[str], bool] = lambda name: True
    ) -> None:
        self._settings = settings
        self._has = has_message
        self._states: dict[str, State] = {}
        self._announcer = Announcer(settings.text_burst, settings.text_interval_s)
        self._newest: dict[str, np.void] = {}
        self._sent_t_us: dict[tuple[str, str], int] = {}
        self._sent_faults: dict[str, int] = {}
        self._heartbeat = Every(HEARTBEAT_US)
        self._masks = Every(1e6 / settings.mask_rate_hz)
        self._values = Every(_value_period_us(settings))
        self._own = OwnIntervals()
        self._silent = True
        self._t_us: int | None = None
        self._text: Message | None = None

    def retune(self, settings: Settings) -> Retuned:
        """Take new rates and choices, of [publish] alone; what was said and sent is remembered.

        Returns
        -------
        Retuned
            Dotted keys. Where messages go (``publish.to_input``) waits.
        """
        self._settings, done = blend(self._settings, settings.publish, ("to_input",))
        s = self._settings
        self._announcer.retune(s.text_burst, s.text_interval_s)
        self._masks.retune(1e6 / s.mask_rate_hz)
        self._values.retune(_value_period_us(s))
        return done.under("publish")

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
        self._silent, self._t_us = silent, t_us
        own = self._own.due(now_us)
        if t_us is not None:
            out += self._fault_masks(now_us, t_us, own)
            if self._settings.text:
                texts = [
                    Message("STATUSTEXT", {"severity": t.severity, "text": t.text})
                    for t in self._announcer.due(now_us, t_us)
                ]
                self._text = texts[-1] if texts else self._text
                out += texts
            if not silent:
                configured = bool(self._settings.value_rate_hz) and self._values(now_us)
                if configured or own:
                    out += self._reconstructed(t_us, configured, own)
        if self._heartbeat(now_us):
            out.append(self._heartbeat_message(silent or t_us is None))
        return out

    # ------------------------------------------------------------------ on request

    def interval_us(self, name: str) -> int:
        """Time between two messages of a name [us]; -1 not sent, 0 not ours or on a change only."""
        if name == "HEARTBEAT":
            return HEARTBEAT_US
        if name not in PERIODIC or not self._has(name):
            return 0
        rate_hz = self._settings.value_rate_hz
        if name == "NAMED_VALUE_FLOAT":
            rate_hz = max(rate_hz, self._settings.mask_rate_hz)
        offered = self._offers(name)
        return self._own.get(name, round(1e6 / rate_hz) if offered else STOPPED)

    def set_interval(self, name: str, interval_us: int) -> bool:
        """Send a periodic message at another interval [us]; -1 stops it, 0 takes that back.

        What goes out on a change goes out all the same, and the heartbeat stays as it is: False
        for it, for messages that are not ours or switched off by the configuration, and for
        intervals below ``monitor.pacing.LEAST_INTERVAL_US``.
        """
        if name == "HEARTBEAT":
            return interval_us in (0, HEARTBEAT_US)
        if name not in PERIODIC or not self._has(name) or not self._offers(name):
            return False
        return self._own.put(name, interval_us)

    def newest(self, name: str) -> list[Message]:
        """The messages of a name as they would be sent now; empty where there is nothing to say."""
        if name == "HEARTBEAT":
            return [self._heartbeat_message(self._silent or self._t_us is None)]
        if name == "STATUSTEXT":
            return [self._text] if self._text is not None else []
        if self._t_us is None:
            return []
        out = self._all_masks(self._t_us) if name == "NAMED_VALUE_FLOAT" else []
        for estimate, row in self._newest.items():
            if not self._old(row, self._t_us):
                out += self._contents(estimate, row)
        return [m for m in out if m.name == name and self._has(name)]

    def _offers(self, name: str) -> bool:
        """Whether the configuration has this message sent at all."""
        here = self._settings
        if name == "NAMED_VALUE_FLOAT":
            return True
        if not here.value_rate_hz:
            return False
        if name in ("AIRSPEED", "AOA_SSA", "WIND_COV"):
            return here.values_standard
        if name == "DEBUG_FLOAT_ARRAY":
            return here.imu_faults
        return name.startswith(here.imu_reconstructed)

    # ------------------------------------------------------------------ contents

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

    def _faults(self) -> dict[str, int]:
        faults = {FAULT + k: bits for k, bits in masks(self._states, {State.FAULTY}).items()}
        return faults | stopped_engines(self._states)

    def _monitored(self) -> dict[str, int]:
        """What is being judged: nothing while the vehicle is not heard, whatever the states say."""
        return masks(self._states, () if self._silent else _MONITORED)

    def _all_masks(self, t_us: int) -> list[Message]:
        monitored = self._monitored()
        return [_named(t_us, name, bits) for name, bits in self._faults().items()] + [
            _named(t_us, MONITORED + name, bits) for name, bits in monitored.items()
        ]

    def _fault_masks(self, now_us: int, t_us: int, own: set[str]) -> list[Message]:
        faults = self._faults()
        name = "NAMED_VALUE_FLOAT"
        periodic = name in own if name in self._own else self._masks(now_us)
        out = [
            _named(t_us, name, bits)
            for name, bits in faults.items()
            if periodic or bits != self._sent_faults.get(name, 0)
        ]
        self._sent_faults = faults
        if periodic:
            monitored = self._monitored()
            out += [_named(t_us, MONITORED + name, bits) for name, bits in monitored.items()]
        return out

    def _reconstructed(self, t_us: int, configured: bool, own: set[str]) -> list[Message]:
        """Values of every estimate that is new since it was last sent and not too old.

        ``configured``: messages without an interval of their own are due; ``own``: these are.
        """
        out: list[Message] = []
        for name, row in self._newest.items():
            row_t_us = int(row["t_us"])
            if self._old(row, t_us):
                continue
            sent = set()
            for message in self._contents(name, row):
                due = message.name in own if message.name in self._own else configured
                if due and self._sent_t_us.get((name, message.name)) != row_t_us:
                    sent.add(message.name)
                    out.append(message)
            self._sent_t_us |= dict.fromkeys(((name, m) for m in sent), row_t_us)
        return [m for m in out if self._has(m.name)]

    def _old(self, row: np.void, t_us: int) -> bool:
        return int(row["t_us"]) < t_us - round(self._settings.value_age_max_s * 1e6)

    def _contents(self, name: str, row: np.void) -> list[Message]:
        """An estimate's newest row as messages."""
        if name == "air":
            return self._air(row)
        if name.startswith("imu") and name[3:].isdigit():
            return self._imu(int(name[3:]), row)
        if self._settings.values_named and name == "engine":
            return self._engine(row)
        if self._settings.values_named and name == "wing":
            return self._wing(row)
        return []

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


def _value_period_us(settings: PublishSettings) -> float:
    """Period of the values; some period where none are sent, so that they can begin."""
    return 1e6 / (settings.value_rate_hz or 1.0)


def _boot_ms(t_us: int) -> int:
    return (t_us // 1000) & 0xFFFFFFFF


def _named(t_us: int, name: str, value: float) -> Message:
    return Message(
        "NAMED_VALUE_FLOAT",
        {"time_boot_ms": _boot_ms(t_us), "name": name, "value": float(value)},
    )
