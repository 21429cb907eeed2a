"""What a log carries that could be broken, and whether an injection fits it."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Frames
from links.mavlink.options import DecoderOptions
from links.mavlink.patch import Carried, Carrier
from links.samples import Rows
from sim_feeds.faults import PLUMBING, Fault
from sim_feeds.injection import Injection
from sim_feeds.section import ScenarioError

__all__ = ["Survey"]

_BREAKABLE = ("imu", "airspeed", "aoa", "spool", "gps", "attitude", "baro")
_FLYING_M_S = 8.0
"""Below this an airspeed says nothing about who mirrors whom."""
_MIRROR_SHARE, _MIRROR_M_S, _MIRROR_FRACTION = 0.9, 1.0, 0.1
"""VFR_HUD mirrors airspeed0 when this share of it is within this distance or fraction of it."""


class Survey:
    """Counts, over the frames of a log, which message carries which sensor.

    Parameters
    ----------
    options
        How the log is read.

    Attributes
    ----------
    carriers
        Sensor -> message -> readings.
    """

    def __init__(self, options: DecoderOptions | None = None) -> None:
        options = options or DecoderOptions()
        self._carrier = Carrier(load_dialect(options.dialect), options, None)
        self._alive: set[str] = set()
        self._vertical: set[str] = set()
        self._cas_m_s = np.nan
        self._hud = Counter[bool]()
        self.carriers: dict[str, Counter[str]] = {}

    def note(self, frames: Frames, t_us: NDArray[np.int64], usable: NDArray[np.bool_]) -> None:
        """Take the next frames of the vehicle, with their times."""
        carried = list(self._carrier.read(frames, t_us, usable))
        for c in carried:
            self.carriers.setdefault(c.sensor, Counter())[c.entry.source.message] += len(c.rows)
            if _shows_something(c.rows):
                self._alive.add(c.sensor)
            if c.entry.source.quantity == "gps" and np.isfinite(c.rows["vel_ned_m_s"][:, 2]).any():
                self._vertical.add(c.sensor)
        self._compare([c for c in carried if c.sensor == "airspeed0"])

    def _compare(self, carried: list[Carried]) -> None:
        """Whether VFR_HUD repeats what airspeed0 itself says."""
        hud = [c.rows for c in carried if c.entry.source.synthetic]
        own = min(
            (c for c in carried if not c.entry.source.synthetic),
            key=lambda c: c.entry.rank,
            default=None,
        )
        if own is None:
            return
        seq = np.concatenate([[-1], own.rows["seq"]])
        cas = np.concatenate([[self._cas_m_s], own.rows["cas_m_s"]])
        for rows in hud:
            latest = cas[np.searchsorted(seq, rows["seq"]) - 1]
            far = np.abs(rows["cas_m_s"] - latest)
            near = far <= np.maximum(_MIRROR_M_S, _MIRROR_FRACTION * latest)
            self._hud.update(near[latest > _FLYING_M_S].tolist())
        self._cas_m_s = float(cas[-1])

    @property
    def left(self) -> frozenset[tuple[str, str]]:
        """(sensor, message) that an injection leaves alone: a VFR_HUD that shows something else."""
        others = len(self.carriers.get("airspeed0", ())) > 1
        mirrors = self._hud[True] >= _MIRROR_SHARE * self._hud.total()
        return frozenset({("airspeed0", "VFR_HUD")} if others and not mirrors else ())

    @property
    def sensors(self) -> list[str]:
        """Sensors that could be broken."""
        return sorted(
            (s for s in self._alive if s.rstrip("0123456789") in _BREAKABLE),
            key=lambda s: (_BREAKABLE.index(s.rstrip("0123456789")), s),
        )

    def check(self, injection: Injection, duration_s: float) -> None:
        """That every fault meets readings.

        Raises
        ------
        ScenarioError
            The log lacks what a fault needs, or ends before one begins; one sentence.
        """
        for fault in injection.faults:
            self._check(fault, duration_s)
        follows = injection.attitude
        if follows is None:
            return
        for sensor in (f"imu{follows.imu}", "attitude"):
            if injection.faults and sensor not in self.carriers:
                raise ScenarioError(
                    f"the attitude is to follow imu{follows.imu}, but the log carries no {sensor}"
                )

    def _check(self, fault: Fault, duration_s: float) -> None:
        sensor, _, axis = fault.sensor.partition(".")
        if sensor not in self.carriers:
            raise ScenarioError(
                f"the log carries no {sensor}: it has {', '.join(self.sensors) or 'no sensor'}"
            )
        if sensor not in self._alive and sensor.startswith("imu"):
            raise ScenarioError(f"{sensor} is not fitted: all its readings in the log are zero")
        if axis == "vel_d" and sensor not in self._vertical:
            raise ScenarioError(f"{sensor} of this log has no vertical velocity that could break")
        if fault.kind in PLUMBING and not self._has_static(sensor):
            raise ScenarioError(
                f"{fault.kind} of {sensor} needs a static pressure, which the log does not carry"
            )
        if fault.start_s >= duration_s:
            raise ScenarioError(
                f"the fault of {fault.sensor} begins at {fault.start_s:g} s, but the log ends at "
                f"{duration_s:.1f} s"
            )

    def _has_static(self, sensor: str) -> bool:
        return not {"baro0", sensor.replace("airspeed", "baro")}.isdisjoint(self.carriers)


def _shows_something(rows: Rows) -> bool:
    """Whether any reading differs from zero."""
    names = [n for n in rows.dtype.names or () if n not in ("seq", "t_us", "stamp_us")]
    return any(bool(np.any(np.nan_to_num(rows[n]) != 0)) for n in names)
