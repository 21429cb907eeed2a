"""``mavsentry reproduce``: the tables and figures of the papers, by our estimators."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands.common import Refused, console, note, progress

if TYPE_CHECKING:
    from monitor.commands.reproduce.study import Chapter, Job, Paper, Table

__all__ = ["reproduce"]


class Which(StrEnum):
    """A paper, or all."""

    WAN2018 = "wan2018"
    WAN2016 = "wan2016"
    LU2016 = "lu2016"
    WANG2020 = "wang2020"
    SAMAR2006 = "samar2006"
    ALL = "all"


NEEDED = ("matplotlib", "jinja2")
MISSING = "{} is not installed; the papers need the extra: pip install 'mavsentry[reproduce]'"


def reproduce(
    which: Annotated[Which, typer.Argument(metavar="PAPER", help=", ".join(Which) + ".")],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where report.html, the tables and results go.")
    ],
    quick: Annotated[
        bool, typer.Option("--quick", help="A small version of each study, two minutes for all.")
    ] = False,
    flights: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Recorded flights for lu2016's open-loop method; without it that part is not run.",
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes; by default one a core.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Other draws of everything.")] = 0,
    redraw: Annotated[
        bool,
        typer.Option(
            "--redraw", help="Take up results in DIR that other code has made; the report says so."
        ),
    ] = False,
) -> None:
    """Rebuild the tables and figures of the papers the estimators come from.

    Prints our numbers beside the papers' and says where a claim holds, where not and why. What is
    finished stays in DIR: the same command continues after an interruption.
    """
    from importlib.metadata import version

    from estimators.jit import is_cold
    from monitor.commands.reproduce.engine import run_jobs
    from monitor.commands.reproduce.papers import KEYS
    from monitor.commands.reproduce.render import Stamp, write
    from monitor.commands.reproduce.store import Store, code_digest
    from monitor.commands.reproduce.study import Scope
    from monitor.warmup import COMPILING

    if flights is not None and not flights.is_dir():
        raise Refused(f"no such folder: {flights}")
    _writable(out)
    scope = Scope(quick=quick, seed=seed, flights=flights.resolve() if flights else None)
    papers = _papers(KEYS if which is Which.ALL else (which.value,))
    todo = [job for paper in papers.values() for job in paper.jobs(scope)]
    if is_cold():
        note(COMPILING)
    kept = Store(out / ("results-quick" if quick else "results"))
    try:
        with progress(f"reproducing {which.value}") as tell:
            done = run_jobs(_mixed(todo), kept, jobs or _cores(), tell, any_code=redraw)
    except KeyboardInterrupt:
        note(f"stopped; what is finished stays in {out}, and the same command continues")
        raise
    if done.taken:
        note(f"{done.taken} of {len(todo)} results were there already")
    try:
        chapters = {key: paper.chapter(done.results[key], scope) for key, paper in papers.items()}
    except Exception as error:
        if done.codes <= {code_digest()}:
            raise
        raise Refused(
            f"the results in {out} are of other code and lack what this version shows ({error!r}); "
            "without --redraw they are made anew"
        ) from None
    codes = tuple(sorted(done.codes))
    stamp = Stamp(version("mavsentry"), codes, seed, quick, done.seconds)
    try:
        page = write(chapters, stamp, out)
    except OSError as error:
        raise Refused(f"cannot write {out}: {error.strerror}") from None
    _print(chapters)
    console().print(f"{page}: {stamp.line()}", soft_wrap=True)


def _writable(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise Refused(f"cannot make {out}: {error.strerror}; --out names another folder") from None
    if not os.access(out, os.W_OK):
        raise Refused(f"cannot write into {out}: you may not; --out names another folder")


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _papers(keys: Sequence[str]) -> Mapping[str, Paper]:
    """The papers of these keys, if everything they need is installed."""
    from monitor.commands.reproduce.papers import paper_of

    papers = {}
    for need in NEEDED:
        _need(need)
    for key in keys:
        paper = paper_of(key)
        for need in paper.needs:
            _need(need)
        papers[key] = paper
    return papers


def _need(module: str) -> None:
    if importlib.util.find_spec(module) is None:
        raise Refused(MISSING.format(module))


def _mixed(jobs: Sequence[Job]) -> list[Job]:
    """Each paper's first jobs first: a paper's long ones are not left to the end."""
    place: dict[str, int] = {}
    ranked = []
    for job in jobs:
        place[job.paper] = place.get(job.paper, 0) + 1
        ranked.append((place[job.paper], job))
    return [job for _, job in sorted(ranked, key=lambda entry: entry[0])]


def _print(chapters: Mapping[str, Chapter]) -> None:
    """Each table that stands beside the paper's, and what became of the claims."""
    from rich.text import Text as Words

    from monitor.commands.reproduce.render import MARKS
    from monitor.commands.reproduce.study import Table

    out = console()
    for chapter in chapters.values():
        out.rule(Words(chapter.title), align="left")
        for block in chapter.blocks:
            if isinstance(block, Table) and any("paper" in column for column in block.columns):
                _print_table(block)
        for claim in chapter.claims:
            out.print(Words(f"{MARKS[claim.outcome]} {claim.outcome}: {claim.statement}"))
            out.print(Words(f"    {claim.because}"))
        out.print()


def _print_table(table: Table) -> None:
    """The numbers as a grid; the reasons below it, once each, where they would squeeze it."""
    from rich import box
    from rich.table import Table as Grid
    from rich.text import Text as Words

    from monitor.commands.reproduce.render import shown

    out = console()
    reasons: dict[str, str] = {}
    last = len(table.columns) - 1 if table.columns[-1].startswith("why") else len(table.columns)
    grid = Grid(title=Words(table.caption), title_justify="left", box=box.SIMPLE_HEAD)
    for column in table.columns[:last]:
        grid.add_column(Words(column))  # as it is: "[kt]" is a unit, not a style
    noted = last < len(table.columns)
    if noted:
        grid.add_column("")
    for row in table.rows:
        cells = [shown(cell, table.digits) for cell in row[:last]]
        if noted:
            why = row[last]
            mark = "" if why is None else reasons.setdefault(str(why), f"[{len(reasons) + 1}]")
            cells.append(mark)
        grid.add_row(*(Words(cell) for cell in cells))
    out.print(grid)
    for why, mark in reasons.items():
        out.print(Words(f"  {mark} {why}"))
    out.print()
