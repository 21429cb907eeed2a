"""``mavsentry bench against``: our verdicts beside those of the autopilots' own checks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from monitor.commands import completing
from monitor.commands.common import (
    ConfigFile,
    Profile,
    Refused,
    console,
    load_settings,
    note,
    progress,
)

if TYPE_CHECKING:
    from monitor.commands.bench_against.score import Truth
    from monitor.commands.bench_against.tables import Flight
    from monitor.settings import Settings

__all__ = ["against"]


def against(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Telemetry logs (.tlog), or folders of them.",
            autocompletion=completing.logs,
        ),
    ],
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="JSON: flight's name -> {faults: [{sensors, on, off}], tolerated: [...]}, times "
            "in seconds from the first record. Without it nothing is scored.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write DIR/against.md and DIR/against.json."),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SENSOR",
            help="Leave a sensor out (airspeed1, imu1); may be given several times. What the "
            "autopilot said is then left out too: it had that sensor.",
        ),
    ] = None,
    profile: Profile = None,
    config: ConfigFile = None,
) -> None:
    """Compare with ArduPilot's and PX4's own checks, and with what the autopilot said."""
    from estimators.jit import is_cold
    from monitor.warmup import COMPILING

    settings = load_settings(profile, config)
    known = _truths(truth)
    files = _files(logs)
    if is_cold():
        note(COMPILING)
    missing = _sensors(without or [])
    flights = [_flight(file, settings, known.get(file.stem), missing) for file in files]
    if out is not None:
        _write(flights, out)
    _show(flights)


def _files(logs: list[Path]) -> list[Path]:
    """The logs, those of a folder in order of name.

    Raises
    ------
    Refused
        A path that is not there, or a folder without logs.
    """
    out: list[Path] = []
    for log in logs:
        if log.is_dir():
            found = sorted(log.glob("*.tlog"))
            if not found:
                raise Refused(f"there is no .tlog in {log}")
            out += found
        elif log.is_file():
            out.append(log)
        else:
            raise Refused(f"cannot read {log}: no such file")
    return out


def _sensors(names: list[str]) -> frozenset[str]:
    """The sensors to leave out.

    Raises
    ------
    Refused
        A name that no sensor has.
    """
    from links.samples import quantity_of

    for name in names:
        try:
            quantity_of(name)
        except KeyError as error:
            raise Refused(f"{error.args[0]}; a sensor is called airspeed1 or imu1") from None
    return frozenset(names)


def _truths(file: Path | None) -> dict[str, Truth]:
    """Flight's name -> what is known of it.

    Raises
    ------
    Refused
        The file cannot be read, or is not of the form that ``--help`` shows.
    """
    from pydantic import TypeAdapter, ValidationError

    from monitor.commands.bench_against.score import Truth

    if file is None:
        return {}
    try:
        return TypeAdapter(dict[str, Truth]).validate_json(file.read_bytes())
    except OSError as error:
        raise Refused(f"cannot read {file}: {error.strerror}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise Refused(f"{file}: {where or 'the file'}: {first['msg']}") from None


def _flight(file: Path, settings: Settings, truth: Truth | None, without: frozenset[str]) -> Flight:
    """One flight judged and scored; a sensor that is left out has no fault."""
    from links.logs import LogError
    from monitor.commands.bench_against.judges import judge_flight
    from monitor.commands.bench_against.score import score
    from monitor.commands.bench_against.tables import Flight

    with progress(file.name) as tell:
        try:
            said = judge_flight(file, settings, tell, without)
        except LogError as error:
            raise Refused(str(error)) from None
    if truth is not None:
        truth = truth.model_copy(
            update={"faults": [f for f in truth.faults if not without.issuperset(f.sensors)]}
        )
    scores = {} if truth is None else {judge: score(said[judge], truth) for judge in said}
    return Flight(file.stem, said, truth, scores)


def _write(flights: list[Flight], out: Path) -> None:
    from monitor.commands.bench_against.tables import as_json, markdown

    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / "against.md").write_text(markdown(flights), encoding="utf-8")
        text = json.dumps(as_json(flights), indent=1, allow_nan=False)
        (out / "against.json").write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise Refused(f"cannot write to {out}: {error.strerror}") from None


def _show(flights: list[Flight]) -> None:
    """Both tables, and where another judge did better."""
    from rich.table import Table

    from monitor.commands.bench_against.score import beaten
    from monitor.commands.bench_against.tables import delay_rows, false_rows, judges_of

    screen = console()
    for title, head, rows in (
        ("delay from when a fault shows", ("fault", "shows"), delay_rows(flights)),
        ("false verdicts", ("broken",), false_rows(flights)),
    ):
        if rows:
            table = Table(title=title, title_justify="left")
            for column in ("flight", *head, *judges_of(flights)):
                table.add_column(column)
            for row in rows:
                table.add_row(*row)
            screen.print(table)
    for flight in flights:
        for line in beaten(flight.truth, flight.scores) if flight.truth else ():
            screen.print(f"{flight.name}: {line}", soft_wrap=True)
