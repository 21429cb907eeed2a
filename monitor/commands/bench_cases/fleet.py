"""The fleet: one flight's logs on two workers against one, both clusters standing."""

from __future__ import annotations

import statistics
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from links.mavlink import encode
from monitor.commands.bench_cases import BenchCase, Measured
from monitor.fleet.engine import Engine, open_engine
from monitor.fleet.sources import Source, expand
from monitor.fleet.task import Plan, Task, judge, make_plan
from monitor.settings import load
from monitor.warmup import warm_up

__all__ = ["cases"]

LOGS = 12
ROUNDS = 3
EXTRA = ("dask", "distributed", "fsspec", "pyarrow")


def cases(log: Path) -> list[BenchCase]:
    """The case on copies of a telemetry log that differ in a last message."""
    missing = tuple(package for package in EXTRA if find_spec(package) is None)
    return [
        BenchCase(
            "fleet_speedup",
            unit="times one worker",
            value=None if missing else lambda: _speedup(log),
            note=f"{LOGS} logs on two workers against one, one numeric thread each, clusters up",
            missing=missing,
        )
    ]


def _speedup(log: Path) -> Measured:
    warm_up(load())
    with tempfile.TemporaryDirectory(prefix="mavsentry-bench-") as folder:
        logs = _logs(log, Path(folder, "logs"))
        plan = make_plan(load(), str(Path(folder, "out")), again=True)
        with open_engine(1) as one, open_engine(2) as two:
            for engine in (one, two):  # each worker loads its kernels
                _timed(engine, logs, plan)
            rounds = [(_timed(one, logs, plan), _timed(two, logs, plan)) for _ in range(ROUNDS)]
    alone_s, together_s = (statistics.median(taken) for taken in zip(*rounds, strict=True))
    each = 1e6 * together_s / LOGS
    note = f"{logs[0].bytes / 1e6:.1f} MB each; {LOGS / together_s:.2f} logs a second on two"
    return Measured(alone_s / together_s, each, 1e6 * max(t for _, t in rounds) / LOGS, note)


def _logs(log: Path, folder: Path) -> list[Source]:
    """Copies that are no copies to a fleet: each ends with a text of its own."""
    folder.mkdir()
    whole = log.read_bytes()
    stamp = whole[:8]
    for k in range(LOGS):
        text = encode("STATUSTEXT", severity=6, text=f"copy {k}".encode())
        (folder / f"{k:02d}.tlog").write_bytes(whole + stamp + text)
    return expand([str(folder)])


def _timed(engine: Engine, logs: list[Source], plan: Plan) -> float:
    """Time that the engine takes for all of them [s].

    Raises
    ------
    RuntimeError
        A log was not judged: the time would mean nothing.
    """
    began_s = time.perf_counter()
    for ended in engine.run(judge, [Task(log, plan) for log in logs]):
        if ended.result is None or ended.result["status"] != "judged":
            raise RuntimeError(f"a log was not judged: {ended.error or ended.result}")
    return time.perf_counter() - began_s
