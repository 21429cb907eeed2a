"""What a telephone needs of a page: names in tables that break, pictures that open full size.

A browser breaks words at spaces and hyphens alone: one ``MAV_CMD_SET_MESSAGE_INTERVAL`` takes the
width of a telephone. ``<wbr>`` says where it may; unlike a zero-width space it is not copied.
"""

from __future__ import annotations

import re
from typing import Any

CELL = re.compile(r"(?<=<t[dh])(?:\s[^>]*)?>.*?(?=</t[dh]>)", re.DOTALL)
TEXT = re.compile(r"(?<=>)[^<]+")
LONG = re.compile(r"[^\s&;]{12,}")
PICTURE = re.compile(r'<img [^>]*src="([^"]+)"[^>]*>')
PLACE = re.compile(r"(?<=\w[_/.])(?=[^\W_])")


def broken(body: str) -> str:
    """The page's HTML with places to break in the cells of its tables."""
    return CELL.sub(lambda cell: TEXT.sub(_words, cell[0]), body)


def opening(body: str) -> str:
    """The page's HTML with pictures that are links to themselves."""
    return PICTURE.sub(r'<a class="picture" href="\1" title="Open full size">\g<0></a>', body)


def _words(text: re.Match[str]) -> str:
    return LONG.sub(lambda word: PLACE.sub("<wbr>", word[0]), text[0])


def at_page(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    if "body" in context:
        context["body"] = opening(broken(context["body"]))


def setup(app: Any) -> dict[str, bool]:
    app.connect("html-page-context", at_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
