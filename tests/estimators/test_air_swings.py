"""Oscillation of one pitot: found at any rate and frequency; steps, drifts and gusts are none."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from estimators import air_swings as swings

from .test_air_checks import LIMITS

Error = Callable[[float], float]


def still(_: float) -> float:
    return 0.0


def sine(hz: float, size: float) -> Error:
    return lambda t: size * math.sin(2.0 * math.pi * hz * (t - 20.0)) if t > 20.0 else 0.0


def found(
    errors: list[Error], hz: float = 10.0, gust: float = 0.05, noise: float = 0.005
) -> list[float]:
    """When each of several pitots is first found to oscillate [s]; inf if it never is.

    All feel one first-order gust of 1 s about the prediction, and ``noise`` of their own.
    """
    rng = np.random.default_rng(2)
    state = swings.new_swings()
    use = (1 << len(errors)) - 1
    first = [math.inf] * len(errors)
    keep, g = math.exp(-1.0 / hz), 0.0
    for k in range(round(40 * hz)):
        t = k / hz
        g = keep * g + gust * math.sqrt(1.0 - keep * keep) * rng.standard_normal()
        for i, error in enumerate(errors):
            rho = g + noise * rng.standard_normal() + math.log1p(error(t))
            swings.follow_swing(state, LIMITS, i, t, rho)
            rms, _, _ = swings.swings(state, LIMITS, i, use & ~(1 << i), t)
            if rms > 0.0:
                first[i] = min(first[i], t)
    return first


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 50.0])
@pytest.mark.parametrize("hz", [0.5, 1.0, 2.0, 4.0])
def test_an_oscillation_is_found_and_put_on_the_right_pitot(hz: float, rate_hz: float) -> None:
    times = found([still, sine(hz, 0.15)], rate_hz)
    assert times[0] == math.inf
    assert 21.0 < times[1] < 20.0 + 1.5 / hz + 1.5


def test_one_of_three_is_found_alone() -> None:
    times = found([still, sine(1.0, 0.15), still])
    assert times[1] < 24.0
    assert times[0] == times[2] == math.inf


def test_two_that_swing_against_each_other_are_not_told_apart() -> None:
    assert found([sine(1.0, 0.08), sine(1.0, -0.08)]) == [math.inf, math.inf]


@pytest.mark.parametrize(
    "error",
    [
        lambda t: -0.4 if t > 20.0 else 0.0,
        lambda t: 0.4 if 20.0 < t < 24.0 else 0.0,
        lambda t: -0.02 * max(t - 20.0, 0.0),
        sine(1.0, 0.02),
    ],
    ids=["step", "step back", "drift", "small"],
)
def test_what_does_not_swing_is_no_oscillation(error: Error) -> None:
    assert found([error, still]) == [math.inf, math.inf]


def test_a_step_of_a_noisy_pitot_is_no_oscillation() -> None:
    def step(t: float) -> float:
        return -0.3 if t > 20.0 else 0.0

    assert found([step, still], noise=0.015) == [math.inf, math.inf]


def test_gusts_and_a_single_pitot_are_no_oscillation() -> None:
    assert found([still, still], gust=0.2) == [math.inf, math.inf]
    assert found([sine(1.0, 0.2)]) == [math.inf]
