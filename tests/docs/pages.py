"""The pages, and the fences in them: what stands in each, and what a comment above says of it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from markdown_it import MarkdownIt

from tests.conftest import ROOT

DIRECTIVES = ("elsewhere", "setup", "numbers", "fails", "output", "like", "copy")
"""What a comment may say; every other comment is the page's own."""

_COMMENT = re.compile(r"<!--\s*([a-z]+)(?::\s*(.*?))?\s*-->", re.DOTALL)
_BUILT = ("_build", "_static", "_templates")


class Wrong(AssertionError):
    """What is not true in a page, with its line."""


@dataclass(frozen=True)
class Fence:
    """One snippet.

    Parameters
    ----------
    language
        First word behind the back ticks; empty if there is none.
    text
        What stands in it, with the last line feed.
    line
        Of the back ticks, counted from 1.
    says
        Directives of the comments right above, by their first word.
    """

    language: str
    text: str
    line: int
    says: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Setup:
    """A file that the page's commands find, or a command that is not shown."""

    text: str
    line: int


@dataclass(frozen=True)
class Inline:
    """Code within a line."""

    text: str
    line: int


@dataclass(frozen=True)
class Page:
    """A page's snippets, in their order."""

    name: str
    items: tuple[Fence | Setup | Inline, ...]

    def fences(self) -> Iterator[Fence]:
        """Snippets only."""
        return (item for item in self.items if isinstance(item, Fence))


def paths() -> list[Path]:
    """README and every page below docs/ and examples/ that is not made by the build."""
    found = [ROOT / "README.md"]
    for folder in ("docs", "examples"):
        found += sorted((ROOT / folder).rglob("*.md"))
    return [path for path in found if not set(_BUILT) & set(path.parts)]


def read(path: Path) -> Page:
    """One page of the checkout."""
    return parse(path.relative_to(ROOT).as_posix(), path.read_text("utf-8"))


def parse(name: str, text: str) -> Page:
    """A page's snippets; a comment that is misspelt is wrong.

    Raises
    ------
    Wrong
        Of a directive that is not known or has nothing below it to speak of.
    """
    items: list[Fence | Setup | Inline] = []
    waiting: dict[str, str] = {}
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        line = token.map[0] + 1 if token.map else 0
        if token.type == "html_block" and token.content.lstrip().startswith("<!--"):
            for key, value in _directives(token.content, f"{name}:{line}"):
                if key == "setup":
                    items.append(Setup(value, line))
                elif key in waiting:
                    raise Wrong(f"{name}:{line}: {key} is said twice")
                else:
                    waiting[key] = value
        elif token.type in ("fence", "code_block"):
            if token.type == "code_block":
                raise Wrong(f"{name}:{line}: indented code has no language; use a fence")
            language = token.info.split()[0] if token.info.strip() else ""
            items.append(Fence(language, token.content, line, waiting))
            waiting = {}
        elif token.type == "inline":
            items += [
                Inline(child.content, line)
                for child in token.children or ()
                if child.type == "code_inline"
            ]
        if waiting and token.type not in ("html_block", "list_item_close"):
            raise Wrong(f"{name}:{line}: no fence right below the comment {sorted(waiting)}")
    if waiting:
        raise Wrong(f"{name}: no fence below the last comment {sorted(waiting)}")
    return Page(name, tuple(items))


def _directives(comment: str, where: str) -> Iterator[tuple[str, str]]:
    for match in _COMMENT.finditer(comment):
        key, value = match[1], " ".join((match[2] or "").split())
        if key in DIRECTIVES:
            yield key, value
        elif match[2] is not None and len(comment.strip().splitlines()) == 1:
            raise Wrong(f"{where}: <!-- {key}: --> is no directive; {', '.join(DIRECTIVES)} are")
