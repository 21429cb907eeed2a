"""Sigmas of the reconstructed air data tell the size of its errors, healthy and after a fault.

Ideal Gaussian errors lie inside two sigmas in 95.4 %. Errors of wind and scale stay for minutes, so
a flight is one draw of them rather than a thousand: of one kind of flight at least 75 %, of all
kinds together 85 % are asked for. Wide sigmas tell nothing, so that over all kinds they may not
exceed 2.5 times the rms error; they are wider than it since pitots and sideslip of real aircraft,
on which they rest, spread more than those of synthetic ones.

``python -m tests.monitor.consistency`` prints the whole table over many flights.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from links.vocabulary import State

from .consistency import (
    FAULT_S,
    FOUND_S,
    QUANTITIES,
    SETTLED_S,
    Case,
    Result,
    Tally,
    examine,
    faulty_cases,
    healthy_cases,
)

LEAST_OF_ONE, LEAST_OF_ALL, WIDEST = 0.75, 0.85, 2.5
SHORT_MIN = 4.0
PICKED = ("small-uav 1+0 12 m/s", "small-uav 2+0 12 rough", "light-aircraft 1+1 12 rough",
          "transport 3+3 12 m/s")  # fmt: skip
CASES = {c.name: c for c in (*healthy_cases(), *faulty_cases())}


@cache
def flown(name: str, seed: int = 1) -> Result:
    case = CASES[name]
    short = Case(
        case.name, case.aircraft, case.pitots, case.vanes, case.wind_m_s, case.rough, case.fault,
        SHORT_MIN,
    )  # fmt: skip
    return examine(short.scenario(seed).fly(seed))


@pytest.mark.parametrize("name", PICKED)
def test_two_sigmas_hold_in_every_class(name: str) -> None:
    result = flown(name)
    assert not [v for v in result.verdicts if v.state is State.FAULTY]
    for quantity, (error, std) in result.after(SETTLED_S).items():
        assert len(error) > 500
        assert (np.abs(error) <= 2.0 * std).mean() > LEAST_OF_ONE, quantity


def test_two_sigmas_hold_over_all_classes_and_are_not_too_wide() -> None:
    for quantity in QUANTITIES:
        tally = Tally()
        for name in PICKED:
            tally.add(*flown(name).after(SETTLED_S)[quantity])
        assert tally.share > LEAST_OF_ALL, quantity
        assert tally.sigma < WIDEST * tally.rms, quantity


@pytest.mark.parametrize("case", list(faulty_cases()), ids=lambda c: c.name)
def test_two_sigmas_hold_after_a_fault(case: Case) -> None:
    result = flown(case.name)
    told = {v.sensor for v in result.verdicts if v.state is State.FAULTY}
    assert told == {f["sensor"] for f in case.fault}
    for quantity, (error, std) in result.after(FAULT_S + FOUND_S).items():
        assert len(error) > 200
        assert (np.abs(error) <= 2.0 * std).mean() > LEAST_OF_ONE, quantity


def test_sigmas_grow_while_the_wind_ages_without_a_pitot() -> None:
    result = flown("small-uav 1+0 dead")
    _, before = result.after(FAULT_S - 30.0, FAULT_S)["cas"]
    _, late = result.after(FAULT_S + 60.0)["cas"]
    assert late.mean() > 1.5 * before.mean()
    assert np.mean(late[-100:]) > np.mean(late[:100])
