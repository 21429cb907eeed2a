"""``mavsentry bench``: how fast each part is, and how many times slower its peers are.

``mavsentry bench detect`` stands in :mod:`monitor.commands.bench_detect`, ``mavsentry bench
against`` in :mod:`monitor.commands.bench_against`.
"""

from __future__ import annotations

import json
import math
import tempfile
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from monitor.commands import completing
from monitor.commands.bench_against.command import against
from monitor.commands.bench_detect.command import detect
from monitor.commands.common import Refused, console, progress
from monitor.commands.helping import App

if TYPE_CHECKING:
    from monitor.commands.bench_cases import BenchCase
    from monitor.commands.bench_cases.long_log import Flight

__all__ = ["app"]

app = App()
app.command("detect")(detect)
app.command("against")(against)

FLIGHT = "small-uav-healthy"
SIXDOF = "aerosonde-healthy"
LIVE_IMU_HZ = 200.0
SETTLING_S = 60.0
"""Time until all monitors of a live link are at work [s]."""

NAMES = {
    "air": ("mhe_step_n3", "mhe_stage_n100_over_n10", "mhe_converged_n10"),
    "imu": ("atsekf_step",),
    "engine": ("imkf_step",),
    "wing": ("mhmap_n50", "mhmap_n200"),
    "links": ("decode_tlog", "tlog_rows"),
    "live": (
        "decode_live",
        "decode_live_1",
        "decode_live_32",
        "reception_live",
        "reception_signed",
        "udp_roundtrip",
    ),
    "dataflash": ("decode_bin", "bin_rows"),
    "ulog": ("decode_ulg", "ulg_rows"),
    "whole": ("pipeline", "start_to_verdict_s", "latency_ms", "latency_all_ms"),
    "fleet": ("fleet_speedup",),
    "start": ("help_start",),
    "hours": ("analyze", "analyze_two_imus", "analyze_all"),
    "report": ("report_s",),
    "memory": ("analyze_memory",),
}
"""Module of ``monitor.commands.bench_cases`` -> what it measures; the last two are in ``hours``."""

TOGETHER = {"analyze": NAMES["hours"]}
"""Names that stand for several."""

ON_DEMAND = NAMES["memory"]
"""What takes minutes and is measured only when it is asked for."""

CIRCUITS_S = 100.0
"""Least time that the flight's circuits take [s]."""
CIRCUITS_AGAIN = 4
"""Times that the flight goes round once more for a log of hours."""
SIXDOF_S = 400.0
"""The same for the six-degree-of-freedom vehicle [s]."""


@app.callback(invoke_without_command=True)
def bench(
    context: typer.Context,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the results here.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Measure only this; may be given several times."),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="Telemetry log to work on; else a synthetic flight's.",
            autocompletion=completing.logs,
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=0.1, help="Time per case, seconds.", metavar="S")
    ] = 4.0,
    minutes: Annotated[
        float,
        typer.Option(
            min=0.1, help="How long latency_ms watches a live link, minutes.", metavar="MIN"
        ),
    ] = 0.5,
) -> None:
    """Measure how fast each part is, against its peers, all in one run, interleaved."""
    if context.invoked_subcommand is not None:
        if json_file or only or log:
            raise Refused(f"options of {context.invoked_subcommand} stand behind its name")
        return
    from monitor.commands.timing import machine

    with tempfile.TemporaryDirectory(prefix="mavsentry-bench-") as folder:
        cases = _cases(only or [], log, Path(folder), minutes)
        document = {"machine": machine(), **_results(cases, seconds)}
    if json_file is not None:
        try:
            json_file.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise Refused(f"cannot write {json_file}: {error.strerror}") from None
    _show(document)


def _cases(only: list[str], log: Path | None, folder: Path, minutes: float) -> list[BenchCase]:
    """All cases, or those asked for.

    Raises
    ------
    Refused
        A name that no case has, or a log that cannot be read.
    """
    known = [name for names in NAMES.values() for name in names]
    wanted = only or [name for name in known if name not in ON_DEMAND]
    wanted = [part for name in wanted for part in TOGETHER.get(name, (name,))]
    for name in wanted:
        if name not in known:
            raise Refused(f"nothing to measure is called {name}; known are {', '.join(known)}")
    cases: list[BenchCase] = []
    if set(wanted) & set(NAMES["imu"]):
        from monitor.commands.bench_cases import imu

        cases += imu.cases()
    if set(wanted) & set(NAMES["air"]):
        from monitor.commands.bench_cases import air

        cases += air.cases()
    if set(wanted) & set(NAMES["engine"]):
        from monitor.commands.bench_cases import engine

        cases += engine.cases()
    if set(wanted) & set(NAMES["wing"]):
        from monitor.commands.bench_cases import wing

        cases += wing.cases()
    if set(wanted) & set(NAMES["dataflash"]):
        from monitor.commands.bench_cases import dataflash

        cases += dataflash.cases(_dataflash(folder), folder)
    if set(wanted) & set(NAMES["ulog"]):
        from monitor.commands.bench_cases import ulog

        cases += ulog.cases(_ulog(folder))
    if set(wanted) & set(NAMES["start"]):
        from monitor.commands.bench_cases import start

        cases += start.cases()
        if set(wanted) <= set(NAMES["start"]):
            return cases
    log = log or _synthetic(folder)
    if not log.is_file():
        raise Refused(f"cannot read {log}: there is no such file")
    if set(wanted) & set(NAMES["links"]):
        from monitor.commands.bench_cases import links

        cases += links.cases(log, folder)
    if set(wanted) & set(NAMES["live"]):
        from monitor.commands.bench_cases import live

        cases += live.cases(log)
    if set(wanted) & set(NAMES["fleet"]):
        from monitor.commands.bench_cases import fleet

        cases += fleet.cases(log)
    if set(wanted) & set(NAMES["whole"]):
        from monitor.commands.bench_cases import whole

        seconds = 60.0 * minutes
        sixdof = find_spec("jsbsim") is not None
        cases += whole.cases(
            log,
            partial(_long_flight, folder, seconds),
            partial(_sixdof_flight, folder, seconds) if sixdof else None,
            minutes,
        )
    if set(wanted) & {*NAMES["hours"], *NAMES["report"], *NAMES["memory"]}:
        from monitor.commands.bench_cases import hours

        some_minutes = cache(partial(_circuits, folder))
        sixdof = find_spec("jsbsim") is not None
        cases += hours.cases(
            folder, some_minutes, partial(_all_watched, folder) if sixdof else None
        )
        cases += hours.report_cases(folder, some_minutes)
        cases += hours.memory_cases(folder, some_minutes)
    return [case for case in cases if case.name in wanted]


def _synthetic(folder: Path) -> Path:
    """Telemetry log of a healthy synthetic flight, take-off to landing."""
    from monitor.commands.feed import write_log
    from sim_feeds.scenario import load

    file = folder / f"{FLIGHT}.tlog"
    if not file.exists():
        write_log(load(FLIGHT).fly(), file)
    return file


def _dataflash(folder: Path) -> Path:
    """DataFlash log of the same flight, over and over until it is large enough."""
    from monitor.commands.bench_cases import BULK_BYTES
    from sim_feeds.dataflash import ardupilot_log
    from sim_feeds.scenario import load

    file, log = folder / f"{FLIGHT}.BIN", ardupilot_log(load(FLIGHT).fly())
    file.write_bytes(log.content(-(-BULK_BYTES // len(log.content())) + 1))
    return file


def _ulog(folder: Path) -> Path:
    """ULog of the same flight, over and over until it is large enough."""
    from monitor.commands.bench_cases import BULK_BYTES
    from sim_feeds.scenario import load
    from sim_feeds.ulog import px4_log

    file, log = folder / f"{FLIGHT}.ulg", px4_log(load(FLIGHT).fly())
    file.write_bytes(log.content(-(-BULK_BYTES // len(log.content())) + 1))
    return file


def _long_flight(folder: Path, seconds: float) -> Path:
    """The same flight with IMUs at 200 Hz, as many circuits as the time asks, no landing."""
    from monitor.commands.feed import write_log
    from sim_feeds.scenario import load

    file = folder / f"{FLIGHT}-{seconds:.0f}s.tlog"
    write_log(load(FLIGHT, partial(_circling, math.ceil(seconds / CIRCUITS_S))).fly(), file)
    return file


def _circling(times: int, table: dict[str, Any]) -> None:
    """Override a scenario: IMUs at 200 Hz, its circuits flown so many times more, no landing."""
    table["imu"]["rate_hz"] = LIVE_IMU_HZ
    flown = [leg for leg in table["leg"] if leg["do"] != "land"]
    circuits = [leg for leg in flown if leg["do"] in ("turn", "level")]
    table["leg"] = flown + circuits * times


def _circuits(folder: Path) -> Flight:
    """Some minutes of circuits that may go on for ever."""
    from monitor.commands.bench_cases.long_log import Flight
    from sim_feeds.scenario import load

    log = _long_flight(folder, CIRCUITS_AGAIN * CIRCUITS_S)
    first, last = (load(FLIGHT, partial(_circling, n)).duration_s for n in (0, CIRCUITS_AGAIN))
    return Flight(log, last - first)


def _all_watched(folder: Path) -> tuple[Flight, Path]:
    """The Aerosonde, which goes on as it flew, and the settings that know it."""
    from monitor.commands.bench_cases.long_log import Flight
    from monitor.commands.bench_cases.whole import known_aircraft

    log = _sixdof_flight(folder, SIXDOF_S)
    return Flight(log, SIXDOF_S), known_aircraft(log)


def _sixdof_flight(folder: Path, seconds: float) -> Path:
    """The Aerosonde with IMUs at 200 Hz and three engine-speed sensors, two minutes at least."""
    from monitor.commands.feed import write_log
    from sim_feeds.scenario import load

    def override(table: dict[str, Any]) -> None:
        table["imu"]["rate_hz"] = LIVE_IMU_HZ
        table["rpm"]["count"] = 3
        table["circuit"]["duration_s"] = max(seconds + SETTLING_S, 2 * CIRCUITS_S)

    file = folder / f"{SIXDOF}-{seconds:.0f}s.tlog"
    write_log(load(SIXDOF, override).fly(), file)
    return file


def _results(cases: list[BenchCase], seconds: float) -> dict[str, Any]:
    results, missing = [], []
    with progress("measuring") as tell:
        for i, case in enumerate(cases):
            tell(i / len(cases))
            results.append(_measured(case, seconds))
            missing += [peer for peer in case.missing if peer not in missing]
    return {"results": results, "missing": missing}


def _measured(case: BenchCase, seconds: float) -> dict[str, Any]:
    """One entry of ``results``."""
    from monitor.commands.bench_cases import Measured
    from monitor.commands.timing import interleaved

    result: dict[str, Any] = {
        "name": case.name,
        "median_us": None,
        "p99_us": None,
        "value": None,
        "unit": case.unit,
        "peers": {},
    }
    if case.run is not None:
        timings = interleaved({"": case.run, **case.peers}, seconds)
        ours = timings.pop("")
        result["median_us"] = ours.median_us / case.calls
        result["p99_us"] = ours.p99_us / case.calls
        result["peers"] = {
            peer: timing.median_us
            / case.peer_calls.get(peer, case.calls)
            / (ours.median_us / case.calls)
            for peer, timing in timings.items()
        }
    note = case.note
    if case.value is not None:
        measured = case.value()
        if isinstance(measured, Measured):
            if measured.median_us is not None:
                result["median_us"], result["p99_us"] = measured.median_us, measured.p99_us
            note, measured = " ".join(filter(None, (note, measured.note))), measured.value
        result["value"] = measured
    if note:
        result["note"] = note
    return result


def _show(document: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table(title=f"mavsentry bench on {document['machine']['processor']}")
    table.add_column("name", no_wrap=True)
    for column in ("median", "p99", "value"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("peers: times slower", ratio=1)
    for result in document["results"]:
        value = result["value"]
        table.add_row(
            result["name"],
            _duration(result["median_us"]),
            _duration(result["p99_us"]),
            "" if value is None else f"{value:.4g} {result['unit']}",
            ", ".join(f"{peer} {ratio:.3g}" for peer, ratio in result["peers"].items()),
        )
    console().print(table)
    for result in document["results"]:
        if "note" in result:
            print(f"{result['name']}: {result['note']}")
    if document["missing"]:
        print("not installed, so not compared: " + ", ".join(document["missing"]))


def _duration(us: float | None) -> str:
    if us is None:
        return ""
    return f"{us:.3g} us" if us < 1000 else f"{us / 1e3:.3g} ms"
