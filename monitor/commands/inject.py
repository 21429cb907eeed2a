"""``mavsentry inject``: break the sensors of a recorded flight, on paper."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands import completing
from monitor.commands.common import ConfigFile, Refused, console, load_settings, progress

if TYPE_CHECKING:
    from links.logs import LogInfo
    from links.mavlink.options import DecoderOptions
    from links.mavlink.patch import StreamPatcher
    from sim_feeds.injection import Injection
    from sim_feeds.injection_frames import FrameInjector
    from sim_feeds.injection_survey import Survey

__all__ = ["inject", "inject_log"]

CHUNK_BYTES = 1 << 20
READING_SHARE = 0.5
"""Share of the work that the first reading of the log is."""

Tell = Callable[[float], None]


def _show_example(asked: bool) -> None:
    if asked:
        from sim_feeds.injection import EXAMPLE

        print(EXAMPLE, end="")
        raise typer.Exit


def inject(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG", help="Telemetry log (.tlog).", autocompletion=completing.logs
        ),
    ],
    faults: Annotated[
        Path,
        typer.Argument(
            metavar="FAULTS.toml",
            help="What breaks, and when.",
            autocompletion=completing.settings_files,
        ),
    ],
    to: Annotated[Path, typer.Option("--to", metavar="OUT.tlog", help="The log to write.")],
    seed: Annotated[int, typer.Option(min=0, help="Of the noise.", metavar="N")] = 0,
    config: ConfigFile = None,
    example: Annotated[
        bool,
        typer.Option(
            "--example",
            callback=_show_example,
            is_eager=True,
            help="Print an example of FAULTS.toml and leave.",
        ),
    ] = False,
) -> None:
    """Write a recorded flight anew as if some of its sensors had been broken.

    The aircraft flies as it flew: nothing steers on the faulty readings. The fields of the
    sensors' messages are changed; every other byte, and the times, stay.
    """
    settings = load_settings(None, config)
    _check_output(log, to)
    injection = _injection(faults)
    with progress(f"injecting into {log.name}") as tell:
        done = inject_log(log, injection, to, seed, settings.links.decoder_options(), tell)
    _show(done, injection, to)


@dataclass(frozen=True, slots=True)
class _Done:
    info: LogInfo
    survey: Survey
    injector: FrameInjector


def inject_log(
    log: Path,
    injection: Injection,
    to: Path,
    seed: int = 0,
    options: DecoderOptions | None = None,
    tell: Tell = lambda fraction: None,
) -> _Done:
    """Write the log with the faults in it.

    Raises
    ------
    Refused
        The log cannot be used, a fault does not fit it, or the output cannot be written.
    """
    from links.mavlink.patch import StreamPatcher
    from sim_feeds.injection_frames import FrameInjector
    from sim_feeds.section import ScenarioError

    info, survey = _read(log, options, tell)
    try:
        survey.check(injection, info.duration_s)
    except ScenarioError as error:
        raise Refused(str(error)) from None
    injector = FrameInjector(
        injection, seed, info.first_t_us, options, info.vehicle.autopilot, survey.left
    )
    _copy(log, to, StreamPatcher(injector.change, options), tell)
    return _Done(info, survey, injector)


def _injection(faults: Path) -> Injection:
    from sim_feeds.injection import load_injection
    from sim_feeds.section import ScenarioError

    try:
        return load_injection(faults)
    except ScenarioError as error:
        raise Refused(str(error).replace("\n", "; ")) from None


def _check_output(log: Path, to: Path) -> None:
    if to.is_dir():
        raise Refused(f"cannot write {to}: it is a directory")
    if to.suffix.lower() != ".tlog":
        raise Refused(f"the output is a telemetry log and must be called .tlog, unlike {to}")
    if to.exists() and log.exists() and to.samefile(log):
        raise Refused(f"{log} cannot be read and written at once: give --to another name")


def _read(log: Path, options: DecoderOptions | None, tell: Tell) -> tuple[LogInfo, Survey]:
    """What the log is and carries.

    Raises
    ------
    Refused
        It cannot be read, or is no telemetry log.
    """
    from links.logs import LogError, TlogReader, open_log
    from sim_feeds.injection_survey import Survey

    survey = Survey(options)
    try:
        reader = open_log(log, options)
        if not isinstance(reader, TlogReader):
            raise Refused(f"faults are injected into telemetry logs (.tlog) only: {log} is none")
        for _ in reader:
            survey.note(*reader.decoder.timed)
            tell(READING_SHARE * reader.info.bytes_read / max(reader.info.bytes, 1))
    except LogError as error:
        raise Refused(str(error)) from None
    return reader.info, survey


def _copy(log: Path, to: Path, patcher: StreamPatcher, tell: Tell) -> None:
    """Write the patched log beside its place, then move it there: never half a file.

    Raises
    ------
    Refused
        The log cannot be read again, or the output not be written.
    """
    size, part = max(log.stat().st_size, 1), to.with_name(f"{to.name}.part")
    try:
        with open(log, "rb") as source, open(part, "wb") as target:
            while data := source.read(CHUNK_BYTES):
                target.write(patcher.feed(data))
                tell(READING_SHARE + (1.0 - READING_SHARE) * source.tell() / size)
            target.write(patcher.finish())
        os.replace(part, to)
    except OSError as error:
        raise Refused(f"cannot write {to}: {error.strerror or error}") from None
    finally:
        part.unlink(missing_ok=True)


def _show(done: _Done, injection: Injection, to: Path) -> None:
    """What was changed as a table, what was not as sentences, the file."""
    from rich.table import Table

    screen = console()
    screen.print(
        f"{done.info.path}: {done.info.duration_s:.0f} s, {len(injection.faults)} fault(s)",
        soft_wrap=True,
    )
    table = Table()
    for column in ("sensor", "message"):
        table.add_column(column, no_wrap=True)
    for column in ("readings", "changed", "lost in rounding", "clipped", "frames out", "blanked"):
        table.add_column(column, justify="right")
    for (sensor, message), t in sorted(done.injector.tallies.items()):
        lost = t.readings - t.changed - t.removed - t.blanked
        numbers = (t.readings, t.changed, lost, t.clipped, t.removed, t.blanked)
        if t.readings:
            table.add_row(sensor, message, *map(str, numbers))
    if table.row_count:
        screen.print(table)
    for sentence in _sentences(done, injection):
        screen.print(f"  {sentence}", soft_wrap=True)
    screen.print(f"  {to}", soft_wrap=True)


def _sentences(done: _Done, injection: Injection) -> list[str]:
    """What the table does not say."""
    touched = {sensor for (sensor, _), t in done.injector.tallies.items() if t.readings}
    said = [
        f"{sensor} has no reading that the faults change: the log is as it was there"
        for sensor in injection.sensors
        if sensor not in touched
    ]
    if not injection.faults:
        said.append("no faults: the output is the same as the log")
    if any(t.clipped for t in done.injector.tallies.values()):
        said.append("clipped: the field could not hold the value and holds its nearest")
    if any(t.blanked for t in done.injector.tallies.values()):
        said.append("blanked: the frame carries other sensors, so only these fields are NaN or 0")
    if done.injector.unsigned:
        said.append(
            f"{done.injector.unsigned} changed frames were signed: the signature, which only the "
            "vehicle can make, was taken off"
        )
    if ("airspeed0", "VFR_HUD") in done.survey.left and "airspeed0" in injection.sensors:
        said.append("VFR_HUD shows another airspeed than airspeed0 and was left as it is")
    return said
