"""A fleet's run: each content analyzed once, each log a row, an interruption loses nothing."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from monitor.fleet import task as task_module
from monitor.fleet.dataset import load
from monitor.fleet.engine import Here
from monitor.fleet.places import Place, report_folder
from monitor.fleet.runner import Account, judge_all
from monitor.fleet.sources import Source, expand
from monitor.fleet.tables import AircraftRule
from monitor.fleet.task import make_plan
from monitor.settings import load as load_settings

Run = Callable[..., Account]


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    folder = tmp_path / "logs"
    folder.mkdir()
    for name in ("a", "b", "c"):
        (folder / f"{name}.tlog").write_text(f"{name}: healthy")
    (folder / "d.tlog").write_text("d: faulty")
    return folder


@pytest.fixture
def run(logs: Path, tmp_path: Path, analyses) -> Run:
    def once(engine: Any = None, changes: Any = None, **options: Any) -> Account:
        settings = load_settings()
        if changes:
            settings = settings.model_copy(update=changes)
        plan = make_plan(settings, str(tmp_path / "out"), **options)
        rule, place = AircraftRule(), Place(plan.out)
        return judge_all(engine or Here(), expand([str(logs)]), plan, load(place), rule, retries=1)

    return once


def rows(tmp_path: Path, table: str = "logs") -> dict[str, dict[str, Any]]:
    """Rows of a table by the log's name."""
    read = load(Place(str(tmp_path / "out")))[table].to_pylist()
    return {Path(row["log"]).stem: row for row in read}


def test_every_log_is_a_row_that_leads_to_its_report(run, tmp_path) -> None:
    account = run()
    assert account.by_status == {"judged": 4}
    assert (account.known, account.faults, account.faulty) == (0, 1, 1)
    found = rows(tmp_path)
    assert sorted(found) == ["a", "b", "c", "d"]
    for row in found.values():
        report = json.loads((tmp_path / "out" / row["report"]).read_text())
        assert report["log"]["path"] == row["log"]
    assert rows(tmp_path, "faults")["d"]["sensor"] == "airspeed0"


def test_what_is_known_is_not_analyzed_again(run, logs, tmp_path, analyses) -> None:
    run()
    before = rows(tmp_path)
    account = run()
    assert (account.known, account.by_status) == (4, {"judged": 4})
    assert len(analyses.of) == 4
    assert rows(tmp_path) == before
    (logs / "b.tlog").write_text("b: faulty now")
    account = run()
    assert (account.known, account.faults) == (3, 2)
    assert analyses.of[4:] == ["b: faulty now"]


def test_the_same_content_under_another_name_is_not_analyzed_twice(
    run, logs, tmp_path, analyses
) -> None:
    (logs / "copy.tlog").write_text("a: healthy")
    (logs / "e.tlog").write_text("d: faulty")
    account = run()
    assert sorted(analyses.of) == ["a: healthy", "b: healthy", "c: healthy", "d: faulty"]
    assert account.by_status == {"judged": 4, "copy": 2}
    assert account.faults == 1
    assert rows(tmp_path)["e"]["copy_of"] == str(logs / "d.tlog")
    assert run().known == 6
    (logs / "a.tlog").rename(logs / "moved.tlog")
    run()
    assert len(analyses.of) == 4


def test_a_copy_whose_original_changed_stands_for_itself(run, logs, tmp_path) -> None:
    (logs / "e.tlog").write_text("d: faulty")
    run()
    (logs / "d.tlog").write_text("d: healthy after all")
    account = run()
    assert account.by_status == {"judged": 5}
    assert {name: row["faults"] for name, row in rows(tmp_path).items() if row["faults"]} == {
        "e": 1
    }
    assert list(rows(tmp_path, "faults")) == ["e"]


def test_other_settings_code_or_outputs_are_another_result(
    run, tmp_path, analyses, monkeypatch
) -> None:
    run()
    other = load_settings().streams.model_copy(update={"horizon_s": 1.0})
    assert run(changes={"streams": other}).known == 0
    assert len(analyses.of) == 8
    assert len(rows(tmp_path)) == 4
    monkeypatch.setattr(task_module, "code_version", lambda: "another")
    task_module._key.cache_clear()
    try:
        assert run(changes={"streams": other}).known == 0
    finally:
        task_module._key.cache_clear()
    assert len(analyses.of) == 12


def test_again_means_all_of_them(run, analyses) -> None:
    run()
    assert run(again=True).known == 0
    assert len(analyses.of) == 8


def test_a_hundred_corrupt_logs_are_a_hundred_rows(run, logs, tmp_path, analyses) -> None:
    for k in range(100):
        (logs / f"x{k}.tlog").write_text(f"junk {k}")
    account = run()
    assert account.by_status == {"judged": 4, "unusable": 100}
    assert account.reasons == {"the log holds no messages": 100}
    found = [row for name, row in rows(tmp_path).items() if name.startswith("x")]
    assert {(row["status"], row["reason"]) for row in found} == {
        ("unusable", "the log holds no messages")
    }
    assert len(found) == 100
    assert run().known == 104
    assert len(analyses.of) == 104


def test_a_mistake_of_ours_is_one_row_and_is_not_tried_twice_in_a_run(
    run, logs, tmp_path, analyses
) -> None:
    (logs / "m.tlog").write_text("mistake")
    assert run().by_status == {"judged": 4, "failed": 1}
    assert analyses.of.count("mistake") == 1
    reason = rows(tmp_path)["m"]["reason"]
    assert reason.startswith("mavsentry failed on it (IndexError in conftest.py, line ")
    account = run()
    assert (account.known, account.by_status["failed"]) == (4, 1)
    assert analyses.of.count("mistake") == 2


def test_what_cannot_be_read_is_tried_again_and_then_a_row(run, logs, tmp_path, analyses) -> None:
    (logs / "u.tlog").write_text("unreadable")
    assert run().by_status == {"judged": 4, "failed": 1}
    assert analyses.of.count("unreadable") == 2
    assert rows(tmp_path)["u"]["reason"] == "cannot read or write: Input/output error"


def test_a_log_that_takes_too_long_is_given_up(run, tmp_path) -> None:
    assert run(limit_s=-1.0).by_status == {"failed": 4}
    assert rows(tmp_path)["a"]["reason"] == "gave up after -1 s, 50 % of it read"


class Interrupted(Here):
    """An engine that is interrupted after so many logs."""

    def __init__(self, after: int) -> None:
        self._after = after

    def run(self, function, items, **options) -> Iterator:
        for k, ended in enumerate(super().run(function, items, **options)):
            if k == self._after:
                raise KeyboardInterrupt
            yield ended


def test_an_interruption_keeps_what_was_done_and_the_next_run_goes_on(
    run, tmp_path, analyses
) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(Interrupted(2))
    assert sorted(rows(tmp_path)) == ["a", "b"]
    account = run()
    assert (account.known, account.by_status) == (2, {"judged": 4})
    assert analyses.of == ["a: healthy", "b: healthy", "c: healthy", "d: faulty"]


def test_outcomes_outlive_the_process_that_collects_them(run, tmp_path, analyses) -> None:
    """The dataset is written at the end; what died before that is taken up by content."""
    run()
    for file in (tmp_path / "out" / "dataset").rglob("*.parquet"):
        file.unlink()
    assert run().by_status == {"judged": 4}
    assert len(analyses.of) == 4


def test_a_damaged_outcome_is_made_again(run, tmp_path, analyses) -> None:
    run()
    row = rows(tmp_path)["a"]
    outcome = tmp_path / "out" / report_folder(row["sha256"]) / "outcome.json"
    outcome.write_text(outcome.read_text()[:100])
    for file in (tmp_path / "out" / "dataset").rglob("*.parquet"):
        file.unlink()
    run()
    assert analyses.of[4:] == ["a: healthy"]


def test_a_worker_with_another_mavsentry_judges_nothing(run, tmp_path, monkeypatch) -> None:
    whole = task_module.judge

    def elsewhere(task):
        monkeypatch.setattr(task_module, "code_version", lambda: "0.0.1")
        task_module._key.cache_clear()
        try:
            return whole(task)
        finally:
            monkeypatch.undo()
            task_module._key.cache_clear()

    monkeypatch.setattr("monitor.fleet.runner.judge", elsewhere)
    assert run().by_status["failed"] >= 1
    assert rows(tmp_path)["a"]["reason"] == "the worker runs another mavsentry, 0.0.1"


def test_results_and_logs_may_lie_behind_urls(analyses) -> None:
    import fsspec

    system = fsspec.filesystem("memory")
    for name, text in (("a", "healthy"), ("b", "faulty"), ("c", "junk")):
        system.pipe_file(f"/runner-test/{name}.tlog", text.encode())
    plan = make_plan(load_settings(), "memory://runner-test/out")
    place, sources = Place(plan.out), expand(["memory://runner-test"])
    assert [s.name for s in sources] == ["a.tlog", "b.tlog", "c.tlog"]
    account = judge_all(Here(), sources, plan, load(place), AircraftRule())
    assert account.by_status == {"judged": 2, "unusable": 1}
    logs = load(place)["logs"].to_pylist()
    assert [row["faults"] for row in logs] == [0, 1, 0]
    assert all(system.exists(f"/runner-test/out/{row['report']}") for row in logs[:2])
    assert judge_all(Here(), sources, plan, load(place), AircraftRule()).known == 3
    assert len(analyses.of) == 3


def test_a_copy_waits_for_its_original_alone(logs) -> None:
    from monitor.fleet.runner import _tasks

    sources = [Source("x", 5, "1"), Source("y", 7, "1"), Source("z", 5, "1")]
    twins = {t.source.log: t.twin for t in _tasks(sources, make_plan(load_settings(), "out"))}
    assert twins == {"x": True, "y": False, "z": True}


def test_a_file_name_that_is_no_text_is_a_row_like_any_other(run, logs, tmp_path) -> None:
    name = os.fsdecode(b"caf\xe9-2026-05-03.tlog")
    try:
        (logs / name).write_text("faulty, too")
    except OSError:
        pytest.skip("this file system takes no such name")
    assert run().by_status["judged"] == 5
    row = rows(tmp_path)["caf\\udce9-2026-05-03"]
    assert (row["faults"], row["month"]) == (1, "2026-03")
    assert "caf\\udce9-2026-05-03.tlog" in (tmp_path / "out" / "index.html").read_text("utf-8")
    assert run().known == 5
