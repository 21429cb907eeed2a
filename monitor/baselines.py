"""What the autopilots' own checks would have said of the same rows, beside our verdicts.

A :class:`BaselineTap` sees what the watches see: the released rows of a pipeline, in time order. It
never touches a sensor's state. ``analyze`` puts its findings into ``summary.json``::

    "baselines": {
      "settings":       {"<ArduPilot parameter>": {"value", "from": "log" | "default"}},
      "ardupilot":      [{"sensor", "check", "from_s", "to_s"|null, "evidence"}],
      "px4":            [ the same ],
      "autopilot_said": [{"t_s", "severity", "text"}],
      "lanes_lost_s":   seconds }

``sensor`` is ``airspeedN``, ``imuN``, or ``imu`` when a check finds that the IMUs differ and not
which is wrong. ``from_s`` is when the check would have acted, ``to_s`` when it would have taken
that back, null when it did not. ``autopilot_said`` are the STATUSTEXT lines of the log that speak
of airspeed, IMU, EKF or GPS: MAVLink's severity, 0 the gravest. ``lanes_lost_s`` is for how long
EKF3's lanes could not be followed from the log's samples.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.baselines import ardupilot, px4
from estimators.baselines.ardupilot import PARAMETERS, ArduPilotAirspeed
from estimators.baselines.ardupilot_imu import (
    ARMED,
    BARO,
    FIX,
    HEADING,
    LANES,
    SAMPLE,
    SWITCHED,
    ArduPilotImus,
)
from estimators.baselines.autopilot_events import (
    AIRSPEED,
    ATTITUDE,
    DENSITY,
    FLYING,
    GPS,
    NAV,
    PARAMETER,
    PITOTS,
)
from estimators.baselines.px4 import IMUS, PX4Airspeed, PX4ImuSelector
from links.samples import Rows

__all__ = ["BaselineTap", "one_line"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Entry = dict[str, Any]

SEA_LEVEL_PA: Final = 101325.0
DENSITY_EXPONENT: Final = 0.5 * 0.80974
"""sqrt(rho_0 / rho) = (p_0 / p)^this in the standard atmosphere, troposphere."""

LISTED: Final = 10_000
"""Findings of one check, and lines of the autopilot, that are kept."""

_ABOUT = re.compile(r"airspeed|arspd|pitot|\bimu|ekf|gps|gyro|accel|lane", re.IGNORECASE)
_NOT_ABOUT = re.compile(r"^(No ap_message|SRC=|GCS:|\[mavlink: component )", re.IGNORECASE)
"""Lines that are of no use, and those that the autopilot logged of others."""
_USE = re.compile(r"ARSPD[2-9]?_USE")


class BaselineTap:
    """Runs ArduPilot's and PX4's logic beside the watches of a pipeline.

    Parameters
    ----------
    follow_log
        Take ArduPilot's parameters from the log's PARAM_VALUEs where it has them; otherwise the
        defaults stand.
    """

    def __init__(self, *, follow_log: bool = True) -> None:
        self._follow_log = follow_log
        self._values: dict[str, float] = {}
        self._airspeed = ArduPilotAirspeed()
        self._imus = ArduPilotImus()
        self._px4_airspeed = PX4Airspeed()
        self._px4_imus = PX4ImuSelector()
        self._found: dict[str, list[Floats]] = {}
        self._kept: Counter[str] = Counter()
        self._texts: dict[tuple[int, str], int] = {}

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Use released rows, each sensor in time order."""
        if (text := rows.get("text")) is not None:
            self._listen(text)
        air = self.air_events(rows)
        if air is not None:
            self._keep("ardupilot_airspeed", self._airspeed.step(*air))
            self._keep("px4_airspeed", self._px4_airspeed.step(*air))
        imu = _ordered(_imu_events(rows))
        if imu is not None:
            t_us, kind, value = imu
            self._keep("ardupilot_imus", self._imus.step(t_us, kind, value))
            self._keep("px4_imus", self._px4_imus.step(t_us, kind, value))

    def summary(self, first_us: int) -> dict[str, Any]:
        """The ``baselines`` of ``summary.json``; times count from ``first_us``."""

        def seconds(t_us: float) -> float:
            return round((float(t_us) - first_us) / 1e6, 3)

        return {
            "settings": {
                name: {
                    "value": self._values.get(name, default),
                    "from": "log" if name in self._values else "default",
                }
                for name, (_, default) in PARAMETERS.items()
            },
            "ardupilot": _sorted(
                _ardupilot_airspeed(self._rows("ardupilot_airspeed", 5), seconds)
                + _ardupilot_imus(self._rows("ardupilot_imus", 5), seconds)
            ),
            "px4": _sorted(
                _px4_airspeed(self._rows("px4_airspeed", 5), seconds)
                + _px4_imus(self._rows("px4_imus", 4), seconds)
            ),
            "autopilot_said": [
                {"t_s": seconds(t_us), "severity": severity, "text": text}
                for (t_us, text), severity in self._texts.items()
            ],
            "lanes_lost_s": round(self._imus.lost_s, 1),
        }

    def _keep(self, name: str, found: Floats) -> None:
        found = found[: LISTED - self._kept[name]]
        if len(found):
            self._kept[name] += len(found)
            self._found.setdefault(name, []).append(found)

    def _rows(self, name: str, columns: int) -> Floats:
        parts = self._found.get(name)
        return np.concatenate(parts) if parts else np.empty((0, columns))

    def _listen(self, rows: Rows) -> None:
        for row in rows:
            text = bytes(row["text"]).decode("utf-8", "replace").strip("\0 ")
            if len(self._texts) == LISTED:
                return
            if _ABOUT.search(text) and not _NOT_ABOUT.search(text):
                self._texts.setdefault((int(row["t_us"]), text), int(row["severity"]))

    def air_events(self, rows: Mapping[str, Rows]) -> tuple[Ints, Ints, Floats] | None:
        """Time, kind and values of everything that the airspeed checks look at, in order."""
        events: list[tuple[Rows, int, Floats]] = []
        for k in range(PITOTS):
            if (r := rows.get(f"airspeed{k}")) is not None:
                events.append((r, AIRSPEED + k, _columns(r["cas_m_s"])))
        if (r := rows.get("gps0")) is not None:
            vel = r["vel_ned_m_s"]
            events.append((r, GPS, _columns(vel[:, 0], vel[:, 1], r["fix_type"])))
        if (r := rows.get("nav")) is not None:
            events.append((r, NAV, _columns(*r["vel_ned_m_s"].T)))
        if (r := rows.get("attitude")) is not None:
            events.append((r, ATTITUDE, _columns(*r["q_ned_from_frd"].T)))
        if (r := rows.get("baro0")) is not None:
            rho = (SEA_LEVEL_PA / r["static_press_pa"]) ** DENSITY_EXPONENT
            events.append((r, DENSITY, _columns(rho)))
        if (r := rows.get("phase")) is not None:
            events.append((r, FLYING, _columns(r["flying"])))
        if self._follow_log and (r := rows.get("param")) is not None:
            events += self._parameter_events(r)
        return _ordered(events)

    def _parameter_events(self, rows: Rows) -> list[tuple[Rows, int, Floats]]:
        """Parameters as the log shows them; ARSPD_USE only once: the check itself changes it."""
        events = []
        for i, row in enumerate(rows):
            name = bytes(row["name"]).decode("ascii", "replace")
            if name not in PARAMETERS or (_USE.fullmatch(name) and name in self._values):
                continue
            self._values[name] = float(row["value"])
            place = np.array([float(PARAMETERS[name][0])])
            events.append((rows[i : i + 1], PARAMETER, _columns(place, rows["value"][i : i + 1])))
        return events


def one_line(baselines: Mapping[str, Any]) -> str:
    """ArduPilot's and PX4's findings in one line for a person."""
    said = []
    for name, key in (("ArduPilot's own logic", "ardupilot"), ("PX4's", "px4")):
        found = [
            f"{e['sensor']} {e['check']} {e['from_s']:.1f}-"
            + ("end" if e["to_s"] is None else f"{e['to_s']:.1f} s")
            for e in baselines[key]
        ]
        if len(found) > 3:
            found = [*found[:2], f"{len(found) - 2} more"]
        said.append(f"{name}: {', '.join(found) or 'nothing'}")
    return "; ".join(said)


# --------------------------------------------------------------------------- rows to events


def _columns(*columns: Floats | Rows) -> Floats:
    """Columns side by side, float64."""
    out = np.empty((len(columns[0]), len(columns)))
    for j, column in enumerate(columns):
        out[:, j] = column
    return out


def _ordered(events: list[tuple[Rows, int, Floats]]) -> tuple[Ints, Ints, Floats] | None:
    """All events as time, kind and values, in order of time and arrival."""
    if not events:
        return None
    t_us = np.concatenate([r["t_us"] for r, _, _ in events])
    seq = np.concatenate([r["seq"] for r, _, _ in events])
    kind = np.repeat([k for _, k, _ in events], [len(r) for r, _, _ in events])
    value = np.zeros((len(t_us), max(4, *(v.shape[1] for _, _, v in events))))
    start = 0
    for _, _, v in events:
        value[start : start + len(v), : v.shape[1]] = v
        start += len(v)
    order = np.lexsort((seq, t_us))
    return t_us.take(order), kind.take(order), value.take(order, axis=0)


def _imu_events(rows: Mapping[str, Rows]) -> list[tuple[Rows, int, Floats]]:
    """(rows, kind, values) of everything that the IMU checks look at."""
    events: list[tuple[Rows, int, Floats]] = []
    for k in range(IMUS):
        if (r := rows.get(f"imu{k}")) is not None:
            value = np.empty((len(r), 6))
            value[:, :3], value[:, 3:] = r["gyro_rad_s"], r["acc_m_s2"]
            moves = (value[:, 3] != 0.0) | (value[:, 4] != 0.0) | (value[:, 5] != 0.0)
            if not moves.all():
                r, value = r[moves], value[moves]
            events.append((r, SAMPLE + k, value))
    if not events:
        return events
    if (r := rows.get("gps0")) is not None:
        vel = r["vel_ned_m_s"]
        place = (r["lat_rad"], r["lon_rad"], r["alt_m"])
        events.append((r, FIX, _columns(vel[:, 0], vel[:, 1], *place, r["fix_type"])))
    if (r := rows.get("baro0")) is not None:
        events.append((r, BARO, _columns(_altitude(r["static_press_pa"]))))
    if (r := rows.get("attitude")) is not None:
        events.append((r, HEADING, _columns(*r["q_ned_from_frd"].T)))
    if (r := rows.get("heartbeat")) is not None:
        events.append((r, ARMED, _columns(r["armed"])))
    return events


def _altitude(static_pa: Floats) -> Floats:
    """Pressure altitude of the standard atmosphere's troposphere [m]."""
    out: Floats = 44330.77 * (1.0 - (static_pa / SEA_LEVEL_PA) ** 0.190263)
    return out


# --------------------------------------------------------------------------- events to entries


def _entry(sensor: str, check: str, from_s: float, evidence: str) -> Entry:
    return {"sensor": sensor, "check": check, "from_s": from_s, "to_s": None, "evidence": evidence}


def _sorted(entries: list[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda e: (e["from_s"], e["sensor"]))


def _ardupilot_airspeed(rows: Floats, seconds: Any) -> list[Entry]:
    """Spans in which the health check kept a pitot disabled, or EKF3 rejected it for good."""
    out: list[Entry] = []
    standing: dict[tuple[int, bool], Entry] = {}
    for t_us, pitot, what, ratio, speed_diff in rows:
        gate = what in (ardupilot.TIMED_OUT, ardupilot.FUSED_AGAIN)
        key, name = (int(pitot), gate), f"airspeed{int(pitot)}"
        if what == ardupilot.DISABLED:
            said = (
                f"airspeed {speed_diff:+.1f} m/s from ground speed, innovation of the primary "
                f"{ratio:.1f} sigma: health fell below 10 %"
            )
            standing[key] = _entry(name, "disabled", seconds(t_us), said)
            out.append(standing[key])
        elif what == ardupilot.TIMED_OUT:
            said = f"innovation {ratio:.1f} sigma, beyond EKF3's gate for 5 s: not fused"
            standing[key] = _entry(name, "rejected by EKF3", seconds(t_us), said)
            out.append(standing[key])
        elif key in standing:
            standing.pop(key)["to_s"] = seconds(t_us)
    return out


def _ardupilot_imus(rows: Floats, seconds: Any) -> list[Entry]:
    """Lanes that EKF3 left, each until it came back, and differences before arming."""
    out: list[Entry] = []
    left: dict[int, Entry] = {}
    for t_us, what, a, b, c in rows:
        if what == SWITCHED:
            new = int(a)
            if new in left:
                left.pop(new)["to_s"] = seconds(t_us)
            old = (new + 1) % LANES
            said = f"EKF3 lane switch {new}: error score {b:.2f}, the other lane's {c:.2f}"
            left[old] = _entry(f"imu{old}", "lane left", seconds(t_us), said)
            out.append(left[old])
        else:
            said = f"differs from imu0 by {b:.2f} m/s^2 and {np.degrees(c):.1f} deg/s before arming"
            out.append(_entry(f"imu{int(a)}", "not consistent", seconds(t_us), said))
    return out


_PX4_AIRSPEED = {
    px4.INNOVATION: ("invalid", "{0:.1f} m/s off ground velocity minus wind for too long"),
    px4.MISSING: ("invalid", "no data for 1 s"),
    px4.STUCK: ("invalid", "exactly {1:.2f} m/s for 2 s"),
}


def _px4_airspeed(rows: Floats, seconds: Any) -> list[Entry]:
    """Spans in which the validator called a pitot invalid."""
    out: list[Entry] = []
    standing: dict[int, Entry] = {}
    for t_us, pitot, what, innovation, cas in rows:
        k = int(pitot)
        if what == px4.VALID:
            standing.pop(k)["to_s"] = seconds(t_us)
            continue
        check, said = _PX4_AIRSPEED[what]
        standing[k] = _entry(f"airspeed{k}", check, seconds(t_us), said.format(innovation, cas))
        out.append(standing[k])
    return out


def _px4_imus(rows: Floats, seconds: Any) -> list[Entry]:
    """Spans in which the IMUs differed by more than the selector allows."""
    out: list[Entry] = []
    standing: dict[int, Entry] = {}
    for t_us, which, known, total in rows:
        if int(which) in standing:
            standing.pop(int(which))["to_s"] = seconds(t_us)
        if known < 0:
            continue
        sensor = f"imu{int(known)}" if known < IMUS else "imu"
        if which == px4.GYRO:
            check, said = "gyros differ", f"integrated difference {np.degrees(total):.0f} deg"
        else:
            check, said = "accelerometers differ", f"integrated difference {total:.1f} m/s"
        if sensor == "imu":
            said += ", which of two is wrong is not known"
        standing[int(which)] = _entry(sensor, check, seconds(t_us), said)
        out.append(standing[int(which)])
    return out
