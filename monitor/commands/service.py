"""``mavsentry service``: install the monitor as a systemd service, and take it away again."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands.common import Profile, Refused, load_settings
from monitor.commands.helping import App

if TYPE_CHECKING:
    from monitor.service.installation import Step

__all__ = ["app"]

app = App(help="Install the monitor as a systemd service, or take it away.")

SYSTEMD_RUNS = Path("/run/systemd/system")
DEFAULT_INPUT = "udpin:0.0.0.0:14550"

Root = Annotated[
    Path,
    typer.Option(
        metavar="DIR",
        help="Root of an image that is being built: only files below it are written.",
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Say what would be done, and do nothing of it.")
]

_CONFIG = """\
# What the service watches; `mavsentry config show` has every key. After a change
# `sudo systemctl reload mavsentry` takes what can be taken in flight.

profile = "{profile}"

[links]
inputs = [{inputs}]

[recorder]
folder = "/var/lib/mavsentry/recordings"

# The live page, with the extra `web`:
# [web]
# address = "127.0.0.1:8080"
"""

_PAST = {"write": "wrote", "keep": "kept", "link": "linked", "remove": "removed"}


@app.command()
def install(
    inputs: Annotated[
        list[str] | None,
        typer.Option(
            "--in",
            metavar="LINK",
            help="Where the vehicle's MAVLink comes from, as of `mavsentry run`; may be given "
            f"several times. Without it {DEFAULT_INPUT}. Goes into the configuration.",
        ),
    ] = None,
    profile: Profile = None,
    program: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The command that the service starts, as it is called on the finished system; "
            "without it the one of this environment.",
        ),
    ] = None,
    root: Root = Path("/"),
    dry_run: DryRun = False,
    start: Annotated[
        bool, typer.Option("--start/--no-start", help="Compile the kernels and start it now.")
    ] = True,
) -> None:
    """Write unit, configuration and udev rules, compile the kernels, start the service.

    Done again it changes nothing but what differs; a configuration that is there stays as it is.
    """
    from monitor.service.installation import CACHE, CONFIG, Place, below, installing

    here = root.absolute() == Path("/")
    chosen = _program(program, here)
    config = below(root, CONFIG)
    links, text = _configuration(config, inputs, profile)
    if not dry_run:
        _allowed(root, here)
    _do(installing(Place(root, chosen), text, links), dry_run)
    if not here:
        print("the kernels are compiled at its first start; nothing was started")
        return
    _run(dry_run, "systemctl", "daemon-reload")
    if shutil.which("udevadm"):
        _run(dry_run, "udevadm", "control", "--reload")
        _run(dry_run, "udevadm", "trigger", "--subsystem-match=tty")
    if start:
        _run(dry_run, "env", f"MAVSENTRY_CACHE_DIR={CACHE}", str(chosen), "warmup")
        _run(dry_run, "systemctl", "restart", "mavsentry")
        print("`systemctl status mavsentry` says how it does; it starts with the computer from now")


@app.command()
def uninstall(
    purge: Annotated[
        bool,
        typer.Option(
            "--purge",
            help="Remove configuration, state, kernels and recordings below /var/lib/mavsentry "
            "as well.",
        ),
    ] = False,
    root: Root = Path("/"),
    dry_run: DryRun = False,
) -> None:
    """Stop the service and take its files away; configuration and state stay unless purged."""
    from monitor.service.installation import UNIT, below, removing

    here = root.absolute() == Path("/")
    if not dry_run:
        _allowed(root, here)
    if here and below(root, UNIT).exists():
        _run(dry_run, "systemctl", "stop", "mavsentry")
    _do(removing(root, purge), dry_run)
    if here:
        _run(dry_run, "systemctl", "daemon-reload")


def _program(given: Path | None, here: bool) -> Path:
    """The command that the service starts, which it must be able to see."""
    from monitor.service.installation import hidden_from_service

    chosen = given or Path(sys.executable).with_name("mavsentry")
    if not chosen.is_absolute():
        raise Refused(f"{chosen} is no absolute path, and a service has no folder of its own")
    if not here and given is not None:
        return chosen
    if not chosen.is_file():
        raise Refused(
            f"there is no {chosen}: install the program first (docs/installation.md), or name it "
            "with --program"
        )
    paths = (chosen, chosen.resolve(), Path(sys.base_prefix)) if given is None else (chosen,)
    if hidden := hidden_from_service(*paths):
        raise Refused(
            f"the service runs as a user of its own and cannot see {hidden}: install the program "
            "elsewhere, such as /opt/mavsentry (docs/service.md), and call it from there"
        )
    return chosen


def _configuration(
    file: Path, inputs: Sequence[str] | None, profile: str | None
) -> tuple[tuple[str, ...], str]:
    """The links that will be in force, and the configuration to begin with."""
    from monitor.settings import SettingsError, load
    from monitor.toml import toml_value

    if file.exists():
        if inputs or profile:
            raise Refused(
                f"{file} is there and is not written over: set [links] inputs and profile in it, "
                "or remove it"
            )
        try:
            links = load(None, file).links.inputs
        except SettingsError as error:
            raise Refused(f"{error}; the service would not start with it") from None
    else:
        links = tuple(inputs or (DEFAULT_INPUT,))
    settings = load_settings(profile, None)
    text = _CONFIG.format(
        profile=settings.profile, inputs=", ".join(toml_value(link) for link in links)
    )
    _check(text)
    _have_serial(links)
    return links, text


def _check(text: str) -> None:
    """Refuse links that the program would not take."""
    import tomllib

    from pydantic import ValidationError

    from monitor.settings import Settings

    try:
        Settings.model_validate(tomllib.loads(text))
    except ValidationError as error:
        reason = str(error.errors()[0]["msg"]).removeprefix("Value error, ")
        raise Refused(f"the service would not start: {reason}") from None


def _have_serial(links: Sequence[str]) -> None:
    from importlib.util import find_spec

    port = next((link for link in links if link.startswith("/dev/")), None)
    if port is not None and find_spec("serial") is None:
        raise Refused(
            f"{port} is a serial port, and those need the extra serial: "
            "pip install 'mavsentry[serial]' into the same environment"
        )


def _allowed(root: Path, here: bool) -> None:
    """Refuse where no service can be installed."""
    if not here:
        if not root.is_dir():
            raise Refused(f"there is no folder {root}")
        return
    if not SYSTEMD_RUNS.is_dir():
        raise Refused(
            "this computer was not started by systemd; `--root DIR` prepares an image, and "
            "`mavsentry run --config FILE` can be started by any other service manager"
        )
    if os.geteuid() != 0:
        raise Refused("a service is installed by root: put sudo before the same command")


def _do(steps: Sequence[Step], dry_run: bool) -> None:
    for step in steps:
        if says := step.says:
            try:
                if not dry_run:
                    step.do()
            except OSError as error:
                raise Refused(f"cannot {says} {step.path}: {error.strerror}") from None
            print(f"{f'would {says}' if dry_run else _PAST[says]} {step.path}")


def _run(dry_run: bool, *command: str) -> None:
    """Run a program of the system."""
    print(f"{'would run' if dry_run else 'runs'} {' '.join(command)}", flush=True)
    if dry_run:
        return
    try:
        status = subprocess.run(command, check=False).returncode
    except OSError as error:
        raise Refused(f"cannot run {command[0]}: {error.strerror}") from None
    if status != 0:
        raise Refused(f"`{' '.join(command)}` failed with status {status}")
