"""The report: one HTML file that needs nothing else, and the tables as CSV and JSON."""

from __future__ import annotations

import base64
import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from monitor.commands.reproduce.drawing import svg
from monitor.commands.reproduce.study import FULL_WIDTH_IN, Cell, Chapter, Figure, Table, Text

__all__ = ["SCHEMA", "Stamp", "shown", "write"]

SCHEMA: Final = "mavsentry/reproduce/1"
MARKS: Final = {
    "holds": "✓",
    "holds in part": "◐",
    "does not hold": "✗",
    "not reproducible": "∅",
    "not run": "–",
}
"""A sign for each outcome, so that it does not hang on a colour."""
LONG: Final = 40
"""Characters from which a cell is a sentence."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """What the report was made from.

    Attributes
    ----------
    version, code
        Of mavsentry; digests of the code that made the results.
    seed, quick
        As asked for.
    seconds
        By paper: its jobs' times, each on one core.
    """

    version: str
    code: tuple[str, ...]
    seed: int
    quick: bool
    seconds: Mapping[str, float]

    def line(self) -> str:
        """The stamp in one line."""
        scope = "quick version" if self.quick else "full"
        return (
            f"mavsentry {self.version}, code {' and '.join(self.code)}, seed {self.seed}, {scope}"
        )


def shown(value: Cell, digits: int) -> str:
    """A cell as text: numbers to ``digits`` significant digits, None as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return _number(value, digits)
    return str(value)


def _number(value: float, digits: int) -> str:
    if not math.isfinite(value):
        return "–" if math.isnan(value) else str(value)
    if value == 0.0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if -4 <= magnitude < 6:
        return f"{value:.{max(digits - 1 - magnitude, 0)}f}"
    return f"{value:.{digits - 1}e}"


def write(chapters: Mapping[str, Chapter], stamp: Stamp, folder: Path) -> Path:
    """Write ``report.html``, ``tables/*.csv``, ``tables.json`` and ``figures/*.svg``.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    tables, figures = folder / "tables", folder / "figures"
    for made in (tables, figures):
        made.mkdir(parents=True, exist_ok=True)
    pictures = {}
    for chapter in chapters.values():
        for block in chapter.blocks:
            if isinstance(block, Figure):
                picture = svg(block)
                (figures / f"{block.name}.svg").write_text(picture, encoding="utf-8")
                pictures[block.name] = base64.b64encode(picture.encode()).decode()
            elif isinstance(block, Table):
                _write_csv(block, stamp, tables / f"{block.name}.csv")
    (folder / "tables.json").write_text(_json(chapters, stamp), encoding="utf-8")
    page = folder / "report.html"
    page.write_text(_page(chapters, stamp, pictures), encoding="utf-8")
    return page


def _write_csv(table: Table, stamp: Stamp, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {stamp.line()}\n")
        writer = csv.writer(file)
        writer.writerow(table.columns)
        writer.writerows(table.rows)


def _json(chapters: Mapping[str, Chapter], stamp: Stamp) -> str:
    papers: dict[str, Any] = {}
    for key, chapter in chapters.items():
        papers[key] = {
            "title": chapter.title,
            "claims": [asdict(claim) for claim in chapter.claims],
            "tables": [
                {
                    "name": block.name,
                    "caption": block.caption,
                    "columns": list(block.columns),
                    "rows": [[_plain(cell) for cell in row] for row in block.rows],
                }
                for block in chapter.blocks
                if isinstance(block, Table)
            ],
        }
    head = {"schema": SCHEMA, **asdict(stamp), "papers": papers}
    return json.dumps(head, indent=1, allow_nan=False)


def _plain(cell: Cell) -> Cell:
    """The cell as JSON can carry it: what is not finite becomes null."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _page(chapters: Mapping[str, Chapter], stamp: Stamp, pictures: Mapping[str, str]) -> str:
    import jinja2

    folder = Path(__file__).parent
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["shown"] = shown
    environment.filters["paragraphs"] = _paragraphs
    environment.tests["table"] = lambda block: isinstance(block, Table)
    environment.tests["figure"] = lambda block: isinstance(block, Figure)
    environment.tests["words"] = lambda block: isinstance(block, Text)
    environment.filters["alignment"] = _alignment
    return environment.get_template("report.html.jinja").render(
        chapters=chapters,
        stamp=stamp,
        pictures=pictures,
        marks=MARKS,
        full_width=FULL_WIDTH_IN,
        counts={key: _count(chapter) for key, chapter in chapters.items()},
    )


def _alignment(table: Table) -> list[str]:
    """Each column's class: numbers stand to the right, sentences have room."""
    out = []
    for cells in zip(*table.rows, strict=True):
        words = [cell for cell in cells if isinstance(cell, str)]
        if any(len(word) > LONG for word in words):
            out.append("long")
        else:
            out.append("" if words or all(cell is None for cell in cells) else "number")
    return out or [""] * len(table.columns)


def _count(chapter: Chapter) -> dict[str, int]:
    outcomes = [claim.outcome for claim in chapter.claims]
    return {word: outcomes.count(word) for word in MARKS if word in outcomes}


def _paragraphs(text: str) -> Sequence[Sequence[tuple[bool, str]]]:
    """Paragraphs as runs of (is code, text)."""
    return [
        [(i % 2 == 1, run) for i, run in enumerate(part.strip().split("`")) if run]
        for part in text.split("\n\n")
        if part.strip()
    ]
