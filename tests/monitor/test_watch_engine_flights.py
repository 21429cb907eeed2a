"""The engine watch on recorded flights: RPM in the simulator's, an engine cut in a real one."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from links.logs import open_log
from links.samples import Batch
from links.vocabulary import State
from monitor.learn.engine import EngineLearnt, learn_engine, measure_engine
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.settings.engine import EngineSettings
from monitor.verdict import Verdict
from monitor.watch.engine import EngineWatch

SITL = (
    "n1_calm_nominal", "nominal", "h4_healthy_windy", "n2_windy_nominal", "f2_pitot_block_pressure",
    "f3_arspd_scale", "f5_gyro_bias", "f6_accel_bias", "f7_gps_faults", "f9_noise_and_gust",
    "h1_accz5", "h2_ramp60", "h5_pitot_autotest", "h7_icing_both",
)  # fmt: skip
CUT = "carbonZ_2018-07-30-17-36-35_engine_failure_with_emr_traj"
SOUND = (
    "carbonZ_2018-07-30-16-39-00_3_no_failure",
    "carbonZ_2018-09-11-14-41-51_elevator_failure",
)


@cache
def decoded(path: Path) -> tuple[Batch, int]:
    log = open_log(path)
    batch = Batch.concatenate(list(log))
    return batch, log.info.first_t_us


@cache
def learnt(data: Path) -> EngineLearnt:
    """From the calm flight alone."""
    return learn_engine(
        [measure_engine(data / "sitl/n1_calm_nominal.tlog", Settings())], Settings()
    )


def alarms(path: Path, engine: EngineSettings) -> list[tuple[float, Verdict]]:
    """Verdicts against a channel or an engine, by seconds from the first record."""
    batch, first_us = decoded(path)
    pipeline = Pipeline(Settings(engine=engine), watches=[EngineWatch(engine)])
    verdicts = pipeline.feed(batch).verdicts + pipeline.finish().verdicts
    engines = [v for v in verdicts if v.sensor.startswith(("spool", "engine"))]
    assert "engine0" in {v.sensor for v in engines if v.state is State.OK}
    bad = (State.FAULTY, State.STOPPED)
    return [((v.t_us - first_us) / 1e6, v) for v in engines if v.state in bad]


@pytest.mark.parametrize("name", SITL)
def test_no_engine_is_blamed_whatever_breaks_elsewhere(shared_data: Path, name: str) -> None:
    path = shared_data / f"sitl/{name}.tlog"
    assert not alarms(path, EngineSettings())
    fit = learnt(shared_data)
    model = EngineSettings(model="single-shaft", channels=fit.channels, single_shaft=fit.settings)
    assert not alarms(path, model)


def test_what_the_calm_flight_teaches(shared_data: Path) -> None:
    """The simulator's engine turns at 7000 rpm times the throttle, after a short lag."""
    fit = learnt(shared_data)
    assert list(fit.channels) == ["spool0"]
    assert fit.fit.explained > 0.99
    c0, c1, c2, c3, c4 = fit.settings.coefficients
    for throttle, speed in ((0.2, 1400.0), (0.5, 3500.0), (0.9, 6300.0)):
        model = c0 + c1 * throttle + c2 * throttle**2 + 22.0 * (c3 + c4 * throttle)
        assert model == pytest.approx(speed, abs=50.0)
    assert fit.settings.time_constant_s < 0.3


def test_the_cut_engine_is_an_event(shared_data: Path) -> None:
    """Cut at 133.4 s: the throttle output goes to idle and the autopilot cannot hold height."""
    found = alarms(shared_data / f"alfa/{CUT}.tlog", EngineSettings())
    assert [(v.sensor, v.state) for _, v in found] == [("engine0", State.STOPPED)]
    at_s, v = found[0]
    assert 133.4 < at_s < 150.0
    assert "throttle output has stood idle" in v.evidence


@pytest.mark.parametrize("name", SOUND)
def test_no_engine_event_on_the_other_real_flights(shared_data: Path, name: str) -> None:
    """One of them descends at idle throttle: wanted by its autopilot, hence no event."""
    assert not alarms(shared_data / f"alfa/{name}.tlog", EngineSettings())
