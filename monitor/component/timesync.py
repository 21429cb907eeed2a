"""TIMESYNC both ways, and PING: how far away the others are, and how their clocks stand.

A request carries the sender's time in ts1 and 0 in tc1; the answer echoes ts1 and carries the
answerer's time in tc1. The autopilot's clock minus ours is ``tc1 - (sent + received) / 2``, wrong
by half of what the two ways differ at most; of the newest answers the one with the shortest round
trip tells it, since whatever delayed the others delayed one of their two ways.

PX4 takes any answer that it hears for its own, and so does MAVROS. So an answer goes out on the
link of the question alone; a question of another component of the vehicle means the autopilot and
is left to it; and where another companion answers the autopilot already we are silent.

Source: mavlink.io/en/services/timesync.html; Mills, RFC 5905 section 10 (clock filter).
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import NamedTuple

from links.mavlink.heard import Heard
from monitor.component.identity import Identity
from monitor.component.limit import Limit
from monitor.publish import Message
from monitor.settings.component import ComponentSettings

__all__ = ["Offset", "TimeSync"]

_V2, _TARGET = 0xFD, 10 + 16

OUTSTANDING = 8
"""Requests that an answer is still taken to."""

ANSWERS = 8
"""Newest answers of which the quickest tells the offset, as in RFC 5905."""

FIRST_S, FIRST = 1.0, 4
"""The first requests go out a second apart, so that there is an offset soon."""

ROUND_TRIP_MAX_NS = 2_000_000_000
"""An answer that took longer says nothing."""

JUMP_NS = 1_000_000_000
"""An answer this far from the others: the autopilot's clock began anew."""

RIVAL_US = 30_000_000
"""Time that another's answers keep us silent."""


class Offset(NamedTuple):
    """The autopilot's clock against ours.

    Attributes
    ----------
    offset_ns
        Autopilot's time minus our monotonic time [ns].
    round_trip_ns
        Of the answer that tells it [ns]; half of it bounds the error.
    answers
        Answers heard so far.
    """

    offset_ns: int
    round_trip_ns: int
    answers: int


class TimeSync:
    """Asks the autopilot for its time (unless told not to), and answers who asks for ours."""

    wants = frozenset({"TIMESYNC", "PING"})
    notes: tuple[str, ...] = ()

    def __init__(
        self, settings: ComponentSettings, identity: Identity, *, asks: bool = True
    ) -> None:
        self._identity = identity
        self._period_us = round(settings.timesync_s * 1e6) if asks else 0
        self._limit = Limit(settings.answers_per_s)
        self._next_us: int | None = None
        self._sent: OrderedDict[int, None] = OrderedDict()
        self._samples: deque[tuple[int, int]] = deque(maxlen=ANSWERS)
        self._answers = self._requests = 0
        self._asked: OrderedDict[int, None] = OrderedDict()
        self._rival_us: int | None = None

    @property
    def offset(self) -> Offset | None:
        """The autopilot's clock against ours; None before an answer."""
        if not self._samples:
            return None
        round_trip_ns, offset_ns = min(self._samples)
        return Offset(offset_ns, round_trip_ns, self._answers)

    @property
    def facts(self) -> tuple[str, ...]:
        """The offset in words."""
        known = self.offset
        if known is None:
            return ()
        return (
            f"the autopilot's clock is {known.offset_ns / 1e9:+.4f} s from ours, "
            f"round trip {known.round_trip_ns / 1e6:.1f} ms",
        )

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Take an answer to us, answer a question."""
        if heard.name == "PING":
            return self._ping(heard, now_us)
        if int(heard.fields["tc1"]) != 0:
            self._take(heard, now_us)
            return []
        return self._answer(heard, now_us)

    def due(self, now_us: int) -> list[Message]:
        """A request, once a period."""
        autopilot = self._identity.autopilot
        if not self._period_us or autopilot is None or self._identity.address is None:
            return []
        if self._next_us is not None and now_us < self._next_us:
            return []
        period_us = self._period_us
        if self._requests < FIRST:
            self._requests += 1
            period_us = min(period_us, round(FIRST_S * 1e6))
        self._next_us = now_us + period_us
        stamp_ns = self._stamp(now_us)
        self._sent[stamp_ns] = None
        if len(self._sent) > OUTSTANDING:
            self._sent.popitem(last=False)
        return [Message("TIMESYNC", {"tc1": 0, "ts1": stamp_ns}, autopilot.link)]

    def close(self, now_us: int) -> list[Message]:
        """Nothing."""
        return []

    def _stamp(self, now_us: int) -> int:
        """Our time [ns]; its last three digits say that it is ours, as ArduPilot does it."""
        return now_us * 1000 + self._identity.component_id

    def _take(self, heard: Heard, now_us: int) -> None:
        """An answer: to us, by our stamp and from the autopilot, or by a rival to the autopilot."""
        stamp_ns = int(heard.fields["ts1"])
        autopilot = self._identity.autopilot
        if autopilot is None:
            return
        theirs = (heard.system, heard.component) == (autopilot.system, autopilot.component)
        if not theirs:
            if stamp_ns in self._asked:
                self._rival_us = now_us
            return
        if stamp_ns not in self._sent:
            return
        del self._sent[stamp_ns]
        received_ns = heard.host_us * 1000
        round_trip_ns = received_ns - stamp_ns
        if not 0 <= round_trip_ns + 1000 <= ROUND_TRIP_MAX_NS:
            return
        offset_ns = int(heard.fields["tc1"]) - (stamp_ns + received_ns) // 2
        known = self.offset
        if known is not None and abs(offset_ns - known.offset_ns) > JUMP_NS:
            self._samples.clear()
        self._samples.append((max(round_trip_ns, 0), offset_ns))
        self._answers += 1

    def _answer(self, heard: Heard, now_us: int) -> list[Message]:
        """Our time, to who may expect it of us."""
        autopilot, address = self._identity.autopilot, self._identity.address
        if address is None:
            return []
        stamp_ns = int(heard.fields["ts1"])
        asked = _target(heard)
        if not self._identity.addressed(*asked) or stamp_ns in self._sent:
            return []  # for another, or our own question come back
        if autopilot is not None and heard.system == autopilot.system and not all(asked):
            if heard.component != autopilot.component:
                return []
            self._asked[stamp_ns] = None
            if len(self._asked) > OUTSTANDING:
                self._asked.popitem(last=False)
            if self._rival_us is not None and now_us - self._rival_us < RIVAL_US:
                return []
        if not self._limit.allows(now_us):
            return []
        return [Message("TIMESYNC", {"tc1": now_us * 1000, "ts1": stamp_ns}, heard.link)]

    def _ping(self, heard: Heard, now_us: int) -> list[Message]:
        """A ping to all comes back to who sent it; one with a target is an answer to another."""
        fields = heard.fields
        if (fields["target_system"], fields["target_component"]) != (0, 0):
            return []
        if self._identity.address is None or not self._limit.allows(now_us):
            return []
        back = {
            "time_usec": fields["time_usec"],
            "seq": fields["seq"],
            "target_system": heard.system,
            "target_component": heard.component,
        }
        return [Message("PING", back, heard.link)]


def _target(heard: Heard) -> tuple[int, int]:
    """Who a TIMESYNC is for; 0 for all.

    The fields are an extension that pymavlink's dialects lack: they are the payload's bytes after
    tc1 and ts1.
    """
    frame = heard.frame
    if len(frame) < _TARGET or frame[0] != _V2:
        return 0, 0
    target = frame[_TARGET : 10 + frame[1]].ljust(2, b"\0")
    return target[0], target[1]
