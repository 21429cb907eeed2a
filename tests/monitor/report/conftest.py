"""Flights as a report sees them: one of a synthetic feed, and those recorded, each read once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from monitor.analyze import analyze_log
from monitor.commands.feed import write_log
from monitor.recording import Estimates
from monitor.report.flight import Flight
from monitor.report.tables import MemoryTables
from monitor.settings import load
from sim_feeds.scenario import load as load_scenario

SCENARIO = """\
title = "A pitot reads low for half a minute, then an accelerometer is off"
aircraft = "small-uav"
seed = 11
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 60.0
[[leg]]
do = "turn"
angle_deg = 360.0
[[leg]]
do = "level"
duration_s = 60.0
[imu]
count = 2
rate_hz = 50.0
[airspeed]
count = 2
[[fault]]
sensor = "airspeed0"
kind = "scale"
fraction = -0.4
start_s = 70.0
end_s = 100.0
[[fault]]
sensor = "imu0.acc_x"
kind = "bias"
size_m_s2 = 3.0
start_s = 120.0
"""


def analysed(log: Path, profile: str | None = None) -> Flight:
    """A log as its report sees it, with all tables in memory."""
    settings, estimates = load(profile), Estimates()
    analysis = analyze_log(log, settings, sink=estimates)
    return Flight(analysis.summary, settings, analysis.verdicts, MemoryTables(estimates.joined()))


@pytest.fixture(scope="session")
def synthetic_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Telemetry log of three minutes: 50 Hz IMUs, a pitot 40 % low at 70 s, acc_x off at 120 s."""
    folder = tmp_path_factory.mktemp("synthetic")
    (folder / "flight.toml").write_text(SCENARIO)
    write_log(load_scenario(folder / "flight.toml").fly(), folder / "flight.tlog")
    return folder / "flight.tlog"


@pytest.fixture(scope="session")
def flight(synthetic_log: Path) -> Flight:
    """The synthetic flight, analysed."""
    return analysed(synthetic_log)


@pytest.fixture(scope="session")
def recorded(shared_data: Path) -> Callable[[str], Flight]:
    """Analyses a log of the shared data once: ``recorded("sitl/f5_gyro_bias.tlog")``."""

    @cache
    def flight_of(name: str) -> Flight:
        if not (shared_data / name).is_file():
            pytest.skip(f"no {name} in the shared data")
        return analysed(shared_data / name)

    return flight_of
