"""What a section of the report is made of; how it looks is the template's business.

A section's text is plain: the template escapes it. A chart brings its alternative text, because
whoever cannot see it must be told what is in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from links.vocabulary import State
from monitor.pages.charts import LegendEntry, TimeChart
from monitor.pages.palette import LOOKS, Look

if TYPE_CHECKING:
    from bokeh.models import Model

__all__ = [
    "Cell",
    "Chart",
    "Column",
    "Fold",
    "Link",
    "Listing",
    "Part",
    "Said",
    "Section",
    "Table",
    "Text",
    "event_key",
    "fault_key",
]


def fault_key(index: int) -> str:
    """Anchor of the evidence of ``summary["faults"][index]``."""
    return f"fault-{index + 1}"


def event_key(index: int) -> str:
    """Anchor of the evidence of ``summary["events"][index]``."""
    return f"event-{index + 1}"


@dataclass(frozen=True, slots=True)
class Link:
    """Words that lead to another place of the report: ``Link("evidence", "#fault-1")``."""

    words: str
    href: str


@dataclass(frozen=True, slots=True)
class Said:
    """A state, shown by its mark, its colour and its word."""

    state: State

    @property
    def look(self) -> Look:
        """Of the palette."""
        return LOOKS[self.state]


Cell = str | Link | Said
"""What stands in a table or a list."""


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph; ``tone`` is ``""``, ``"soft"`` (small, grey) or ``"warn"``."""

    words: str
    tone: str = ""
    part: ClassVar[str] = "text"


@dataclass(frozen=True, slots=True)
class Listing:
    """Points of a list, or terms with what is said of them.

    ``items`` are cells, or pairs of a term and its words.
    """

    items: Sequence[Cell | tuple[str, str]]
    part: ClassVar[str] = "listing"


@dataclass(frozen=True, slots=True)
class Column:
    """Heading of a column; numbers stand right, long texts wrap."""

    name: str
    number: bool = False
    long: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column names its rows.

    On a phone each row becomes a card, each cell with the name of its column.
    """

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    part: ClassVar[str] = "table"


@dataclass(frozen=True, slots=True)
class Chart:
    """One or several figures above each other, with one legend and one caption.

    Attributes
    ----------
    key
        Unique in the report; letters, digits and dashes.
    model
        A :class:`~monitor.pages.charts.TimeChart`, any Bokeh model of a known height, or a list.
    caption
        What is to be seen, in one or two sentences, below it.
    alt
        What a reader would see who sees the picture: the finding, not the look.
    more_legend
        Entries beside those of the time charts.
    """

    key: str
    model: TimeChart | Model | Sequence[TimeChart | Model]
    caption: str
    alt: str
    more_legend: Sequence[LegendEntry] = ()
    part: ClassVar[str] = "chart"

    @property
    def _shown(self) -> list[Any]:
        return list(self.model) if isinstance(self.model, Sequence) else [self.model]

    @property
    def models(self) -> list[Model]:
        """The Bokeh models, each a root of the report's document."""
        return [one.model if isinstance(one, TimeChart) else one for one in self._shown]

    @property
    def legend(self) -> list[LegendEntry]:
        """Of all its figures, each entry once."""
        entries = [e for one in self._shown if isinstance(one, TimeChart) for e in one.legend]
        return list(dict.fromkeys([*entries, *self.more_legend]))


@dataclass(frozen=True, slots=True)
class Fold:
    """Parts behind a line that opens them; the keyboard reaches it; print shows the open ones."""

    title: str
    parts: Sequence[Part]
    part: ClassVar[str] = "fold"


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the report with a heading of its own, and an entry in the table of contents.

    Attributes
    ----------
    key
        Its anchor; unique in the report.
    title
        Its heading.
    lead
        One or two sentences below the heading, or ``""``.
    parts
        What stands in it, sections (with smaller headings) among them.
    """

    key: str
    title: str
    lead: str = ""
    parts: Sequence[Part] = field(default_factory=tuple)
    part: ClassVar[str] = "section"


Part = Text | Listing | Table | Chart | Fold | Section
