"""``mavsentry learn thresholds`` on what it cannot use, and in two processes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from links.logs import TlogWriter
from monitor import settings as configuration
from monitor.cli import invoke
from monitor.fleet.engine import Here, open_engine
from monitor.learn.runs import logs_of, measure_logs
from sim_feeds.player import frames_of, unix_us
from sim_feeds.scenario import load

DEFAULTS = configuration.load()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A healthy flight of three and a half minutes."""
    path = tmp_path_factory.mktemp("learn") / "healthy.tlog"
    flight = load("small-uav-healthy").fly()
    with TlogWriter(path) as writer:
        for t_us, frame in frames_of(flight):
            writer.write(frame, unix_us(flight, t_us))
    return path


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one sentence with which the command is refused."""
    assert invoke(["learn", "thresholds", *map(str, arguments)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (sentence,) = said.err.splitlines()
    return sentence.removeprefix("mavsentry: ")


def test_the_group_alone_shows_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["learn"]) == 0
    assert "thresholds  Fit thresholds to an airframe" in capsys.readouterr().out


def test_one_flight_is_too_little(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Path
) -> None:
    said = refused(capsys, log, "--out", tmp_path / "o.toml")
    assert said.startswith("thresholds need 3 healthy flights and 10 judged minutes of each sensor")
    assert "this flight judged " in said
    assert list(tmp_path.iterdir()) == []


def test_a_copy_and_a_part_of_a_flight_are_the_same_flight(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Path
) -> None:
    copy, part = tmp_path / "copy.tlog", tmp_path / "part.tlog"
    shutil.copy(log, copy)
    part.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    for other in (copy, part):
        said = refused(capsys, log, other, "--out", tmp_path / "o.toml")
        assert said == f"healthy.tlog and {other.name} are the same flight: give it once"


def test_what_is_no_log_or_would_be_overwritten_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Path
) -> None:
    no_log = tmp_path / "no.tlog"
    no_log.write_bytes(b"nothing that flies")
    assert str(no_log) in refused(capsys, log, no_log, "--out", tmp_path / "o.toml")
    assert "is there already" in refused(capsys, log, "--out", no_log)
    missing = tmp_path / "none.toml"
    assert str(missing) in refused(capsys, log, "--config", missing, "--out", tmp_path / "o.toml")


def test_two_processes_measure_the_same(tmp_path: Path, log: Path) -> None:
    part = tmp_path / "part.tlog"
    part.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    logs = [(source, DEFAULTS) for source in logs_of([str(part), str(log)])]
    told: list[float] = []
    one_by_one = measure_logs(Here(), logs, told.append)
    with open_engine(workers=2) as engine:
        both = measure_logs(engine, logs)
    assert [f.name for f in both] == ["part.tlog", "healthy.tlog"]
    for a, b in zip(one_by_one, both, strict=True):
        assert (a.peaks, a.levels, a.judged_s, a.sha256) == (
            b.peaks,
            b.levels,
            b.judged_s,
            b.sha256,
        )
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_a_pattern_names_logs_and_each_counts_once(tmp_path: Path, log: Path) -> None:
    named = logs_of([str(log.parent / "*.tlog"), str(log), str(log.parent)])
    assert [source.log for source in named] == [str(log)]
