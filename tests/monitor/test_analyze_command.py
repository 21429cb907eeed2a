"""``mavsentry analyze``: what it writes where, several logs at once, what it says of bad ones."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from monitor.cli import invoke
from monitor.commands import analyze as command
from monitor.commands.feed import write_log
from sim_feeds.scenario import load

UNUSABLE, INTERRUPTED = 2, 130

FLIGHT = """\
title = "Half a minute in the air, a pitot breaks"
aircraft = "small-uav"
seed = 3
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
duration_s = 12.0
[airspeed]
count = 2
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("log")
    (folder / "flight.toml").write_text(FLIGHT)
    write_log(load(folder / "flight.toml").fly(), folder / "flight.tlog")
    return folder / "flight.tlog"


def analyze(*arguments: object) -> int:
    return invoke(["analyze", *map(str, arguments)])


def test_estimates_are_written_beside_the_summary_and_as_text_if_asked(log, tmp_path) -> None:
    assert analyze(log, "--out", tmp_path) == 0
    estimates = tmp_path / "flight" / "estimates"
    assert {p.suffix for p in estimates.iterdir()} <= {".parquet"}
    assert analyze(log, "--out", tmp_path, "--csv") == 0
    assert {"air.csv", "imu0.csv"} <= {p.name for p in estimates.iterdir()}
    summary = json.loads((tmp_path / "flight" / "summary.json").read_text())
    assert summary["made_by"]["profile"] == "small-uav"
    assert summary["made_by"]["changed"] == {}
    assert not any(summary["left_out"].values())
    assert "live" not in summary


def test_a_report_is_written_and_named_unless_told_otherwise(log, tmp_path, capsys) -> None:
    folder = tmp_path / "flight"
    assert analyze(log, "--out", tmp_path) == 0
    report = folder / "report.html"
    assert report.stat().st_mtime_ns > (folder / "summary.json").stat().st_mtime_ns
    assert "<title>" in report.read_text("utf-8")
    said = capsys.readouterr()
    assert said.out.splitlines()[-2:] == [f"  {folder / 'summary.json'}", f"  {report}"]
    assert said.err == ""
    assert {"measured_imu0.parquet", "measured_airspeed1.parquet"} <= {
        p.name for p in (folder / "estimates").iterdir()
    }
    # the report of another analysis is none of this one
    assert analyze(log, "--out", tmp_path, "--no-report") == 0
    assert not report.exists()
    assert capsys.readouterr().out.splitlines()[-1] == f"  {folder / 'summary.json'}"


def test_without_the_extra_there_is_a_sentence_instead_of_a_report(
    log, tmp_path, capsys, monkeypatch
) -> None:
    monkeypatch.setattr("monitor.analyze.REPORT_PACKAGES", ("bokeh", "no_such_package"))
    assert analyze(log, "--out", tmp_path) == 0
    (sentence,) = capsys.readouterr().err.splitlines()
    assert sentence.startswith("mavsentry: no report: `pip install mavsentry[report]` adds")
    assert not (tmp_path / "flight" / "report.html").exists()
    assert analyze(log, "--out", tmp_path, "--no-report") == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device"),
            UNUSABLE,
            "No space left on device; --out names another folder",
        ),
        (KeyboardInterrupt(), INTERRUPTED, ""),
    ],
)
def test_a_full_disk_or_ctrl_c_leaves_no_half_report(
    log, tmp_path, capsys, monkeypatch, error, status, said
) -> None:
    whole = Path.write_text

    def cut_short(self, text, *arguments, **named):
        if "report" in self.name:
            whole(self, text[:1000], *arguments, **named)
            raise error
        return whole(self, text, *arguments, **named)

    monkeypatch.setattr(Path, "write_text", cut_short)
    assert analyze(log, "--out", tmp_path) == status
    folder = tmp_path / "flight"
    sentence = f"mavsentry: cannot write to {folder}: {said}\n" if said else ""
    assert capsys.readouterr().err == sentence
    assert {p.name for p in folder.iterdir()} == {"summary.json", "estimates"}


def test_a_report_that_fails_costs_no_verdict(log, tmp_path, capsys, monkeypatch) -> None:
    import monitor.report

    def fails(folder, flight):
        raise KeyError("x")

    monkeypatch.setattr(monitor.report, "write_report", fails)
    assert analyze(log, "--out", tmp_path) == UNUSABLE
    said = capsys.readouterr()
    assert "messages" in said.out
    (sentence,) = said.err.splitlines()
    assert sentence.startswith(
        f"mavsentry: {log} has no report: mavsentry failed on it (KeyError in "
    )
    assert (tmp_path / "flight" / "summary.json").is_file()


def test_the_summary_says_what_differs_from_the_profile(log, tmp_path) -> None:
    config = tmp_path / "sentry.toml"
    config.write_text("[streams]\nhorizon_s = 1.0\n")
    assert analyze(log, "--out", tmp_path, "--config", config) == 0
    summary = json.loads((tmp_path / "flight" / "summary.json").read_text())
    assert summary["made_by"]["changed"] == {"streams.horizon_s": 1.0}


@pytest.mark.parametrize("jobs", [1, 2])
def test_of_several_logs_each_is_said_in_its_turn(log, tmp_path, capsys, jobs) -> None:
    logs = []
    for name in ("b", "a", "c"):
        logs.append(tmp_path / f"{name}.tlog")
        logs[-1].write_bytes(log.read_bytes())
    empty, none, folder = tmp_path / "empty.tlog", tmp_path / "none.tlog", tmp_path / "folder"
    empty.write_bytes(b"")
    folder.mkdir()
    order = [logs[0], empty, logs[1], none, folder, logs[2]]
    assert analyze(*order, "--out", tmp_path / "out", "--jobs", jobs) == UNUSABLE
    said = capsys.readouterr()
    assert [line.partition(":")[0] for line in said.out.splitlines() if "messages" in line] == [
        str(x) for x in logs
    ]
    assert said.err.splitlines() == [
        f"mavsentry: {empty} is empty: whoever recorded it wrote nothing "
        "(disk full, switched off at once?)",
        f"mavsentry: cannot read {none}: No such file or directory",
        f"mavsentry: {folder} is a folder: name the logs in it (there is none)",
    ]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["a", "b", "c"]


def test_logs_of_one_name_do_not_overwrite_each_other(log, tmp_path) -> None:
    same = [tmp_path / "one" / "flight.tlog", tmp_path / "two" / "flight.tlog"]
    other = tmp_path / "flight.log.tlog"
    for file in (*same, other):
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(log.read_bytes())
    assert analyze(*same, other, same[0], "--out", tmp_path / "out") == 0
    written = {
        json.loads(p.read_text())["log"]["path"]: p.parent.name
        for p in (tmp_path / "out").glob("*/summary.json")
    }
    assert set(written) == {str(p) for p in (*same, other)}
    assert written[str(other)] == "flight.log"


def test_a_log_and_its_sibling_of_another_format_have_folders_of_their_own(tmp_path) -> None:
    folders = command._folders([Path("x/f6.tlog"), Path("x/f6.BIN"), Path("y/f7.tlog")], tmp_path)
    assert [f.name for f in folders] == ["f6.tlog", "f6.BIN", "f7"]


def test_a_folder_that_cannot_be_written_is_said_once(log, tmp_path, capsys) -> None:
    other = tmp_path / "other.tlog"
    other.write_bytes(log.read_bytes())
    blocked = tmp_path / "blocked"
    blocked.write_text("")
    assert analyze(log, other, "--out", blocked) == UNUSABLE
    (sentence,) = capsys.readouterr().err.splitlines()
    assert sentence.startswith(f"mavsentry: cannot write to {blocked / 'flight'}")


def test_a_log_that_may_not_be_read_is_refused(log, tmp_path, capsys, monkeypatch) -> None:
    file = tmp_path / "secret.tlog"
    file.write_bytes(log.read_bytes())
    file.chmod(0)
    if os.geteuid() == 0:  # who may read everything
        before = open

        def forbidden(path, *arguments, **named):
            if Path(path) == file:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            return before(path, *arguments, **named)

        monkeypatch.setattr("builtins.open", forbidden)
    assert analyze(file, "--out", tmp_path / "out") == UNUSABLE
    assert capsys.readouterr().err == f"mavsentry: cannot read {file}: Permission denied\n"


def test_a_mistake_of_ours_costs_one_log_and_says_where_it_was(
    log, tmp_path, capsys, monkeypatch
) -> None:
    import monitor.analyze

    whole = monitor.analyze.analyze_into

    def fails_once(folder, path, *arguments, **named):
        if path.name == "first.tlog":
            raise IndexError("list index out of range")
        return whole(folder, path, *arguments, **named)

    monkeypatch.setattr(monitor.analyze, "analyze_into", fails_once)
    first = tmp_path / "first.tlog"
    first.write_bytes(log.read_bytes())
    assert analyze(first, log, "--out", tmp_path / "out") == UNUSABLE
    said = capsys.readouterr()
    assert "messages" in said.out
    (sentence,) = said.err.splitlines()
    assert sentence.startswith(f"mavsentry: {first}: mavsentry failed on it (IndexError in ")
    assert "Traceback" not in sentence


def alive(group: int) -> bool:
    """Whether a process of the group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_ctrl_c_leaves_nothing_unfinished_and_no_process(log, tmp_path) -> None:
    logs = [tmp_path / "a.tlog", tmp_path / "b.tlog"]
    for file in logs:
        file.write_bytes(400 * log.read_bytes())
    out = tmp_path / "out"
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "monitor.cli", "analyze", *logs),
            *("--jobs", "2", "--out", str(out)),
        ],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A shell's background job ignores SIGINT and would hand that down.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 60.0
    while not list(out.rglob("*.unfinished")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert process.poll() is None
    os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=20.0)
    assert (process.returncode, said) == (INTERRUPTED, "")
    assert [p for p in out.rglob("*") if p.is_file()] == []
    while alive(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(process.pid)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("photo.tlog", b"\x89PNG\r\n" * 4000),
        ("zeros.tlog", bytes(50_000)),
        ("text.tlog", b"nothing but words, " * 4000),
        ("one.tlog", b"\xfd"),
    ],
)
def test_what_is_no_log_is_refused_in_one_sentence(tmp_path, capsys, name, content) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    assert analyze(file, "--out", tmp_path / "out") == UNUSABLE
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert str(file) in said.err
    assert not (tmp_path / "out").exists()
