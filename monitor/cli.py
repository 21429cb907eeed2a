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
    completion,
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
from monitor.commands.helping import App
from monitor.commands.reproduce.command import reproduce

__all__ = ["app", "invoke", "main"]

DONE, UNUSABLE, INTERRUPTED = 0, 2, 130

_ClickException: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")
"""Base of typer's complaints about arguments; some versions of typer carry their own click."""

FLY, AFTER, SET_UP, WITHOUT, MEASURE = (
    "In flight",
    "After the flight",
    "Set up and tune",
    "Without an aircraft",
    "Measured",
)
"""Headings that the commands stand under in the help."""

app = App(
    name="mavsentry",
    help="Says which sensor of a fixed-wing aircraft is faulty, since when and why, over MAVLink "
    "in flight and from a log afterwards.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
app.command("run", rich_help_panel=FLY)(run.run)
app.command("analyze", rich_help_panel=AFTER)(analyze.analyze)
app.command("fleet", rich_help_panel=AFTER)(fleet.fleet)
app.command("replay", rich_help_panel=AFTER)(replay.replay)
app.command("inject", rich_help_panel=AFTER)(inject.inject)
app.add_typer(config.app, name="config", rich_help_panel=SET_UP)
app.add_typer(learn.app, name="learn", rich_help_panel=SET_UP)
app.add_typer(key.app, name="key", rich_help_panel=SET_UP)
app.add_typer(service.app, name="service", rich_help_panel=SET_UP)
app.command("warmup", rich_help_panel=SET_UP)(warmup.warmup)
app.command("completion", rich_help_panel=SET_UP)(completion.completion)
app.command("demo", rich_help_panel=WITHOUT)(demo.demo)
app.command("selftest", rich_help_panel=WITHOUT)(selftest.selftest)
app.command("feed", rich_help_panel=WITHOUT)(feed.feed)
app.add_typer(bench.app, name="bench", rich_help_panel=MEASURE)
app.command("reproduce", rich_help_panel=MEASURE)(reproduce)


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
    if completion.ASKED in os.environ:
        completion.prepare()
    try:
        status = typer.main.get_command(app).main(
            arguments, prog_name="mavsentry", standalone_mode=False
        )
    except _ClickException as error:
        note(f"mavsentry: {_usage(error)}")
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


def _usage(error: Any) -> str:
    """A complaint about arguments in one line, with where to look if it has no advice itself."""
    said = " ".join(error.format_message().split()).removesuffix(".")
    context = getattr(error, "ctx", None)
    if said.endswith("?") or context is None:
        return said
    return f"{said}; `{context.command_path} --help` shows what it takes"


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
