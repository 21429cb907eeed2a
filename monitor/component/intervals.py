"""Asks the autopilot for the streams that the estimators need, and puts back what it changed.

Rates are measured first. A stream that comes too slowly is asked for: how often it is sent now
(GET_MESSAGE_INTERVAL), then the wanted rate (SET_MESSAGE_INTERVAL), one command at a time; whether
it then arrives so often is measured again. What cannot be had is said in a sentence. A stream that
somebody sets back twice is left alone, and so is everything while a telemetry radio is on the link.
At the end every stream gets the interval that it had, unless somebody has changed it since.

An autopilot that does not know the command (ArduPilot before 4.0) is asked for the group of streams
with REQUEST_DATA_STREAM. Intervals do not outlive a reboot of the autopilot: all begins anew then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

from links.mavlink.heard import Heard
from monitor.component.asking import Answer, Asking, Command, MavCmd, Result
from monitor.component.identity import Autopilot, Identity
from monitor.component.rates import Counted, Rates
from monitor.needs import NEEDS, Need
from monitor.publish import Message
from monitor.settings.component import ComponentSettings

__all__ = ["Intervals"]

STOPPED_US, DEFAULT_US = -1, 0
"""Intervals with a meaning: not sent; as the autopilot itself would send it."""

LOW = 0.6
"""Share of the wanted rate below which a stream is too slow: a third of the frames may be lost."""

FALLS = 2
"""Times that a stream may fall back after it was set before it is left alone."""

RADIO_US = 10_000_000
"""A telemetry radio is there while its RADIO_STATUS is not older than this."""

DEAF_US, DEAF_MAX_US = 60_000_000, 960_000_000
"""After this time an autopilot that did not answer is asked once more; it doubles each time."""

SHOWN = 3
"""Streams that a STATUSTEXT names; so many fit into its 50 characters, whatever they are."""

_ARDUPILOT = 3
_WARNING = 4


class _Step(Enum):
    GET = "get"
    SET = "set"
    SETTLE = "settle"
    HELD = "held"
    """It comes as asked for, or as good as it gets."""
    REFUSED = "refused"
    LEFT = "left"
    """Others set it back: theirs."""


@dataclass(slots=True)
class _Request:
    """What was asked for one message.

    Attributes
    ----------
    need
        The first stream it was asked for.
    before_hz
        Rate before [1/s].
    before_us
        Interval before, as the autopilot told it [us]; None if it did not.
    hz
        The rate asked for [1/s].
    changed
        The autopilot has accepted another interval.
    reached_hz
        Rate that came of it [1/s].
    falls
        Times that it fell back.
    """

    need: Need
    hz: float
    before_hz: float
    step: _Step = _Step.GET
    before_us: int | None = None
    changed: bool = False
    reached_hz: float = 0.0
    falls: int = 0

    @property
    def settled(self) -> bool:
        """Nothing is under way."""
        return self.step in (_Step.HELD, _Step.REFUSED, _Step.LEFT)

    @property
    def restored_us(self) -> int:
        """The interval to give it back [us].

        "Not available" (0) is what PX4 says of a stream that it does not send.
        """
        if self.before_us is None or (self.before_us == 0 and self.before_hz > 0):
            return DEFAULT_US
        return self.before_us or STOPPED_US


class Intervals:
    """See the module.

    Parameters
    ----------
    settings
        Of the component section.
    identity
        Who we are and whom we watch.
    message_id
        MAVLink message name -> number, None where the dialect has none.
    streams
        Stream -> its account, as the pipeline keeps it.
    boots
        Times that the vehicle's clock began anew.
    sources
        Stream -> message that it mostly comes from.
    """

    wants = frozenset({"COMMAND_ACK", "MESSAGE_INTERVAL", "RADIO_STATUS"})

    def __init__(
        self,
        settings: ComponentSettings,
        identity: Identity,
        message_id: Callable[[str], int | None],
        streams: Callable[[], Mapping[str, Counted]],
        boots: Callable[[], int] = lambda: 0,
        sources: Callable[[], Mapping[str, str]] = dict,
    ) -> None:
        self._settings = settings
        self._identity = identity
        self._id = message_id
        self._rates = Rates(streams)
        self._boots = boots
        self._sources = sources
        self._used: Mapping[str, str] = {}
        self._booted = 0
        self._asking = Asking()
        self._current: str | None = None
        self._requests: dict[str, _Request] = {}
        self._groups: dict[int, float] = {}  # asked for by REQUEST_DATA_STREAM: rate before [1/s]
        self._old = False
        self._deaf_us: int | None = None
        self._deaf_for_us = DEAF_US // 2
        self._told = False
        self._radio_us: int | None = None
        self._measured = False
        self._slow: dict[str, float] = {}

    # ------------------------------------------------------------------ what to tell

    @property
    def notes(self) -> tuple[str, ...]:
        """Every stream that comes too slowly for good, why, and what is lost by it.

        The rate told stays as it is while it changes little: a log takes a sentence once.
        """
        return tuple(self._sentence(need) for need in NEEDS.values() if need.stream in self._slow)

    @property
    def facts(self) -> tuple[str, ...]:
        """What was asked for, and what comes."""
        return tuple(
            f"{name} was asked for at {r.hz:g} Hz (came at {r.before_hz:.0f}): "
            f"comes at {self._rates.hz.get(r.need.stream, 0.0):.0f}"
            for name, r in self._requests.items()
            if r.changed
        )

    def _short(self, need: Need, least_hz: float) -> bool:
        """Whether a stream that there should be comes more slowly than this."""
        hz = self._rates.hz.get(need.stream, 0.0)
        return hz < least_hz and self._wanted_hz(need) > 0 and (need.fitted or hz > 0)

    def _note_slow(self, autopilot: Autopilot) -> None:
        """A window has ended: which streams come too slowly, with nothing more to be done."""
        for need in NEEDS.values():
            stream, name = need.stream, self._carrier(need, autopilot)
            request = self._requests.get(name)
            pending = request is None and self._id(name) is not None
            pending |= request is not None and not request.settled
            if not self._short(need, need.least_hz) or (self._may_ask and pending):
                self._slow.pop(stream, None)
                continue
            hz, told_hz = self._rates.hz.get(stream, 0.0), self._slow.get(stream)
            if told_hz is None or abs(hz - told_hz) > 0.3 * told_hz:
                self._slow[stream] = hz

    def _carrier(self, need: Need, autopilot: Autopilot | None) -> str:
        return need.carrier(autopilot.kind if autopilot else 0, self._used.get(need.stream))

    def _wanted_hz(self, need: Need) -> float:
        own = self._settings.stream_hz
        return own.get(need.stream, need.wanted_hz)

    def _sentence(self, need: Need) -> str:
        autopilot = self._identity.autopilot
        name = self._carrier(need, autopilot)
        hz = self._slow[need.stream]
        comes = f"{need.stream} comes at {hz:.1f} Hz" if hz else f"{need.stream} does not come"
        return f"{comes}, {self._wanted_hz(need):g} are wanted: {need.loss} ({self._why(name)})"

    def _why(self, name: str) -> str:
        request = self._requests.get(name)
        if not self._settings.request_streams:
            return "nothing is asked for: [component] request_streams is false"
        if self._deaf_us is not None:
            return "the autopilot does not answer commands"
        if self._radio_us is not None:
            return "a telemetry radio is on the link: nothing is asked for"
        if request is None:
            return f"{name} is unknown to the dialect"
        if request.step is _Step.LEFT:
            return f"another sets {name} back: it is left alone"
        if request.step is _Step.REFUSED:
            return f"the autopilot refuses {name} at {request.hz:g} Hz"
        return f"the autopilot accepted {name} at {request.hz:g} Hz and does not send it so"

    # ------------------------------------------------------------------ service

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Take what the autopilot answers."""
        autopilot = self._identity.autopilot
        if heard.name == "RADIO_STATUS":
            if autopilot is None or heard.link == autopilot.link:
                self._radio_us = now_us
        elif autopilot is None or (heard.system, heard.component) != (
            autopilot.system,
            autopilot.component,
        ):
            return []
        elif heard.name == "COMMAND_ACK":
            self._asking.hear(heard, self._us, now_us)
        elif self._current is not None and heard.fields["message_id"] == self._id(self._current):
            request = self._requests[self._current]
            if request.step is _Step.GET:
                request.before_us = int(heard.fields["interval_us"])
        return []

    def due(self, now_us: int) -> list[Message]:
        """The next thing to ask, if there is one."""
        self._follow_reboots()
        autopilot = self._identity.autopilot
        ended = self._rates.look(now_us, autopilot.heard_us if autopilot is not None else None)
        self._measured |= ended
        if self._radio_us is not None and now_us - self._radio_us > RADIO_US:
            self._radio_us = None
        if self._deaf_us is not None and now_us - self._deaf_us > self._deaf_for_us:
            self._deaf_us = None
        if autopilot is None or self._identity.address is None:
            return []
        if ended:
            self._used = self._sources()
            self._judge()
        out = self._asking.due(now_us)
        answer = self._asking.take()
        if answer is not None:
            out += self._answered(answer, autopilot, now_us)
        if self._may_ask and not self._asking.busy:
            out += self._next(autopilot, now_us)
        if ended:
            self._note_slow(autopilot)
            out += self._tell()
        return out

    def close(self, now_us: int) -> list[Message]:
        """Give every stream the interval that it had, but for those that others changed since."""
        autopilot = self._identity.autopilot
        if autopilot is None:
            return []
        out = []
        for name, request in self._requests.items():
            hz = self._rates.hz.get(request.need.stream, 0.0)
            theirs = request.step is _Step.LEFT or hz > 1.5 * request.hz
            if request.changed and not theirs:
                out.append(self._set(autopilot, name, request.restored_us).message(0))
        out += [self._ask_group(autopilot, group, hz) for group, hz in self._groups.items()]
        self._requests.clear()
        self._groups.clear()
        return out

    # ------------------------------------------------------------------ asking

    @property
    def _us(self) -> tuple[int, int]:
        return self._identity.system_id, self._identity.component_id

    @property
    def _may_ask(self) -> bool:
        return self._settings.request_streams and self._deaf_us is None and self._radio_us is None

    def _follow_reboots(self) -> None:
        """An autopilot that has rebooted forgot what it was asked for."""
        boots = self._boots()
        if boots != self._booted:
            self._booted = boots
            self._asking.drop()
            self._requests.clear()
            self._groups.clear()
            self._slow.clear()
            self._rates.restart()
            self._current, self._deaf_us, self._measured = None, None, False

    def _next(self, autopilot: Autopilot, now_us: int) -> list[Message]:
        """Begin the next command: of what is under way first, then of a stream that is short."""
        for name, request in self._requests.items():
            if request.step is _Step.GET:
                return self._begin(name, self._get(autopilot, name), now_us)
            if request.step is _Step.SET:
                interval_us = round(1e6 / request.hz)
                return self._begin(name, self._set(autopilot, name, interval_us), now_us)
        if not self._measured:
            return []
        for need in NEEDS.values():
            name, hz = self._carrier(need, autopilot), self._wanted_hz(need)
            if name in self._requests or self._id(name) is None or hz <= 0:
                continue
            comes_hz = self._rates.hz.get(need.stream, 0.0)
            if comes_hz < LOW * hz:
                request = self._requests[name] = _Request(need, hz, comes_hz)
                if self._old:
                    return self._ask_old(autopilot, request)
                return self._begin(name, self._get(autopilot, name), now_us)
        return []

    def _begin(self, name: str, command: Command, now_us: int) -> list[Message]:
        self._current = name
        return self._asking.begin(command, now_us)

    def _get(self, autopilot: Autopilot, name: str) -> Command:
        return self._command(autopilot, MavCmd.GET_MESSAGE_INTERVAL, float(self._id(name) or 0))

    def _set(self, autopilot: Autopilot, name: str, interval_us: int) -> Command:
        number = float(self._id(name) or 0)
        return self._command(autopilot, MavCmd.SET_MESSAGE_INTERVAL, number, float(interval_us))

    def _command(self, autopilot: Autopilot, number: int, *params: float) -> Command:
        return Command(number, params, autopilot.system, autopilot.component, autopilot.link)

    def _ask_old(self, autopilot: Autopilot, request: _Request) -> list[Message]:
        """Ask who knows no intervals for the group of a stream, at the rate of its fastest one."""
        request.step, group = _Step.SETTLE, request.need.group
        if group in self._groups:
            return []
        needs = [need for need in NEEDS.values() if need.group == group]
        self._groups[group] = max(self._rates.hz.get(need.stream, 0.0) for need in needs)
        self._rates.restart()
        wanted_hz = max(
            self._wanted_hz(need) for need in needs if need.fitted or need == request.need
        )
        return [self._ask_group(autopilot, group, wanted_hz)]

    def _ask_group(self, autopilot: Autopilot, group: int, hz: float) -> Message:
        fields = {
            "target_system": autopilot.system,
            "target_component": autopilot.component,
            "req_stream_id": group,
            "req_message_rate": round(hz),
            "start_stop": int(round(hz) > 0),
        }
        return Message("REQUEST_DATA_STREAM", fields, autopilot.link)

    def _answered(self, answer: Answer, autopilot: Autopilot, now_us: int) -> list[Message]:
        """Go on from the autopilot's answer, or from its silence."""
        assert self._current is not None
        request = self._requests[self._current]
        self._current = None
        if answer.result is None:
            self._deaf_us, self._deaf_for_us = now_us, min(2 * self._deaf_for_us, DEAF_MAX_US)
            return []
        if request.step is _Step.GET:
            there = request.before_us is not None and request.before_us > 0
            if there and not request.need.fitted and request.before_hz == 0:
                request.step = _Step.HELD  # it is sent, of a sensor that is not fitted: never comes
            else:
                request.step = _Step.SET
            return []
        if answer.result == Result.ACCEPTED:
            request.changed, request.step = True, _Step.SETTLE
            self._rates.restart()
        elif answer.result == Result.TEMPORARILY_REJECTED and request.hz / 2 >= (
            max(request.need.least_hz, request.before_hz)
        ):
            request.hz /= 2
        elif answer.result == Result.UNSUPPORTED and autopilot.kind == _ARDUPILOT:
            self._old = True
            return self._ask_old(autopilot, request)
        else:
            request.step = _Step.REFUSED
        return []

    def _judge(self) -> None:
        """A window has ended: what was asked for has come, or not, or was set back."""
        for request in self._requests.values():
            hz = self._rates.hz.get(request.need.stream, 0.0)
            if request.step is _Step.SETTLE:
                request.step, request.reached_hz = _Step.HELD, hz
            elif request.step is _Step.HELD and request.changed and hz < LOW * request.reached_hz:
                request.falls += 1
                request.step = _Step.LEFT if request.falls >= FALLS else _Step.SET

    def _tell(self) -> list[Message]:
        """Once, when all is asked for: which streams are too slow."""
        waiting = self._may_ask and not all(r.settled for r in self._requests.values())
        if self._told or waiting or not self._slow:
            return []
        self._told = True
        shown = list(self._slow)[:SHOWN]
        more = f" +{len(self._slow) - SHOWN}" if len(self._slow) > SHOWN else ""
        text = f"Streams slow: {' '.join(shown)}{more}"
        return [Message("STATUSTEXT", {"severity": _WARNING, "text": text})]
