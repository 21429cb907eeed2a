"""``mavsentry reproduce``: what is typed, written and said."""

import json

import pytest

from monitor.cli import invoke
from monitor.commands.reproduce import store
from monitor.commands.reproduce.command import Which, _print_table
from monitor.commands.reproduce.papers import KEYS, paper_of
from monitor.commands.reproduce.store import Store
from monitor.commands.reproduce.study import Scope, Table

UNUSABLE = 2


def test_units_are_seen_on_a_terminal(capsys):
    table = Table("t", "Errors [kt], medians", ["run", "delay [s] ours", "paper"], [["a", 1.0, 2]])
    _print_table(table)
    said = capsys.readouterr().out
    assert "Errors [kt], medians" in said
    assert "delay [s] ours" in said


def test_every_paper_can_be_asked_for():
    assert [which.value for which in Which] == [*KEYS, "all"]


def test_all_papers_quickly(quickly, quick_dir, capsys):
    """The whole quick version, over the results that the papers' own tests made."""
    for key in KEYS:
        quickly(key)
    assert invoke(["reproduce", "all", "--quick", "--out", str(quick_dir), "--jobs", "1"]) == 0
    said = capsys.readouterr()
    assert "results were there already" in said.err
    document = json.loads((quick_dir / "tables.json").read_text())
    assert list(document["papers"]) == list(KEYS)
    page = (quick_dir / "report.html").read_text(encoding="utf-8")
    for key, paper in document["papers"].items():
        assert f'id="{key}"' in page
        assert paper["claims"], key
        assert paper["tables"], key
        assert paper["title"] in said.out.replace("\n", " ")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["wan2019"], "'wan2019' is not one of"),
        (["wang2020", "--flights", "nowhere"], "no such folder: nowhere"),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path, capsys, arguments, sentence):
    assert invoke(["reproduce", *arguments, "--out", str(tmp_path / "o")]) == UNUSABLE
    assert sentence in capsys.readouterr().err


def test_results_of_other_code_that_do_not_fit(quickly, tmp_path, capsys, monkeypatch):
    """``--redraw`` takes them up; what a chapter then misses is one sentence."""
    results, _ = quickly("wang2020")
    kept = Store(tmp_path / "o" / "results-quick")
    monkeypatch.setattr(store, "code_digest", lambda: "older")
    for job in paper_of("wang2020").jobs(Scope(quick=True)):
        kept.keep(job, {k: v for k, v in results[job.name].items() if k != "observable"}, 1.0)
    monkeypatch.undo()
    again = ["reproduce", "wang2020", "--quick", "--redraw", "--out", str(tmp_path / "o")]
    assert invoke(again) == UNUSABLE
    assert "without --redraw they are made anew" in capsys.readouterr().err


def test_an_output_that_is_a_file(tmp_path, capsys):
    (tmp_path / "o").write_text("")
    assert invoke(["reproduce", "wang2020", "--out", str(tmp_path / "o")]) == UNUSABLE
    assert "cannot make" in capsys.readouterr().err


def test_a_missing_extra_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("monitor.commands.reproduce.command.NEEDED", ("not_installed_here",))
    assert invoke(["reproduce", "wang2020", "--out", str(tmp_path / "o")]) == UNUSABLE
    assert "pip install 'mavsentry[reproduce]'" in capsys.readouterr().err
