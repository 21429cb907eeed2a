"""What a service of the component is: it hears messages, has things due, and takes its leave."""

from __future__ import annotations

from typing import Protocol

from links.mavlink.heard import Heard
from monitor.publish import Message

__all__ = ["Service"]


class Service(Protocol):
    """One duty of a MAVLink component; no clock and no socket inside.

    Time is the host's monotonic clock [us], given by the caller. Messages are returned, not sent:
    one with a ``link`` goes out there alone, others on every output.
    """

    @property
    def wants(self) -> frozenset[str]:
        """Names of the messages to be shown."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What an operator must know and what holds now, a sentence each."""
        ...

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Answers to a message; never one of ours, nor an instruction of who may not give it."""
        ...

    def due(self, now_us: int) -> list[Message]:
        """What time makes due; called in every turn of the loop."""
        ...

    def close(self, now_us: int) -> list[Message]:
        """What must still be said: the loop ends. Called once; nothing is heard afterwards."""
        ...
