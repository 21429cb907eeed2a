"""``mavsentry learn``: what an airframe's own healthy flights say about it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands.common import ConfigFile, Profile, Refused, console, note, progress

if TYPE_CHECKING:
    from monitor.learn import Change, Flight, Learnt
    from monitor.learn.airframe import AirframeLearnt
    from monitor.learn.engine import EngineLearnt
    from monitor.settings import Settings

__all__ = ["app"]

app = typer.Typer(help="Learn settings from healthy flights.", no_args_is_help=False)


@app.callback(invoke_without_command=True)
def _group(context: typer.Context) -> None:
    """Learn settings from healthy flights."""
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit


@app.command()
def thresholds(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Healthy flights of one airframe.")
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
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Fit thresholds to an airframe from its healthy flights.

    Needs 3 flights and 10 judged minutes of each sensor; lowers a threshold only on 5 flights and
    an hour. Example: mavsentry learn thresholds healthy/*.tlog --out ranger.toml --airframe ranger
    """
    from estimators.jit import is_cold
    from links.logs import LogError
    from monitor.learn import Unfit, calibrate, document
    from monitor.learn.runs import measure_logs
    from monitor.settings import SettingsError, by_hand
    from monitor.warmup import COMPILING

    try:
        settings, hand = by_hand(profile, config)
    except SettingsError as error:
        raise Refused(str(error)) from None
    if out.exists() and not force:
        raise Refused(f"{out} is there already; --force overwrites it")
    if is_cold():
        note(COMPILING)

    def measure(tried: Settings, doing: str) -> list[Flight]:
        with progress(doing) as tell:
            return measure_logs(logs, tried, tell)

    try:
        learnt = calibrate(measure, settings, airframe, assert_healthy=assert_healthy)
    except (Unfit, LogError) as error:
        raise Refused(str(error)) from None
    try:
        out.write_text(document(learnt, hand), encoding="utf-8")
    except OSError as error:
        raise Refused(f"cannot write {out}: {error.strerror}") from None
    _show(learnt, len(logs), out)


@app.command()
def engine(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Healthy flights of one airframe.")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="File to write.")],
    profile: Profile = None,
    config: ConfigFile = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Fit the engine model of a piston or electric aircraft to its healthy flights.

    Speed follows throttle and airspeed. The file of --config is carried along; where it says which
    channel measures which shaft, that stands. Example: mavsentry learn engine healthy/*.tlog --out
    engine.toml
    """
    import tomllib

    from links.logs import LogError
    from monitor.learn.engine import learn_engine, measure_engine
    from monitor.learn.engine_document import engine_document
    from monitor.learn.thresholds import Unfit
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
        list[Path], typer.Argument(metavar="LOG...", help="Healthy flights of one airframe.")
    ],
    start: Annotated[
        str, typer.Option(metavar="FILE.toml", help="Airframe to start from, or a bundled name.")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="File to write.")],
    profile: Profile = None,
    config: ConfigFile = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Refine the coefficients of an airframe that healthy flights can tell.

    The others keep their value, and are named. The file of --config says how servos move surfaces.
    Example: mavsentry learn airframe healthy/*.tlog --start aerosonde --out mine.toml
    """
    from links.logs import LogError
    from monitor.learn.airframe import airframe_document, learn_airframe, measure_airframe
    from monitor.learn.thresholds import Unfit
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


def _show(learnt: Learnt, flights: int, out: Path) -> None:
    """What was learnt as a table, what it rests on, what it promises."""
    from rich.table import Table

    screen = console()
    table = Table()
    table.add_column("key", no_wrap=True)
    for column in ("default", "learnt", "healthy max"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("from")
    table.add_column("so")
    for change in learnt.changes:
        moved = change.value != change.default
        table.add_row(
            change.key,
            f"{change.default:g}",
            f"{change.value:g}" if moved else "",
            "" if math.isnan(change.peak) else f"{change.peak:.3g}",
            change.log,
            _effect(change),
        )
    screen.print(table)
    screen.print(
        f"{flights} flights, {learnt.hours:.2f} h judged, nothing found in them with these "
        f"thresholds. If the flights to come are like them, false alarms are at most "
        f"{3.0 / learnt.hours:.2g} an hour (95 %: 3 / {learnt.hours:.2f} h).",
        soft_wrap=True,
    )
    screen.print(f"wrote {out}: use it with --config {out}", soft_wrap=True)


def _effect(change: Change) -> str:
    """What a change does to the monitor, in a few words."""
    from monitor.learn.rules import Kind

    outcome = change.outcome.value
    if change.value == change.default:
        return outcome
    if change.kind is Kind.LEVEL:
        return f"{outcome}: the aircraft is noisier"
    if change.kind is Kind.REFERENCE:
        return f"{outcome}: a worse reference is believed"
    percent = round(100.0 * (change.fault_growth - 1.0))
    if percent == 0:
        return outcome
    return f"{outcome}: finds faults {abs(percent)} % {'larger' if percent > 0 else 'smaller'}"
