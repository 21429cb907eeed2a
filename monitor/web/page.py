"""The live page, made once: one HTML file with its style, its scripts, BokehJS and its figures.

It loads nothing; its policy lets it talk to the server that it came from, and to nobody else.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from monitor.pages.html import (
    base_style,
    bokeh_script,
    content_security_policy,
    data_block,
    environment,
    script,
)
from monitor.web.figures import TONES, WINDOWS_S, catalogue

__all__ = ["Page", "rendered"]

SCRIPTS: Final = ("store.js", "charts.js", "panels.js", "live.js")
"""In the order in which they need each other."""

_HERE = Path(__file__).parent


class Page(NamedTuple):
    """The page, and the policy to send as its header ``Content-Security-Policy``."""

    html: bytes
    policy: str


@cache
def rendered() -> Page:
    """The page; the same bytes each time.

    Raises
    ------
    ModuleNotFoundError
        Bokeh or jinja2 is not installed: the extra ``web`` brings them.
    """
    style = base_style(_HERE / "live.css") + _strokes()
    own = [(_HERE / name).read_text("utf-8") for name in SCRIPTS]
    scripts = [script("theme.js"), bokeh_script(), *own]
    policy = content_security_policy([style], scripts, charts=True, connect=True)
    html = (
        environment(_HERE)
        .get_template("page.html.jinja")
        .render(
            style=style,
            scripts=scripts,
            policy=policy,
            catalogue=data_block(json.dumps(catalogue(), separators=(",", ":"), allow_nan=False)),
            windows=WINDOWS_S,
        )
    )
    return Page(html.encode(), policy)


def _strokes() -> str:
    """Colours of the lines in the keys of charts, as style rules by class."""
    return "".join(
        f".tone-{i}{{--tone:light-dark({tone.light},{tone.dark})}}\n"
        for i, tone in enumerate(TONES)
    )
