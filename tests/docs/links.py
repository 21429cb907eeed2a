"""Links of the Markdown files as they stand, before a site is made of them.

The site's own build looks at them too, but only at those of its pages, and by the rules of Sphinx:
README and CHANGELOG are read where the files lie.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token

NO_NAME = re.compile(r"[^\w\- ]")
HOST = re.compile(r"(?!-)[a-z0-9-]+(\.[a-z0-9-]+)*\.[a-z]{2,}")


@dataclass(frozen=True)
class Link:
    """Where it stands, what it shows (of a picture: its description), where it leads."""

    page: Path
    line: int
    words: str
    target: str
    picture: bool = False

    @property
    def outside(self) -> bool:
        """Whether it leads out of the checkout."""
        return bool(urlsplit(self.target).scheme) or self.target.startswith("//")


@cache
def tokens(page: Path) -> tuple[Token, ...]:
    """The page, parsed once."""
    return tuple(MarkdownIt("commonmark").enable("table").parse(page.read_text("utf-8")))


def links(page: Path) -> Iterator[Link]:
    """Links and pictures of a page."""
    for token in tokens(page):
        children = token.children or []
        line = token.map[0] + 1 if token.map else 0
        for place, child in enumerate(children):
            if child.type == "image":
                yield Link(page, line, child.content, str(child.attrs["src"]), picture=True)
            elif child.type == "link_open":
                inner = children[place + 1 : _end(children, place)]
                words = "".join(part.content for part in inner)
                yield Link(page, line, words, str(child.attrs["href"]))


def _end(children: list[Token], place: int) -> int:
    """Where the link ends that begins there: links do not nest."""
    return next(i for i in range(place, len(children)) if children[i].type == "link_close")


@cache
def anchors(page: Path) -> frozenset[str]:
    """Names of the headings, as GitHub and MyST make them of their words."""
    found: list[str] = []
    parsed = tokens(page)
    for heading, inline in pairwise(parsed):
        if heading.type == "heading_open":
            words = "".join(
                c.content for c in inline.children or () if c.type in ("text", "code_inline")
            )
            found.append(NO_NAME.sub("", words.strip().lower()).replace(" ", "-"))
    named = []
    for place, name in enumerate(found):
        before = found[:place].count(name)
        named.append(f"{name}-{before}" if before else name)
    return frozenset(named)


def broken(link: Link) -> str | None:
    """What is wrong with a link, None if nothing is."""
    if not link.words.strip():
        return "a picture without a description" if link.picture else "a link without words"
    if link.outside:
        return _wrong_address(link.target)
    path, _, name = unquote(link.target).partition("#")
    if path.startswith("/"):
        return "leads to the root of whatever computer reads it"
    page = (link.page.parent / path).resolve() if path else link.page
    if not page.is_file():
        return "no such file"
    if name and page.suffix == ".md" and name not in anchors(page):
        return f"no such heading; {page.name} has {', '.join(sorted(anchors(page)))}"
    return None


def _wrong_address(target: str) -> str | None:
    """What cannot be right about an address, without asking for it."""
    parts = urlsplit(target)
    if parts.scheme == "mailto":
        return None if "@" in parts.path else "no address"
    if parts.scheme != "https":
        return "not https"
    if parts.username or parts.port:
        return "a user or a port"
    return None if HOST.fullmatch(parts.netloc) else "not a public host"
