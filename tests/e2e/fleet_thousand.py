"""A fleet of a thousand logs: how much faster two workers are, and what a dead one costs.

    python -m tests.e2e.fleet_thousand [--data ../shared/data] [--logs 1000] [--keep DIR]

Logs of about 1 MB are cut from the recorded flights, most with a fault injected; ``mavsentry
fleet`` runs over them as a process, its workers with one numeric thread each:

one worker, then two
    wall time of the whole command, start of the workers and page included;
two workers, one of them killed in the middle
    the same rows as before, none lost;
and a hundred corrupt files beside them
    a hundred rows with their reason, and nothing else analyzed again;
called once more
    everything known.

The status is 1 if one of these does not hold. A log takes 0.1 to 0.2 s of one core: a thousand some
eight minutes in all, on two cores with nothing else to do.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
from rich.console import Console
from rich.table import Table

from monitor.fleet.dataset import load
from monitor.fleet.engine import open_engine
from monitor.fleet.places import Place
from tests.e2e.cut_flights import corrupt, cuts, make

COMMAND = (sys.executable, "-m", "monitor.cli", "fleet")
FASTER = 1.6
KILL_AFTER = 0.4
"""Share of the logs that are done when a worker is killed."""
POLL_S = 0.05
WORKER = b"multiprocessing.spawn"
RUN_OWN = frozenset({"seconds", "stamp", "key"})
"""Columns of a run and not of a log."""
SORTED_BY = {"logs": "log", "faults": "log detected_s sensor", "sensors": "log sensor"}


@dataclass(slots=True)
class Ledger:
    """What was found, as lines of a table."""

    lines: list[tuple[str, str, str, bool]] = field(default_factory=list)

    def note(self, what: str, found: object, wanted: str, holds: bool) -> None:
        self.lines.append((what, str(found), wanted, holds))

    def table(self) -> Table:
        table = Table("what", "found", "wanted", "holds")
        for what, found, wanted, holds in self.lines:
            table.add_row(what, found, wanted, "yes" if holds else "NO")
        return table


def main() -> int:
    """Make the logs, run the fleets, print the table."""
    options = _options()
    ledger = Ledger()
    with tempfile.TemporaryDirectory(prefix="fleet-thousand-") as scratch:
        folder = options.keep or Path(scratch)
        logs, bad = folder / "logs", folder / "corrupt"
        made = _make(options, logs)
        megabytes = sum(log.stat().st_size for log in made) / 1e6
        broken = len({log.stem for log in made}) == len(made) == options.logs
        ledger.note("logs made", f"{len(made)}, {megabytes:.0f} MB", str(options.logs), broken)
        _speed(ledger, logs, folder)
        _killed(ledger, logs, folder, options.logs)
        corrupt(made, bad, options.corrupt, options.seed)
        _with_corrupt(ledger, logs, bad, folder / "two", options)
    Console(width=110).print(ledger.table())
    return 0 if all(holds for *_, holds in ledger.lines) else 1


def _options() -> argparse.Namespace:
    shared = Path(__file__).resolve().parents[3] / "shared"
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path, default=shared / "data")
    parser.add_argument("--logs", type=int, default=1000)
    parser.add_argument("--corrupt", type=int, default=100)
    parser.add_argument("--size", type=int, default=1_000_000, help="bytes of a log")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="an empty folder for logs and results")
    return parser.parse_args()


def _make(options: argparse.Namespace, logs: Path) -> list[Path]:
    flights = sorted(options.data.rglob("*.tlog"))
    recipes = cuts(flights, logs, options.logs, options.size, options.seed)
    with open_engine(2) as engine:
        for ended in engine.run(make, recipes):
            if ended.error is not None:
                raise ended.error
    return sorted(logs.rglob("*.tlog"))


def _speed(ledger: Ledger, logs: Path, folder: Path) -> None:
    taken_s = {}
    _fleet(2, [next(logs.iterdir())], folder / "first")  # kernels are compiled, files are cached
    for name, workers in (("one", 1), ("two", 2)):
        began_s = time.perf_counter()
        _fleet(workers, [logs], folder / name)
        taken_s[name] = time.perf_counter() - began_s
        ledger.note(f"{name}: wall time", f"{taken_s[name]:.1f} s", "", True)
    ratio = taken_s["one"] / taken_s["two"]
    ledger.note("two workers are faster", f"{ratio:.2f} x", f">= {FASTER}", ratio >= FASTER)
    different = _differences(folder / "one", folder / "two")
    ledger.note("rows that differ", different, "0", different == 0)
    found = _tables(folder / "one")
    faults = f"{len(found['faults'])} in {len({row['log'] for row in found['faults']})} logs"
    ledger.note("faults found", faults, "", True)


def _killed(ledger: Ledger, logs: Path, folder: Path, count: int) -> None:
    out = folder / "killed"
    process = subprocess.Popen(
        [*COMMAND, "--jobs", "2", "--out", str(out), str(logs)], stdout=subprocess.DEVNULL
    )
    killed = 0
    while process.poll() is None:
        done = sum(1 for _ in out.rglob("outcome.json"))
        if not killed and done >= KILL_AFTER * count:
            killed = next(_workers(process.pid))
            os.kill(killed, signal.SIGKILL)
        time.sleep(POLL_S)
    ledger.note("a worker killed in the middle", "killed" if killed else "none", "", killed > 0)
    ledger.note("  exit status", process.returncode, "0", process.returncode == 0)
    rows = len(_tables(out)["logs"])
    ledger.note("  logs with a row", rows, str(count), rows == count)
    different = _differences(folder / "one", out)
    ledger.note("  rows that differ", different, "0", different == 0)


def _with_corrupt(
    ledger: Ledger, logs: Path, bad: Path, out: Path, options: argparse.Namespace
) -> None:
    said = _fleet(2, [logs, bad], out, status=2)
    ledger.note("with corrupt ones", said, f"{options.logs} known", f"({options.logs} " in said)
    rows = [r for r in _tables(out)["logs"] if "corrupt-" in r["log"]]
    lost = {row["status"] for row in rows} == {"unusable"} and all(row["reason"] for row in rows)
    wanted = str(options.corrupt)
    ledger.note("  rows with a reason", len(rows), wanted, lost and len(rows) == options.corrupt)
    reasons = {row["reason"] for row in rows}
    ledger.note("  reasons", "; ".join(sorted(reasons))[:200], "", True)
    began_s = time.perf_counter()
    said = _fleet(2, [logs, bad], out, status=2)
    known = options.logs + options.corrupt
    taken = f"{time.perf_counter() - began_s:.1f} s"
    ledger.note("called once more", taken, f"{known} known", f"({known} known before)" in said)


def _fleet(workers: int, patterns: Sequence[Path], out: Path, status: int = 0) -> str:
    """Run the command; what it says first.

    Raises
    ------
    RuntimeError
        It ends with another status.
    """
    call = [*COMMAND, "--jobs", str(workers), "--out", str(out), *map(str, patterns)]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    if done.returncode != status:
        raise RuntimeError(f"status {done.returncode}, not {status}: {done.stderr or done.stdout}")
    return done.stdout.partition("\n")[0]


def _tables(out: Path) -> dict[str, list[dict[str, Any]]]:
    """The dataset's rows without what is a run's own, in order."""
    tables = load(Place(str(out)))
    found = {}
    for name, columns in SORTED_BY.items():
        order = [(column, "ascending") for column in columns.split()]
        table = tables[name].take(pc.sort_indices(tables[name], sort_keys=order))
        found[name] = table.drop_columns(
            [c for c in RUN_OWN if c in table.column_names]
        ).to_pylist()
    return found


def _differences(one: Path, other: Path) -> int:
    """Rows of one dataset that are not in the other."""
    a, b = _tables(one), _tables(other)
    return sum(
        abs(len(a[name]) - len(b[name]))
        + sum(x != y for x, y in zip(a[name], b[name], strict=False))
        for name in SORTED_BY
    )


def _workers(of: int) -> Iterator[int]:
    """Worker processes under one process."""
    for entry in Path("/proc").iterdir():
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            line = (entry / "cmdline").read_bytes()
        except (OSError, IndexError, ValueError):
            continue
        if parent == of and WORKER in line and b"spawn_main" in line:
            yield int(entry.name)


if __name__ == "__main__":
    sys.exit(main())
