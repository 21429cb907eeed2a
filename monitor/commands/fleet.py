"""``mavsentry fleet``: an archive of logs to one dataset and one page."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from monitor.commands import completing
from monitor.commands.common import (
    OUTPUT,
    WORK,
    ConfigFile,
    Profile,
    Refused,
    console,
    load_settings,
    note,
    progress,
)
from monitor.fleet.reports import Reports

if TYPE_CHECKING:
    from monitor.fleet.dataset import Tables
    from monitor.fleet.runner import Account
    from monitor.fleet.sources import Source
    from monitor.fleet.tables import AircraftRule
    from monitor.fleet.task import Plan
    from monitor.settings import Settings

__all__ = ["fleet"]

FAULT_FOUND, UNUSABLE = 1, 2

PACKAGES: Final = ("dask", "distributed", "fsspec", "pyarrow", "jinja2")
REASONS: Final = 5
"""Reasons why logs were not judged that are said."""


def fleet(
    patterns: Annotated[
        list[str],
        typer.Argument(
            metavar="PATTERN...",
            help="Logs, folders, patterns such as 'flights/**/*.tlog', or URLs of these.",
            autocompletion=completing.logs,
        ),
    ],
    out: Annotated[
        str,
        typer.Option(
            metavar="DIR",
            help="Folder or URL of dataset, reports and page.",
            rich_help_panel=OUTPUT,
        ),
    ],
    profile: Profile = None,
    config: ConfigFile = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "--workers",
            min=1,
            metavar="N",
            help="Processes here; by default the cores.",
            rich_help_panel=WORK,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Dask scheduler to use, such as tcp://host:8786.",
            rich_help_panel=WORK,
        ),
    ] = None,
    aircraft: Annotated[
        str | None,
        typer.Option(
            metavar="REGEX",
            help="Finds the aircraft in a log's path; by default its folder and system id.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    retries: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Tries more for a log that cannot be read.",
            rich_help_panel=WORK,
        ),
    ] = 2,
    limit_s: Annotated[
        float,
        typer.Option(
            min=1.0, metavar="S", help="Longest time for one log, seconds.", rich_help_panel=WORK
        ),
    ] = 3600.0,
    estimates: Annotated[
        bool,
        typer.Option(
            "--estimates", help="Write the estimates of each log as well.", rich_help_panel=OUTPUT
        ),
    ] = False,
    reports: Annotated[
        Reports,
        typer.Option(
            metavar="none|found|all",
            help="Write report.html of no log, of those with findings, or of all.",
            rich_help_panel=OUTPUT,
        ),
    ] = Reports.NONE,
    again: Annotated[
        bool,
        typer.Option(
            "--again", help="Analyze logs whose outcome is known, too.", rich_help_panel=WORK
        ),
    ] = False,
    exit_code: Annotated[
        bool,
        typer.Option(
            "--exit-code", help="End with 1 when a fault was found.", rich_help_panel=OUTPUT
        ),
    ] = False,
) -> None:
    """Analyze an archive of logs on many processes: one dataset, one page.

    A log is analyzed once: the next call goes on where this one ended, and takes up what is new or
    changed. A log that cannot be judged is a row with the reason; the status is then 2.
    """
    _refuse_without_extra(reports)
    from monitor.fleet.dataset import DatasetError, load
    from monitor.fleet.places import Place
    from monitor.fleet.sources import SourceError, expand, is_url
    from monitor.fleet.tables import AircraftRule
    from monitor.fleet.task import make_plan

    if scheduler is not None and jobs is not None:
        raise Refused("--jobs are processes here; a cluster has the workers that it has")
    settings = load_settings(profile, config)
    out = out if is_url(out) else str(Path(out).absolute())
    try:
        rule = AircraftRule(aircraft)
        old = load(Place(out))
        with progress("looking for logs"):
            sources = expand(patterns)
    except (SourceError, DatasetError, ValueError) as error:
        raise Refused(str(error)) from None
    except ImportError as error:
        raise Refused(f"{out} needs one more package: {error}") from None
    except OSError as error:
        raise Refused(f"cannot read {out}: {error.strerror or error}") from None
    plan = make_plan(
        settings, out, limit_s=limit_s, estimates=estimates, reports=reports, again=again
    )
    account = _judged(sources, plan, old, rule, settings, jobs, scheduler, retries)
    _show(account, out)
    if sum(account.reasons.values()):
        raise typer.Exit(UNUSABLE)
    if account.faults and exit_code:
        raise typer.Exit(FAULT_FOUND)


def _refuse_without_extra(reports: Reports) -> None:
    from monitor.analyze import have_report

    missing = [package for package in PACKAGES if find_spec(package) is None]
    if missing:
        raise Refused(
            f"fleet needs packages that are not installed ({', '.join(missing)}): "
            "pip install 'mavsentry[fleet]'"
        )
    if reports != Reports.NONE and not have_report():
        raise Refused("--reports needs one more extra: pip install 'mavsentry[fleet,report]'")


def _judged(
    sources: list[Source],
    plan: Plan,
    old: Tables,
    rule: AircraftRule,
    settings: Settings,
    jobs: int | None,
    scheduler: str | None,
    retries: int,
) -> Account:
    """Every log judged, under a progress bar."""
    from monitor.fleet.engine import EngineError, open_engine
    from monitor.fleet.probe import check_workers
    from monitor.fleet.runner import judge_all, left

    todo = len(left(sources, plan, old))
    if todo and scheduler is None:
        _compile(settings)
    # A cluster is started only if there is something to do.
    where = (jobs, scheduler) if todo else (0, None)
    try:
        with progress(_count(len(sources))) as bar, open_engine(*where, tasks=todo) as engine:
            check_workers(engine, plan.out)
            tell = _teller(bar, bar.name)
            return judge_all(engine, sources, plan, old, rule, retries=retries, tell=tell)
    except EngineError as error:
        raise Refused(str(error)) from None
    except OSError as error:
        raise Refused(
            f"cannot write to {plan.out}: {error.strerror or error}; --out names another"
        ) from None


def _compile(settings: Settings) -> None:
    """Kernels of this code that were never compiled are compiled once, not by every worker."""
    from estimators.jit import cache_root, is_cold
    from monitor.fleet.task import code_version
    from monitor.warmup import COMPILING, warm_up

    mark = cache_root() / f"warm-{code_version()}"
    if mark.exists():
        return
    if is_cold():
        note(COMPILING)
    warm_up(settings)
    with suppress(OSError):
        mark.touch()


def _teller(bar: Callable[[float], None], name: Callable[[str], None]) -> Callable[[Account], None]:
    def tell(account: Account) -> None:
        bar(account.done / max(account.logs, 1))
        failed = sum(account.reasons.values())
        without = f", {failed} not judged" if failed else ""
        name(f"{account.done} of {_count(account.logs)}{without}")

    return tell


def _count(logs: int) -> str:
    return "1 log" if logs == 1 else f"{logs} logs"


def _show(account: Account, out: str) -> None:
    """What the run did, and where its results are."""
    from monitor.fleet.page import PAGE

    screen = console()
    words = [f"{count} {status}" for status, count in sorted(account.by_status.items())]
    known = f" ({account.known} known before)" if account.known else ""
    screen.print(
        f"{_count(account.logs)}{known}: {', '.join(words)}; "
        f"{account.faults} faults in {_count(account.faulty)}",
        soft_wrap=True,
    )
    for reason, count in account.reasons.most_common(REASONS):
        screen.print(f"  {count} x {reason}", soft_wrap=True, markup=False)
    if len(account.reasons) > REASONS:
        screen.print(f"  and {len(account.reasons) - REASONS} other reasons")
    for name in (PAGE, "dataset/"):
        screen.print(f"  {out.rstrip('/')}/{name}", soft_wrap=True, markup=False)
