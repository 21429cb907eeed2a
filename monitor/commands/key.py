"""``mavsentry key``: make a MAVLink 2 signing key, or see whether a file holds one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from monitor.commands.common import Refused
from monitor.commands.helping import App

__all__ = ["app"]

app = App(help="Make and check signing keys.")


@app.command()
def new(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="File to write; must not be there yet.")
    ],
) -> None:
    """Write a random passphrase into a file that only you can read."""
    from monitor.security.key import KeyFileError, new_key_file

    try:
        new_key_file(file)
    except KeyFileError as error:
        raise Refused(str(error)) from None
    print(
        f"wrote {file}; name it in [security] key_file, and give the passphrase in it to the "
        "vehicle by your ground station (docs/security.md)"
    )


@app.command()
def check(file: Annotated[Path, typer.Argument(metavar="FILE", help="File to check.")]) -> None:
    """Say whether a file can be used as [security] key_file; never shows what is in it."""
    from monitor.security.key import KeyFileError, read_key

    try:
        read_key(file)
    except KeyFileError as error:
        raise Refused(str(error)) from None
    print(f"{file} is good")
