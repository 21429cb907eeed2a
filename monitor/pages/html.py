"""What a page is made of besides its own words: templates, filters, style, script, and its policy.

A page is one file that loads nothing. Its content security policy forbids every request; scripts
are admitted by their digests alone, so that no text of a log can become one.

BokehJS writes ``<style>`` elements whose text depends on the sizes of a chart, which no digest can
name in advance: a page with charts admits inline styles, and pictures out of ``data:`` for the
icons of its tools. It needs no ``eval`` and no ``blob:`` as long as no chart holds custom scripts.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from monitor.pages.palette import LOOKS, dark_by_light, tokens
from monitor.pages.units import as_written

if TYPE_CHECKING:
    import jinja2

__all__ = [
    "base_style",
    "bokeh_script",
    "clock",
    "content_security_policy",
    "data_block",
    "digest",
    "environment",
    "script",
]

_HERE = Path(__file__).parent
_BOKEH: Final = "bokeh.min.js"
"""The one bundle that figures need; widgets, tables, WebGL and MathJax are others."""


def environment(folder: Path) -> jinja2.Environment:
    """Templates of a folder, then the shared ones; every text is escaped, every gap an error.

    Parameters
    ----------
    folder
        Of the page's own templates.
    """
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, _HERE]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
        finalize=lambda value: as_written(value) if type(value) is str else value,
    )
    made.globals["marks"] = {str(state): look.mark for state, look in LOOKS.items()}
    made.filters |= {"count": lambda count: f"{count:,}", "clock": clock}
    return made


def digest(text: str) -> str:
    """As a content security policy wants it."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def content_security_policy(
    styles: Iterable[str], scripts: Iterable[str], *, charts: bool = False, connect: bool = False
) -> str:
    """The policy of a page that holds these styles and scripts, and loads nothing.

    Parameters
    ----------
    styles, scripts
        The texts of the page's ``<style>`` and ``<script>`` elements.
    charts
        The page has Bokeh figures.
    connect
        The page talks to the server that it came from (the live page).
    """

    def admitted(texts: Iterable[str]) -> str:
        return " ".join(f"'{digest(text)}'" for text in texts) or "'none'"

    rules = [
        "default-src 'none'",
        "style-src 'unsafe-inline'" if charts else f"style-src {admitted(styles)}",
        f"script-src {admitted(scripts)}",
    ]
    if charts:
        rules.append("img-src data:")
    if connect:
        rules.append("connect-src 'self'")
    return "; ".join([*rules, "base-uri 'none'", "form-action 'none'"])


def base_style(*more: Path) -> str:
    """Tokens and shared rules, then those of the page's own files."""
    texts = (path.read_text("utf-8") for path in (_HERE / "base.css", *more))
    return tokens() + "\n".join(texts)


@cache
def script(name: str) -> str:
    """A script of this folder; ``theme.js`` brings the table of colours with it."""
    text = (_HERE / name).read_text("utf-8")
    return text.replace("__DARK_BY_LIGHT__", json.dumps(dark_by_light(), separators=(",", ":")))


@cache
def bokeh_script() -> str:
    """BokehJS, as the installed Bokeh brings it.

    Raises
    ------
    ModuleNotFoundError
        Bokeh is not installed: the extra ``report`` or ``web`` brings it.
    """
    import bokeh

    js = Path(bokeh.__file__).parent / "server" / "static" / "js" / _BOKEH
    return js.read_text("utf-8")


def data_block(text: str) -> str:
    """JSON that may stand in a ``<script>``: nothing in it ends the element."""
    return as_written(text).replace("<", "\\u003c")


def clock(seconds: float | None, digits: int = 0) -> str:
    """Seconds as ``m:ss``, or ``h:mm:ss`` from an hour on; a dash for None.

    >>> clock(83.4), clock(3723.0), clock(83.44, 1)
    ('1:23', '1:02:03', '1:23.4')
    """
    if seconds is None:
        return "–"
    whole, rest = divmod(round(abs(seconds) * 10**digits), 10**digits)
    sign = "-" if seconds < 0.0 and whole + rest else ""
    part = f".{rest:0{digits}d}" if digits else ""
    minutes, whole = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    shown = f"{hours}:{minutes:02d}" if hours else f"{minutes}"
    return f"{sign}{shown}:{whole:02d}{part}"
