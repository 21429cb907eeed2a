"""What every command shares: refusals in one sentence, consoles, the progress bar."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from links.endpoints import Endpoint
    from monitor.settings import Settings

__all__ = [
    "ConfigFile",
    "Profile",
    "Refused",
    "console",
    "load_settings",
    "note",
    "open_link",
    "progress",
]

Profile = Annotated[
    str | None, typer.Option(help="small-uav (the default), light-aircraft or transport.")
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", metavar="FILE", help="Settings in TOML.")
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


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """A function that takes the fraction done: a bar on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda fraction: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)
