"""``mavsentry fleet``: what it says, its exit status, and its dataset as others read it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from monitor.cli import invoke
from monitor.fleet.dataset import load
from monitor.fleet.engine import Engine, EngineError, Here
from monitor.fleet.places import Place

DONE, FAULT_FOUND, UNUSABLE, INTERRUPTED = 0, 1, 2, 130


@pytest.fixture
def archive(tmp_path: Path, analyses) -> Path:
    folder = tmp_path / "flights"
    for name, text in (("plane-1/a", "healthy"), ("plane-1/b", "faulty"), ("plane-2/c", "fine")):
        file = folder / f"{name}.tlog"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return folder


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Engines are this process; how they were asked for."""
    asked: list[dict[str, Any]] = []

    @contextmanager
    def opened(workers=None, scheduler=None, *, tasks=None) -> Iterator[Engine]:
        asked.append({"workers": workers, "scheduler": scheduler, "tasks": tasks})
        yield Here()

    monkeypatch.setattr("monitor.fleet.engine.open_engine", opened)
    monkeypatch.setattr("monitor.commands.fleet._compile", lambda settings: None)
    return asked


def fleet(*arguments: object) -> int:
    return invoke(["fleet", *map(str, arguments)])


def test_it_says_what_became_of_the_logs_and_where_the_results_are(
    archive, tmp_path, capsys
) -> None:
    assert fleet(archive, "--out", tmp_path / "out") == DONE
    assert capsys.readouterr().out.splitlines() == [
        "3 logs: 3 judged; 1 faults in 1 log",
        f"  {tmp_path}/out/index.html",
        f"  {tmp_path}/out/dataset/",
    ]
    assert (tmp_path / "out" / "index.html").is_file()


def test_a_second_call_starts_no_workers_for_nothing(archive, tmp_path, capsys, here) -> None:
    fleet(archive, "--out", tmp_path / "out", "--jobs", 7)
    fleet(archive, "--out", tmp_path / "out", "--jobs", 7)
    assert here == [
        {"workers": 7, "scheduler": None, "tasks": 3},
        {"workers": 0, "scheduler": None, "tasks": 0},
    ]
    assert "3 logs (3 known before): 3 judged" in capsys.readouterr().out


def test_exit_codes_are_those_of_analyze(archive, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    assert fleet(archive / "plane-2", "--out", out, "--exit-code") == DONE
    assert fleet(archive / "plane-1", "--out", out, "--exit-code") == FAULT_FOUND
    assert fleet(archive / "plane-1", "--out", out, "--exit-code") == FAULT_FOUND
    (archive / "d.tlog").write_text("junk")
    for _ in range(2):
        assert fleet(archive, "--out", out, "--exit-code") == UNUSABLE
    assert "  1 x the log holds no messages" in capsys.readouterr().out.splitlines()


def test_an_interruption_ends_with_130_and_the_next_call_goes_on(
    archive, tmp_path, capsys, analyses, monkeypatch
) -> None:
    whole = Here.run

    def interrupted(self, function, items, **options):
        yield next(whole(self, function, items, **options))
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Here, "run", interrupted)
        assert fleet(archive, "--out", tmp_path / "out") == INTERRUPTED
    assert capsys.readouterr().err == ""
    assert fleet(archive, "--out", tmp_path / "out") == DONE
    assert analyses.of == ["healthy", "faulty", "fine"]


def test_the_aircraft_is_found_in_the_path(archive, tmp_path) -> None:
    fleet(archive, "--out", tmp_path / "out", "--aircraft", r"plane-(\d)")
    logs = load(Place(str(tmp_path / "out")))["logs"]
    assert logs["aircraft"].to_pylist() == ["1", "1", "2"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--aircraft", "("], "'(' is no regular expression"),
        (["--jobs", "2", "--scheduler", "tcp://x:1"], "--jobs are processes here"),
        (["--profile", "zeppelin"], "zeppelin"),
        (["--retries", "-1"], "retries"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(archive, tmp_path, capsys, options, said) -> None:
    assert fleet(archive, "--out", tmp_path / "out", *options) == UNUSABLE
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert said in captured.err
    assert not (tmp_path / "out").exists()


def test_a_cluster_that_is_gone_is_a_sentence(archive, tmp_path, capsys, monkeypatch) -> None:
    @contextmanager
    def dead(*_: object, **__: object) -> Iterator[Engine]:
        raise EngineError("no scheduler answers at tcp://x:1: timed out")
        yield

    monkeypatch.setattr("monitor.fleet.engine.open_engine", dead)
    assert fleet(archive, "--out", tmp_path / "out", "--scheduler", "tcp://x:1") == UNUSABLE
    assert capsys.readouterr().err == ("mavsentry: no scheduler answers at tcp://x:1: timed out\n")


def test_a_folder_that_cannot_be_written_is_a_sentence(archive, tmp_path, capsys) -> None:
    (tmp_path / "blocked").write_text("")
    assert fleet(archive, "--out", tmp_path / "blocked") == UNUSABLE
    (sentence,) = capsys.readouterr().err.splitlines()
    assert sentence.startswith(f"mavsentry: cannot write to {tmp_path}/blocked")


def test_a_dataset_of_something_else_is_refused_and_left_as_it_is(
    archive, tmp_path, capsys
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = tmp_path / "out" / "dataset" / "logs" / "month=2026-03" / "part-0.parquet"
    file.parent.mkdir(parents=True)
    pq.write_table(pa.table({"log": ["x"], "colour": ["red"]}), file)
    before = file.read_bytes()
    assert fleet(archive, "--out", tmp_path / "out") == UNUSABLE
    (sentence,) = capsys.readouterr().err.splitlines()
    assert "is no part of a fleet's dataset" in sentence
    assert "take another --out" in sentence
    assert file.read_bytes() == before


def test_without_the_extra_it_says_what_to_install(archive, tmp_path, capsys, monkeypatch) -> None:
    from monitor.commands import fleet as command

    monkeypatch.setattr(command, "find_spec", lambda name: None if name == "dask" else name)
    assert fleet(archive, "--out", tmp_path / "out") == UNUSABLE
    assert capsys.readouterr().err == (
        "mavsentry: fleet needs packages that are not installed (dask): "
        "pip install 'mavsentry[fleet]'\n"
    )


def test_one_line_of_duckdb_reads_the_dataset(archive, tmp_path) -> None:
    duckdb = pytest.importorskip("duckdb")
    (archive / "d.tlog").write_text("junk")
    fleet(archive, "--out", tmp_path / "out", "--aircraft", r"plane-\d")
    faults = duckdb.sql(
        f"select aircraft, sensor, count(*) from '{tmp_path}/out/dataset/faults/*/*.parquet' "
        "group by all"
    )
    assert faults.fetchall() == [("plane-1", "airspeed0", 1)]
    logs = duckdb.sql(
        f"select month, status, reason from '{tmp_path}/out/dataset/logs/*/*.parquet' order by log"
    )
    assert logs.fetchall() == [
        ("unknown", "unusable", "the log holds no messages"),
        *[("2026-03", "judged", "")] * 3,
    ]


def test_help_loads_none_of_it() -> None:
    said = subprocess.run(
        [
            *(sys.executable, "-c"),
            "import sys; from monitor.cli import invoke; invoke(['fleet', '--help']); "
            "print([m for m in ('dask', 'distributed', 'pyarrow', 'numpy') if m in sys.modules])",
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "--scheduler" in said
    assert said.splitlines()[-1] == "[]"
