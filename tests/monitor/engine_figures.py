"""What the engine watch reaches on the Aerosonde in wind, over seeds, from MAVLink on.

``python -m tests.monitor.engine_figures [--seeds N]`` learns the engine on three healthy flights
and prints what it finds on others: healthy ones, one intermittent and one dead sensor of three, an
engine that stops; with the learnt model and without any.
"""

from __future__ import annotations

import argparse
import tomllib
from importlib.resources import files
from typing import Any

import numpy as np

from links.vocabulary import State
from monitor.learn.engine import EngineLearnt, flight_of, learn_engine
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.settings.engine import EngineSettings
from monitor.watch.engine import EngineWatch
from sim_feeds.scenario import Flight, Scenario

from .consistency import batch_of

LEARN_SEEDS = (101, 102, 103)
SETTLED_S = 5.0


def scenario(name: str, **change: Any) -> Scenario:
    """A bundled scenario with some of its keys changed."""
    text = files("sim_feeds").joinpath(f"scenarios/{name}.toml").read_text("utf-8")
    return Scenario.model_validate(tomllib.loads(text) | change)


def settings(learnt: EngineLearnt, channels: int) -> EngineSettings:
    """The learnt model with the first channels."""
    return EngineSettings(
        model="single-shaft",
        channels=dict(list(learnt.channels.items())[:channels]),
        single_shaft=learnt.settings,
    )


def judged(flight: Flight, engine: EngineSettings) -> tuple[list[tuple[str, str, float]], Any]:
    """Sensor, state and seconds of every alarm; estimates with their time and the true speed."""
    pipeline = Pipeline(Settings(engine=engine), watches=[EngineWatch(engine)])
    steps = [pipeline.feed(batch_of(flight)), pipeline.finish()]
    boot_us = flight.scenario.start.boot_s * 1e6
    bad = (State.FAULTY, State.STOPPED)
    alarms = [
        (v.sensor, str(v.state), (v.t_us - boot_us) * 1e-6)
        for s in steps
        for v in s.verdicts
        if v.state in bad and v.sensor.startswith(("spool", "engine"))
    ]
    rows = [s.estimates["engine"] for s in steps if "engine" in s.estimates]
    return alarms, np.concatenate(rows) if rows else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    seeds = range(1, parser.parse_args().seeds + 1)
    sound = scenario("aerosonde-rpm-sensors", fault=[])
    learnt = learn_engine(
        [flight_of([batch_of(sound.fly(s))], Settings(), str(s)) for s in LEARN_SEEDS], Settings()
    )
    print(f"model: {100.0 * learnt.fit.explained:.1f} % explained, {learnt.fit.rms_rpm:.1f} rpm")
    for seed in seeds:
        flight = sound.fly(seed)
        for channels in (0, 1, 3):
            engine = settings(learnt, channels) if channels else EngineSettings()
            alarms, _ = judged(flight, engine)
            if alarms:
                print(f"  FALSE, seed {seed}, {channels} channels: {alarms}")
    print(f"healthy: {len(seeds)} flights of {sound.circuit.duration_s:.0f} s judged")
    broken = scenario("aerosonde-rpm-sensors")
    errors, inside = [], []
    for seed in seeds:
        flight = broken.fly(seed)
        alarms, rows = judged(flight, settings(learnt, 3))
        t = rows["t_us"] * 1e-6 - flight.scenario.start.boot_s
        controls = flight.controls
        assert controls is not None
        truth = np.interp(t, controls.t_s, controls.shaft_rpm[:, 0])
        error = np.abs(rows["speed_rpm"][:, 0] - truth)[t > SETTLED_S]
        errors.append(np.quantile(error, 0.95) / learnt.channels["spool0"].range_rpm)
        inside.append(np.mean(error < 2.0 * rows["speed_std_rpm"][t > SETTLED_S, 0]))
        bare, _ = judged(flight, EngineSettings())
        print(f"  sensors, seed {seed}: {alarms}; without a model {bare}")
    worst, middle = 100.0 * max(errors), 100.0 * np.median(errors)
    print(f"reconstructed speed, 95 % error in % of range: median {middle:.2f}, worst {worst:.2f}")
    print(f"inside 2 sigma: {100.0 * np.mean(inside):.1f} %")
    cut = scenario("aerosonde-engine-cut")
    for seed in seeds:
        flight = cut.fly(seed)
        said = {
            f"{n} channels": judged(flight, settings(learnt, n) if n else EngineSettings())[0]
            for n in (0, 1, 2)
        }
        print(f"  engine cut, seed {seed}: {said}")


if __name__ == "__main__":
    main()
