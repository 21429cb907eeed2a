"""``mavsentry run``: watch a live link until told to stop."""

from __future__ import annotations

import signal
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands.common import ConfigFile, Profile, Refused, note
from monitor.commands.live.asked import Asked
from monitor.commands.live.turning import STOP, TELL, turn_until_stopped

if TYPE_CHECKING:
    from monitor.commands.live.assembly import Links
    from monitor.commands.live.page import LivePage
    from monitor.settings import Settings

__all__ = ["run"]


def run(
    sources: Annotated[
        list[str] | None,
        typer.Option(
            "--in",
            metavar="LINK",
            help="Where the vehicle's MAVLink comes from: udpin:HOST:PORT, udpout:HOST:PORT, "
            "tcp:HOST:PORT, tcpin:HOST:PORT, /dev/ttyX[:BAUD] or FILE.tlog; may be given several "
            "times. Without it [links] inputs, or udpin:0.0.0.0:14550.",
        ),
    ] = None,
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
    system_id: Annotated[
        int | None,
        typer.Option(
            metavar="ID",
            min=0,
            max=255,
            help="MAVLink system id of the vehicle, where several are heard; 0 takes the first.",
        ),
    ] = None,
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
    log: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Log events there, one a line as JSON; journal: in systemd's journal; -: on "
            "standard error.",
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
    inputs, outputs = tuple(sources or ()), tuple(sinks or ())
    asked = Asked(profile, config, inputs, outputs, system_id, record, web, log)
    with ExitStack() as stack:
        from monitor.commands.live.assembly import assemble, open_links
        from monitor.commands.screen import output, tell_status
        from monitor.settings import SettingsError

        try:
            settings = asked.settings()
        except SettingsError as error:
            raise Refused(str(error)) from None
        # Before the rest, so that what arrives while we get ready waits in the links' buffers.
        links = open_links(settings, stack)
        page = _page(settings, links, stack)
        note(f"mavsentry: listening on {links.title}")
        running = assemble(settings, links, page, note, stack)
        tell = partial(tell_status, json_lines=json_lines)
        with output(json_lines, links.title, running.beside) as show:
            turn_until_stopped(running, show, tell)
        tell(running.daemon.status(), stopped=True)


def _page(settings: Settings, links: Links, stack: ExitStack) -> LivePage | None:
    """The live page, if an address is given; nothing of it is loaded otherwise."""
    if not settings.web.address:
        return None
    from monitor.commands.live.page import LivePage

    return LivePage(settings.web.address, settings, links.title, stack)
