"""``mavsentry bench detect``: the smallest faults found, per airframe, configuration and axis."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from monitor.commands import completing
from monitor.commands.common import Profile, Refused, console, load_settings, note, progress

if TYPE_CHECKING:
    from monitor.commands.bench_detect.campaign import Group, Plan
    from monitor.settings import Settings

__all__ = ["detect"]

SCHEMA = "mavsentry/detectability/1"
SYNTHETIC = ("small-uav", "light-aircraft", "transport")


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is done.

    Attributes
    ----------
    trials
        Per size.
    flights, minutes
        Synthetic flights per class, and their time between take-off and landing.
    classes
        Airframe classes flown.
    """

    trials: int
    flights: int
    minutes: float
    classes: tuple[str, ...]


FULL = Effort(trials=20, flights=6, minutes=6.0, classes=SYNTHETIC)
QUICK = Effort(trials=4, flights=2, minutes=3.0, classes=("small-uav",))


def detect(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[LOG...]",
            help="Healthy recorded flights (.tlog), several of each airframe; those of one folder "
            "are taken for one airframe.",
            autocompletion=completing.logs,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write DIR/detectability.md and DIR/detectability.svg."),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all numbers here.")
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="A rough table of small-uav and the logs: few trials, four axes of an IMU.",
        ),
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this class or folder; may be given several times."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, metavar="N", help="Processes.")] = 2,
    seed: Annotated[int, typer.Option(metavar="N", help="Of flights and moments.")] = 1,
    profile: Profile = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Keep finished parts in this file, and take up those that it has already.",
        ),
    ] = None,
) -> None:
    """Find the smallest step and ramp of each sensor that is found within 10, 30 and 60 s.

    Faults are injected into synthetic and recorded flights. PROFILE is for the recorded ones.
    """
    from estimators.jit import is_cold
    from monitor.commands.bench_detect.campaign import Kept, Plan, parts_of, run_all
    from monitor.warmup import COMPILING, warm_up

    began_s = time.monotonic()
    effort = QUICK if quick else FULL
    settings = load_settings(profile, None)
    folders = _folders(logs or [])
    classes = _chosen(effort.classes, list(folders), only)
    kept = Kept(keep)
    if is_cold():
        note(COMPILING)
    warm_up(settings)
    plan = Plan(effort.trials, seed, quick=quick)
    with tempfile.TemporaryDirectory(prefix="mavsentry-detect-") as folder:
        groups: list[Group] = []
        with progress("flying") as tell:
            groups += _synthetic(classes, effort, plan, Path(folder), jobs, tell)
        with progress("reading") as tell:
            chosen = {name: own for name, own in folders.items() if not only or name in only}
            groups += _recorded(chosen, settings, plan, Path(folder), tell)
        with progress("breaking sensors") as tell:
            results = run_all(parts_of(groups, plan), jobs, kept, tell)
    document = _document(groups, results, plan, quick, jobs, time.monotonic() - began_s)
    document["command"] = _typed(logs or [], quick, only, seed, profile)
    _write(document, out, json_file)
    _show(document)


def _folders(logs: Sequence[Path]) -> dict[str, list[Path]]:
    """Folder name -> its logs.

    Raises
    ------
    Refused
        A file is not there, or given twice.
    """
    folders: dict[str, list[Path]] = {}
    for log in logs:
        if not log.is_file():
            raise Refused(f"cannot read {log}: no such file")
        own = folders.setdefault(log.resolve().parent.name or "recorded", [])
        if log in own:
            raise Refused(f"{log} is given twice")
        own.append(log)
    return folders


def _chosen(
    classes: Sequence[str], folders: Sequence[str], only: Sequence[str] | None
) -> list[str]:
    """Airframe classes to fly.

    Raises
    ------
    Refused
        A name that is neither a class nor a folder of the logs.
    """
    for name in only or ():
        if name not in SYNTHETIC and name not in folders:
            known = ", ".join([*SYNTHETIC, *folders])
            raise Refused(f"nothing to break is called {name}; known are {known}")
    return [name for name in (SYNTHETIC if only else classes) if not only or name in only]


def _synthetic(
    classes: Sequence[str],
    effort: Effort,
    plan: Plan,
    folder: Path,
    jobs: int,
    tell: Callable[[float], None],
) -> list[Group]:
    """Fly the synthetic flights."""
    from monitor.commands.bench_detect import flights
    from monitor.commands.bench_detect.campaign import Group
    from monitor.commands.bench_detect.configurations import fitting
    from monitor.commands.processes import each

    settings = {name: load_settings(name, None) for name in classes}
    orders = [
        flights.Order(
            name, plan.seed, k, effort.minutes, settings[name], folder / f"synthetic {name} {k}"
        )
        for name in classes
        for k in range(effort.flights)
    ]
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        tell(done / len(orders))

    for _ in each(flights.fly, orders, jobs, step):
        pass
    groups = []
    for name in classes:
        how = flights.CLASSES[name]
        files = [order.file for order in orders if order.name == name]
        configurations = fitting(
            how.pitots, 2, how.vanes, own_attitude=how.own_attitude, quick=plan.quick
        )
        groups.append(
            Group(
                name,
                recorded=False,
                profile=name,
                thresholds="thresholds of the bundled profile, none of them set on these flights",
                files=tuple(files),
                settings=(settings[name],) * len(files),
                configurations=tuple(configurations),
            )
        )
    return groups


def _recorded(
    folders: dict[str, list[Path]],
    settings: Settings,
    plan: Plan,
    folder: Path,
    tell: Callable[[float], None],
) -> list[Group]:
    """Decode the logs, and learn each one's thresholds from the others.

    Raises
    ------
    Refused
        A log cannot be read, or none of a folder is long enough for a trial.
    """
    from monitor.commands.bench_detect import flights
    from monitor.commands.bench_detect.campaign import WINDOWS_S, Group
    from monitor.commands.bench_detect.configurations import fitting
    from monitor.commands.bench_detect.leave_one_out import calibrated, leave_one_out

    groups = []
    for i, (name, logs) in enumerate(folders.items()):
        decoded = [flights.recorded(log, settings) for log in logs]
        if all(flight.duration_s < max(WINDOWS_S) for flight in decoded):
            longest_s = max(flight.duration_s for flight in decoded)
            raise Refused(
                f"no flight of {name} is long enough: a trial takes {max(WINDOWS_S):g} s of judged "
                f"flight, the longest log has {longest_s:.0f} s"
            )
        files = []
        for flight in decoded:
            files.append(folder / f"{name}-{flight.name}")
            flights.store(flight, files[-1])
        learnt, thresholds = leave_one_out(logs, settings, calibrated())
        own_attitude = settings.imu.attitude_independent
        counts = flights.instruments(decoded)
        configurations = fitting(*counts, own_attitude=own_attitude, quick=plan.quick)
        groups.append(
            Group(
                f"{name} logs" if name in SYNTHETIC else name,
                recorded=True,
                profile=settings.profile,
                thresholds=thresholds,
                files=tuple(files),
                settings=tuple(learnt),
                configurations=tuple(configurations),
            )
        )
        tell((i + 1) / len(folders))
    return groups


def _document(
    groups: Sequence[Group],
    results: Sequence[dict[str, Any]],
    plan: Plan,
    quick: bool,
    jobs: int,
    took_s: float,
) -> dict[str, Any]:
    """All numbers (docs/detectability.md says what they mean).

    Raises
    ------
    Refused
        No flight at all left time for a trial.
    """
    from importlib.metadata import version

    from monitor.commands.bench_detect.campaign import WINDOWS_S
    from monitor.commands.bench_detect.search import SHARE
    from monitor.commands.timing import machine

    if not any(result["cells"] for result in results):
        raise Refused(
            f"no flight leaves {max(WINDOWS_S):g} s after its sensors are judged: nothing to break"
        )
    return {
        "schema": SCHEMA,
        "version": version("mavsentry"),
        "machine": machine(),
        "seed": plan.seed,
        "trials": plan.trials,
        "share": SHARE,
        "windows_s": list(WINDOWS_S),
        "quick": quick,
        "jobs": jobs,
        "took_s": round(took_s, 1),
        "groups": [
            {
                "name": group.name,
                "recorded": group.recorded,
                "profile": group.profile,
                "thresholds": group.thresholds,
                "configurations": [
                    result
                    for configuration in group.configurations
                    for result in results
                    if (result["group"], result["configuration"])
                    == (group.name, configuration.name)
                ],
            }
            for group in groups
        ],
    }


def _typed(
    logs: Sequence[Path],
    quick: bool,
    only: Sequence[str] | None,
    seed: int,
    profile: str | None,
) -> str:
    """The command that gives the same numbers; logs by their names, without their folders."""
    words = ["mavsentry bench detect", *(log.name for log in logs)]
    words += ["--quick"] if quick else []
    words += [f"--only {name}" for name in only or ()]
    words += [f"--seed {seed}"]
    words += [f"--profile {profile}"] if profile else []
    return " ".join(words)


def _write(document: dict[str, Any], out: Path | None, json_file: Path | None) -> None:
    from monitor.commands.bench_detect.curves import picture
    from monitor.commands.bench_detect.markdown import PICTURE, page

    texts: dict[Path, str] = {}
    if json_file is not None:
        texts[json_file] = json.dumps(document, indent=1, allow_nan=False) + "\n"
    if out is not None:
        texts[out / "detectability.md"] = page(document)
        texts[out / PICTURE] = picture(document)
    for file, text in texts.items():
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            raise Refused(f"cannot write {file}: {error.strerror}") from None


def _show(document: dict[str, Any]) -> None:
    """The tables on the terminal."""
    from rich.table import Table

    from monitor.commands.bench_detect.table import alarm_rows, rows

    screen = console()
    windows = [f"{w:g} s" for w in document["windows_s"]]
    for group in document["groups"]:
        screen.print(f"{group['name']}: {group['thresholds']}", soft_wrap=True)
        found = list(rows(group))
        for name in dict.fromkeys(row.configuration for row in found):
            table = Table(title=name, title_justify="left", title_style="bold")
            table.add_column("named within", no_wrap=True)
            for column in (*windows, *(f"ramp {w}" for w in windows), "trials", "wrong", "first"):
                table.add_column(column, justify="right", no_wrap=True)
            for row in found:
                if row.configuration == name:
                    table.add_row(
                        f"{row.sensor} \\[{row.unit}]",
                        *(row.step or ("",) * len(windows)),
                        *(row.ramp or ("",) * len(windows)),
                        str(row.trials),
                        f"{row.wrong_axis}+{row.wrong_instrument}",
                        str(row.misled),
                    )
            screen.print(table)
    table = Table(title="healthy flights")
    for column in ("flights", "configuration"):
        table.add_column(column)
    for column in ("judged hours", "false alarms", "at most an hour (95 %)"):
        table.add_column(column, justify="right")
    for alarm in alarm_rows(document):
        table.add_row(
            alarm.group,
            alarm.configuration,
            f"{alarm.judged_h:.2f}",
            str(alarm.false),
            f"{alarm.upper_per_h:.2g}",
        )
    screen.print(table)
    screen.print(
        "ramps per minute; wrong: trials in which another axis + another instrument was blamed; "
        "first: before the right one, or alone",
        soft_wrap=True,
    )
