"""A log as its report sees it, and the synthetic flight that most tests of the report look at."""

from __future__ import annotations

from pathlib import Path

from monitor.analyze import analyze_log
from monitor.recording import Estimates
from monitor.report.flight import Flight
from monitor.report.tables import MemoryTables
from monitor.settings import load

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
