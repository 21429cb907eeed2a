"""``mavsentry learn engine``: what it writes, what it refuses, and that its file is of use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from links.samples import Batch
from monitor.cli import app
from monitor.commands.common import Refused
from monitor.learn.engine import flight_of, learn_engine
from monitor.learn.engine_document import engine_document
from monitor.learn.fit import Unfit
from monitor.settings import Settings, load
from monitor.settings.engine import EngineSettings

from .engine_flights import aerosonde, batch_of


def flight(batch: Batch, name: str = "flight"):
    return flight_of([batch], Settings(), name)


def test_the_file_loads_and_says_what_was_learnt(tmp_path: Path) -> None:
    learnt = learn_engine([flight(batch_of(aerosonde(s), 2), f"f{s}") for s in (1, 2)], Settings())
    carried = {"profile": "small-uav", "air": {"margin_one": 9.0}, "engine": {"stuck_s": 6.0}}
    file = tmp_path / "engine.toml"
    file.write_text(engine_document(learnt, carried), encoding="utf-8")
    engine = load(file=file).engine
    assert engine.model == "single-shaft"
    assert engine.stuck_s == 6.0
    assert load(file=file).air.margin_one == 9.0
    assert engine.single_shaft == learnt.settings
    assert {s: c.shaft for s, c in engine.channels.items()} == {"spool0": 0, "spool1": 0}
    text = file.read_text("utf-8")
    assert "spool0 and spool1 read the same" in " ".join(text.replace("#", " ").split())
    # noise was 20 rpm, and a propeller follows throttle with a share of a second
    assert 10.0 < engine.channels["spool0"].noise_rpm < 35.0
    assert engine.single_shaft.time_constant_s < 1.0


def test_two_engines_stay_two_shafts() -> None:
    batch = batch_of(aerosonde(1), 2)
    rows = dict(batch.rows)
    rows["spool1"] = rows["spool1"].copy()
    rows["spool1"]["speed_rpm"] *= 1.05
    learnt = learn_engine([flight(Batch(rows))], Settings(engine=EngineSettings(
        throttle_channels=(3, 3))))  # fmt: skip
    assert {s: c.shaft for s, c in learnt.channels.items()} == {"spool0": 0, "spool1": 1}
    assert not learnt.alike


def test_a_speed_that_does_not_follow_the_throttle_is_refused() -> None:
    batch = batch_of(aerosonde(1), 1)
    rows = dict(batch.rows)
    r = rows["spool0"] = rows["spool0"].copy()
    r["speed_rpm"] = 2400.0 + 20.0 * np.random.default_rng(1).standard_normal(len(r))
    with pytest.raises(Unfit, match="constant-speed propeller"):
        learn_engine([flight(Batch(rows))], Settings())


def test_a_flight_with_a_dead_channel_is_refused() -> None:
    batch = batch_of(aerosonde(1), 1)
    rows = dict(batch.rows)
    r = rows["spool0"] = rows["spool0"].copy()
    r["speed_rpm"][len(r) // 2 :] = 0.0
    with pytest.raises(Unfit, match=r"no healthy flight: at .* spool0 has read 0 rpm"):
        flight(Batch(rows))


def test_the_command_learns_and_refuses_in_a_sentence(shared_data: Path, tmp_path: Path) -> None:
    log, out = shared_data / "sitl/n1_calm_nominal.tlog", tmp_path / "engine.toml"
    run = CliRunner()
    done = run.invoke(app, ["learn", "engine", str(log), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "explain 99." in done.output
    again = run.invoke(app, ["learn", "engine", str(log), "--out", str(out)])
    assert isinstance(again.exception, Refused)
    alfa = shared_data / "alfa/carbonZ_2018-07-30-16-39-00_3_no_failure.tlog"
    without = run.invoke(app, ["learn", "engine", str(alfa), "--out", str(tmp_path / "x.toml")])
    assert isinstance(without.exception, Refused)
    assert "has no engine speed in flight" in str(without.exception)
