"""Equations of the site as MathML, written when it is built.

Browsers draw MathML themselves, so no page needs a script for it, and a reader's screen reader
reads it. The font is STIX Two Math (SIL Open Font License) as the package ``ziamath`` brings it.
"""

from __future__ import annotations

import html
import re
import shutil
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util import logging

UNREAD = re.compile(r"<mi>(&|\\[^<]*)</mi>")
"""What the converter hands on as it stands: a command that it does not know, a stray ``&``."""
ACCENT = re.compile(
    r"<mover>((?:<mrow>)?<mi>[^<]*</mi>(?:</mrow>)?)(<mo[^>]*>&#x(?:002D9|000A8|0005E|0007E|000AF);)"
)
"""A dot, hat, tilde or bar over a letter, which without ``accent`` is drawn as small as a power."""
PRIME = re.compile(r"<mi>(&#x0203[2-7];)</mi>")
"""Small as a power the font's own is hardly seen: site.css takes another font's."""
BAR = re.compile(r"<mo(?: [^>]*)?>(&#x0(?:2225|2016);)</mo>")
"""Bars of a norm, of which a browser stretches only the first."""
FUNCTION = re.compile(
    r"(?<!<msub>)(?<!<msup>)(?<!<mover>)(?<!<munder>)(?<!<mfrac>)(?<!<msubsup>)(?<!<munderover>)"
    r"(<mi>(?:sin|cos|tan|ln|log|arcsin|arctan)</mi>)(?=<m(?:i|sub|sup|subsup|over)\b)"
)
"""A function's name right before its argument, which browsers set without a space."""
FONT = "STIXTwoMath-Regular.ttf"
MENDED = (
    (ACCENT, r'<mover accent="true">\1\2'),
    (PRIME, r'<mi class="prime">\1</mi>'),
    (BAR, r'<mo stretchy="false">\1</mo>'),
    (FUNCTION, r'\1<mspace width="0.17em"/>'),
)
log = logging.getLogger(__name__)


def mathml(latex: str, display: str, at: nodes.Node) -> str:
    """An equation; one that cannot be read is a warning, which ends a strict build."""
    try:
        found = convert(latex.replace("{aligned}", "{split}"), display=display)
        if left := UNREAD.search(found):
            raise ValueError(f"{left[1]} is not known")
    except Exception as error:
        log.warning("equation %r: %s %s", latex, type(error).__name__, error, location=at)
        return f"<code>{html.escape(latex)}</code>"
    for wrong, right in MENDED:
        found = wrong.sub(right, found)
    return found


def visit_inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(mathml(node.astext(), "inline", node))
    raise nodes.SkipNode


def visit_block(writer: Any, node: nodes.math_block) -> None:
    name = f' id="{node["ids"][0]}"' if node["ids"] else ""
    writer.body.append(f'<div class="equation" role="group" tabindex="0"{name}>')
    writer.body.append(mathml(node.astext().strip(), "block", node))
    if node["number"]:
        writer.body.append(f'<span class="number">({node["number"]})</span>')
    writer.body.append("</div>\n")
    raise nodes.SkipNode


def bring_font(app: Any, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        with as_file(files("ziamath") / "fonts" / FONT) as font:
            shutil.copyfile(font, Path(app.outdir) / "_static" / FONT)


def setup(app: Any) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.connect("build-finished", bring_font)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
