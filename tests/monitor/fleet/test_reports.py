"""``mavsentry fleet --reports``: reports of the flights that are asked for, and links to them."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.commands.feed import write_log
from monitor.fleet.places import report_folder
from monitor.fleet.reports import Reports
from monitor.fleet.sources import expand
from monitor.fleet.tables import AircraftRule, rows_of
from monitor.fleet.task import Task, judge, make_plan
from monitor.settings import load as load_settings
from sim_feeds.scenario import load

pytest.importorskip("bokeh")

FLIGHT = """\
title = "An accelerometer is off"
aircraft = "small-uav"
seed = 3
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 40.0
[imu]
count = 2
rate_hz = 50.0
[airspeed]
count = 2
"""
FAULT = """\
[[fault]]
sensor = "imu1.acc_y"
kind = "bias"
size_m_s2 = 4.0
start_s = 20.0
"""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("logs")
    for name, text in (("healthy", FLIGHT), ("faulty", FLIGHT + FAULT)):
        (folder / f"{name}.toml").write_text(text)
        write_log(load(folder / f"{name}.toml").fly(), folder / f"{name}.tlog")
    return {name: folder / f"{name}.tlog" for name in ("healthy", "faulty")}


@pytest.mark.parametrize(
    ("reports", "estimates", "expected"),
    [
        (Reports.NONE, False, {"healthy": [], "faulty": []}),
        (Reports.FOUND, False, {"healthy": [], "faulty": ["report.html"]}),
        (Reports.ALL, True, {"healthy": ["report.html"], "faulty": ["report.html"]}),
    ],
)
def test_reports_are_of_the_flights_that_are_asked_for(
    logs, tmp_path, reports, estimates, expected
) -> None:
    plan = make_plan(load_settings(), str(tmp_path / "out"), reports=reports, estimates=estimates)
    for name, log in logs.items():
        (source,) = expand([str(log)])
        outcome = judge(Task(source, plan))
        assert outcome["status"] == "judged", outcome["reason"]
        assert bool(outcome["faults"]) == (name == "faulty")
        folder = tmp_path / "out" / report_folder(outcome["sha256"])
        written = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
        assert written == {"outcome.json", *outcome["files"]}
        assert [f for f in outcome["files"] if f.endswith(".html")] == expected[name]
        assert ("estimates/air.parquet" in written) == estimates
        (row,) = rows_of(outcome, source, AircraftRule(None))["logs"]
        linked = (expected[name] or ["summary.json"])[0]
        assert row["report"] == f"{report_folder(outcome['sha256'])}/{linked}"
        assert (tmp_path / "out" / row["report"]).is_file()
        again = judge(Task(source, plan))
        assert again == outcome


def test_flights_that_are_known_are_judged_again_when_other_reports_are_asked_for() -> None:
    keys = {make_plan(load_settings(), "out", reports=r).key for r in Reports}
    assert len(keys) == len(Reports)
