"""Two of three pitots fail together while the wind ramps: the sound one is not blamed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from monitor.commands.reproduce.wan2016.deployed import run_deployed
from sim_feeds.faults import KNOT_M_S, Fault, FaultKind
from sim_feeds.papers.wan import LongitudinalExperiment, wan_experiment
from sim_feeds.papers.wan2016 import flight_plan, table1
from sim_feeds.wind import Constant, Dryden, Ramp, Wind

ONSET_S = 21.0
SEED = 31
FAULTS = {
    # name: (fault of two pitots, speed [kt], found within seconds)
    "step": ({"kind": FaultKind.NRZ, "size": 0.1}, 180.0, 2.0),
    "runaway": ({"kind": FaultKind.RUNAWAY, "rate": 2.5}, 330.0, 6.0),
    "stuck": ({"kind": FaultKind.STUCK}, 165.0, 6.0),
}


def _flight(
    fault: dict[str, Any] | None, speed_kt: float, ramp_m_s: float
) -> LongitudinalExperiment:
    """Level for 12 s, then slower by 0.5 m/s^2; the wind along the flight ramps from 14 to 27 s."""
    plan = flight_plan(speed_kt, 3000.0)
    plan.level(12.0).change_speed(speed_kt * KNOT_M_S - 15.0, acc_m_s2=0.5)
    wind = Wind(
        [
            Constant(np.array([6.0, 0.0, 0.0])),
            Ramp(14.0, 27.0, np.array([ramp_m_s, 0.0, 0.0])),
            Dryden(fixed_std_m_s=0.5, fixed_scale_m=530.0),
        ]
    )
    faults = [Fault(f"airspeed{i}", start_s=ONSET_S, **fault) for i in (0, 1)] if fault else []
    return wan_experiment(
        faults, SEED, plan=plan, wind=wind, duration_s=45.0,
        noise_std=table1().noise["assumed"].si(),
    )  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("ramp_m_s", [16.0, -16.0])
def test_the_two_that_failed_are_found_and_the_third_is_believed(
    name: str, ramp_m_s: float
) -> None:
    fault, speed_kt, within_s = FAULTS[name]
    flight = _flight(fault, speed_kt, ramp_m_s)
    record = run_deployed(flight, SEED)
    found = record.faulty.any(axis=0)
    assert found.tolist() == [[False] * 3, [True, True, False]]
    first_s = flight.t_s[record.faulty[:, 1, :2].argmax(axis=0)]
    assert np.all((first_s > ONSET_S) & (first_s < ONSET_S + within_s))


def test_healthy_sensors_in_the_ramp_are_not_blamed() -> None:
    flight = _flight(None, 165.0, 16.0)
    assert not run_deployed(flight, SEED).faulty.any()
