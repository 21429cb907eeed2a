"""The fast checks of one pitot: each finds its fault in its time and nothing else."""

import math

import numpy as np

from estimators import air_checks as checks

LIMITS = checks.CheckLimits(
    constant_s=2.0,
    gross_ln=0.5,
    gross_s=1.0,
    dead_wind_m_s=12.0,
    dead_s=2.0,
    noise_rms=0.03,
    noise_ratio=0.5,
    noise_s=1.0,
    noise_tau_s=1.0,
)
HZ = 10.0


def first_failure(
    c: np.ndarray, *, flying: bool = True, learnt: bool = True, p: float = 18.0, V: float = 18.0
) -> tuple[float, float]:
    """Check and time [s] of the first failure; (CHECK_NONE, inf) without one."""
    state = checks.new_check()
    for k, value in enumerate(c):
        t = k / HZ
        failed = checks.check_sample(
            state, LIMITS, t, value, value, p, 0.01, V, 1.0, flying, learnt
        )
        if failed != checks.CHECK_NONE:
            return failed, t
    return checks.CHECK_NONE, math.inf


def healthy(seconds: float, seed: int = 0) -> np.ndarray:
    return 18.0 + 0.1 * np.random.default_rng(seed).standard_normal(round(seconds * HZ))


def test_a_healthy_pitot_passes() -> None:
    assert first_failure(healthy(60)) == (checks.CHECK_NONE, math.inf)


def test_constant_after_two_seconds_and_only_in_flight() -> None:
    c = healthy(20)
    c[100:] = c[99]
    check, t = first_failure(c)
    assert check == checks.CHECK_CONSTANT
    assert 2.0 < t - 9.9 < 2.3
    assert first_failure(c, flying=False)[0] == checks.CHECK_NONE


def test_gross_error_after_one_second_but_not_a_spike() -> None:
    c = healthy(20)
    c[50:57] *= 3.0
    assert first_failure(c)[0] == checks.CHECK_NONE
    c[100:] *= 1.8
    check, t = first_failure(c)
    assert check == checks.CHECK_GROSS
    assert 1.0 < t - 10.0 < 1.3


def test_dead_pitot_at_flying_speed_before_anything_is_learnt() -> None:
    c = 0.5 + healthy(20) * 0.02
    check, t = first_failure(c, learnt=False, p=math.nan)
    assert check == checks.CHECK_DEAD
    assert 2.0 < t < 2.3
    assert first_failure(c, learnt=False, p=math.nan, V=5.0)[0] == checks.CHECK_NONE


def test_a_good_pitot_with_a_storm_behind_it_is_not_dead() -> None:
    c = healthy(20) * 0.9
    assert first_failure(c, learnt=False, p=math.nan, V=40.0)[0] == checks.CHECK_NONE


def scatter(
    noise: list[float], gust: float, scale: list[float], seed: int = 1, lost: float = 0.0
) -> list[bool]:
    """Whether each of several pitots in the same gusts is found noisy; some samples are lost."""
    rng = np.random.default_rng(seed)
    states = np.stack([checks.new_check() for _ in range(3)])
    use = (1 << len(noise)) - 1
    found = [False] * len(noise)
    for k in range(200):
        air = 20.0 * (1.0 + gust * rng.standard_normal())
        for i, std in enumerate(noise):
            if rng.random() < lost:
                continue
            c = scale[i] * air * (1.0 + std * rng.standard_normal())
            checks.check_sample(states[i], LIMITS, k / HZ, c, c, 20.0, 0.01, 20.0, 1.0, True, True)
            checks.pair_noise(states, LIMITS, i, 1.0 / HZ)
            found[i] |= bool(checks.noise_check(states, LIMITS, i, use & ~(1 << i), k / HZ))
    return found


def test_noise_is_blamed_on_the_noisy_one_of_two_and_of_three() -> None:
    assert scatter([0.08, 0.003], gust=0.02, scale=[1.0, 1.0]) == [True, False]
    assert scatter([0.003, 0.08, 0.003], gust=0.02, scale=[1.0, 1.0, 1.0]) == [False, True, False]


def test_gusts_and_a_wrong_scale_are_not_noise() -> None:
    assert scatter([0.003, 0.003], gust=0.15, scale=[1.0, 1.0]) == [False, False]
    assert scatter([0.003, 0.003], gust=0.15, scale=[0.7, 1.0]) == [False, False]


def test_lost_samples_are_not_noise_and_noise_is_found_among_them() -> None:
    for seed in range(5):
        for lost in (0.05, 0.3):
            alike = scatter([0.003, 0.003], 0.15, [1.0, 1.0], seed, lost)
            assert alike == [False, False], (seed, lost)
        noisy = scatter([0.08, 0.003], 0.02, [1.0, 1.0], seed, 0.15)
        assert noisy == [True, False], seed


def test_beside_a_blocked_pitot_a_good_one_is_not_noisy() -> None:
    rng = np.random.default_rng(2)
    states = np.stack([checks.new_check() for _ in range(3)])
    for k in range(700):
        t = k / HZ
        air = 20.0 * (1.0 + 0.05 * rng.standard_normal())
        for i in range(2):
            blocked = i == 0 and t > 60.0
            c = (20.0 if blocked else air) + 0.05 * rng.standard_normal()
            checks.check_sample(states[i], LIMITS, t, c, c, 20.0, 0.01, 20.0, 1.0, True, True)
            checks.pair_noise(states, LIMITS, i, 1.0 / HZ)
            assert not checks.noise_check(states, LIMITS, i, 3 & ~(1 << i), t), t


def test_the_scatter_of_a_parked_pitot_is_no_noise() -> None:
    """On the ground a pitot shows the root of 1 Pa of noise: 0 to 2 m/s, wildly in logarithms."""
    rng = np.random.default_rng(5)
    states = np.stack([checks.new_check() for _ in range(3)])
    for k in range(400):
        t, flying = k / HZ, k >= 200
        speed = min(max(0.0, 15.0 * (t - 20.0)), 22.0)
        for i in range(2):
            pa = max(0.5 * 1.225 * speed**2 + 2.0 * rng.uniform(-1.0, 1.0), 0.0)
            c = math.sqrt(2.0 * pa / 1.225)
            checks.check_sample(
                states[i], LIMITS, t, c, c, math.nan, 1.0, speed, 1.0, flying, False
            )
            checks.pair_noise(states, LIMITS, i, 1.0 / HZ)
            assert not checks.noise_check(states, LIMITS, i, 3 & ~(1 << i), t), t


def test_a_single_pitot_is_never_called_noisy() -> None:
    assert scatter([0.2], gust=0.02, scale=[1.0]) == [False]
