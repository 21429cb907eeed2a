"""Who we are on the network, and whom we watch.

We are a component of the vehicle's own system. Before anything is sent we listen: when another
sender uses our component id there, another one of those configured is taken, or the clash is said
and the id stays. What an echo of our own is, and what another sender with our ids, is told by the
frames that we sent lately.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from links.catalog import AUTOPILOT_INVALID
from links.mavlink import Vehicle
from links.mavlink.heard import Heard
from monitor.publish import Message
from monitor.settings.component import ComponentSettings

__all__ = ["Autopilot", "Identity"]

SENT_KEPT = 4096
"""Sent frames that are remembered to know their echo by: half a minute on four links."""

PEERS_KEPT = 512
"""Senders remembered; a network has a few dozen, a hostile one is bounded."""

CLASH_FRAMES = 2
"""Foreign frames with our ids that make a clash once we send ourselves."""

CLASH_US = 10_000_000
"""A clash is over when no such frame came for this time; so long is a sender taken to be there."""

LINK_US = 3_000_000
"""An autopilot that is heard on several links is spoken to on one until it was silent so long."""

LISTED = 8
"""Vehicles that a note lists; of more the number is told."""

_WARNING = 4


@dataclass(slots=True)
class Autopilot:
    """An autopilot that was heard.

    Attributes
    ----------
    system, component
        Its ids.
    kind, vehicle_type
        MAV_AUTOPILOT and MAV_TYPE of its HEARTBEAT.
    link, heard_us
        The link that it is spoken to on, and when it was heard there last (host monotonic [us]).
    """

    system: int
    component: int
    kind: int
    vehicle_type: int
    link: int
    heard_us: int


class Identity:
    """Our ids, the autopilots on the links, and who else claims to be us.

    Parameters
    ----------
    settings
        Of the component section.
    component_id
        The id that we would like to have.
    vehicle
        The vehicle that is watched, None before one is known (``Decoder.vehicle``).
    system_id
        System to send as before a vehicle is known.
    autopilot_component
        Component id of autopilots: some other components call themselves one.
    """

    wants = frozenset({"HEARTBEAT"})

    def __init__(
        self,
        settings: ComponentSettings,
        component_id: int,
        vehicle: Callable[[], Vehicle | None] = lambda: None,
        system_id: int = 1,
        autopilot_component: int = 1,
    ) -> None:
        self._settings = settings
        self._wished = component_id
        self._vehicle = vehicle
        self._system_id = system_id
        self._autopilot_component = autopilot_component
        self._began_us: int | None = None
        self._address: tuple[int, int] | None = None
        self._sent: OrderedDict[bytes, None] = OrderedDict()
        self._peers: OrderedDict[tuple[int, int], int] = OrderedDict()
        self._foreign: list[int] = []
        self._clash_link = 0
        self._told = False
        self.autopilots: dict[int, Autopilot] = {}

    # ------------------------------------------------------------------ who we are

    @property
    def address(self) -> tuple[int, int] | None:
        """System and component id to send as; None while we still listen."""
        return self._address

    @property
    def system_id(self) -> int:
        """The vehicle's system, which is ours."""
        vehicle = self._vehicle()
        return vehicle.system_id if vehicle is not None else self._system_id

    @property
    def component_id(self) -> int:
        """Our component id: the one taken, before that the one wished for."""
        return self._address[1] if self._address is not None else self._wished

    @property
    def autopilot(self) -> Autopilot | None:
        """The watched vehicle's autopilot; None before it was heard."""
        return self.autopilots.get(self.system_id) if self._vehicle() is not None else None

    def addressed(self, system: int, component: int) -> bool:
        """Whether a message with this target is for us; 0 means all."""
        return system in (0, self.system_id) and component in (0, self.component_id)

    def ours(self, heard: Heard) -> bool:
        """Whether a message carries our own ids: an echo, or another sender."""
        return heard.system == self.system_id and heard.component == self.component_id

    def obeys(self, system: int) -> bool:
        """Whether instructions of this system are obeyed: not of another vehicle."""
        return (
            system == self.system_id
            or system not in self.autopilots
            or system in self._settings.obey_systems
        )

    # ------------------------------------------------------------------ service

    @property
    def notes(self) -> tuple[str, ...]:
        """A clash of ids; several vehicles."""
        out = []
        if len(self._foreign) >= CLASH_FRAMES:
            out.append(
                f"another sender uses our id, component {self.component_id} of system "
                f"{self.system_id}, on link {self._clash_link}: choose another [links] component_id"
            )
        if len(self.autopilots) > 1:
            others = sorted(self.autopilots.keys() - {self.system_id})
            listed = ", ".join(map(str, others[:LISTED]))
            more = f" and {len(others) - LISTED} more" if len(others) > LISTED else ""
            out.append(
                f"vehicle {self.system_id} is watched; also heard: {listed}{more} "
                "(run --system-id chooses)"
            )
        if self._address is not None and self._address[1] != self._wished:
            out.append(
                f"component id {self._wished} is taken by another: we are {self._address[1]}"
            )
        return tuple(out)

    def sent(self, frame: bytes) -> None:
        """Remember a frame of ours."""
        self._sent[_trace(frame)] = None
        if len(self._sent) > SENT_KEPT:
            self._sent.popitem(last=False)

    def met(self, heard: Heard, now_us: int) -> None:
        """A message with our ids: nothing if it is an echo, else a clash begins or goes on."""
        if not heard.frame or _trace(heard.frame) in self._sent:
            return
        self._meet(heard.system, heard.component, now_us)
        if self._address is not None:
            self._clash_link = heard.link
            self._foreign = [*self._foreign[-CLASH_FRAMES:], now_us]

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Take note of who is there."""
        self._meet(heard.system, heard.component, now_us)
        kind = int(heard.fields["autopilot"])
        if kind == AUTOPILOT_INVALID or heard.component != self._autopilot_component:
            return []
        known = self.autopilots.get(heard.system)
        if known is None or heard.link == known.link or now_us - known.heard_us > LINK_US:
            vehicle_type = int(heard.fields["type"])
            self.autopilots[heard.system] = Autopilot(
                heard.system, heard.component, kind, vehicle_type, heard.link, now_us
            )
        return []

    def due(self, now_us: int) -> list[Message]:
        """Take an id when we have listened for long enough; say once that another has it."""
        if self._began_us is None:
            self._began_us = now_us
        if self._address is None and now_us - self._began_us < self._settings.listen_s * 1e6:
            return []
        if self._address is None or self._address[0] != self.system_id:
            self._address = self.system_id, self._choose(now_us)
        self._foreign = [t for t in self._foreign if now_us - t < CLASH_US]
        if len(self._foreign) < CLASH_FRAMES or self._told:
            return []
        self._told = True
        text = f"MAVSENTRY: another sender has our id {self.component_id}"
        return [Message("STATUSTEXT", {"severity": _WARNING, "text": text})]

    def close(self, now_us: int) -> list[Message]:
        """Nothing."""
        return []

    def _meet(self, system: int, component: int, now_us: int) -> None:
        self._peers[system, component] = now_us
        self._peers.move_to_end((system, component))
        if len(self._peers) > PEERS_KEPT:
            self._peers.popitem(last=False)

    def _choose(self, now_us: int) -> int:
        """The first id of those we may have that nobody uses; the wished one if all are in use."""
        for wished in (self._wished, *self._settings.other_ids):
            met_us = self._peers.get((self.system_id, wished))
            if met_us is None or now_us - met_us > CLASH_US:
                return wished
        return self._wished


def _trace(frame: bytes) -> bytes:
    """What of a MAVLink 2 frame stays when it is passed on: sequence to end of payload."""
    return frame[4 : 10 + frame[1]]
