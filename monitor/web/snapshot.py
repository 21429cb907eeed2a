"""What the daemon tells the live page: a frame of what is new, and all that stands.

What is new gathers until a frame is made of it, so that nothing is lost when one is left out: two
changes of a state come with the next frame, and ranges get wider.
"""

from __future__ import annotations

import json
import secrets
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from links.samples import Rows
from links.vocabulary import State
from monitor.daemon import Status
from monitor.verdict import StepResult, Verdict
from monitor.web import accounts, wire
from monitor.web.accounts import Accounts, Judged, Received, Recording
from monitor.web.found import Found
from monitor.web.measured import Measured, joined
from monitor.web.protocol import PROTOCOL, Event, Fault, Frame, Hello, Standing

__all__ = ["About", "Snapshots"]

CHANGES: Final = 100
"""New states of one sensor in a frame: the newest."""

STEPS_WAITING: Final = 64
"""Steps whose test rows wait to be reduced."""

_TESTS: Final = "_tests"
_RATIO: Final = "_ratio"


class About(NamedTuple):
    """What a ``hello`` says of the daemon itself; see the protocol."""

    source: str
    profile: str
    version: str
    rate_hz: float
    history_s: float


class Snapshots:
    """Makes the messages.

    Parameters
    ----------
    about
        The daemon.
    judged
        The pipeline.
    received
        Counters of its decoder.
    measured
        The pipeline's tap.
    recorder
        None when nothing is recorded.
    """

    def __init__(
        self,
        about: About,
        judged: Judged,
        received: Received,
        measured: Measured,
        recorder: Recording | None,
    ) -> None:
        self._about = about
        self._judged, self._received, self._measured = judged, received, measured
        self._accounts = Accounts(judged, recorder)
        self._run = secrets.token_hex(8)
        self._started_unix_s = time.time()
        self._number = 0
        self._standing: dict[str, Verdict] = {}
        self._changes: dict[str, deque[Standing]] = {}
        self._faults: Found[Fault] = Found(State.FAULTY, wire.fault)
        self._events: Found[Event] = Found(State.STOPPED, wire.event)
        self._newest: dict[str, Rows] = {}
        self._tests: dict[str, list[Rows]] = {}
        self._seldom: dict[str, Any] = {}
        self._channels = 0

    def note(self, result: StepResult) -> None:
        """Take what a step of the pipeline gave."""
        for verdict in result.verdicts:
            self._standing[verdict.sensor] = verdict
            changes = self._changes.setdefault(verdict.sensor, deque(maxlen=CHANGES))
            changes.append(wire.standing(verdict))
            self._faults.add(verdict)
            self._events.add(verdict)
        for name, rows in result.estimates.items():
            if not len(rows):
                continue
            if name.endswith(_TESTS):
                waiting = self._tests.setdefault(name, [])
                waiting.append(rows)
                if len(waiting) > STEPS_WAITING:
                    self._tests[name] = [_largest(waiting)]
            else:
                self._newest[name] = rows[-1:]

    def skip(self) -> None:
        """Leave a frame out: nobody takes it now."""
        self._number += 1
        self._accounts.dropped += 1

    def frame(self, now_us: int, status: Status) -> bytes:
        """What is new, as JSON.

        Parameters
        ----------
        now_us
            Host monotonic time [us].
        status
            Of the daemon.
        """
        began_ns = time.thread_time_ns()
        frame = Frame(
            kind="frame",
            number=self._number,
            unix_s=round(time.time(), 3),
            t_s=self._t_s(),
            flying=self._judged.flying,
            link=accounts.link(status, self._received, self._accounts),
        )
        self._number += 1
        news: dict[str, Any] = {
            "changes": {sensor: list(changes) for sensor, changes in self._changes.items()},
            "faults": self._faults.news(),
            "events": self._events.news(),
            "measured": self._measured.take(),
            "tests": self._ratios(),
            **self._estimates(),
        }
        self._changes.clear()
        seldom = self._accounts.news(now_us, status)
        if len(self._measured.units) != self._channels:
            self._channels = len(self._measured.units)
            seldom["channels"] = dict(self._measured.units)
        self._seldom |= seldom
        data = _encoded({**frame, **{key: value for key, value in news.items() if value}, **seldom})
        self._accounts.cost(time.thread_time_ns() - began_ns)
        return data

    def hello(self, status: Status) -> bytes:
        """All that stands, as JSON; what is new stays new for the next frame."""
        said = Hello(
            kind="hello",
            protocol=PROTOCOL,
            run=self._run,
            source=self._about.source,
            profile=self._about.profile,
            version=self._about.version,
            started_unix_s=round(self._started_unix_s, 3),
            rate_hz=self._about.rate_hz,
            history_s=self._about.history_s,
            number=self._number - 1,
            t_s=self._t_s(),
            flying=self._judged.flying,
            link=accounts.link(status, self._received, self._accounts),
            timeline=self._timeline(),
            faults=self._faults.all(),
            events=self._events.all(),
        )
        return _encoded({**said, **self._seldom})

    def _t_s(self) -> float | None:
        """Vehicle time up to which everything is judged [s]; before any it is far in the past."""
        t_us = self._judged.now_us
        return wire.seconds(t_us) if t_us > _NEVER_US else None

    def _timeline(self) -> dict[str, list[Standing]]:
        """States that stand, without those that the next frame brings."""
        return {
            sensor: [wire.standing(verdict)]
            for sensor, verdict in self._standing.items()
            if sensor not in self._changes
        }

    def _ratios(self) -> dict[str, float]:
        """Sensor -> largest ratio of the rows that waited."""
        out: dict[str, float] = {}
        for table, waiting in self._tests.items():
            row = _largest(waiting)[0]
            for column in (row.dtype.names or ())[1:]:
                ratio = wire.number(float(row[column]))
                if ratio is not None:
                    out[_sensor(table, column)] = ratio
        self._tests.clear()
        return out

    def _estimates(self) -> Mapping[str, Any]:
        out: dict[str, Any] = {}
        for name, rows in self._newest.items():
            if name == "air_expected":
                out["expected"] = wire.expected(rows[0])
            elif name.startswith("imu"):
                out.setdefault("imu", {})[name] = wire.estimate("imu", rows[0])
            elif name in ("air", "engine", "wing"):
                out[name] = wire.estimate(name, rows[0])
        self._newest.clear()
        return out


_NEVER_US = -(1 << 60)


def _largest(waiting: list[Rows]) -> Rows:
    """One row with the largest value of each column, NaN where there is none; the newest time."""
    rows = joined(waiting)
    out = rows[-1:].copy()
    for column in (rows.dtype.names or ())[1:]:
        out[column] = np.fmax.reduce(rows[column])
    return out


def _sensor(table: str, column: str) -> str:
    """The sensor of a column: the reverse of :func:`monitor.verdict.ratio_column`."""
    group, part = table.removesuffix(_TESTS), column.removesuffix(_RATIO)
    if group == "wing":
        side, _, what = part.partition("_")
        return f"wing_{side}.{what}"
    return f"{group}.{part}" if group.startswith("imu") else part


def _encoded(message: Mapping[str, Any]) -> bytes:
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
