"""Help of every command: an example that can be typed, words for every option, no stray type."""

import re
import shlex
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from monitor.cli import app, invoke
from monitor.commands.examples import EXAMPLES
from monitor.commands.helping import grouped

ROOT: Any = typer.main.get_command(app)


def contexts(command: Any = ROOT, name: str = "mavsentry", parent: Any = None) -> Iterator[Any]:
    """A context of each command of the tree, the root first."""
    context = command.context_class(command, info_name=name, parent=parent)
    yield context
    for below in getattr(command, "commands", {}).values():
        yield from contexts(below, below.name, context)


TREE = {" ".join(c.command_path.split()[1:]): c for c in contexts()}


def parsed(line: str) -> None:
    """Parse a command line as far as its last command, without running it."""
    words = shlex.split(line.partition(" > ")[0])
    words = words[1:] if words[0] == "sudo" else words
    assert words.pop(0) == "mavsentry"
    command, parent = ROOT, None
    while True:
        group = hasattr(command, "commands")
        context = command.make_context(command.name, list(words), parent=parent)
        if not (group and words and words[0] in command.commands):
            break
        command, parent, words = command.commands[words[0]], context, words[1:]


def test_every_command_has_an_example_and_every_example_a_command() -> None:
    assert set(EXAMPLES) == set(TREE)
    assert all(EXAMPLES.values())


@pytest.mark.parametrize("line", [line for of in EXAMPLES.values() for line, _ in of])
def test_every_example_can_be_typed(line: str) -> None:
    if "COMMAND" in line:
        line = line.replace("COMMAND --help", "run")
    try:
        parsed(line)
    except typer.Exit:  # an option that does all by itself, such as --example
        assert "--example" in line


def test_an_example_that_cannot_be_typed_would_be_seen() -> None:
    with pytest.raises(Exception, match="--recrd"):
        parsed("mavsentry run --recrd x")


@pytest.mark.parametrize("path", TREE)
def test_every_option_has_words_and_says_what_is_typed(path: str) -> None:
    for param in TREE[path].command.get_params(TREE[path]):
        assert param.help, param.name
        assert param.help[-1] in ".]", param.help
        assert param.metavar or getattr(param, "is_flag", False), param.name
        assert not re.search(r"\b(TEXT|PATH|INTEGER|FLOAT)\b", param.metavar or "")


@pytest.mark.parametrize("path", TREE)
def test_help_fits_a_terminal_and_ends_with_its_examples(
    path: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERMINAL_WIDTH", "100")
    assert invoke([*path.split(), "--help"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"Usage: mavsentry {path}".rstrip())
    lines = {line.strip() for of in EXAMPLES.values() for line, _ in of}
    assert all(len(line) <= 100 for line in text.splitlines() if line.strip() not in lines)
    if "COMMAND" in text:  # every command below has room for its first sentence
        assert not re.search(r"^  \S+  .*\.\.\.$", text, re.MULTILINE)
    assert text.rstrip().endswith(EXAMPLES[path][-1][1].split()[-1])


def test_options_of_a_group_stand_together() -> None:
    groups = grouped(TREE["run"].command, TREE["run"])
    assert list(groups) == ["Links", "Aircraft and settings", "Output", "Options"]
    assert [row.typed for row in groups["Links"]] == ["--in LINK", "--out LINK", "--system-id ID"]


@pytest.mark.parametrize("asked", ["config", "key", "learn", "service"])
def test_a_group_without_a_command_shows_its_help(
    asked: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke([asked]) == 0
    said = capsys.readouterr()
    assert "Examples" in said.out or "Example:" in said.out
    assert said.err == ""
