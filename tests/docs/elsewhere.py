"""Commands that cannot be run here: whether what is typed is right all the same."""

from __future__ import annotations

import contextlib
import io
import re
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer

from monitor.cli import app
from tests.conftest import ROOT
from tests.docs.console import commands, words
from tests.docs.kinds import PROGRAMS
from tests.docs.pages import Wrong

REASONS = (
    "needs root",
    "needs a vehicle",
    "needs hardware",
    "needs another computer",
    "needs the network",
    "needs another program",
    "takes long",
)

_ROOT: Any = typer.main.get_command(app)
_Exit: Any = next(c for c in typer.Exit.__mro__ if c.__module__.endswith("exceptions"))
_ClickException: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")
_EXTRA = re.compile(r"mavsentry\[([\w,-]+)\]")
_OWN_MODULES = ("monitor", "links", "estimators", "sim_feeds", "tests")


def check(text: str) -> None:
    """Every command of a console that is not run.

    Raises
    ------
    Wrong
        Of the first that names what is not there.
    """
    for command in commands(text):
        for simple in words(command.text):
            check_words(simple)


def check_words(command: list[str]) -> None:
    """One program and its words."""
    for extra in _EXTRA.findall(" ".join(command)):
        have = _project()["optional-dependencies"]
        for name in extra.split(","):
            if name not in have:
                raise Wrong(f"there is no extra {name}: {', '.join(have)}")
    program, arguments = Path(command[0]).name, command[1:]
    if program == "mavsentry":
        parses(arguments)
    elif program == "make":
        for target in arguments:
            if "=" not in target and not re.search(rf"(?m)^{target}:", _makefile()):
                raise Wrong(f"there is no make {target}")
    elif program in ("python", "python3") and arguments[:1] == ["-m"]:
        _module(arguments[1:])
    elif program not in PROGRAMS:
        raise Wrong(f"{program} is not in tests/docs/programs.toml")
    else:
        _foreign(program, arguments)


def parses(arguments: list[str]) -> None:
    """A whole command line of ours: command, options, types and values.

    Raises
    ------
    Wrong
        With what the command line itself says.
    """
    command, context, rest = _ROOT, None, arguments
    name = "mavsentry"
    try:
        while True:
            with contextlib.redirect_stdout(io.StringIO()):
                context = command.make_context(name, list(rest), parent=context)
            if not hasattr(command, "resolve_command"):
                return
            rest = [*context._protected_args, *context.args]
            if not rest:
                return
            name, command, rest = command.resolve_command(context, rest)
    except (_Exit, SystemExit):
        return
    except _ClickException as error:
        raise Wrong(f"mavsentry {' '.join(arguments)}: {error.format_message()}") from error


def exists(text: str) -> None:
    """Of code within a line: its command and its options are there, whatever is left out.

    Raises
    ------
    Wrong
        Of a command or an option that is not.
    """
    command, path = _ROOT, "mavsentry"
    for word in re.findall(r"\S+", text)[1:]:
        bare = word.strip("[](),'\"")
        if bare.startswith("--"):
            if bare.partition("=")[0] not in {*_options(command), "--help", "--version"}:
                raise Wrong(f"{path} has no {bare}")
        elif hasattr(command, "commands") and re.fullmatch(r"[a-z][a-z-]*", bare):
            if bare not in command.commands:
                raise Wrong(f"{path} has no command {bare}")
            command, path = command.commands[bare], f"{path} {bare}"


def _options(command: Any) -> Iterator[str]:
    for parameter in command.params:
        yield from (*parameter.opts, *parameter.secondary_opts)


def _module(arguments: list[str]) -> None:
    name, rest = arguments[0], arguments[1:]
    if name.partition(".")[0] in _OWN_MODULES:
        if find_spec(name) is None:
            raise Wrong(f"there is no module {name}")
    elif name in PROGRAMS:
        _foreign(name, rest)
    else:
        raise Wrong(f"python -m {name} is not in tests/docs/programs.toml")


def _foreign(program: str, arguments: list[str]) -> None:
    known = PROGRAMS[program]
    if known.get("runs"):  # a program that starts another: its own options, then that one
        rest = list(arguments)
        while rest and rest[0].startswith("-"):
            option = rest.pop(0)
            _option(program, option)
            if option in known.get("valued", ()):
                rest.pop(0)
        if rest:
            check_words(rest)
        return
    for word in arguments:
        if word == "--":
            return
        if word.startswith("-") and len(word) > 1:
            _option(program, word.partition("=")[0])
    first = next((word for word in arguments if not word.startswith("-")), None)
    if "commands" in known and first not in known["commands"]:
        raise Wrong(f"{program} {first} is not in tests/docs/programs.toml")


def _option(program: str, option: str) -> None:
    if option not in PROGRAMS[program].get("options", ()):
        raise Wrong(f"{program} {option} is not in tests/docs/programs.toml")


def _project() -> dict[str, Any]:
    project: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return project


def _makefile() -> str:
    return (ROOT / "Makefile").read_text("utf-8")
