"""Commands to us: obeyed, refused with a reason, or not known; always acknowledged, once each.

A command names us by both ids, or all components by 0. One to all is obeyed only where we can give
what it asks for, and passed over otherwise: an UNSUPPORTED of ours would read as the autopilot's.
A command that comes again, as a retransmission or over a second link, is answered again and not
carried out again.

Source: mavlink.io/en/services/command.html.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from math import inf
from typing import Any, NamedTuple, Protocol

from links.mavlink.heard import Heard
from monitor.component.asking import MavCmd, Result
from monitor.component.identity import Identity
from monitor.component.limit import Limit
from monitor.publish import Message
from monitor.settings.component import ComponentSettings

__all__ = ["Commands", "Outputs"]

REPEATED_US = 3_000_000
"""Time within which the same command with a higher confirmation is a retransmission."""

COPIED_US = 200_000
"""Time within which the same command with the same confirmation is a copy over another way."""

REMEMBERED = 64
"""Commands remembered to know a repeated one by."""

_NOTICE = 5
_REBOOT_REFUSED = "MAVSENTRY: no reboot over MAVLink: it watches"


class Outputs(Protocol):
    """What is asked of who publishes: his messages' rates and newest contents."""

    def interval_us(self, name: str) -> int:
        """Time between two messages of a name [us]; -1 not sent, 0 not ours or on a change only."""
        ...

    def set_interval(self, name: str, interval_us: int) -> bool:
        """Change it (-1 stops, 0 as configured); False where it cannot be."""
        ...

    def newest(self, name: str) -> list[Message]:
        """What was published last under this name, every instance; empty if nothing was."""
        ...


class _Asked(NamedTuple):
    """A command as it was asked."""

    system: int
    component: int
    number: int
    params: tuple[float, ...]


class _Done(NamedTuple):
    """How it was answered, and when."""

    result: Result
    confirmation: int
    at_us: int


class Commands:
    """Answers COMMAND_LONG and COMMAND_INT.

    Parameters
    ----------
    settings
        Of the component section.
    identity
        Who we are.
    outputs
        Who publishes.
    message_name
        MAVLink message number -> name, None where the dialect has none.
    about
        Messages about ourselves that can be asked for (AUTOPILOT_VERSION), by name.
    """

    wants = frozenset({"COMMAND_LONG", "COMMAND_INT"})
    notes: tuple[str, ...] = ()

    def __init__(
        self,
        settings: ComponentSettings,
        identity: Identity,
        outputs: Outputs,
        message_name: Callable[[int], str | None],
        about: Mapping[str, Callable[[], Message]],
    ) -> None:
        self._identity = identity
        self._outputs = outputs
        self._name = message_name
        self._about = about
        self._limit = Limit(settings.answers_per_s)
        self._done: OrderedDict[_Asked, _Done] = OrderedDict()

    @property
    def dropped(self) -> int:
        """Commands that came faster than they are answered."""
        return self._limit.dropped

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Carry a command out and acknowledge it to who asked, where he asked."""
        fields = heard.fields
        target = int(fields["target_system"]), int(fields["target_component"])
        if not self._identity.addressed(*target) or self._identity.address is None:
            return []
        if not self._limit.allows(now_us):
            return []
        asked = _Asked(heard.system, heard.component, int(fields["command"]), _params(fields))
        confirmation = int(fields.get("confirmation", 0))
        before = self._done.get(asked)
        if before is not None and _same(before, confirmation, now_us):
            return [self._ack(asked, before.result, heard.link)]
        result, out = self._carry_out(asked, to_all=0 in target)
        if result is None:
            return []
        self._done[asked] = _Done(result, confirmation, now_us)
        self._done.move_to_end(asked)
        if len(self._done) > REMEMBERED:
            self._done.popitem(last=False)
        told = [Message(m.name, m.fields, heard.link) for m in out]
        return [self._ack(asked, result, heard.link), *told]

    def due(self, now_us: int) -> list[Message]:
        """Nothing."""
        return []

    def close(self, now_us: int) -> list[Message]:
        """Nothing."""
        return []

    def _ack(self, asked: _Asked, result: Result, link: int) -> Message:
        fields = {
            "command": asked.number,
            "result": int(result),
            "target_system": asked.system,
            "target_component": asked.component,
        }
        return Message("COMMAND_ACK", fields, link)

    def _carry_out(self, asked: _Asked, *, to_all: bool) -> tuple[Result | None, list[Message]]:
        """Result and messages; no result when a command to all is none for us."""
        first, second = asked.params[:2]
        match asked.number:
            case MavCmd.REQUEST_MESSAGE:
                out = self._message(first, second)
                found = Result.ACCEPTED if out else Result.DENIED
                return (None if to_all and not out else found), out
            case MavCmd.REQUEST_AUTOPILOT_CAPABILITIES:
                return Result.ACCEPTED, [self._about["AUTOPILOT_VERSION"]()]
            case _ if to_all:
                return None, []
            case MavCmd.GET_MESSAGE_INTERVAL:
                out = self._interval(first)
                return (Result.ACCEPTED if out else Result.DENIED), out
            case MavCmd.SET_MESSAGE_INTERVAL:
                return self._set(first, second), []
            case MavCmd.PREFLIGHT_REBOOT_SHUTDOWN:
                return Result.DENIED, [
                    Message("STATUSTEXT", {"severity": _NOTICE, "text": _REBOOT_REFUSED})
                ]
            case _:
                return Result.UNSUPPORTED, []

    def _message(self, number: float, extra: float) -> list[Message]:
        """The messages of a number, as they are now."""
        name = self._named(number)
        if name is None:
            return []
        if name == "MESSAGE_INTERVAL":
            return self._interval(extra)
        if name in self._about:
            return [self._about[name]()]
        return self._outputs.newest(name)

    def _interval(self, number: float) -> list[Message]:
        """MESSAGE_INTERVAL of one of our messages; 0 says that it is none of ours."""
        if not 0 <= number <= 0xFFFF:
            return []
        name = self._named(number)
        interval_us = 0 if name is None else self._outputs.interval_us(name)
        fields = {"message_id": round(number), "interval_us": interval_us}
        return [Message("MESSAGE_INTERVAL", fields)]

    def _set(self, number: float, interval_us: float) -> Result:
        name = self._named(number)
        if name is None or not -1 <= interval_us <= 0x7FFFFFFF:
            return Result.DENIED
        done = self._outputs.set_interval(name, round(interval_us))
        return Result.ACCEPTED if done else Result.DENIED

    def _named(self, number: float) -> str | None:
        """The message of a number that came as a float, which may be NaN."""
        return self._name(round(number)) if 0 <= number < 1 << 24 else None


def _params(fields: Mapping[str, Any]) -> tuple[float, ...]:
    """The seven parameters; COMMAND_INT calls the last three x, y, z."""
    names = ("x", "y", "z") if "x" in fields else ("param5", "param6", "param7")
    values = [float(fields[f"param{k}"]) for k in range(1, 5)]
    # NaN, a parameter that is not given, is equal to nothing: a repeated command would be another
    return tuple(v if v == v else -inf for v in values + [float(fields[n]) for n in names])


def _same(done: _Done, confirmation: int, now_us: int) -> bool:
    """Whether a command that equals one carried out is that one, come again."""
    if confirmation == done.confirmation:
        return now_us - done.at_us < COPIED_US
    return confirmation > done.confirmation and now_us - done.at_us < REPEATED_US
