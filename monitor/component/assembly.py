"""The component of the daemon: all of its services, put together for a live vehicle."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from links.mavlink import Decoder
from links.mavlink.dialect import load_dialect
from monitor.component import Component
from monitor.component.about import about
from monitor.component.commands import Commands
from monitor.component.identity import Identity
from monitor.component.intervals import Intervals
from monitor.component.services import Service
from monitor.component.timesync import TimeSync
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.settings import Settings

__all__ = ["assemble", "identify"]


def identify(settings: Settings, decoder: Decoder, *, listens: bool = True) -> Identity:
    """Who we are on the network of the decoder's vehicle.

    Parameters
    ----------
    listens
        Hear who is there before anything is sent; not when the input is a file.
    """
    here, own = settings.links, settings.component
    return Identity(
        own if listens else own.model_copy(update={"listen_s": 0.0}),
        here.component_id,
        lambda: decoder.vehicle,
        here.system_id or 1,
        here.autopilot_component_id,
    )


def assemble(
    settings: Settings,
    identity: Identity,
    decoder: Decoder,
    pipeline: Pipeline,
    publisher: Publisher,
    *,
    others: Sequence[Service] = (),
    capabilities: Callable[[], int] = lambda: 0,
    asks: bool = True,
) -> Component:
    """Put the services together.

    Parameters
    ----------
    identity
        From :func:`identify`.
    others
        Services that are made elsewhere: parameters.
    capabilities
        MAV_PROTOCOL_CAPABILITY bits that they add.
    asks
        Whether the vehicle can be asked for anything: not when the input is a file, or nothing is
        sent back to it.
    """
    dialect, own = load_dialect(settings.links.dialect), settings.component

    def message_id(name: str) -> int | None:
        return dialect.by_name[name].id if name in dialect.by_name else None

    def message_name(number: int) -> str | None:
        return dialect.by_id[number].name if number in dialect.by_id else None

    answering = Commands(own, identity, publisher, message_name, about(capabilities))
    asking: list[Service] = []
    if asks:
        asking = [
            Intervals(
                own,
                identity,
                message_id,
                lambda: pipeline.streams,
                lambda: decoder.counters.reboots,
                lambda: {s: n.most_common(1)[0][0] for s, n in decoder.sensors.used.items() if n},
            )
        ]
    clocks = TimeSync(own, identity, asks=asks)
    return Component(identity, (answering, clocks, *others, *asking))
