"""What the self-test measures and what it says of it; `tests/packaging` runs all of it."""

import tomllib

import pytest

from monitor.analyze import analyze_log
from monitor.commands import selftest
from monitor.commands.machine_speed import EXTRAS, live_cost, missing_extras
from monitor.commands.warmup import compile_jobs
from monitor.settings import load
from tests.conftest import ROOT


def result(share=0.05, **others):
    return {"live": {"processor_share": share}, "machine": {"cores": 4}, "passed": True, **others}


def test_a_live_flight_costs_its_parts(flight_log):
    settings = load()
    duration_s = analyze_log(flight_log, settings).summary["log"]["duration_s"]
    cost = live_cost(flight_log, duration_s, settings)
    assert set(cost.parts) == {"decode", "other", "imu", "air", "engine", "wing"}
    assert 0.0 < cost.share < selftest.TOO_SLOW
    assert sum(cost.parts.values()) == pytest.approx(cost.share, rel=0.8)
    assert cost.seconds == pytest.approx(min(20.0, duration_s / 2), abs=0.1)
    assert cost.messages_hz > 50


@pytest.mark.parametrize(
    ("told", "says"),
    [
        (result(), "PASS: it works here, and leaves 95% of one of its 4 processors"),
        (result(0.7), "PASS, narrowly"),
        (result(0.95), "FAIL: this machine is too slow"),
        (result(passed=False), "FAIL: what is marked above"),
    ],
)
def test_the_verdict_is_a_sentence(told, says):
    assert selftest._verdict(told).startswith(says)


def test_parts_are_told_largest_first_in_percent_of_all():
    assert selftest._shares({"air": 0.01, "imu": 0.03}, 0.04) == "imu 75%, air 25%"


def test_the_extras_are_those_of_the_package(monkeypatch):
    with (ROOT / "pyproject.toml").open("rb") as file:
        extras = tomllib.load(file)["project"]["optional-dependencies"]
    names = {"prometheus_client": "prometheus-client", "serial": "pyserial"}
    for extra, (modules, _) in EXTRAS.items():
        needed = {text.partition(">")[0] for text in extras[extra]}
        assert needed == {names.get(module, module) for module in modules}
    there = {"serial": None}
    monkeypatch.setattr(
        "monitor.commands.machine_speed.find_spec", lambda name: there.get(name, name)
    )
    assert missing_extras() == ["serial"]


def test_kernels_are_compiled_by_as_many_as_there_is_memory_for(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    for free_mb, jobs in ((300.0, 1), (2500.0, 2), (8000.0, 4), (float("inf"), 4)):
        monkeypatch.setattr("monitor.commands.warmup._free_mb", lambda mb=free_mb: mb)
        assert compile_jobs(4) == jobs


def test_warming_up_where_nothing_can_be_kept_is_refused_before_it_takes_minutes(
    command, tmp_path, monkeypatch
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("MAVSENTRY_CACHE_DIR", str(tmp_path / "file" / "kernels"))
    done = command("warmup")
    assert done.returncode == 2
    (sentence,) = done.stderr.splitlines()
    assert "Not a directory" in sentence
    assert "MAVSENTRY_CACHE_DIR" in sentence
