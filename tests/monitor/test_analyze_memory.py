"""Memory does not grow with the length of a log."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from links.samples import Batch
from links.vocabulary import Reason, State
from monitor import summary
from monitor.analyze import analyze_into
from monitor.commands.feed import write_log
from monitor.settings import load
from monitor.verdict import Verdict
from sim_feeds.scenario import load as load_scenario

FLIGHT = """\
title = "Two minutes in the air"
aircraft = "small-uav"
seed = 5
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 50.0
[[leg]]
do = "turn"
angle_deg = 180.0
[[leg]]
do = "level"
duration_s = 50.0
[imu]
count = 2
rate_hz = 50.0
[airspeed]
count = 2
"""
MIB = 1 << 20


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("log")
    (folder / "flight.toml").write_text(FLIGHT)
    write_log(load_scenario(folder / "flight.toml").fly(), folder / "flight.tlog")
    return folder / "flight.tlog"


def peak_bytes(log: Path, out: Path) -> int:
    """Largest memory that an analysis had in use at once, beside what stood before."""
    analyze_into(out, log, load())
    tracemalloc.start()
    try:
        analyze_into(out, log, load())
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_log_five_times_as_long_takes_no_more_memory(log, tmp_path) -> None:
    data = log.read_bytes()
    assert len(data) > 0.5 * MIB
    short, long = tmp_path / "short.tlog", tmp_path / "long.tlog"
    short.write_bytes(6 * data)  # enough that every buffer is full
    long.write_bytes(30 * data)
    before, after = peak_bytes(short, tmp_path / "s"), peak_bytes(long, tmp_path / "l")
    assert after < 1.2 * before, (before / MIB, after / MIB)


def changing(n: int) -> list[Verdict]:
    """A sensor whose state changes without end."""
    states = (State.OK, State.FAULTY, State.UNMONITORED)
    reason = (None, None, Reason.LEARNING)
    return [Verdict(k, "airspeed0", states[k % 3], reason[k % 3]) for k in range(n)]


def test_what_is_not_listed_any_more_is_counted_and_times_stay_right(monkeypatch) -> None:
    monkeypatch.setattr(summary, "LISTED", 10)
    monkeypatch.setattr(summary, "KEPT_VERDICTS", 25)
    ledger = summary.Ledger()
    for verdict in changing(300):
        ledger.add([verdict])
    assert len(ledger.verdicts) == 25
    assert len(ledger.faults(0)) == 10
    assert ledger.faults(0)[9]["cleared_s"] is not None
    (account,) = ledger.monitored(0, 300)
    assert account["seconds"] == pytest.approx(200e-6)
    assert len(account["unmonitored"]) == 10
    assert ledger.left_out == {"verdicts": 275, "faults": 90, "events": 0, "spans": 89}


def test_a_ledger_that_is_asked_in_between_says_the_same_in_the_end() -> None:
    asked, whole = summary.Ledger(), summary.Ledger()
    for verdict in changing(60):
        asked.add([verdict])
        asked.monitored(0, verdict.t_us + 5)
        asked.faults(0)
    whole.add(changing(60))
    assert asked.monitored(0, 100) == whole.monitored(0, 100)
    assert json.dumps(asked.faults(0)) == json.dumps(whole.faults(0))


def test_two_times_without_a_verdict_are_two_spans_although_the_reason_is_the_same() -> None:
    verdicts = [
        Verdict(0, "airspeed0", State.UNMONITORED, Reason.ON_GROUND),
        Verdict(10, "airspeed0", State.OK),
        Verdict(50, "airspeed0", State.UNMONITORED, Reason.ON_GROUND),
    ]
    (account,) = summary.monitored(verdicts, 0, 60)
    spans = [(round(s["from_s"] * 1e6), s["reason"]) for s in account["unmonitored"]]
    assert spans == [(0, "on ground"), (0, "on ground")]  # seconds have three decimals
    assert account["seconds"] == pytest.approx(40e-6)


def test_boots_are_kept_when_batches_are_joined_and_split() -> None:
    from links.samples import empty_rows

    rows = empty_rows("airspeed0", 10)
    rows["seq"], rows["t_us"] = np.arange(10), np.arange(10) * 100
    batch = Batch({"airspeed0": rows}, boots=(350, 850))
    parts = batch.split([2, 5])
    assert [p.boots for p in parts] == [(), (350,), (850,)]
    assert Batch.concatenate(parts).boots == batch.boots
