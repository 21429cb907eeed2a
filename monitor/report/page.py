"""``report.html``: the frame around the sections, and the one file they become."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from monitor.pages import html
from monitor.report import (
    air,
    autopilots,
    configuration,
    coverage,
    engine,
    evidence,
    imu,
    live,
    rejected,
    streams,
    timeline,
    track,
    wing,
)
from monitor.report.section import Chart, Fold, Part, Section
from monitor.report.verdict_sentence import Top, top

if TYPE_CHECKING:
    from bokeh.models import Model

    from monitor.report.flight import Flight

__all__ = ["REPORT", "render", "write_report"]

REPORT: Final = "report.html"
_HERE = Path(__file__).parent
_ORDER: Final = (
    timeline,
    evidence,
    air,
    imu,
    engine,
    wing,
    track,
    autopilots,
    live,
    streams,
    rejected,
    coverage,
    configuration,
)
_SCRIPTS: Final = ("theme.js", "charts.js", "report.js")


def render(flight: Flight) -> str:
    """The report as HTML.

    Parameters
    ----------
    flight
        What was found, and the series to draw.
    """
    from bokeh.models import Range1d

    axis = Range1d(0.0, max(flight.duration_s, 1.0), bounds="auto")
    sections = (part.section(flight, axis) for part in _ORDER)
    return frame(top(flight), [section for section in sections if section is not None])


def write_report(folder: Path, flight: Flight) -> Path:
    """Write ``report.html`` into a folder and return its path; it is whole or not there.

    Raises
    ------
    OSError
        It cannot be written.
    ModuleNotFoundError
        The extra ``report`` is not installed.
    """
    path = folder / REPORT
    write_file(path, render(flight))
    return path


def frame(head: Top, sections: Sequence[Section]) -> str:
    """The page as HTML.

    Parameters
    ----------
    head
        What stands above the sections.
    sections
        In the order in which they stand.
    """
    models = []
    for chart in _charts(sections):
        for k, model in enumerate(chart.models):
            model.name = model.name or (f"{chart.key}-{k + 1}" if k else chart.key)
            models.append(model)
    style = html.base_style(_HERE / "report.css")
    own = "\n".join(
        (html.script(name) if name != "report.js" else (_HERE / name).read_text("utf-8"))
        for name in _SCRIPTS
    )
    bokeh = html.bokeh_script()
    page = html.environment(_HERE).get_template("report.html.jinja")
    return page.render(
        top=head,
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
    with document.models.freeze():  # what belongs to it is found once, not with every root
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
