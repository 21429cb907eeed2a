"""The asking side of the MAVLink command protocol: one command at a time, until it is answered.

A command that is not answered is sent again with its confirmation counted up, and given up after
the last try. IN_PROGRESS asks for patience, a limited number of times. An answer counts only when
it comes from who was asked, names the command and means us: a target of 0 is that of an older
sender, which leaves those fields out.

Source: mavlink.io/en/services/command.html.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from links.mavlink.heard import Heard
from monitor.publish import Message

__all__ = ["Answer", "Asking", "Command", "MavCmd", "Result"]

ACK_US = 1_000_000
"""Time for an answer before a command is sent again: companion links answer in tens of ms."""

TRIES = 3
"""Times that a command is sent."""

PATIENCE = 10
"""IN_PROGRESS that are believed, each good for as many :data:`ACK_US` as :data:`TRIES`."""


class MavCmd(IntEnum):
    """MAV_CMD that we ask or answer."""

    PREFLIGHT_REBOOT_SHUTDOWN = 246
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


@dataclass(frozen=True, slots=True)
class Command:
    """A command to a component: MAV_CMD, its parameters, and over which link."""

    number: int
    params: tuple[float, ...]
    system: int
    component: int
    link: int | None = None

    def message(self, confirmation: int) -> Message:
        """COMMAND_LONG of this command."""
        params = {f"param{k}": float(v) for k, v in enumerate(self.params, start=1)}
        fields: dict[str, Any] = {
            "target_system": self.system,
            "target_component": self.component,
            "command": self.number,
            "confirmation": confirmation,
        }
        return Message("COMMAND_LONG", fields | params, self.link)


@dataclass(frozen=True, slots=True)
class Answer:
    """How a command ended: a MAV_RESULT, or None when nobody answered."""

    command: Command
    result: int | None


class Asking:
    """At most one command under way."""

    def __init__(self) -> None:
        self._command: Command | None = None
        self._tries = self._patience = 0
        self._again_us = 0
        self._ended: Answer | None = None

    @property
    def busy(self) -> bool:
        """A command is under way, or its end was not taken yet."""
        return self._command is not None or self._ended is not None

    def begin(self, command: Command, now_us: int) -> list[Message]:
        """Send a command.

        Raises
        ------
        ValueError
            While another is under way: never two at a time.
        """
        if self.busy:
            raise ValueError("a command is under way")
        self._command, self._tries, self._patience = command, 1, PATIENCE
        self._again_us = now_us + ACK_US
        return [command.message(0)]

    def drop(self) -> None:
        """Forget the command under way: who was asked has started anew."""
        self._command = self._ended = None

    def hear(self, heard: Heard, us: tuple[int, int], now_us: int) -> None:
        """Take a COMMAND_ACK that may answer; ``us`` are our system and component id."""
        command, fields = self._command, heard.fields
        if command is None or not _answers(command, heard, us):
            return
        result = int(fields["result"])
        if result != Result.IN_PROGRESS:
            self._command, self._ended = None, Answer(command, result)
        elif self._patience > 0:
            self._patience -= 1
            self._again_us = now_us + TRIES * ACK_US

    def due(self, now_us: int) -> list[Message]:
        """The command once more when its answer is late; it ends after the last try."""
        command = self._command
        if command is None or now_us < self._again_us:
            return []
        if self._tries == TRIES:
            self._command, self._ended = None, Answer(command, None)
            return []
        self._tries += 1
        self._again_us = now_us + ACK_US
        return [command.message(self._tries - 1)]

    def take(self) -> Answer | None:
        """How the command ended, once."""
        ended, self._ended = self._ended, None
        return ended


def _answers(command: Command, heard: Heard, us: tuple[int, int]) -> bool:
    fields: Mapping[str, Any] = heard.fields
    for name, own in zip(("target_system", "target_component"), us, strict=True):
        if int(fields.get(name, 0)) not in (0, own):
            return False
    return (heard.system, heard.component) == (command.system, command.component) and (
        int(fields["command"]) == command.number
    )
