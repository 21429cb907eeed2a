"""Lines of a console: which are typed, and what is expected below them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass

_PROMPT = re.compile(r"(?P<who>[\w@.\-]*)[$] (?P<command>.*)")
INTERRUPT = "^C"


@dataclass(frozen=True)
class Command:
    """One command of a fence.

    Parameters
    ----------
    text
        As it is typed, in one line for each that a backslash continues.
    expected
        Lines below it; empty if output is not shown.
    interrupted
        Ended by Ctrl-C.
    elsewhere
        Typed on another computer, which the prompt names.
    """

    text: str
    expected: str
    interrupted: bool
    elsewhere: bool


def commands(text: str) -> Iterator[Command]:
    """Commands of a fence.

    Raises
    ------
    ValueError
        Of a line in front of the first prompt.
    """
    typed: list[str] = []
    below: list[str] = []
    who = ""
    goes_on = False
    for line in text.splitlines():
        prompt = _PROMPT.fullmatch(line)
        if goes_on:
            typed.append(line.removeprefix("> "))
        elif prompt:
            if typed:
                yield _command(typed, below, who)
            typed, below, who = [prompt["command"]], [], prompt["who"]
        elif not typed:
            raise ValueError(f"{line!r}: a console begins with '$ '")
        else:
            below.append(line)
        goes_on = (goes_on or bool(prompt)) and line.endswith("\\")
    if not typed:
        raise ValueError("nothing is typed")
    yield _command(typed, below, who)


def _command(typed: list[str], below: list[str], who: str) -> Command:
    interrupted = bool(below) and below[-1].strip() == INTERRUPT
    expected = "\n".join(below[:-1] if interrupted else below)
    return Command("\n".join(typed), expected, interrupted, bool(who))


def words(text: str) -> list[list[str]]:
    """Words of each simple command of a line, redirections left out.

    Raises
    ------
    ValueError
        Of a quote that is not closed.
    """
    lexer = shlex.shlex(text.replace("\\\n", " "), posix=True, punctuation_chars=";|&<>()")
    lexer.whitespace_split = True
    found: list[list[str]] = [[]]
    skip = False
    for word in lexer:
        if skip:
            skip = False
        elif set(word) <= set("<>") or word in (">&", "&>"):
            skip = True
            if found[-1] and found[-1][-1] in ("1", "2"):
                found[-1].pop()
        elif set(word) <= set(";|&()"):
            found.append([])
        else:
            found[-1].append(word)
    return [command for command in map(_bare, found) if command]


def _bare(command: list[str]) -> list[str]:
    """Without assignments and the words of loops."""
    while command:
        if command[0] in ("do", "then", "else", "time", "!") or "=" in command[0].split("/")[0]:
            command = command[1:]
        elif command[0] in ("for", "done", "fi", "if", "while"):
            return command[1:] if command[0] in ("if", "while") else []
        else:
            break
    return command


def lasts(text: str) -> bool:
    """Whether this command goes on until it is interrupted."""
    if text.rstrip().endswith("&"):
        return True
    for command in words(text):
        if command[0] != "mavsentry" or "--help" in command or "-h" in command:
            continue
        given = dict(zip(command, [*command[1:], ""], strict=True))
        if command[1:2] == ["run"] and not given.get("--in", "").endswith(".tlog"):
            return True
        at_once = given.get("--speed") == "max" or given.get("--to", "").endswith(".tlog")
        if command[1:2] in (["feed"], ["replay"]) and not at_once:
            return True
    return False
