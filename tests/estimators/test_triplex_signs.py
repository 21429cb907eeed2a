"""What a sensor betrays by itself, and when a found one is believed again."""

import math

import numpy as np
import pytest

from estimators.triplex_return import like_the_others, met_the_held_wind
from estimators.triplex_signs import NO_SIGN, NOISY, S_LEVEL, SIGNS, STANDS_STILL, own_sign, quiet

DEG = math.radians(1.0)
J_TH = 2.9 * DEG
STEP_S = 0.048
ONSET = 400


def _watch(readings, share=3.0):
    """Sign after each reading, and whether the sensor is quiet then."""
    ring, signs = np.zeros(10), np.zeros(SIGNS)
    out, calm = [], []
    for v in readings:
        out.append(own_sign(float(v), share, J_TH, ring, signs))
        calm.append(quiet(J_TH, signs))
    return np.array(out), np.array(calm)


def _healthy(seed, n=800, std=0.2 * DEG):
    rng = np.random.default_rng(seed)
    t = np.arange(n) * STEP_S
    return 3.0 * DEG + 2.0 * DEG * np.sin(2 * np.pi * t / 8.0) + std * rng.standard_normal(n)


def test_a_good_sensor_gives_no_sign_in_an_hour():
    signs, calm = _watch(_healthy(0, n=75_000))
    assert (signs == NO_SIGN).all()
    assert calm.all()


@pytest.mark.parametrize("std_deg", [1.0, 2.0])
def test_noise_of_table_ii_is_found_within_two_seconds_and_ends_when_it_ends(std_deg):
    for seed in range(20):
        rng = np.random.default_rng([seed, 1])
        v = _healthy(seed)
        v[ONSET:600] += std_deg * DEG * rng.standard_normal(200)
        signs, calm = _watch(v)
        assert (signs[:ONSET] == NO_SIGN).all()
        first = int((signs == NOISY).argmax())
        assert ONSET < first <= ONSET + 2.0 / STEP_S
        assert calm[620:].all()


def test_a_jam_is_found_by_its_repetition_wherever_it_stands():
    v = _healthy(1)
    v[ONSET:600] = v[ONSET - 1]
    signs, calm = _watch(v)
    first = int((signs == STANDS_STILL).argmax())
    assert (signs[:first] == NO_SIGN).all()
    assert (first - ONSET) * STEP_S < 0.5
    assert not calm[first:600].any()
    assert (signs[600:] == NO_SIGN).all()


def test_a_coarse_sensor_repeats_itself_and_is_not_blamed_but_its_jam_is():
    """Steps of a degree: the same reading for up to a second."""
    v = np.round(_healthy(2, std=0.0) / DEG) * DEG
    longest = max(len(list(run)) for run in np.split(v, np.flatnonzero(np.diff(v)) + 1))
    assert longest > 15
    assert (_watch(v)[0] == NO_SIGN).all()
    v[ONSET:] = v[ONSET]
    assert (_watch(v)[0][ONSET + 5 * longest :] == STANDS_STILL).all()


@pytest.mark.parametrize("what", ["one wild reading", "a jump"])
def test_neither_a_wild_reading_nor_a_jump_is_noise(what):
    v = _healthy(3)
    v[ONSET : ONSET + 1 if what == "one wild reading" else None] += 20.0 * DEG
    assert (_watch(v)[0] == NO_SIGN).all()


def test_the_usual_size_is_that_of_second_differences():
    """Of white noise the root of six times its deviation."""
    signs = np.zeros(SIGNS)
    ring = np.zeros(10)
    for v in 0.2 * DEG * np.random.default_rng(5).standard_normal(5000):
        own_sign(float(v), 3.0, J_TH, ring, signs)
    assert signs[S_LEVEL] == pytest.approx(math.sqrt(6.0) * 0.2 * DEG, rel=0.1)


def test_an_infinite_share_switches_both_signs_off():
    v = _healthy(4)
    v[ONSET:] = v[ONSET]
    assert (_watch(v, share=np.inf)[0] == NO_SIGN).all()


def test_a_sensor_returns_to_its_kind_when_it_reads_what_they_read():
    use, J = np.array([0.0, 1.0, 1.0]), np.full(3, 0.3 * J_TH)
    r = np.zeros((3, 10))
    r[0] = 0.1 * J_TH
    assert like_the_others(0, J, use, r, 10, J_TH, 0.6)
    r[0] = 0.3 * J_TH  # a bias that no residual shows while a gust moves all
    assert not like_the_others(0, J, use, r, 10, J_TH, 0.6)
    r[0] = 0.0
    assert not like_the_others(0, np.array([0.7 * J_TH, 0.1, 0.1]), use, r, 10, J_TH, 0.6)


def test_a_lost_channel_returns_by_a_jump_if_it_left_by_one():
    def back(value=(10.0, 10.0, 30.0), left=8.0, jump=0.0, waiting=False, J=1.0):
        return met_the_held_wind(
            0, np.full(3, J), np.array(value), 6.0, 0.6, 1.0, 20.0, left, jump, waiting
        )

    assert not back()  # the wind brought it into agreement
    assert back(jump=8.0)
    assert back(waiting=True)
    assert back(left=1.0)  # it had crept away
    assert not back(jump=8.0, value=(10.0, 20.0, 30.0))  # nobody agrees
    assert not back(jump=8.0, J=9.0)
