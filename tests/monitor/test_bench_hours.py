"""A lengthened log is a log: checksums right, time running on, the same rows again."""

from pathlib import Path

import numpy as np
import pytest

from links.logs import read_tlog
from links.samples import Batch
from monitor.commands.bench import NAMES, ON_DEMAND, TOGETHER
from monitor.commands.bench_cases import hours
from monitor.commands.bench_cases.long_log import Flight, lengthen
from monitor.commands.feed import write_log
from sim_feeds.scenario import load

FLIGHT = """\
title = "Level flight"
aircraft = "small-uav"
seed = 2
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 20.0
[imu]
count = 2
rate_hz = 20.0
[airspeed]
count = 1
"""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    (folder / "flight.toml").write_text(FLIGHT)
    write_log(load(folder / "flight.toml").fly(), folder / "flight.tlog")
    return folder / "flight.tlog"


def test_a_lengthened_log_goes_on_and_has_the_same_rows_again(flight, tmp_path) -> None:
    lengthen(Flight(flight, 10.0), tmp_path / "long.tlog", 59.0)
    log = read_tlog(tmp_path / "long.tlog")
    rows = Batch.concatenate(log).rows
    once = Batch.concatenate(read_tlog(flight)).rows
    assert log.info.bad_bytes == 0
    assert log.info.duration_s == pytest.approx(60.0, abs=0.5)
    for sensor in ("imu0", "imu1", "gps0", "attitude"):
        t_us, before = rows[sensor]["t_us"], once[sensor]["t_us"]
        assert (np.diff(t_us) >= 0).all()
        lap = int((before > before[-1] - 10_000_000).sum())
        assert len(t_us) == pytest.approx(len(before) + 4 * lap, abs=4)
        np.testing.assert_allclose(t_us[-40:] - before[-40:], 40_000_000, atol=1000)
    np.testing.assert_array_equal(rows["imu0"]["acc_m_s2"][-50:], once["imu0"]["acc_m_s2"][-50:])


def test_stamps_of_two_units_stay_together_over_many_laps(flight, tmp_path) -> None:
    """RAW_IMU counts microseconds, SCALED_IMU2 milliseconds; a lap is no whole number of them."""
    lengthen(Flight(flight, 5.0005), tmp_path / "long.tlog", 120.0)
    rows = Batch.concatenate(read_tlog(tmp_path / "long.tlog")).rows
    apart = rows["imu0"]["t_us"][-50:] - rows["imu1"]["t_us"][-50:]
    at_first = rows["imu0"]["t_us"][:50] - rows["imu1"]["t_us"][:50]
    assert np.median(apart) == pytest.approx(np.median(at_first), abs=2000)


def test_a_message_may_be_left_out(flight, tmp_path) -> None:
    lengthen(Flight(flight, 10.0), tmp_path / "long.tlog", 30.0, leave_out=hours.SECOND_IMU)
    rows = Batch.concatenate(read_tlog(tmp_path / "long.tlog")).rows
    assert "imu1" not in rows
    assert len(rows["imu0"]) > 500


def test_every_case_is_known_and_the_long_one_is_made_only_on_demand(tmp_path) -> None:
    def nothing() -> Flight:
        raise AssertionError("a case was run")

    names = [case.name for case in hours.cases(tmp_path, nothing, None)]
    assert tuple(names) == NAMES["hours"] == TOGETHER["analyze"]
    assert tuple(c.name for c in hours.memory_cases(tmp_path, nothing)) == ON_DEMAND
    assert tuple(c.name for c in hours.report_cases(tmp_path, nothing)) == NAMES["report"]


def test_the_report_of_a_log_is_timed_apart_from_its_analysis(flight, tmp_path) -> None:
    pytest.importorskip("bokeh")
    taken = hours._analysed(tmp_path, Flight(flight, 10.0), 20.0, 1, report=True)
    assert taken.report_bytes > 100_000
    assert 0.0 < taken.report_cpu_s <= taken.report_s + 0.05
    assert f"its report of {taken.report_bytes / 1e6:.2f} MB in " in taken.said()
