"""What a paper's reproduction is made of: jobs that compute, and a chapter that shows.

A *job* is a few plain values (it fits in JSON), so that any process, here or on a cluster, can do
it. What it returns is kept on disk; a chapter is drawn from what all jobs of its paper returned.
Jobs never see each other, and a chapter computes nothing that takes long.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = [
    "Chapter",
    "Claim",
    "Figure",
    "Job",
    "Paper",
    "Result",
    "Results",
    "Scope",
    "Table",
    "Text",
    "decided",
]

Result = dict[str, Any]
"""What a job returns: arrays, numbers, words, lists and dictionaries of these, None."""
Results = Mapping[str, Result]
"""Results of one paper by :attr:`Job.name`."""
FULL_WIDTH_IN = 8.0
"""Width of a figure that fills the page [inch]."""
APART: Final = 10_000
"""More than any scenario file's seeds differ by."""
Cell = str | float | int | bool | None
Outcome = Literal["holds", "holds in part", "does not hold", "not reproducible", "not run"]


@dataclass(frozen=True, slots=True)
class Job:
    """One piece of work, done in one process, 0.2 to 60 s long.

    Attributes
    ----------
    paper
        Key of the paper, which finds the function that does the work.
    name
        Its own within the paper, as "parametric/017"; also the file of its result.
    what : dict
        Everything the work needs to know, JSON values only.
    seed
        Everything random follows from it.
    """

    paper: str
    name: str
    what: dict[str, Any]
    seed: int

    def digest(self) -> str:
        """The job's content as a short hash: another job, another hash."""
        told = json.dumps([self.paper, self.name, self.what, self.seed], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Scope:
    """How much is asked for.

    Attributes
    ----------
    quick
        The version of all five papers that takes two minutes together.
    seed
        Which draws: 0 gives the figures of the documentation, see :meth:`drawn`.
    flights
        Directory of recorded flights, or None: then what needs them says "not run".
    """

    quick: bool = False
    seed: int = 0
    flights: Path | None = None

    def drawn(self, seed: int) -> int:
        """A scenario file's seed, moved so far that no two scopes share a draw."""
        return seed + APART * self.seed


@dataclass(frozen=True)
class Table:
    """A table of the report, also written as ``tables/<name>.csv`` and into ``tables.json``.

    A table that stands beside the paper's has columns such as "ours" and "paper" and, last, "why":
    one sentence for each difference.

    Attributes
    ----------
    name
        File stem, "wan2018-table3".
    caption
        What it shows, with the paper's own number of the table.
    columns
        With units: "mean delay [s]".
    rows
        Numbers stay numbers; None is shown as a dash.
    digits
        Significant digits of the numbers shown; the files have all of them.
    """

    name: str
    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    digits: int = 3

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.name}: {len(row)} cells under {len(self.columns)} columns")


@dataclass(frozen=True)
class Figure:
    """A figure of the report, drawn with matplotlib into a vector picture.

    Attributes
    ----------
    name, caption
        As of a table.
    draw
        Fills an empty canvas (``canvas.subplots(...)``). The house's style is set: do not set
        fonts, and take colours from the cycle ("C0" ours, "C1" ...; "0.5" for grey). At most
        about 2,000 points a line: see :func:`monitor.commands.reproduce.drawing.thinned`.
    size_in
        Width and height in inches.
    """

    name: str
    caption: str
    draw: Callable[[Canvas], None]
    size_in: tuple[float, float] = (FULL_WIDTH_IN, 3.2)


@dataclass(frozen=True)
class Text:
    """A heading and paragraphs (plain text; blank lines part them; `code` in backquotes)."""

    heading: str
    body: str = ""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and what became of it here.

    Attributes
    ----------
    statement
        In the paper's sense, with its place: "Table IV: no missed detections".
    outcome
    because
        One or two sentences with our numbers.
    """

    statement: str
    outcome: Outcome
    because: str


@dataclass(frozen=True)
class Chapter:
    """One paper's part of the report."""

    title: str
    reference: str
    summary: str
    blocks: Sequence[Table | Figure | Text] = ()
    claims: Sequence[Claim] = ()


@dataclass(frozen=True)
class Paper:
    """A paper that can be reproduced; ``monitor.commands.reproduce.papers`` lists them.

    Attributes
    ----------
    key
        "wan2018".
    jobs
        All jobs of a scope, long ones first; calling it is quick.
    work
        Does one job. A function of a module, pure but for reading the flights.
    chapter
        Draws the chapter from the results.
    """

    key: str
    jobs: Callable[[Scope], list[Job]]
    work: Callable[[Job], Result]
    chapter: Callable[[Results, Scope], Chapter]
    needs: Sequence[str] = field(default=())


def decided(whole: bool, part: bool = False) -> Outcome:
    """The outcome of a claim: ``whole``, else ``part``, else not at all."""
    return "holds" if whole else "holds in part" if part else "does not hold"
