"""What every command shares: refusals in one sentence, consoles, the progress bar."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands import completing

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

    from links.endpoints import Endpoint
    from monitor.settings import Settings

__all__ = [
    "LINKS",
    "OUTPUT",
    "SETTINGS",
    "WORK",
    "Bar",
    "ConfigFile",
    "Profile",
    "Refused",
    "console",
    "load_settings",
    "note",
    "open_link",
    "progress",
]

LINKS, SETTINGS, OUTPUT, WORK = "Links", "Aircraft and settings", "Output", "How it works"
"""Headings that options stand under in the help of commands that have many."""

Profile = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Class of airframe: small-uav (20 m/s, the default), light-aircraft (50 m/s) or "
        "transport (100 m/s).",
        autocompletion=completing.profiles,
        rich_help_panel=SETTINGS,
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Settings in TOML, over those of the profile; `mavsentry config init` writes one.",
        autocompletion=completing.settings_files,
        rich_help_panel=SETTINGS,
    ),
]


class Refused(Exception):
    """Unusable input, arguments or configuration, in one plain sentence; the status is 2."""


def console() -> Console:
    """Standard output; in a pipe as wide as a table needs, without colour."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 120)


def note(text: str) -> None:
    """Say something to the user that is not the command's result."""
    print(text, file=sys.stderr, flush=True)


def load_settings(profile: str | None, config: Path | None) -> Settings:
    """Settings of a profile with a file over them.

    Raises
    ------
    Refused
        The profile, the file or one of its keys cannot be used.
    """
    from monitor.settings import SettingsError, load

    try:
        return load(profile, config)
    except SettingsError as error:
        raise Refused(str(error)) from None


@contextmanager
def open_link(spec: str, *, write: bool = False) -> Iterator[Endpoint]:
    """An endpoint of this connection string, closed afterwards; ``write`` makes a file anew.

    Raises
    ------
    Refused
        The string says no connection, or it cannot be opened.
    """
    from links.endpoints import LinkError, open_endpoint

    try:
        link = open_endpoint(spec, write=write)
    except LinkError as error:
        raise Refused(str(error)) from None
    with link:
        yield link


class Bar:
    """Takes the fraction done; in a pipe nothing is shown.

    Parameters
    ----------
    shown
        rich's bar with its one task, None in a pipe.
    """

    def __init__(self, shown: tuple[RichProgress, TaskID] | None) -> None:
        self._shown = shown

    def __call__(self, fraction: float) -> None:
        """Show how much is done."""
        if self._shown is not None:
            bar, task = self._shown
            bar.update(task, completed=fraction)

    def name(self, text: str) -> None:
        """Show another text before the bar."""
        if self._shown is not None:
            bar, task = self._shown
            bar.update(task, description=text)

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Away while something else is printed."""
        if self._shown is None:
            yield
            return
        bar, _ = self._shown
        bar.stop()
        yield
        bar.start()


@contextmanager
def progress(what: str) -> Iterator[Bar]:
    """Something that takes the fraction done: a bar on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield Bar(None)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=Console(stderr=True), transient=True, redirect_stdout=False
    ) as bar:
        yield Bar((bar, bar.add_task(what, total=1.0)))
