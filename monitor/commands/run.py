"""``mavsentry run``: watch a live link until told to stop."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from monitor.commands.common import ConfigFile, Profile, Refused, load_settings, note, open_link

if TYPE_CHECKING:
    from links.endpoints import Endpoint
    from monitor.commands.live_page import LivePage
    from monitor.commands.screen import Show
    from monitor.daemon import Daemon
    from monitor.pipeline import Pipeline
    from monitor.recorder import Recorder
    from monitor.settings import Settings
    from monitor.verdict import StepResult

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
    web: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Serve the live page and Prometheus metrics there, such as 127.0.0.1:8080; any "
            "address but a loopback one asks for a token.",
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
        page = _page(web, settings, source, stack)
        note(f"mavsentry: listening on {source}")
        loop = _assemble(settings, link_in, links_out, record, page, stack)
        from monitor.commands.screen import output, tell_status

        tell = partial(tell_status, json_lines=json_lines)
        with output(json_lines, source, loop.beside) as show:
            _turn(loop, link_in, show, tell)
        tell(loop.daemon.status(), stopped=True)


class _Loop(NamedTuple):
    """What turns: ``look`` sees the result of each turn, ``beside`` gives facts for the screen."""

    daemon: Daemon
    pipeline: Pipeline
    look: Callable[[StepResult], None]
    beside: Callable[[], Sequence[str]]


def _page(web: str | None, settings: Settings, source: str, stack: ExitStack) -> LivePage | None:
    """The live page at this address, if one is asked for; nothing of it is loaded otherwise."""
    if web is None:
        return None
    from monitor.commands.live_page import LivePage

    return LivePage(web, settings, source, stack)


def _assemble(
    settings: Settings,
    link_in: Endpoint,
    links_out: list[Endpoint],
    record: Path | None,
    page: LivePage | None,
    stack: ExitStack,
) -> _Loop:
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
    pipeline = Pipeline(settings, taps=page.taps if page else ())
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
    looks = [page.begin(daemon, pipeline, decoder.counters, recorder)] if page else []
    if recorder is not None:
        looks.append(_stopped(recorder))

    def look(result: StepResult) -> None:
        for each in looks:
            each(result)

    return _Loop(daemon, pipeline, look, partial(_beside, recorder, page))


def _beside(recorder: Recorder | None, page: LivePage | None) -> list[str]:
    """The recording and the page's address, for the screen."""
    said = [] if page is None else [f"page {page.url}"]
    if recorder is not None:
        file = f"{recorder.path.name}, {recorder.file_bytes / 1e6:.1f} MB"
        said.append(recorder.stopped or f"recording {file}")
    return said


def _stopped(recorder: Recorder) -> Callable[[StepResult], None]:
    """Says once that nothing is recorded any more."""
    told = False

    def look(_: StepResult) -> None:
        nonlocal told
        if recorder.stopped is not None and not told:
            told = True
            note(f"mavsentry: {recorder.stopped}")

    return look


def _turn(
    loop: _Loop,
    link_in: Endpoint,
    show: Show,
    tell: Callable[..., None],
) -> None:
    """Turn until SIGINT, SIGTERM or the end of a file; SIGUSR1 tells how the loop is doing."""
    daemon, pipeline = loop.daemon, loop.pipeline
    recent = partial(daemon.status, recent=True)
    asked: set[int] = set()
    for number in (*STOP, *TELL):
        signal.signal(number, lambda received, frame: asked.add(received))
    while asked.isdisjoint(STOP) and not link_in.ended:
        result = daemon.turn()
        loop.look(result)
        show(result, pipeline.states(), recent)
        if not asked.isdisjoint(TELL):
            asked -= TELL
            tell(daemon.status())
    result = daemon.finish()
    loop.look(result)
    show(result, pipeline.states(), recent)
