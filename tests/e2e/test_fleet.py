"""``mavsentry fleet`` as a process, on workers of its own: what it finds, and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from monitor.fleet.dataset import load
from monitor.fleet.places import Place

UNUSABLE, INTERRUPTED = 2, 130
MANY = 10


def rows(out: Path, table: str = "logs") -> list[dict[str, Any]]:
    return load(Place(str(out)))[table].to_pylist()


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory, flight_log: Path) -> Path:
    """Logs of one flight that differ in a last byte that belongs to no message."""
    folder = tmp_path_factory.mktemp("many")
    for k in range(MANY):
        (folder / f"{k:02d}.tlog").write_bytes(flight_log.read_bytes() + bytes([k]))
    return folder


def test_a_fleet_finds_what_analyze_finds(command, flight_log, tmp_path) -> None:
    logs, out = tmp_path / "logs", tmp_path / "out"
    logs.mkdir()
    for name in ("a.tlog", "copy.tlog"):
        (logs / name).write_bytes(flight_log.read_bytes())
    (logs / "noise.tlog").write_bytes(bytes(range(256)) * 100)
    done = command("fleet", logs, "--out", out, "--jobs", 2, "--estimates", timeout=300.0)
    assert done.returncode == UNUSABLE, done.stderr
    assert done.stderr == ""
    assert [(r["status"], r["faults"]) for r in rows(out)] == [
        ("judged", 2),
        ("copy", 0),
        ("unusable", 0),
    ]
    report = out / rows(out)[0]["report"]
    assert (report.parent / "estimates" / "air.parquet").is_file()
    assert command("analyze", flight_log, "--out", tmp_path / "alone").returncode == 0
    alone = json.loads((tmp_path / "alone" / flight_log.stem / "summary.json").read_text())
    assert json.loads(report.read_text())["faults"] == alone["faults"]
    assert {f["sensor"] for f in rows(out, "faults")} == {f["sensor"] for f in alone["faults"]}


def test_ctrl_c_ends_it_cleanly_and_the_next_call_goes_on(command, many, tmp_path) -> None:
    out = tmp_path / "out"
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "monitor.cli", "fleet", str(many)),
            *("--out", str(out), "--jobs", "2"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A shell's background job ignores SIGINT and would hand that down.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 300.0
    while not list(out.rglob("outcome.json")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers get it, too
    said, complaint = process.communicate(timeout=60.0)
    assert (process.returncode, said, complaint) == (INTERRUPTED, "", "")
    done = len(rows(out))
    assert 0 < len(list(out.rglob("outcome.json"))) < MANY
    assert (out / "index.html").is_file()
    finished = command("fleet", many, "--out", out, "--jobs", 2)
    assert finished.returncode == 0, finished.stderr
    assert f"{MANY} logs" in finished.stdout
    assert (f"({done} known before)" in finished.stdout) == (done > 0)
    assert [r["status"] for r in rows(out)] == ["judged"] * MANY
