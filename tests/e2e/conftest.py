"""A short synthetic flight as a telemetry log, and the command as a process."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.circuit import circuit

COMMAND = (sys.executable, "-m", "monitor.cli")

SCENARIO = f"""\
title = "A minute and a half in flight: an accelerometer and a pitot break"
aircraft = "small-uav"
seed = 7

{circuit(40.0)}
[airspeed]
count = 2

[[fault]]
sensor = "imu0.acc_x"
kind = "bias"
size_m_s2 = 3.0
start_s = 45.0
end_s = 60.0

[[fault]]
sensor = "airspeed0"
kind = "bias"
size_m_s = -7.0
start_s = 70.0
"""


@pytest.fixture(scope="session")
def command():
    """Runs ``mavsentry ...`` to its end and gives what it said."""

    def run(*arguments: object, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=timeout
        )

    return run


@pytest.fixture(scope="session")
def flight_log(tmp_path_factory, command) -> Path:
    """Telemetry log of the scenario above, written by ``mavsentry feed``."""
    folder = tmp_path_factory.mktemp("flight")
    scenario = folder / "breaks.toml"
    scenario.write_text(SCENARIO)
    log = folder / "breaks.tlog"
    done = command("feed", scenario, "--to", log, "--speed", "max")
    assert done.returncode == 0, done.stderr
    return log
