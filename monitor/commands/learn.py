"""``mavsentry learn``: what an airframe's own healthy flights say about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands import completing
from monitor.commands.common import (
    WORK,
    ConfigFile,
    Profile,
    Refused,
    console,
    note,
    progress,
)
from monitor.commands.helping import App

if TYPE_CHECKING:
    from monitor.fleet.sources import Source
    from monitor.learn import Calibration, Change, Flight, Trial
    from monitor.learn.airframe import AirframeLearnt
    from monitor.learn.engine import EngineLearnt

__all__ = ["app"]

app = App(help="Learn settings from healthy flights.")


@app.command()
def thresholds(
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG...",
            autocompletion=completing.logs,
            help="Healthy flights of one airframe: files, folders, patterns, fsspec URLs.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="File to write.")],
    profile: Profile = None,
    config: ConfigFile = None,
    airframe: Annotated[str, typer.Option(metavar="NAME", help="Whose thresholds these are.")] = "",
    assert_healthy: Annotated[
        bool,
        typer.Option(
            "--assert-healthy",
            help="The flights are healthy, whatever the thresholds in force say of them.",
        ),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "--workers",
            min=1,
            metavar="N",
            help="Processes here; by default the cores, if there is much to read.",
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
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Fit thresholds to an airframe from its healthy flights.

    Needs 3 flights and 10 judged minutes of each sensor; lowers a threshold only on 5 flights and
    an hour. One flight in ten that is not healthy is left out and named.
    """
    from links.logs import LogError
    from monitor.fleet.engine import Died, EngineError, open_engine
    from monitor.fleet.probe import check_same_code
    from monitor.fleet.sources import SourceError
    from monitor.learn import Unfit, calibrate, document, flagged_by_the_others
    from monitor.learn.runs import logs_of, measure_logs
    from monitor.settings import SettingsError, by_hand

    try:
        settings, hand = by_hand(profile, config)
        sources = logs_of(logs)
    except (SettingsError, SourceError) as error:
        raise Refused(str(error)) from None
    if out.exists() and not force:
        raise Refused(f"{out} is there already; --force overwrites it")
    if scheduler is not None and jobs is not None:
        raise Refused("--jobs are processes here; a cluster has the workers that it has")

    def measure(trials: Sequence[Trial], doing: str) -> list[Flight]:
        with progress(doing) as tell:
            return measure_logs(working, [(sources[k], tried) for k, tried in trials], tell)

    try:
        with open_engine(_workers(sources, jobs, scheduler), scheduler) as working:
            check_same_code(working)
            calibration = calibrate(
                measure, len(sources), settings, airframe, assert_healthy=assert_healthy
            )
            calibration = flagged_by_the_others(measure, calibration)
    except (Unfit, LogError, EngineError, Died) as error:
        raise Refused(str(error)) from None
    except OSError as error:
        raise Refused(f"cannot read {error.filename or 'a log'}: {error.strerror}") from None
    try:
        out.write_text(document(calibration, hand), encoding="utf-8")
    except OSError as error:
        raise Refused(f"cannot write {out}: {error.strerror}") from None
    _show(calibration, out)


def _workers(sources: Sequence[Source], asked: int | None, scheduler: str | None) -> int | None:
    """Processes that are worth their start: none for little, and none without the extra."""
    from importlib.util import find_spec

    from estimators.jit import is_cold
    from monitor.learn.runs import WORTH_BYTES
    from monitor.warmup import COMPILING

    if scheduler is not None or asked is not None:
        return asked
    if is_cold():
        note(COMPILING)
        return 0
    little = len(sources) < 2 or sum(s.bytes for s in sources) < WORTH_BYTES
    return 0 if little or find_spec("distributed") is None else None


@app.command()
def engine(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            autocompletion=completing.logs,
            help="Healthy flights of one airframe.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="File to write.")],
    profile: Profile = None,
    config: ConfigFile = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Fit the engine model of a piston or electric aircraft to its healthy flights.

    Speed follows throttle and airspeed. The file of --config is carried along; where it says which
    channel measures which shaft, that stands.
    """
    import tomllib

    from links.logs import LogError
    from monitor.learn.engine import learn_engine, measure_engine
    from monitor.learn.engine_document import engine_document
    from monitor.learn.fit import Unfit
    from monitor.settings import SettingsError, load

    try:
        settings = load(profile, config)
    except SettingsError as error:
        raise Refused(str(error)) from None
    if out.exists() and not force:
        raise Refused(f"{out} is there already; --force overwrites it")
    carried = tomllib.loads(config.read_text("utf-8")) if config is not None else {}
    try:
        flights = []
        with progress("engine speeds") as tell:
            for k, log in enumerate(logs):
                flights.append(
                    measure_engine(
                        log,
                        settings,
                        lambda done, of, k=k: tell((k + done / max(of, 1)) / len(logs)),  # type: ignore[misc]
                    )
                )
        learnt = learn_engine(flights, settings)
    except (Unfit, LogError) as error:
        raise Refused(str(error)) from None
    try:
        out.write_text(
            engine_document(learnt, {"profile": settings.profile} | carried), encoding="utf-8"
        )
    except OSError as error:
        raise Refused(f"cannot write {out}: {error.strerror}") from None
    _show_engine(learnt, out)


@app.command()
def airframe(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            autocompletion=completing.logs,
            help="Healthy flights of one airframe.",
        ),
    ],
    start: Annotated[
        str,
        typer.Option(
            metavar="FILE.toml",
            autocompletion=completing.airframes,
            help="Airframe to start from, or a bundled name.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="File to write.")],
    profile: Profile = None,
    config: ConfigFile = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Refine the coefficients of an airframe that healthy flights can tell.

    The others keep their value, and are named. The file of --config says how servos move surfaces.
    """
    from links.logs import LogError
    from monitor.learn.airframe import airframe_document, learn_airframe, measure_airframe
    from monitor.learn.fit import Unfit
    from monitor.settings import SettingsError, load
    from monitor.settings.wing import airframe_of

    try:
        settings = load(profile, config)
        settings = settings.model_copy(
            update={"wing": settings.wing.model_copy(update={"airframe": start})}
        )
        airframe_of(settings.wing)
    except (SettingsError, ValueError) as error:
        raise Refused(str(error)) from None
    if out.exists() and not force:
        raise Refused(f"{out} is there already; --force overwrites it")
    try:
        with progress("airframe") as tell:
            flights = [
                measure_airframe(
                    log,
                    settings,
                    lambda done, of, k=k: tell((k + done / max(of, 1)) / len(logs)),  # type: ignore[misc]
                )
                for k, log in enumerate(logs)
            ]
        learnt = learn_airframe(flights, settings)
    except (Unfit, LogError) as error:
        raise Refused(str(error)) from None
    try:
        out.write_text(airframe_document(learnt, out.stem), encoding="utf-8")
    except OSError as error:
        raise Refused(f"cannot write {out}: {error.strerror}") from None
    _show_airframe(learnt, out)


def _show_airframe(learnt: AirframeLearnt, out: Path) -> None:
    """What was identified, what was not, and whether it can be trusted."""
    from monitor.learn.airframe import doubt

    fit, screen = learnt.fit, console()
    screen.print(
        f"{len(learnt.flights)} flights, {learnt.seconds / 60.0:.1f} min in the air; residuals "
        f"{fit.scatter[0]:.2f} before, {fit.scatter[1]:.2f} after (1: what gusts explain)",
        soft_wrap=True,
    )
    for name in fit.identified:
        was, now = getattr(learnt.start.airframe, name), getattr(fit.airframe, name)
        screen.print(f"  {name}: {was:g} -> {now:.4g}")
    kept = ", ".join(fit.kept) or "none"
    screen.print(f"not identified, kept: {kept}", soft_wrap=True)
    lift, drag = (max(learnt.healthy_percent[i::2]) for i in range(2))
    screen.print(
        f"largest difference between the wings in these flights: lift {lift:.1f} %, drag "
        f"{drag:.1f} %",
        soft_wrap=True,
    )
    screen.print(f'wrote {out}: use it with \\[wing] airframe = "{out}"', soft_wrap=True)
    if why := doubt(learnt):
        screen.print(f"[bold]warning[/]: {why}", soft_wrap=True)


def _show_engine(learnt: EngineLearnt, out: Path) -> None:
    """The model in a few lines."""
    fit, screen = learnt.fit, console()
    screen.print(
        f"{len(learnt.flights)} flights, {learnt.seconds / 60.0:.1f} min in the air: throttle and "
        f"airspeed explain {100.0 * fit.explained:.1f} % of the engine speed, time constant "
        f"{fit.time_constant_s:.2g} s, error {fit.rms_rpm:.3g} rpm",
        soft_wrap=True,
    )
    if not math.isnan(fit.crossed_rpm):
        screen.print(f"on flights left out of the fit: error {fit.crossed_rpm:.3g} rpm")
    for sensor, channel in learnt.channels.items():
        screen.print(
            f"  {sensor}: shaft {channel.shaft}, range {channel.range_rpm:.0f} rpm, noise "
            f"{channel.noise_rpm:.3g} rpm"
        )
    if learnt.alike:
        screen.print(
            f"  {' and '.join(learnt.alike)} read the same: taken for channels of one shaft",
            soft_wrap=True,
        )
    screen.print(f"wrote {out}: use it with --config {out}", soft_wrap=True)


def _show(calibration: Calibration, out: Path) -> None:
    """What was learnt as a table, what it rests on, what it promises."""
    from rich.markup import escape
    from rich.table import Table

    from monitor.learn.document import crossed_sentence

    screen, learnt, flights = console(), calibration.learnt, len(calibration.numbers)
    table = Table()
    table.add_column("key", no_wrap=True)
    for column in ("default", "learnt", "healthy max"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("from")
    table.add_column("without it", justify="right", no_wrap=True)
    table.add_column("beyond", justify="right", no_wrap=True)
    table.add_column("so")
    kept: dict[str, list[str]] = {}
    for change in learnt.changes:
        if change.value == change.default:
            kept.setdefault(change.outcome.value, []).append(change.key)
            continue
        table.add_row(
            change.key,
            f"{change.default:g}",
            f"{change.value:g}",
            f"{change.peak:.3g}",
            escape(change.log),
            f"{change.without:g}" if change.loudest >= 0 else "",
            f"{change.beyond} of {change.flights}",
            _effect(change),
        )
    if table.row_count:
        screen.print(table)
    for why, keys in kept.items():
        screen.print(f"{why}: {', '.join(keys)}", soft_wrap=True)
    for left in calibration.left_out:
        screen.print(escape(f"left out, not healthy: {left.name}: {left.why}"), soft_wrap=True)
    screen.print(
        f"Flights with a verdict: {calibration.flagged} of {flights} by the defaults, none by what "
        f"was learnt. {escape(crossed_sentence(calibration))}",
        soft_wrap=True,
    )
    screen.print(_promise(calibration), soft_wrap=True)
    screen.print(f"wrote {out}: use it with --config {out}", soft_wrap=True)


def _promise(calibration: Calibration) -> str:
    """How many false alarms the silence of these flights still allows."""
    hours, left_out = calibration.learnt.hours, len(calibration.left_out)
    said = (
        f"{len(calibration.numbers)} flights, {hours:.2f} h judged, nothing found in them with "
        "these thresholds. If the flights to come are like them, false alarms are at most "
        f"{3.0 / hours:.2g} an hour (95 %: 3 / {hours:.2f} h)"
    )
    if left_out:
        what = "the flight that was left out was" if left_out == 1 else "those left out were"
        said += f"; more if {what} healthy"
    return said + "."


def _effect(change: Change) -> str:
    """What a change does to the monitor, in a few words."""
    from monitor.learn.rules import Kind

    outcome = change.outcome.value
    if change.kind is Kind.LEVEL:
        return f"{outcome}: the aircraft is noisier"
    if change.kind is Kind.REFERENCE:
        return f"{outcome}: a worse reference is believed"
    percent = round(100.0 * (change.fault_growth - 1.0))
    if percent == 0:
        return outcome
    return f"{outcome}: finds faults {abs(percent)} % {'larger' if percent > 0 else 'smaller'}"
