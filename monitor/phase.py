"""Flight phase of the vehicle: turns GPS and position rows into ``phase`` rows for the watches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimators import flight_phase as fp
from links.samples import Rows
from monitor.retune import Retuned, blend
from monitor.settings.phase import PhaseSettings
from monitor.verdict import PHASE_ROW

__all__ = ["PhaseTracker"]

_EVENT = np.dtype(
    [
        ("seq", "<i8"),
        ("t_us", "<i8"),
        ("source", "<i8"),
        ("speed_m_s", "<f8"),
        ("height_m", "<f8"),
        ("sink_m_s", "<f8"),
    ]
)


class PhaseTracker:
    """Emits a ``phase`` row at each change between flying and not flying.

    Where a vehicle stood before it booted says nothing of where it stands now. One that boots on
    the ground is not flying until it is seen to fly. One that boots *while it flies* may be a new
    day's first boot, of which the end of the flight before is missing, or an autopilot that
    restarted in the air: until it is seen to fly, or to stand, or nothing is known of it for
    ``boot_decide_s``, it is undecided, its sensors start up and its navigation converges, and its
    rows are to be withheld from the watches (:attr:`withheld`). If it flies, the flight goes on and
    no ``phase`` row is emitted: what was learnt and latched stays.

    Attributes
    ----------
    withheld
        Spans (from, to) of time [us] of the last step whose rows are withheld; the last one may
        have no end yet: None. ``to`` itself is not withheld.
    """

    def __init__(self, settings: PhaseSettings) -> None:
        self._settings = settings
        self._par = _params(settings)
        self._state = fp.initial_state()
        self._booted_us: int | None = None
        self._ground_m = np.nan
        self.withheld: list[tuple[int, int | None]] = []

    def retune(self, settings: PhaseSettings) -> Retuned:
        """Take new speeds, heights and times; whether it flies now is decided by the next rows."""
        self._settings, done = blend(self._settings, settings)
        self._par = _params(self._settings)
        return done

    @property
    def flying(self) -> bool:
        """Whether the aircraft is seen to fly now."""
        return bool(self._state[fp.FLYING] > 0.5)

    def step(self, rows: Mapping[str, Rows], boots: Sequence[int] = ()) -> Rows:
        """Use released rows (each sensor in time order); return the new ``phase`` rows.

        Parameters
        ----------
        boots
            Times among these rows at which the vehicle began anew, ascending [us].
        """
        self.withheld = [] if self._booted_us is None else [(self._booted_us, None)]
        events = self._merged(rows)
        parts: list[Rows] = []
        edges = np.searchsorted(events["t_us"], np.array(boots, np.int64))
        for before, boot in zip(np.split(events, edges), (*boots, None), strict=True):
            if self._booted_us is not None:
                before = self._decide(before, parts)
            parts.append(self._track(before))
            if boot is None:
                break
            if self.flying and self._booted_us is None:
                self._booted_us, self._ground_m = boot, float(self._state[fp.H0])
                self.withheld.append((boot, None))
            self._state = fp.initial_state()
        return np.concatenate(parts)

    def _decide(self, events: Rows, parts: list[Rows]) -> Rows:
        """Use events until it is known whether the vehicle that booted flies; return the rest."""
        assert self._booted_us is not None
        settle_us = round(self._settings.boot_settle_s * 1e6)
        decide_us = round(self._settings.boot_decide_s * 1e6)
        for i, event in enumerate(events):
            self._track(events[i : i + 1])
            t_us = int(event["t_us"])
            since_us = t_us - self._booted_us
            flies = self.flying and since_us >= settle_us
            stands = not self.flying and np.isfinite(self._state[fp.H0])
            if not (flies or stands or since_us >= decide_us):
                continue
            if flies:
                self._state[fp.H0] = self._ground_m
            else:
                parts.append(np.array([(event["seq"], t_us, False)], PHASE_ROW))
            self.withheld[-1] = (self._booted_us, t_us)
            self._booted_us = None
            return events[i + 1 :]
        return events[:0]

    def _merged(self, rows: Mapping[str, Rows]) -> Rows:
        """What speed and height are told by, in order."""
        parts = []
        if (gps := rows.get("gps0")) is not None:
            parts.append(_events(gps, fp.RECEIVER))
            parts[-1]["speed_m_s"][gps["fix_type"] < 3] = np.nan
        if (nav := rows.get("nav")) is not None:
            parts.append(_events(nav, fp.NAV))
        if not parts:
            return np.zeros(0, _EVENT)
        events = np.concatenate(parts)
        return events[np.lexsort((events["seq"], events["t_us"]))]

    def _track(self, events: Rows) -> Rows:
        if not len(events):
            return np.zeros(0, PHASE_ROW)
        index = np.empty(len(events), np.int64)
        was = self.flying
        count = fp.track_phase(
            self._state,
            self._par,
            np.ascontiguousarray(events["t_us"]),
            np.ascontiguousarray(events["source"]),
            np.ascontiguousarray(events["speed_m_s"]),
            np.ascontiguousarray(events["height_m"]),
            np.ascontiguousarray(events["sink_m_s"]),
            index,
        )
        out = np.zeros(count, PHASE_ROW)
        out["seq"] = events["seq"][index[:count]]
        out["t_us"] = events["t_us"][index[:count]]
        out["flying"] = (np.arange(count) % 2 == 0) != was
        return out


def _params(s: PhaseSettings) -> NDArray[np.float64]:
    """Parameters of :func:`estimators.flight_phase.track_phase`, (7,)."""
    return np.array(
        [
            s.flying_speed_m_s,
            s.confirm_s * 1e6,
            s.takeoff_height_m,
            s.landing_height_m,
            s.standstill_speed_m_s,
            s.receiver_timeout_s * 1e6,
            s.join_s * 1e6,
        ]
    )


def _events(rows: Rows, source: int) -> Rows:
    """Speed and height events of ``gps`` or ``nav`` rows."""
    events = np.zeros(len(rows), _EVENT)
    events["seq"], events["t_us"], events["source"] = rows["seq"], rows["t_us"], source
    vel = rows["vel_ned_m_s"]
    events["speed_m_s"] = np.hypot(vel[:, 0], vel[:, 1])
    events["height_m"], events["sink_m_s"] = rows["alt_m"], vel[:, 2]
    return events
