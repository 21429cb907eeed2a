"""``mavsentry run``: watch a live link until told to stop."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands.common import ConfigFile, Profile, Refused, load_settings, note, open_link

if TYPE_CHECKING:
    from links.endpoints import Endpoint
    from monitor.commands.screen import Show
    from monitor.daemon import Daemon
    from monitor.pipeline import Pipeline
    from monitor.settings import Settings

__all__ = ["run"]

STOP = {signal.SIGINT, signal.SIGTERM}
TELL = {signal.SIGUSR1} if hasattr(signal, "SIGUSR1") else set()

SLOW_START_S = 5.0
"""Getting ready for longer than this (kernels were compiled) leaves only old data waiting."""


def run(
    source: Annotated[
        str,
        typer.Option(
            "--in",
            metavar="LINK",
            help="Where the vehicle's MAVLink comes from: udpin:HOST:PORT, udpout:HOST:PORT, "
            "tcp:HOST:PORT, tcpin:HOST:PORT, /dev/ttyX[:BAUD] or FILE.tlog.",
        ),
    ] = "udpin:0.0.0.0:14550",
    sinks: Annotated[
        list[str] | None,
        typer.Option(
            "--out",
            metavar="LINK",
            help="Publish here too (a link, or a new FILE.tlog); may be given several times.",
        ),
    ] = None,
    profile: Profile = None,
    config: ConfigFile = None,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Record what is received and published as .tlog in this folder."
        ),
    ] = None,
    json_lines: Annotated[
        bool, typer.Option("--json", help="Print each change of state as a line of JSON.")
    ] = False,
) -> None:
    """Watch a live link: say what is faulty, and publish it over MAVLink."""
    for number in STOP:  # until the loop runs; loading and compiling stop at once
        signal.signal(number, lambda received, frame: sys.exit(0))
    for number in TELL:
        signal.signal(number, signal.SIG_IGN)
    with ExitStack() as stack:
        # First of all, so that what arrives while we get ready waits in the link's buffer.
        link_in = stack.enter_context(open_link(source))
        settings = load_settings(profile, config)
        links_out = [stack.enter_context(open_link(sink, write=True)) for sink in sinks or ()]
        note(f"mavsentry: listening on {source}")
        pipeline, daemon = _assemble(settings, link_in, links_out, record, stack)
        from monitor.commands.screen import output, tell_status

        tell = partial(tell_status, json_lines=json_lines)
        with output(json_lines, source) as show:
            _loop(daemon, pipeline, link_in, show, tell)
        tell(daemon.status(), stopped=True)


def _assemble(
    settings: Settings,
    link_in: Endpoint,
    links_out: list[Endpoint],
    record: Path | None,
    stack: ExitStack,
) -> tuple[Pipeline, Daemon]:
    """Build the stages and load their kernels while the link's buffer already fills."""
    began_s = time.monotonic()
    from links.endpoints.files import LogEndpoint
    from links.mavlink import Decoder, Encoder
    from monitor.daemon import Daemon
    from monitor.pipeline import Pipeline
    from monitor.publish import Message, Publisher
    from monitor.recorder import Recorder
    from monitor.warmup import warm_up

    here = settings.links
    try:
        decoder = Decoder(here.decoder_options())
        recorder = Recorder(record, settings.recorder, here.dialect) if record else None
    except ValueError as error:
        raise Refused(str(error)) from None
    except OSError as error:
        raise Refused(f"cannot record in {record}: {error.strerror}") from None
    if recorder is not None:
        stack.enter_context(recorder)
    encoders: dict[int, Encoder] = {}

    def encode(message: Message) -> bytes:
        """As the vehicle's system: before one is heard, as the configured one or system 1."""
        system = decoder.vehicle.system_id if decoder.vehicle else here.system_id or 1
        if system not in encoders:
            encoders[system] = Encoder(system, here.component_id, here.dialect)
        return encoders[system].encode(message.name, **message.fields)

    has_message = Encoder(1, here.component_id, here.dialect).has
    warm_up(settings, note)
    pipeline = Pipeline(settings)
    daemon = Daemon(
        link_in,
        [*([link_in] if settings.publish.to_input else []), *links_out],
        decoder,
        pipeline,
        Publisher(settings.publish, has_message),
        encode,
        here,
        recorder,
    )
    if time.monotonic() - began_s > SLOW_START_S and not isinstance(link_in, LogEndpoint):
        daemon.discard_waiting()
    return pipeline, daemon


def _loop(
    daemon: Daemon,
    pipeline: Pipeline,
    link_in: Endpoint,
    show: Show,
    tell: Callable[..., None],
) -> None:
    """Turn until SIGINT, SIGTERM or the end of a file; SIGUSR1 tells how the loop is doing."""
    asked: set[int] = set()
    for number in (*STOP, *TELL):
        signal.signal(number, lambda received, frame: asked.add(received))
    while asked.isdisjoint(STOP) and not link_in.ended:
        result = daemon.turn()
        show(result.verdicts, pipeline.states(), daemon.status)
        if not asked.isdisjoint(TELL):
            asked -= TELL
            tell(daemon.status())
    result = daemon.finish()
    show(result.verdicts, pipeline.states(), daemon.status)
