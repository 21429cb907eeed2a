"""The made-up flight takes the pipeline through alignment, fault and reconstruction."""

import pytest

from links.vocabulary import State
from monitor.pipeline import Pipeline
from monitor.settings import PROFILES, load
from monitor.warmup import COMPILING, made_up_flight, warm_up


@pytest.mark.parametrize("profile", PROFILES)
def test_the_made_up_flight_is_sound_until_its_sensors_break(profile):
    settings = load(profile)
    pipeline = Pipeline(settings)
    verdicts = pipeline.feed(made_up_flight(2.0 * settings.phase.flying_speed_m_s)).verdicts
    verdicts += pipeline.finish().verdicts
    faulty = {v.sensor for v in verdicts if v.state is State.FAULTY}
    assert faulty >= {"imu0.acc_x", "airspeed0"}
    assert not {s for s in faulty if s.startswith(("imu1", "airspeed1", "airspeed2"))}
    assert all(v.t_us > 59_000_000 for v in verdicts if v.state is State.FAULTY)


def test_warming_up_says_nothing_when_the_kernels_are_there():
    settings = load()
    warm_up(settings)
    said = []
    warm_up(settings, said.append)
    assert not said


def test_warming_up_says_so_when_kernels_must_be_compiled(monkeypatch, tmp_path):
    monkeypatch.setattr("links.jit._folders", {tmp_path})
    said = []
    warm_up(load(), said.append)
    assert said == [COMPILING]
