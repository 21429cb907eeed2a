"""``mavsentry run``: watch a live link until told to stop."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from monitor.commands import completing
from monitor.commands.common import LINKS, OUTPUT, ConfigFile, Profile, Refused
from monitor.commands.live.asked import Asked
from monitor.commands.live.signals import Signals
from monitor.commands.live.turning import turn_until_stopped

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
            autocompletion=completing.links,
            rich_help_panel=LINKS,
        ),
    ] = None,
    sinks: Annotated[
        list[str] | None,
        typer.Option(
            "--out",
            metavar="LINK",
            help="Publish here too (a link, or a new FILE.tlog); may be given several times.",
            autocompletion=completing.links,
            rich_help_panel=LINKS,
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
            rich_help_panel=LINKS,
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Record what is received and published as .tlog in this folder.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    web: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Serve the live page and Prometheus metrics there, such as 127.0.0.1:8080; any "
            "address but a loopback one asks for a token.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    log: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Log events there, one a line as JSON; journal: in systemd's journal; -: on "
            "standard error.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    json_lines: Annotated[
        bool,
        typer.Option(
            "--json", help="Print each change of state as a line of JSON.", rich_help_panel=OUTPUT
        ),
    ] = False,
) -> None:
    """Watch a live link: say what is faulty, and publish it over MAVLink."""
    signals = Signals()
    from monitor.service import Event, LogError, Notifier, open_event_log
    from monitor.settings import SettingsError

    notifier = Notifier()
    inputs, outputs = tuple(sources or ()), tuple(sinks or ())
    asked = Asked(profile, config, inputs, outputs, system_id, record, web, log)
    with ExitStack() as stack:
        from monitor.commands.live.assembly import assemble, open_links
        from monitor.commands.live.telling import Telling
        from monitor.commands.live.witness import Witness
        from monitor.commands.screen import output, status_facts, status_line, tell_status

        try:
            settings = asked.settings()
            events = open_event_log(settings.log.to, settings.log.level)
        except (SettingsError, LogError) as error:
            raise Refused(str(error)) from None
        stack.callback(notifier.close)
        stack.callback(events.close)
        tell = Telling(events, settings.log)
        # Before the rest, so that what arrives while we get ready waits in the links' buffers.
        links = open_links(settings, stack)
        page = _page(settings, links, stack)
        tell(Event.START, f"listening on {links.title}", **_started(settings, links))
        running = assemble(settings, links, page, tell, notifier, stack)
        running.looks.append(Witness(running, tell, notifier, running.now_us))
        events.log(Event.READY, "the loop turns")

        def reload() -> None:
            done = running.tuning.reload(asked.settings, str(config or "the configuration"))
            grave = "error" if done.failed else "info"
            taken, waiting = list(done.retuned.taken), list(done.retuned.waiting)
            tell(Event.RELOAD, done.sentence, grave, taken=taken, waiting=waiting)

        def report(*, stopped: bool = False) -> None:
            status = running.daemon.status()
            tell_status(status, json_lines=json_lines, stopped=stopped)
            event = Event.STOP if stopped else Event.STATUS
            events.log(event, status_line(status), **status_facts(status))

        with output(json_lines, links.title, running.beside) as show:
            turn_until_stopped(running, signals, notifier, show, report, reload)
        report(stopped=True)


def _started(settings: Settings, links: Links) -> dict[str, Any]:
    """What the log's first entry says."""
    from importlib.metadata import version

    return {
        "version": version("mavsentry"),
        "profile": settings.profile,
        "links": list(links.hub.names),
        "record": settings.recorder.folder or None,
        "pid": os.getpid(),
    }


def _page(settings: Settings, links: Links, stack: ExitStack) -> LivePage | None:
    """The live page, if an address is given; nothing of it is loaded otherwise."""
    if not settings.web.address:
        return None
    from monitor.commands.live.page import LivePage

    return LivePage(settings.web.address, settings, links.title, stack)
