"""Jobs, their results on disk, the report: with a small paper made for the purpose."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from monitor.commands.reproduce import engine, store
from monitor.commands.reproduce.drawing import svg, thinned
from monitor.commands.reproduce.engine import run_jobs
from monitor.commands.reproduce.render import Stamp, _alignment, shown, write
from monitor.commands.reproduce.store import Store
from monitor.commands.reproduce.study import Chapter, Claim, Figure, Job, Table, Text

JOBS = [Job("toy2000", f"square/{i}", {"x": i}, seed=i) for i in range(4)]
STAMP = Stamp("1.2.3", ("abc",), 7, True, {"toy2000": 1.5})


def square(job):
    x = job.what["x"]
    return {"square": x * x, "line": np.arange(x, dtype=float), "deep": {"words": ["a", None]}}


@pytest.fixture
def calls(monkeypatch):
    made = []

    def perform(job):
        made.append(job.name)
        return square(job)

    monkeypatch.setattr(engine, "perform", perform)
    return made


def nothing(fraction):
    pass


def test_results_come_back_as_they_went(tmp_path, calls):
    done = run_jobs(JOBS, Store(tmp_path), 1, nothing)
    found = done.results["toy2000"]
    assert [found[job.name]["square"] for job in JOBS] == [0, 1, 4, 9]
    np.testing.assert_array_equal(found["square/3"]["line"], [0.0, 1.0, 2.0])
    assert found["square/2"]["deep"] == {"words": ["a", None]}


def test_a_second_run_takes_up_what_the_first_left(tmp_path, calls):
    run_jobs(JOBS[:3], Store(tmp_path), 1, nothing)
    told = []
    done = run_jobs(JOBS, Store(tmp_path), 1, told.append)
    assert done.taken == 3
    assert calls == [job.name for job in JOBS]
    assert told == [0.75, 1.0]


@pytest.mark.parametrize(
    "other", [replace(JOBS[1], seed=9), replace(JOBS[1], what={"x": 5})], ids=["seed", "what"]
)
def test_another_job_of_that_name_is_done_again(tmp_path, calls, other):
    run_jobs([JOBS[1]], Store(tmp_path), 1, nothing)
    done = run_jobs([other], Store(tmp_path), 1, nothing)
    assert done.taken == 0
    assert done.results["toy2000"]["square/1"]["square"] == other.what["x"] ** 2


def test_results_of_other_code_are_taken_only_when_asked(tmp_path, calls, monkeypatch):
    run_jobs(JOBS, Store(tmp_path), 1, nothing)
    monkeypatch.setattr(store, "code_digest", lambda: "changed")
    assert Store(tmp_path).take(JOBS[0]) is None
    done = run_jobs(JOBS, Store(tmp_path), 1, nothing, any_code=True)
    assert done.taken == len(JOBS)
    assert "changed" not in done.codes


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 cut"])
def test_a_broken_file_is_no_result(tmp_path, calls, content):
    kept = Store(tmp_path)
    run_jobs(JOBS[:1], kept, 1, nothing)
    kept.path(JOBS[0]).write_bytes(content)
    assert kept.take(JOBS[0]) is None
    assert run_jobs(JOBS[:1], kept, 1, nothing).taken == 0


def test_no_changed_byte_gets_through_or_raises(tmp_path, calls):
    kept, job = Store(tmp_path), JOBS[3]
    run_jobs([job], kept, 1, nothing)
    whole = kept.path(job).read_bytes()
    for at in range(0, len(whole), 3):
        kept.path(job).write_bytes(whole[:at] + bytes([whole[at] ^ 0x14]) + whole[at + 1 :])
        found = kept.take(job)  # a byte that says nothing, as a time of day, may change
        assert found is None or found.result["square"] == 9


def test_a_failure_names_its_job(tmp_path, monkeypatch):
    def perform(job):
        raise ValueError("no such wind")

    monkeypatch.setattr(engine, "perform", perform)
    with pytest.raises(RuntimeError, match=r"toy2000/square/0 failed: .*no such wind"):
        run_jobs(JOBS, Store(tmp_path), 1, nothing)


def test_thinning_keeps_every_peak():
    t = np.arange(100_000.0)
    y = np.zeros_like(t)
    peaks = [17, 50_003, 99_999]
    y[peaks] = [3.0, -2.0, 1.0]
    short_t, short = thinned(t, y)
    assert len(short) <= 2000
    assert set(peaks) <= set(short_t.astype(int))
    assert np.all(np.diff(short_t) >= 0)


def line(canvas):
    canvas.subplots().plot([0, 1], [0, 1])


CHAPTER = Chapter(
    title="A toy",
    reference="Nobody, 2000",
    summary="First part with `code`.\n\nSecond <part>.",
    blocks=[
        Text("Squares", "What they are."),
        Table(
            "toy-squares",
            "Squares & more",
            ["x [m]", "ours", "paper", "why they differ"],
            [[1, 1.0, 1.1, "rounded"], [2, float("nan"), None, "not printed"]],
        ),
        Figure("toy-line", "A line", line),
    ],
    claims=[Claim("Squares grow", "holds", "They do: 4 > 1.")],
)


def test_the_report_is_whole_and_alone(tmp_path):
    page = write({"toy2000": CHAPTER}, STAMP, tmp_path).read_text(encoding="utf-8")
    assert "Second &lt;part&gt;." in page
    assert "<code>code</code>" in page
    assert "✓ holds" in page
    assert STAMP.line() in page
    loaded = re.findall(r"""(?:src|href)=["']?([^"'\s>]+)""", page)
    assert loaded
    assert all(link.startswith(("#", "data:")) for link in loaded)
    assert "<script" not in page
    assert "url(" not in page


def test_tables_are_written_with_seed_and_version(tmp_path):
    write({"toy2000": CHAPTER}, STAMP, tmp_path)
    first, *rest = (tmp_path / "tables" / "toy-squares.csv").read_text().splitlines()
    assert first == f"# {STAMP.line()}"
    assert "1.2.3" in first
    assert "seed 7" in first
    rows = list(csv.reader(rest))
    assert rows[0] == ["x [m]", "ours", "paper", "why they differ"]
    assert rows[1] == ["1", "1.0", "1.1", "rounded"]
    document = json.loads((tmp_path / "tables.json").read_text())
    assert (document["version"], document["seed"]) == ("1.2.3", 7)
    table = document["papers"]["toy2000"]["tables"][0]
    assert table["rows"][1] == [2, None, None, "not printed"]


def test_a_figure_is_the_same_every_time():
    figure = CHAPTER.blocks[2]
    assert svg(figure) == svg(figure)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0"),
        (3, "3"),
        (True, "yes"),
        (12.3456, "12.3"),
        (0.012345, "0.0123"),
        (123456.7, "123457"),
        (1.23456e-9, "1.23e-09"),
        (float("nan"), "–"),
        ("word", "word"),
    ],
)
def test_cells(value, text):
    assert shown(value, 3) == text


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(ValueError, match="2 cells under 1 columns"):
        Table("t", "c", ["a"], [[1, 2]])


def test_numbers_stand_right_and_sentences_have_room():
    table = Table("t", "c", ["n", "w", "mixed", "none", "said"], [[1, "a", None, None, "x" * 60]])
    assert _alignment(table) == ["number", "", "", "", "long"]
    assert _alignment(Table("t", "c", ["a", "b"], [])) == ["", ""]
