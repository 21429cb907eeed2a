"""Mutated logs through every reader: nothing may raise, hang, grow, or break what rows promise.

``python -m tests.links.fuzz all --bytes 10000000 --seed 1`` reads that many bytes of mutated logs
of each format: synthetic flights as the test writers put them down, and pieces of recorded ones
where they are at hand. Every input goes through its reader, whole and in small chunks; a telemetry
log also through ``tlog_columns``; one in ten through ``analyze_log``, the pipeline and its summary.

An input is a failure when anything but a ``LogError`` is raised, a warning included, when it takes
longer than 20 s (even inside a compiled kernel), when the process needs another 2 GiB of address
space, or when the rows are not numbered, timed and bounded as :mod:`links.samples` promises. It
stays in the folder, and the command that repeats it is printed.

``live`` instead of a format sends hostile bytes through the daemon: :mod:`tests.links.fuzz_live`.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from links.catalog import BOUNDS
from links.clock import BACK_US
from links.logs import LogError, LogReader, read_dataflash, read_tlog, read_ulog
from links.logs.tlog import tlog_columns
from links.samples import Batch
from monitor.analyze import analyze_log
from monitor.settings import load
from sim_feeds.dataflash import ardupilot_log
from sim_feeds.player import frames_of, unix_us
from sim_feeds.scenario import Flight
from sim_feeds.scenario import load as load_scenario
from sim_feeds.ulog import dropout, logged, parameter, px4_log

from .mutations import Mutation, Sound, bin_of, drawn, mutated, tlog_of, ulg_of

READERS = {
    "tlog": (read_tlog, tlog_of),
    "bin": (read_dataflash, bin_of),
    "ulg": (read_ulog, ulg_of),
}
SUFFIX = {"tlog": ".tlog", "bin": ".BIN", "ulg": ".ulg"}
SECONDS = 20
"""Longer than any input may take; a hundred times what the slowest needs."""
ROOM = 2 << 30
"""Address space that all inputs together may need beyond what was there before [bytes]."""
ANALYZED = 10
"""One in so many inputs goes through the pipeline too: of a flight that is long enough for it."""
SMALL_CHUNK = 3001
MADE = 0.6
"""Share of the inputs that surely come from a synthetic flight: they are the smaller ones."""
REQUIRED = ("acc_m_s2", "gyro_rad_s", "static_press_pa", "temperature_k", "aoa_rad", "speed_rpm")
LONG = """\
title = "Half a minute in the air"
aircraft = "small-uav"
seed = 5
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 12.0
[[leg]]
do = "turn"
angle_deg = 90.0
[[leg]]
do = "level"
duration_s = 10.0
[imu]
count = 2
[airspeed]
count = 2
"""
SHORT = (
    LONG.split("[[leg]]")[0] + '[[leg]]\ndo = "level"\nduration_s = 1.5\n[airspeed]\ncount = 2\n'
)
RECORDED = {
    "tlog": ("alfa/*no_failure.tlog", "sitl/n1_calm_nominal.tlog"),
    "bin": ("sitl/f6_accel_bias.BIN",),
    "ulg": ("ulog/*.ulg",),
}


@dataclass(slots=True)
class Tally:
    """What went through one reader."""

    inputs: int = 0
    bytes: int = 0
    refused: int = 0
    rows: int = 0
    analyzed: int = 0
    kinds: dict[str, int] = field(default_factory=dict)
    slowest_s: float = 0.0


# --------------------------------------------------------------------------- inputs


@cache
def sounds(reader: str) -> tuple[tuple[Sound, ...], tuple[Sound, ...]]:
    """Undamaged logs: short ones for the reader alone, long ones for the pipeline."""
    short, long = _flown(SHORT), _flown(LONG)
    places = READERS[reader][1]
    of_both = [places(name, _log(reader, f)) for name, f in (("short", short), ("long", long))]
    return (of_both[0], *_recorded(reader)), (of_both[1],)


def _flown(scenario: str) -> Flight:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "flight.toml"
        file.write_text(scenario)
        return load_scenario(file).fly()


def _log(reader: str, flight: Flight) -> bytes:
    if reader == "bin":
        return ardupilot_log(flight).content()
    if reader == "ulg":
        log = px4_log(flight)
        start_us = int(flight.scenario.start.boot_s * 1e6)
        for k in range(20):
            log.parameters += parameter(f"SENS_DPRES_{k}", 10.0)
        log.parameters += parameter("SENS_DPRES_OFF", 10.0)
        log.put(start_us + 500_000, logged(start_us + 500_000, "airspeed0 FAULTY"))
        log.put(start_us + 900_000, dropout(40))
        return log.content()
    return b"".join(
        unix_us(flight, t_us).to_bytes(8, "big") + frame for t_us, frame in frames_of(flight)
    )


def _recorded(reader: str) -> Iterator[Sound]:
    """Pieces of recorded flights, where there are any: definitions, then a second or two."""
    root = Path(__file__).resolve().parents[2].parent / "shared"
    folder = Path(os.environ.get("MAVSENTRY_SHARED", root)) / "data"
    for pattern in RECORDED[reader]:
        for file in sorted(folder.glob(pattern))[:1]:
            with file.open("rb") as f:
                whole = READERS[reader][1](file.name, f.read(400_000))
            size = {"tlog": 20_000, "bin": 120_000, "ulg": 120_000}[reader]
            edges = [at for at, _ in whole.stamps if at <= size]
            if edges:
                yield READERS[reader][1](file.name, whole.data[: edges[-1] + 8])


def inputs(
    reader: str, seed: int, only: int | None = None
) -> Iterator[tuple[int, Sound, list[Mutation]]]:
    """Endless: number, undamaged log, what happens to it."""
    short, long = sounds(reader)
    for number in itertools.count() if only is None else [only]:
        rng = np.random.default_rng([seed, number])
        chosen = long if number % ANALYZED == ANALYZED - 1 else short
        chosen = chosen[: 1 if rng.random() < MADE else None]
        yield number, chosen[int(rng.integers(len(chosen)))], drawn(rng)


# --------------------------------------------------------------------------- what must hold


def examine(reader: str, file: Path, *, analyzed: bool, tally: Tally) -> None:
    """Read one file in every way; raises on whatever must not be."""
    read = READERS[reader][0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        whole = _read(read(file), tally)
        pieces = _read(read(file, chunk=SMALL_CHUNK), tally)
        assert (whole is None) == (pieces is None), "refused or not, as the chunks are"
        if whole is not None and pieces is not None:
            assert whole.rejected == pieces.rejected
            for sensor in whole.rows.keys() | pieces.rows.keys():
                one, other = (b.rows.get(sensor, ()) for b in (whole, pieces))
                assert np.array(one).tobytes() == np.array(other).tobytes(), sensor
            check(whole)
            tally.rows += len(whole)
        else:
            tally.refused += 1
        if reader == "tlog":
            found = tlog_columns(file)
            assert found.bad_bytes <= file.stat().st_size
        if analyzed:
            tally.analyzed += 1
            with contextlib.suppress(LogError):
                json.dumps(analyze_log(file, load()).summary, allow_nan=False)


def _read(log: LogReader, tally: Tally) -> Batch | None:
    """All batches as one; None when the log is refused."""
    try:
        batch = Batch.concatenate(log)
    except LogError:
        return None
    info = log.info
    assert info.bytes == info.path.stat().st_size
    assert 0 <= info.bad_bytes <= info.bytes
    assert info.messages >= 0
    assert all(length_us > 0 for _, length_us in info.gaps)
    return batch


def check(batch: Batch) -> None:
    """What :mod:`links.samples` and :mod:`links.clock` promise of rows."""
    assert all(count > 0 for count in batch.rejected.values())
    if not batch.rows:
        return
    seq = np.concatenate([rows["seq"] for rows in batch.rows.values()])
    t_us = np.concatenate([rows["t_us"] for rows in batch.rows.values()])
    order = np.argsort(seq)
    assert np.array_equal(seq[order], np.arange(len(seq))), "numbers of the rows"
    t_us = t_us[order]
    assert t_us[0] >= -BACK_US
    assert (np.maximum.accumulate(t_us) - t_us <= BACK_US).all(), "a row is too late"
    assert list(batch.boots) == sorted(batch.boots)
    for sensor, rows in batch.rows.items():
        assert (np.diff(rows["seq"]) > 0).all(), sensor
        for name in set(rows.dtype.names or ()) & set(REQUIRED):
            low, high = BOUNDS[name]
            assert ((rows[name] >= low) & (rows[name] <= high)).all(), (sensor, name)


# --------------------------------------------------------------------------- the run


def run(
    reader: str,
    count: int,
    seed: int,
    folder: Path,
    only: int | None = None,
    *,
    watch: bool = False,
) -> Tally:
    """Read mutated logs of ``count`` bytes in all; an input that fails stays in the folder."""
    tally, file = Tally(), folder / f"failed-{seed}{SUFFIX[reader]}"
    for number, sound, mutations in inputs(reader, seed, only):
        data = mutated(sound, mutations)
        file.write_bytes(data)
        (folder / f"failed-{reader}-{seed}.txt").write_text(
            f"{sound.name}\n{mutations}\npython -m tests.links.fuzz {reader} --seed {seed} "
            f"--only {number}\n"
        )
        if watch:
            faulthandler.dump_traceback_later(SECONDS, exit=True)
        begun = time.perf_counter()
        examine(reader, file, analyzed=number % ANALYZED == ANALYZED - 1, tally=tally)
        tally.slowest_s = max(tally.slowest_s, time.perf_counter() - begun)
        if watch:
            faulthandler.cancel_dump_traceback_later()
        tally.inputs += 1
        tally.bytes += len(data)
        for m in mutations:
            tally.kinds[m.kind] = tally.kinds.get(m.kind, 0) + 1
        if tally.bytes >= count:
            break
    file.unlink()
    (folder / f"failed-{reader}-{seed}.txt").unlink()
    return tally


def _work(reader: str, count: int, seed: int, folder: Path, only: int | None) -> None:
    if reader == "live":
        from .fuzz_live import work

        work(count, seed, only)
        return
    for sound in (s for part in sounds(reader) for s in part):  # compile and load before measuring
        (folder / "sound").write_bytes(sound.data)
        examine(reader, folder / "sound", analyzed=True, tally=Tally())
    (folder / "sound").unlink()
    with open("/proc/self/statm") as statm:
        before = int(statm.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (before + ROOM, resource.RLIM_INFINITY))
    rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun = time.perf_counter()
    tally = run(reader, count, seed, folder, only, watch=True)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - rss
    kinds = ", ".join(f"{name} {n}" for name, n in sorted(tally.kinds.items()))
    print(
        f"{reader}: {tally.bytes} bytes in {tally.inputs} inputs, seed {seed}: none failed; "
        f"{tally.rows} rows, {tally.refused} inputs refused, {tally.analyzed} analyzed; "
        f"{time.perf_counter() - begun:.0f} s, slowest input {tally.slowest_s:.2f} s; "
        f"peak memory {(rss + grown) / 1024:.0f} MiB, {grown / 1024:.0f} MiB more than undamaged "
        f"logs need\n  mutations: {kinds}"
    )


def main() -> int:
    """The command; each reader in a process of its own, so that a hang or a crash is told too."""
    parser = argparse.ArgumentParser(prog="python -m tests.links.fuzz", description=__doc__)
    parser.add_argument("reader", choices=[*READERS, "all", "live"])
    parser.add_argument("--bytes", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="one input by its number")
    parser.add_argument("--folder", type=Path, help="where a failing input stays")
    parser.add_argument("--one-life", action="store_true", help="live: a single daemon sees it all")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    told = parser.parse_args()
    folder = told.folder or Path(tempfile.mkdtemp(prefix="fuzz-"))
    folder.mkdir(parents=True, exist_ok=True)
    if told.one_life:
        from .fuzz_live import work_long

        work_long(told.bytes, told.seed)
        return 0
    if told.worker:
        _work(told.reader, told.bytes, told.seed, folder, told.only)
        return 0
    failed = 0
    for reader in READERS if told.reader == "all" else [told.reader]:
        command = [sys.executable, "-m", "tests.links.fuzz", reader, "--bytes", str(told.bytes)]
        command += ["--seed", str(told.seed), "--folder", str(folder), "--worker"]
        command += [] if told.only is None else ["--only", str(told.only)]
        if subprocess.run(command, check=False).returncode:
            failed += 1
            what = folder / f"failed-{reader}-{told.seed}.txt"
            print(f"{reader}: FAILED; the input lies in {folder}")
            print(what.read_text() if what.exists() else "", end="")
    return int(failed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
