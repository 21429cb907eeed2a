"""``mavsentry analyze``: verdicts on recorded flights."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from monitor.commands import completing
from monitor.commands.common import (
    OUTPUT,
    WORK,
    ConfigFile,
    Profile,
    Refused,
    load_settings,
    note,
    progress,
)

if TYPE_CHECKING:
    from monitor.commands.workers import Tell
    from monitor.settings import Settings

__all__ = ["analyze"]

FAULT_FOUND, UNUSABLE = 1, 2

WORTH_BYTES: Final = 60_000_000
"""Fewer bytes are analyzed before further processes have loaded their kernels."""

OUT_OF_MEMORY_SIGNAL: Final = 9

ELSEWHERE: Final = "; --out names another folder"


@dataclass(frozen=True, slots=True)
class Task:
    """One log, and the folder that its files go to."""

    log: Path
    folder: Path
    settings: Settings
    csv: bool
    report: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one log.

    Attributes
    ----------
    summary
        ``summary.json``; None where the log could not be used.
    files
        What was written: ``summary.json`` first, then the report.
    why
        One sentence on why it could not be used, or why it has no report.
    unwritable
        The reason lies in the folder and not in the log.
    """

    summary: dict[str, Any] | None = None
    files: list[Path] = field(default_factory=list)
    why: str = ""
    unwritable: bool = False


def analyze(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Log files of flights.",
            autocompletion=completing.logs,
        ),
    ],
    profile: Profile = None,
    config: ConfigFile = None,
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Folder for DIR/<log stem>/.", rich_help_panel=OUTPUT),
    ] = Path("mavsentry-out"),
    csv: Annotated[
        bool,
        typer.Option("--csv", help="Write the estimates as CSV as well.", rich_help_panel=OUTPUT),
    ] = False,
    exit_code: Annotated[
        bool,
        typer.Option(
            "--exit-code", help="End with 1 when a fault was found.", rich_help_panel=OUTPUT
        ),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Logs at once; as many as cores by default.",
            rich_help_panel=WORK,
        ),
    ] = None,
    report: Annotated[
        bool,
        typer.Option(
            "--report/--no-report", help="Write DIR/<log stem>/report.html.", rich_help_panel=OUTPUT
        ),
    ] = True,
) -> None:
    """Say what was faulty in recorded flights, since when, and why.

    Of several logs all are processed; the status is 2 if one of them was unusable.
    """
    from estimators.jit import is_cold
    from monitor.analyze import MISSING_REPORT_EXTRA, have_report
    from monitor.commands.analysis_shown import show
    from monitor.doubts import about_flight
    from monitor.estimate_files import have_parquet
    from monitor.warmup import COMPILING, warm_up

    settings = load_settings(profile, config)
    logs = list({log.resolve(): log for log in reversed(logs)}.values())[::-1]
    folders = _folders(logs, out)
    able = have_report()
    tasks = [
        Task(*pair, settings, csv, report and able) for pair in zip(logs, folders, strict=True)
    ]
    jobs = min(jobs or _jobs(logs), len(logs))
    if is_cold():
        note(COMPILING)
        if jobs > 1:
            warm_up(settings)
    found = unusable = False
    for outcome in _outcomes(tasks, jobs):
        if outcome.unwritable:
            raise Refused(outcome.why)
        if outcome.summary is not None:
            doubts = about_flight(
                outcome.summary, settings.profile, settings.phase.flying_speed_m_s
            )
            show(outcome.summary, outcome.files, doubts)
            found = found or bool(outcome.summary["faults"])
        if outcome.why:
            note(f"mavsentry: {outcome.why}")
            unusable = True
    if not have_parquet() and not csv:
        note(f"mavsentry: summary.json only: {MISSING_REPORT_EXTRA}, --csv as text")
    elif report and not able:
        note(f"mavsentry: no report: {MISSING_REPORT_EXTRA}")
    if unusable:
        raise typer.Exit(UNUSABLE)
    if found and exit_code:
        raise typer.Exit(FAULT_FOUND)


def _outcomes(tasks: Sequence[Task], jobs: int) -> Iterator[Outcome]:
    """What became of each log, in their order, under a progress bar."""
    from monitor.commands.workers import Died, work

    total = max(sum(_size(task.log) for task in tasks), 1)
    name = tasks[0].log.name if len(tasks) == 1 else f"{len(tasks)} logs"
    with progress(name) as bar:
        results = work(_analyze, tasks, jobs, lambda done: bar(sum(done) / total))
        for k, (task, result) in enumerate(zip(tasks, results, strict=True), 1):
            with bar.hidden():
                if isinstance(result, Died):
                    yield Outcome(why=f"{task.log}: {_last_words(result.signal)}")
                else:
                    yield result
            if len(tasks) > 1:
                bar.name(f"{len(tasks)} logs, {k} done")


def _analyze(task: Task, tell: Tell) -> Outcome:
    """One log; whatever is wrong with it becomes a sentence."""
    from links.logs import LogError
    from monitor.analyze import ESTIMATES, analyze_into

    try:
        analysis = analyze_into(
            task.folder, task.log, task.settings, lambda done, _: tell(done), csv=task.csv
        )
    except LogError as error:
        return Outcome(why=str(error))
    except OSError as error:
        why = f"cannot write to {task.folder}: {error.strerror or error}{ELSEWHERE}"
        return Outcome(why=why, unwritable=True)
    except MemoryError:
        return Outcome(why=f"{task.log}: not enough memory; analyze fewer at once (--jobs 1)")
    except Exception as error:  # a mistake of ours must not cost the other logs
        return Outcome(why=f"{task.log}: {_mistake(error)}")
    why = ""
    if task.report:
        try:
            analysis.write_report(task.folder, task.folder / ESTIMATES)
        except OSError as error:
            why = f"cannot write to {task.folder}: {error.strerror or error}{ELSEWHERE}"
            return Outcome(why=why, unwritable=True)
        except Exception as error:  # nor the verdicts on this one
            why = f"{task.log} has no report: {_mistake(error)}"
    return Outcome(analysis.summary, analysis.files, why)


def _mistake(error: Exception) -> str:
    """An error that nobody foresaw, in one sentence, and where it happened."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    where = "" if trace is None else f" in {Path(trace.tb_frame.f_code.co_filename).name}"
    line = "" if trace is None else f", line {trace.tb_lineno}"
    said = " ".join(str(error).split())[:200]
    return f"mavsentry failed on it ({type(error).__name__}{where}{line}: {said}); please report it"


def _last_words(signal: int | None) -> str:
    if signal == OUT_OF_MEMORY_SIGNAL:
        return "the process that analyzed it was killed, perhaps for want of memory (--jobs 1?)"
    return "the process that analyzed it ended" + (f" by signal {signal}" if signal else "")


def _folders(logs: Sequence[Path], out: Path) -> list[Path]:
    """A folder for each log: named by its stem, where several share it by its whole name.

    Logs of one name in different folders are numbered in the order given.
    """
    stems = Counter(log.stem for log in logs)
    names = Counter(log.name for log in logs)
    taken: Counter[str] = Counter()
    folders = []
    for log in logs:
        name = log.stem if stems[log.stem] == 1 else log.name
        if names[log.name] > 1:
            taken[name] += 1
            name = f"{name}-{taken[name]}"
        folders.append(out / name)
    return folders


def _jobs(logs: Sequence[Path]) -> int:
    """Processes that are worth starting."""
    if len(logs) < 2 or sum(map(_size, logs)) < WORTH_BYTES:
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _size(log: Path) -> int:
    try:
        return log.stat().st_size
    except OSError:
        return 0
