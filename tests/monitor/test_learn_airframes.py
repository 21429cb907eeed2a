"""Airframes on which the defaults cry wolf: learnt thresholds are silent, and still find faults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from links.samples import Batch
from links.vocabulary import State
from monitor import settings as configuration
from monitor.learn import Flight, Learnt, Trial, Unfit, calibrate, measure
from monitor.settings import Settings
from sim_feeds.scenario import Scenario
from sim_feeds.sensors import markov

from . import air_flights, imu_flights

DEFAULTS = configuration.load()


def calibrated(flights: dict[str, Batch], **options: Any) -> Learnt:
    """Thresholds learnt from decoded flights."""

    named = list(flights.items())

    def runs(trials: Sequence[Trial], doing: str) -> list[Flight]:
        return [measure([named[k][1]], settings, named[k][0]) for k, settings in trials]

    return calibrate(runs, len(named), DEFAULTS, "noisy", **options).learnt


def found(batch: Batch, settings: Settings) -> list[tuple[str, float]]:
    """What is called faulty."""
    alarms = measure([batch], settings).alarms
    return [(a.sensor, a.detected_s) for a in alarms if a.state is State.FAULTY]


def wandering_pitot(seed: int, scaled: float = 1.0) -> Batch:
    """Ten minutes with a single pitot whose reading wanders by 5 % within 30 s, as behind a
    propeller; from 300 s on it reads ``scaled`` times that."""
    flight = air_flights.circuits(600.0, pitots=1, seed=seed, gust=0.5, wind=(4.0 + seed % 3, -3.0))
    del flight["phase"]
    pitot = flight["airspeed0"]
    wander = markov(np.random.default_rng(1000 + seed), pitot["t_us"] * 1e-6, 0.05, 30.0)
    pitot["cas_m_s"] *= np.exp(wander)
    flight["nav"]["height_m"] = flight["nav"]["alt_m"] = 100.0
    return Batch(air_flights.scaled(flight, "airspeed0", scaled, 300.0))


def restless_imu(seed: int, faults: Sequence[dict[str, Any]] = ()) -> Batch:
    """Four and a half minutes with accelerometers whose bias walks by 0.2 m/s^2 in 100 s."""
    base = imu_flights.scenario("small-uav", seed=seed)
    table = base.model_dump(exclude={"circuit", "rpm"}) | {
        "leg": [*base.leg, *base.leg],
        "start": base.start,
    }
    table["imu"]["acc_walk_m_s2"] = 0.02
    scenario = Scenario.model_validate(table | {"fault": list(faults)})
    rows = imu_flights.rows_of(scenario.fly())
    del rows["phase"]
    return Batch(rows)


@pytest.fixture(scope="module")
def pitot_learnt() -> Learnt:
    return calibrated({f"{seed}": wandering_pitot(seed) for seed in (1, 2, 3)}, assert_healthy=True)


@pytest.fixture(scope="module")
def imu_learnt() -> Learnt:
    return calibrated({f"{seed}": restless_imu(seed) for seed in (1, 3, 4)}, assert_healthy=True)


def test_a_wandering_pitot_is_left_alone_once_learnt(pitot_learnt: Learnt) -> None:
    assert set(pitot_learnt.overrides) == {"air.margin_single", "air.horizon.margin_all"}
    unseen = wandering_pitot(12)
    assert found(unseen, DEFAULTS)
    assert measure([unseen], pitot_learnt.settings).alarms == ()


def test_its_faults_are_still_found(pitot_learnt: Learnt) -> None:
    for size, within_s in ((0.7, 100.0), (1.3, 200.0)):
        (sensor, when_s), *rest = found(wandering_pitot(13, scaled=size), pitot_learnt.settings)
        assert sensor == "airspeed0"
        assert 0.0 < when_s - 300.0 < within_s
        assert rest == []


def test_a_restless_imu_is_left_alone_once_learnt(imu_learnt: Learnt) -> None:
    assert set(imu_learnt.overrides) == {"imu.difference_sigma"}
    unseen = restless_imu(14)
    assert found(unseen, DEFAULTS)
    assert measure([unseen], imu_learnt.settings).alarms == ()


@pytest.mark.parametrize(("axis", "size"), [("imu0.acc_x", 2.0), ("imu0.gyro_y", 1.4)])
def test_its_steps_are_still_found(imu_learnt: Learnt, axis: str, size: float) -> None:
    """The defaults find 0.7 m/s^2 and 0.7 deg/s on a quiet IMU; here the wander hides more."""
    fault = imu_flights.fault(axis, size, 100.0)
    ((sensor, when_s),) = found(restless_imu(13, [fault]), imu_learnt.settings)
    assert sensor == axis
    assert 100.0 < when_s < 105.0


def test_without_the_operators_word_such_flights_are_refused() -> None:
    with pytest.raises(Unfit, match="not a healthy flight: airspeed0"):
        calibrated({f"{seed}": wandering_pitot(seed) for seed in (1, 2, 3)})
