"""The command line: what is typed, and the exit status that comes back.

Each command stands in its own file of ``monitor.commands`` and imports what it needs when it is
called, so that ``mavsentry --help`` loads neither numpy nor numba.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Any

import typer

from monitor.commands import (
    analyze,
    bench,
    config,
    demo,
    feed,
    fleet,
    inject,
    key,
    learn,
    replay,
    run,
    selftest,
    service,
    warmup,
)
from monitor.commands.common import Refused, note
from monitor.commands.reproduce.command import reproduce

__all__ = ["app", "invoke", "main"]

DONE, UNUSABLE, INTERRUPTED = 0, 2, 130

_ClickException: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")
"""Base of typer's complaints about arguments; some versions of typer carry their own click."""

app = typer.Typer(
    name="mavsentry",
    help="Says which sensor of a fixed-wing aircraft is faulty, since when and why, over MAVLink "
    "in flight and from a log afterwards.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
app.command("run")(run.run)
app.command("analyze")(analyze.analyze)
app.command("fleet")(fleet.fleet)
app.command("feed")(feed.feed)
app.command("inject")(inject.inject)
app.command("replay")(replay.replay)
app.command("reproduce")(reproduce)
app.command("selftest")(selftest.selftest)
app.command("warmup")(warmup.warmup)
app.command("demo")(demo.demo)
app.add_typer(learn.app, name="learn")
app.add_typer(bench.app, name="bench")
app.add_typer(config.app, name="config")
app.add_typer(key.app, name="key")
app.add_typer(service.app, name="service")


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"mavsentry {version('mavsentry')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and leave."
    ),
) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit


def invoke(arguments: list[str]) -> int:
    """Run one command; every expected end becomes an exit status and at most one sentence."""
    try:
        status = typer.main.get_command(app).main(
            arguments, prog_name="mavsentry", standalone_mode=False
        )
    except _ClickException as error:
        note(f"mavsentry: {error.format_message()}")
        return UNUSABLE
    except Refused as error:
        note(f"mavsentry: {error}")
        return UNUSABLE
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has left, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    return status if isinstance(status, int) else DONE


def main() -> None:
    """Entry point of the ``mavsentry`` command."""
    status = invoke(sys.argv[1:])
    if sys.argv[1:2] == ["run"]:
        # Told to stop, a service is gone within a second. All is closed and written; to take
        # numba's machine code down piece by piece would take most of that time.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    main()
