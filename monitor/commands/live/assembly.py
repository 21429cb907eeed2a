"""Puts the daemon of ``run`` together: links, gate, stages, component, recorder, page."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from monitor.commands.common import Refused, note

if TYPE_CHECKING:
    from links.endpoints import Endpoint, Hub
    from links.mavlink import Decoder
    from monitor.checkpoint import Checkpointer
    from monitor.commands.live.page import LivePage
    from monitor.commands.live.telling import Telling
    from monitor.component import Component
    from monitor.daemon import Daemon
    from monitor.outbox import Outbox
    from monitor.pipeline import Pipeline
    from monitor.publish import Publisher
    from monitor.recorder import Recorder
    from monitor.security import Gate
    from monitor.service import Notifier
    from monitor.settings import Settings
    from monitor.tuning import Tuning
    from monitor.verdict import StepResult

__all__ = ["Links", "Running", "assemble", "open_links"]

SLOW_START_S = 5.0
"""Getting ready for longer than this (kernels were compiled) leaves only old data waiting."""

COMPILING_S = 3600.0
"""Compiling kernels on a small computer takes less; the service manager is told to wait."""

Look = Callable[["StepResult"], None]


@dataclass(frozen=True)
class Links:
    """The links of a daemon.

    Attributes
    ----------
    hub
        All of them: inputs, then outputs.
    inputs
        How many of them are inputs.
    outputs
        Numbers of those that are published on.
    from_file
        An input is a log: it ends, and takes nothing.
    """

    hub: Hub
    inputs: int
    outputs: tuple[int, ...]
    from_file: bool

    @property
    def title(self) -> str:
        """The inputs, for people."""
        return ", ".join(self.hub.names[: self.inputs])


@dataclass(frozen=True)
class Running:
    """A daemon and what goes with it.

    Attributes
    ----------
    tuning
        The settings in force; changes them in flight.
    checkpoints
        Keeps what was learnt, over a restart.
    now_us
        Host monotonic time [us].
    unused
        What of the kept parameters could not be used, a sentence; None if all could.
    began_us
        When it was put together [us].
    looks
        Each sees the result of every turn.
    """

    links: Links
    tuning: Tuning
    gate: Gate
    decoder: Decoder
    pipeline: Pipeline
    publisher: Publisher
    component: Component
    outbox: Outbox
    daemon: Daemon
    recorder: Recorder | None
    page: LivePage | None
    checkpoints: Checkpointer
    now_us: Callable[[], int]
    unused: str | None = None
    began_us: int = 0
    looks: list[Look] = field(default_factory=list)

    @property
    def doubts(self) -> list[str]:
        """Why no vehicle is heard, or why it is none to judge."""
        from links.mavlink.dialect import enum_word
        from monitor.doubts import about_links, about_vehicle

        vehicle = self.decoder.vehicle
        if vehicle is not None:
            wingless = about_vehicle(enum_word("MAV_TYPE", vehicle.type))
            return [wingless] if wingless else []
        if self.links.from_file:
            return []
        waited_s = (self.now_us() - self.began_us) / 1e6
        states = self.links.hub.states()[: self.links.inputs]
        return about_links(states, waited_s, self.decoder.counters.messages)

    def beside(self) -> Sequence[str]:
        """The recording, the page's address and what an operator must know, for the screen."""
        said = [] if self.page is None else [f"page {self.page.url}"]
        if self.recorder is not None:
            file = f"{self.recorder.path.name}, {self.recorder.file_bytes / 1e6:.1f} MB"
            said.append(self.recorder.stopped or f"recording {file}")
        return [
            *said,
            *self.doubts,
            *self.links.hub.notes,
            *self.gate.notes,
            *self.component.notes,
            *self.component.facts,
        ]

    def notes(self) -> tuple[str, ...]:
        """What an operator must know now, a sentence each."""
        stopped = self.recorder.stopped if self.recorder is not None else None
        said = [text for text in (stopped, self.unused) if text is not None]
        notes = (*self.links.hub.notes, *self.gate.notes, *self.component.notes)
        return (*said, *self.doubts, *notes)


def open_links(settings: Settings, stack: ExitStack) -> Links:
    """Open every link that the settings name; the stack closes them.

    Raises
    ------
    Refused
        One of them cannot be opened.
    """
    from links.endpoints import Hub, LinkError, open_endpoint
    from links.endpoints.files import LogEndpoint

    here = settings.links
    how = here.link_options()

    def opened(name: str, *, write: bool = False) -> Endpoint:
        link: Endpoint = open_endpoint(name, write=write, dialect=here.dialect, options=how)
        return stack.enter_context(link)

    try:
        inputs = [opened(name) for name in here.inputs]
        outputs = [opened(name, write=True) for name in here.outputs]
    except LinkError as error:
        raise Refused(str(error)) from None
    first = 0 if settings.publish.to_input else len(inputs)
    return Links(
        Hub([*inputs, *outputs]),
        len(inputs),
        tuple(range(first, len(inputs) + len(outputs))),
        any(isinstance(link, LogEndpoint) for link in inputs),
    )


def assemble(
    settings: Settings,
    links: Links,
    page: LivePage | None,
    tell: Telling,
    notifier: Notifier,
    stack: ExitStack,
) -> Running:
    """Build the stages and load their kernels while the links' buffers already fill.

    Raises
    ------
    Refused
        A part cannot work as it is configured.
    """
    began_s = time.monotonic()
    from links.mavlink import Decoder, Encoder
    from monitor.checkpoint import Checkpointer
    from monitor.component.assembly import assemble as assemble_component
    from monitor.component.assembly import identify
    from monitor.component.parameter_file import ParameterFile, parameter_path, read_parameters
    from monitor.component.parameters import Parameters
    from monitor.daemon import Daemon, Host, Parts
    from monitor.outbox import Outbox
    from monitor.pipeline import Pipeline
    from monitor.places import state_folder
    from monitor.publish import Publisher
    from monitor.security import open_gate
    from monitor.service import Event
    from monitor.tuning import Tuning
    from monitor.warmup import warm_up

    kept = parameter_path(settings)
    own, unused = read_parameters(kept, settings)
    tuning = Tuning(settings, own=own)
    settings = tuning.settings
    here, hub = settings.links, links.hub
    try:
        decoder = Decoder(here.decoder_options())
        recorder = _recorder(settings, stack)
        gate = open_gate(
            settings, hub.names, os.environ, state_folder(), inputs=range(links.inputs)
        )
    except ValueError as error:
        raise Refused(str(error)) from None
    stack.enter_context(gate)
    publisher = Publisher(settings.publish, Encoder(1, here.component_id, here.dialect).has)

    def preparing(text: str) -> None:
        notifier.starting(text, COMPILING_S)
        note(text)

    warm_up(settings, preparing)
    pipeline = Pipeline(settings, taps=page.taps if page else ())
    tuning.add(pipeline.retune, publisher.retune)
    identity = identify(settings, decoder, listens=not links.from_file)
    keeping = ParameterFile(kept)
    stack.callback(keeping.close)
    parameters = Parameters(settings.component, identity, tuning, lambda: pipeline.flying, keeping)
    component = assemble_component(
        settings,
        identity,
        decoder,
        pipeline,
        publisher,
        others=(parameters,),
        capabilities=lambda: parameters.capabilities,
        asks=settings.publish.to_input and not links.from_file,
    )
    gate.reception.listen(component.wants)
    outbox = Outbox(
        hub.send, links.outputs, lambda: component.address, gate.sign, component.sent, here.dialect
    )
    parts = Parts(hub, gate, decoder, pipeline, publisher, component, outbox)
    host = Host()
    daemon = Daemon(parts, here, recorder, host)
    tuning.add(daemon.retune, tell.retune)
    checkpoints = Checkpointer(
        None if links.from_file else state_folder(),
        settings,
        decoder,
        pipeline,
        publisher,
        partial(tell, Event.CHECKPOINT),
    )
    checkpoints.resume()
    if time.monotonic() - began_s > SLOW_START_S and not links.from_file:
        daemon.discard_waiting()
    running = Running(
        links=links,
        tuning=tuning,
        gate=gate,
        decoder=decoder,
        pipeline=pipeline,
        publisher=publisher,
        component=component,
        outbox=outbox,
        daemon=daemon,
        recorder=recorder,
        page=page,
        checkpoints=checkpoints,
        now_us=host.now_us,
        unused=unused,
        began_us=host.now_us(),
    )
    if page is not None:
        running.looks.append(page.begin(daemon, pipeline, decoder.counters, recorder))
    return running


def _recorder(settings: Settings, stack: ExitStack) -> Recorder | None:
    """The recorder, if a folder is named."""
    if not settings.recorder.folder:
        return None
    from monitor.recorder import Recorder

    folder = Path(settings.recorder.folder).expanduser()
    try:
        return stack.enter_context(Recorder(folder, settings.recorder, settings.links.dialect))
    except OSError as error:
        raise Refused(
            f"cannot record in {folder}: {error.strerror}; --record (or [recorder] folder) "
            "names another"
        ) from None
