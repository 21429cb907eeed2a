"""`analyze` on logs of an hour and of ten: times real time on one core, memory, and the report.

Each log is analysed by a process of its own that is held to one core and has loaded its kernels
before: its CPU time, its wall time and its largest resident memory are those of the analysis alone.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from numpy.typing import NDArray

from monitor.analyze import ESTIMATES, analyze_into, have_report
from monitor.commands.bench_cases import BenchCase, Measured
from monitor.commands.bench_cases.long_log import Flight, lengthen
from monitor.settings import load
from monitor.warmup import warm_up

__all__ = ["cases", "memory_cases", "report_cases"]

HOUR_S: Final = 3600.0
REPEATS: Final = 3
SECOND_IMU: Final = "SCALED_IMU2"
WITHIN: Final = (
    "wall time on one core, kernels loaded; reading, decoding, all verdicts, the autopilots' own "
    "checks, summary.json and the estimates as Parquet included"
)


@dataclass(frozen=True, slots=True)
class Taken:
    """What the analyses of one log took.

    Attributes
    ----------
    flight_s
        Length of the log [s].
    cpu_s, wall_s
        Of the quickest analysis [s].
    before_mib, peak_mib
        Resident memory with the kernels loaded, and its peak [MiB].
    faults
        Faults found.
    report_cpu_s, report_s
        CPU and wall time of the quickest report, zero without one [s].
    report_bytes
        Its size.
    """

    flight_s: float
    cpu_s: float
    wall_s: float
    before_mib: float
    peak_mib: float
    faults: int
    report_cpu_s: float = 0.0
    report_s: float = 0.0
    report_bytes: int = 0

    def said(self) -> str:
        """In words."""
        return (
            f"{self.flight_s:.0f} s of flight in {self.cpu_s:.2f} s of CPU "
            f"({self.flight_s / self.cpu_s:.0f} times real time) and {self.wall_s:.2f} s of wall "
            f"time ({self.flight_s / self.wall_s:.0f} times); resident {self.before_mib:.0f} MiB "
            f"before, {self.peak_mib:.0f} MiB at most; {self.faults} faults found"
            + (f"; {self.report_said()}" if self.report_bytes else "")
        )

    def report_said(self) -> str:
        """The report in words."""
        return (
            f"its report of {self.report_bytes / 1e6:.2f} MB in {self.report_cpu_s:.2f} s of CPU "
            f"and {self.report_s:.2f} s of wall time"
        )


def cases(
    folder: Path,
    flight: Callable[[], Flight],
    all_watched: Callable[[], tuple[Flight, Path]] | None,
) -> list[BenchCase]:
    """One hour with one IMU, with two, and with every monitor on.

    Parameters
    ----------
    folder
        Where the long logs go.
    flight
        Makes some minutes of flight with two IMUs at 200 Hz.
    all_watched
        The same of an aircraft whose engine and wings are known, with the configuration that says
        so; None without JSBSim.
    """
    return [
        BenchCase(
            "analyze",
            unit="times real time",
            value=lambda: _hour(folder, flight(), leave_out=SECOND_IMU),
            note=f"one IMU at 200 Hz, IMU and air monitors: {WITHIN}.",
        ),
        BenchCase(
            "analyze_two_imus",
            unit="times real time",
            value=lambda: _hour(folder, flight()),
            note="the same with two IMUs at 200 Hz.",
        ),
        BenchCase(
            "analyze_all",
            unit="times real time",
            value=None if all_watched is None else lambda: _hour(folder, *all_watched()),
            note="two IMUs at 200 Hz, engine and wings watched too.",
            missing=() if all_watched is not None else ("jsbsim",),
        ),
    ]


def memory_cases(folder: Path, flight: Callable[[], Flight]) -> list[BenchCase]:
    """Peak memory of ten hours against that of one."""
    return [
        BenchCase(
            "analyze_memory",
            unit="times the peak of one hour",
            value=lambda: _memory(folder, flight()),
            note="peak resident memory of ten hours, two IMUs at 200 Hz, report.html included.",
        )
    ]


def report_cases(folder: Path, flight: Callable[[], Flight]) -> list[BenchCase]:
    """Time to make the report of an hour, once the log is analysed."""
    able = have_report()
    return [
        BenchCase(
            "report_s",
            unit="s",
            value=(lambda: _report(folder, flight())) if able else None,
            note="report.html of one hour with two IMUs at 200 Hz, after its analysis: wall time "
            f"on one core, the quickest of {REPEATS};",
            missing=() if able else ("bokeh",),
        )
    ]


def _hour(
    folder: Path, flight: Flight, config: Path | None = None, leave_out: str = ""
) -> Measured:
    taken = _analysed(folder, flight, HOUR_S, REPEATS, config, leave_out)
    return Measured(
        taken.flight_s / taken.wall_s, taken.wall_s * 1e6, taken.wall_s * 1e6, taken.said()
    )


def _memory(folder: Path, flight: Flight) -> Measured:
    report = have_report()
    one, ten = (_analysed(folder, flight, h * HOUR_S, 1, report=report) for h in (1, 10))
    return Measured(ten.peak_mib / one.peak_mib, note=f"{one.said()}. {ten.said()}")


def _report(folder: Path, flight: Flight) -> Measured:
    taken = _analysed(folder, flight, HOUR_S, REPEATS, report=True)
    return Measured(taken.report_s, taken.report_s * 1e6, taken.report_s * 1e6, taken.report_said())


def _analysed(
    folder: Path,
    flight: Flight,
    seconds: float,
    repeats: int,
    config: Path | None = None,
    leave_out: str = "",
    *,
    report: bool = False,
) -> Taken:
    """Lengthen the flight and analyse it in a process of its own."""
    log = folder / "long.tlog"
    lengthen(flight, log, seconds, leave_out)
    command = [sys.executable, "-m", __name__, str(log), str(repeats), str(config or "")]
    command += ["report"] if report else []
    try:
        answer = subprocess.run(command, check=True, capture_output=True, text=True)
    finally:
        log.unlink()
    return Taken(**json.loads(answer.stdout))


def _take(log: Path, repeats: int, config: Path | None, *, report: bool) -> Taken:
    """Analyse a log several times, in this process, and write its report if asked."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    settings = load(file=config)
    warm_up(settings)
    _forget_peak()
    before_mib = _peak_mib()
    analyses, reports, size = [], [], 0
    for _ in range(repeats):
        with TemporaryDirectory(prefix="mavsentry-bench-") as out:
            began = _clocks()
            analysis = analyze_into(Path(out), log, settings)
            analyses.append(_clocks() - began)
            if report:
                began = _clocks()
                size = analysis.write_report(Path(out), Path(out, ESTIMATES)).stat().st_size
                reports.append(_clocks() - began)
    cpu_s, wall_s = np.min(analyses, axis=0).tolist()
    report_cpu_s, report_s = np.min(reports or [np.zeros(2)], axis=0).tolist()
    flight_s, faults = float(analysis.summary["log"]["duration_s"]), len(analysis.faults)
    peak_mib = _peak_mib()
    return Taken(
        *(flight_s, cpu_s, wall_s, before_mib, peak_mib, faults),
        *(report_cpu_s, report_s, size),
    )


def _clocks() -> NDArray[np.float64]:
    """CPU time of this process, and wall time [s]."""
    return np.array([time.process_time(), time.perf_counter()])


def _forget_peak() -> None:
    """Let the peak of memory begin anew, where the system can: else it is that of the warm-up."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_mib() -> float:
    """Largest resident memory of this process so far, or since the peak was forgotten."""
    with suppress(OSError):
        status = Path("/proc/self/status").read_text()
        if told := re.search(r"^VmHWM:\s+(\d+) kB$", status, re.M):
            return int(told[1]) / 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


if __name__ == "__main__":
    _log, _repeats, _config, *_more = sys.argv[1:]
    _settings_file = Path(_config) if _config else None
    _taken = _take(Path(_log), int(_repeats), _settings_file, report=bool(_more))
    print(json.dumps(asdict(_taken)))
