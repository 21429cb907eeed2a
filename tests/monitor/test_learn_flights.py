"""Thresholds learnt from recorded healthy flights, tried on flights that they have not seen."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from links.vocabulary import State
from monitor import settings as configuration
from monitor.cli import invoke
from monitor.learn import Flight, learn, measure_log

DEFAULTS = configuration.load()
HEALTHY = ("n1_calm_nominal", "nominal", "n2_windy_nominal", "h4_healthy_windy")
FAULTY = (
    "f2_pitot_block_pressure",
    "f3_arspd_scale",
    "f5_gyro_bias",
    "f6_accel_bias",
    "h1_accz5",
    "h2_ramp60",
    "h5_pitot_autotest",
)

Log = Callable[[str], Path]


@pytest.fixture(scope="module")
def log(shared_data: Path) -> Log:
    return lambda name: shared_data / "sitl" / f"{name}.tlog"


@pytest.fixture(scope="module")
def healthy(log: Log) -> dict[str, Flight]:
    return {name: measure_log(log(name), DEFAULTS) for name in HEALTHY}


@pytest.mark.parametrize("name", HEALTHY)
def test_a_flight_left_out_is_silent_with_what_the_others_taught(
    log: Log, healthy: dict[str, Flight], name: str
) -> None:
    learnt = learn([f for n, f in healthy.items() if n != name], DEFAULTS)
    assert measure_log(log(name), learnt.settings).alarms == ()


@pytest.mark.parametrize("name", FAULTY)
def test_faults_are_found_with_what_the_healthy_flights_taught(
    shared_data: Path, log: Log, healthy: dict[str, Flight], name: str
) -> None:
    learnt = learn(list(healthy.values()), DEFAULTS)
    expected = json.loads((shared_data / "sitl" / "expected.json").read_text())[name]["faults"]
    said = measure_log(log(name), learnt.settings).alarms
    alarms = [a for a in said if a.state is State.FAULTY]
    assert {a.sensor for a in alarms} == {s for fault in expected for s in fault["sensors"]}
    for fault in expected:
        for sensor in fault["sensors"]:
            first_s = min(a.detected_s for a in alarms if a.sensor == sensor)
            assert 0.0 <= first_s - fault["on"] < 10.0


def test_a_recorded_flight_with_a_fault_is_not_learnt_from(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Log
) -> None:
    logs = [str(log(name)) for name in ("n1_calm_nominal", "nominal", "f3_arspd_scale")]
    out = tmp_path / "sentry.toml"
    assert invoke(["learn", "thresholds", *logs, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "f3_arspd_scale.tlog is not a healthy flight: airspeed0 " in said
    assert not out.exists()


def test_the_command_writes_what_it_says_and_analyze_knows_the_flights(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, log: Log
) -> None:
    logs = [str(log(name)) for name in HEALTHY]
    out = tmp_path / "sentry.toml"
    done = invoke(["learn", "thresholds", *logs, "--out", str(out), "--airframe", "plane"])
    said = capsys.readouterr()
    assert (done, said.err) == (0, "")
    assert "4 flights, 0.3" in said.out
    loaded = configuration.load(None, out)
    assert [known.name for known in loaded.learnt.logs] == [f"{name}.tlog" for name in HEALTHY]
    assert loaded.learnt.vehicle == "system 1, ARDUPILOTMEGA, FIXED_WING"
    moved = {k for k, v in configuration.origins(None, out).items() if "learnt from" in v}
    assert moved == set(loaded.learnt.keys)
    for name, own in (("nominal", True), ("h5_pitot_autotest", False)):
        invoke(["analyze", str(log(name)), "--config", str(out), "--out", str(tmp_path)])
        note = "thresholds were learnt from this very flight: its silence proves nothing"
        assert (note in capsys.readouterr().out) is own
        summary = json.loads((tmp_path / name / "summary.json").read_text())
        assert summary["learnt"]["from_this_flight"] is own
