"""The log benchmarks: all readers read the same log, and ours is told against each."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.commands.bench import NAMES, _measured
from monitor.commands.bench_cases import BenchCase, dataflash, links, ulog
from monitor.commands.feed import write_log
from sim_feeds.dataflash import ardupilot_log
from sim_feeds.scenario import Flight, load
from sim_feeds.ulog import px4_log


@pytest.fixture(scope="module")
def flight() -> Flight:
    return load("small-uav-healthy").fly()


def assert_told(cases: list[BenchCase], case: str, peers: set[str]) -> None:
    """The case has a ratio of each of its peers that is installed, and ours is faster."""
    (measured,) = [_measured(c, 0.01) for c in cases if c.name == case]
    absent = {peer for c in cases for peer in c.missing}
    assert set(measured["peers"]) == {p for p in peers if p.split("_")[0] not in absent}
    assert measured["median_us"] > 0.0
    assert all(ratio > 1.0 for ratio in measured["peers"].values())


def test_telemetry_log(flight: Flight, tmp_path: Path) -> None:
    file = tmp_path / "x.tlog"
    write_log(flight, file)
    case = links.decode_tlog(file, tmp_path, bulk=1)
    assert case.name in NAMES["links"]
    assert_told([case], "decode_tlog", {"pymavlink", "fasttlogparser"})


def test_dataflash_log(flight: Flight, tmp_path: Path) -> None:
    file = tmp_path / "x.BIN"
    file.write_bytes(ardupilot_log(flight).content()[:300_000])
    cases = dataflash.cases(file, tmp_path)
    assert [case.name for case in cases] == [*NAMES["dataflash"]]
    assert len({cases[0].calls, *cases[0].peer_calls.values()}) == 1
    assert_told(cases, "decode_bin", {"pymavlink", "pymavlink_unread", "mavparser"})


def test_ulog(flight: Flight, tmp_path: Path) -> None:
    file = tmp_path / "x.ulg"
    file.write_bytes(px4_log(flight).content()[:300_000])
    cases = ulog.cases(file)
    assert [case.name for case in cases] == [*NAMES["ulog"]]
    assert_told(cases, "decode_ulg", {"pyulog"})
