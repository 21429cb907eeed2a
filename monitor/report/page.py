"""``report.html``: the frame around the sections, and the one file they become."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from monitor.pages import html
from monitor.report.section import Chart, Fold, Part, Section

if TYPE_CHECKING:
    from bokeh.models import Model

__all__ = ["REPORT", "frame", "write_file"]

REPORT: Final = "report.html"
_HERE = Path(__file__).parent
_SCRIPTS: Final = ("theme.js", "charts.js", "report.js")


def frame(title: str, top: dict[str, Any], sections: Sequence[Section]) -> str:
    """The page as HTML.

    Parameters
    ----------
    title
        Of the document.
    top
        What the template wants above the sections.
    sections
        In the order in which they stand.
    """
    charts = list(_charts(sections))
    models = [model for chart in charts for model in chart.models]
    style = html.base_style(_HERE / "report.css")
    own = "\n".join(
        (html.script(name) if name != "report.js" else (_HERE / name).read_text("utf-8"))
        for name in _SCRIPTS
    )
    bokeh = html.bokeh_script()
    page = html.environment(_HERE).get_template("report.html.jinja")
    return page.render(
        **top,
        title=title,
        sections=sections,
        style=style,
        scripts=[bokeh, own],
        policy=html.content_security_policy([style], [bokeh, own], charts=True),
        charts_json=html.data_block(_document(models)),
    )


def _charts(parts: Iterable[Part]) -> Iterator[Chart]:
    for part in parts:
        if isinstance(part, Chart):
            yield part
        elif isinstance(part, Section | Fold):
            yield from _charts(part.parts)


def _document(models: Sequence[Model]) -> str:
    """All figures as the JSON of one Bokeh document: what they share, they go on sharing."""
    from bokeh.core.json_encoder import serialize_json
    from bokeh.document import Document

    document = Document()
    for model in models:
        document.add_root(model)
    return str(serialize_json(document.to_json(deferred=False)))


def write_file(path: Path, text: str) -> None:
    """Write a file that is whole or not there at all."""
    unfinished = path.with_name(path.name + ".unfinished")
    try:
        unfinished.write_text(text, "utf-8", errors="replace")
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
