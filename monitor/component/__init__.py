"""The daemon as a component of the vehicle's system: what it owes others on the network.

::

    Reception --Heard--> Component.hear --Messages--> Outbox
                         Component.due  --Messages--> Outbox --every frame--> Component.sent

:class:`Component` shows each accepted message to the services that want it and gathers what they
answer. It keeps three rules for all of them: what carries our own ids is shown to none,
instructions of a foreign vehicle are not obeyed, and their texts are paced and folded.
:func:`monitor.component.assembly.assemble` puts the daemon's together.
"""

from __future__ import annotations

from collections.abc import Sequence

from links.mavlink.heard import Heard
from monitor.component.identity import Identity
from monitor.component.services import Service
from monitor.component.texts import Texts
from monitor.publish import Message

__all__ = ["INSTRUCTIONS", "Component", "Heard", "Identity", "Service"]

INSTRUCTIONS = frozenset({"COMMAND_LONG", "COMMAND_INT", "PARAM_SET", "PARAM_EXT_SET"})
"""Messages that change something here: not obeyed from another vehicle's system."""


class Component:
    """The services of one component behind one set of ears.

    Parameters
    ----------
    identity
        Who we are and whom we watch.
    services
        The others, in the order in which they speak.
    """

    def __init__(self, identity: Identity, services: Sequence[Service] = ()) -> None:
        self.identity = identity
        self._services: tuple[Service, ...] = (identity, *services)
        self._texts = Texts()
        self.wants: frozenset[str] = frozenset().union(*(s.wants for s in self._services))

    @property
    def address(self) -> tuple[int, int] | None:
        """System and component id to send as; None while nothing may be sent yet."""
        return self.identity.address

    @property
    def notes(self) -> tuple[str, ...]:
        """What an operator must know and what holds now, a sentence each."""
        return tuple(note for service in self._services for note in service.notes)

    @property
    def facts(self) -> tuple[str, ...]:
        """What is worth showing and needs nobody's attention: streams asked for, clocks."""
        return tuple(fact for s in self._services for fact in getattr(s, "facts", ()))

    def sent(self, frame: bytes) -> None:
        """Remember a frame that leaves, signed or not: its echo is not another sender."""
        self.identity.sent(frame)

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Answers to one accepted message."""
        if self.identity.ours(heard):
            self.identity.met(heard, now_us)
            return []
        if heard.name in INSTRUCTIONS and not self.identity.obeys(heard.system):
            return []
        out: list[Message] = []
        for service in self._services:
            if heard.name in service.wants:
                out += service.hear(heard, now_us)
        return self._without_texts(out)

    def due(self, now_us: int) -> list[Message]:
        """What time makes due; nothing while nothing may be sent yet."""
        out: list[Message] = []
        for service in self._services:
            out += service.due(now_us)
        if self.address is None:
            return []
        return self._without_texts(out) + self._texts.due(now_us)

    def close(self, now_us: int) -> list[Message]:
        """What must be said at the end."""
        return [message for service in self._services for message in service.close(now_us)]

    def _without_texts(self, messages: list[Message]) -> list[Message]:
        """The messages but for texts, which wait for their turn."""
        if not any(m.name == "STATUSTEXT" for m in messages):
            return messages
        for message in messages:
            if message.name == "STATUSTEXT":
                self._texts.put(message)
        return [m for m in messages if m.name != "STATUSTEXT"]
