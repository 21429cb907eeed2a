"""Differences between IMUs, their noise, and values that stand still."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from estimators import imu_difference as difference
from estimators.baselines.numpy_twins_ins import interval_means

Array = NDArray[np.float64]

TICK_S = 0.2


class Bench:
    """Runs the kernels over whole series, as the stream does sample by sample."""

    def __init__(self, n: int = 2) -> None:
        self.edge = np.zeros((n, difference.EDGES, 6))
        self.edge_at = np.full((n, difference.EDGES), -1, dtype=np.int64)
        self.integral = np.zeros((n, 6))
        self.usual_s = np.zeros(n)
        self.pair = np.zeros((n, n, difference.PAIR_ROWS, 6))
        self.noise = np.zeros((n, 8, 6))
        self.alias = np.zeros((n, 6))
        self.closed = 0
        self.d: list[Array] = []
        self.z: list[Array] = []

    def fly(self, series: list[tuple[Array, Array]]) -> Bench:
        """Feed (times, samples) per IMU in order of time."""
        events = sorted((t, i, k) for i, (ts, _) in enumerate(series) for k, t in enumerate(ts))
        last = [0.0] * len(series)
        for t, i, k in events:
            ts, u = series[i]
            if k:
                args = (i, ts[k - 1], t, u[k - 1], u[k], self.usual_s, TICK_S)
                difference.fill_bins(self.edge, self.edge_at, self.integral, *args)
                dt = t - ts[k - 1]
                difference.watch_noise(self.noise, i, t, dt, u[k - 1], u[k], True)
            last[i] = t
            self.close(int(np.floor(min(last) / TICK_S)))
        return self

    def close(self, tick: int) -> None:
        while self.closed < tick:
            self.closed += 1
            seen = self.pair[0, -1, difference.D_COUNT, 0]
            args = (self.edge, self.edge_at, self.pair, self.alias, self.closed, TICK_S)
            difference.close_bins(*args)
            if self.pair[0, -1, difference.D_COUNT, 0] > seen:
                self.d.append(self.pair[0, -1, difference.D_LAST].copy())
                self.z.append(self.pair[0, -1, difference.D_Z : difference.D_Z + 3].copy())


def still(rng: np.random.Generator, t: Array, noise: float = 0.05) -> Array:
    """Samples at rest with white noise (a tenth of it on the gyros)."""
    scale = np.repeat([noise, 0.1 * noise], 3)
    return np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0]) + scale * rng.standard_normal((len(t), 6))


def test_interval_means_equal_the_twin_whatever_rates_and_jitter() -> None:
    rng = np.random.default_rng(1)
    a_t = np.cumsum(rng.uniform(0.01, 0.05, 200)) - 0.02
    b_t = np.cumsum(rng.uniform(0.02, 0.19, 60)) - 0.02
    a, b = rng.standard_normal((200, 6)), rng.standard_normal((60, 6))
    bench = Bench().fly([(a_t, a), (b_t, b)])
    edges = TICK_S * np.arange(1, bench.closed + 1)
    want = interval_means(a_t, a, edges) - interval_means(b_t, b, edges)
    np.testing.assert_allclose(np.array(bench.d), want[-len(bench.d) :], rtol=0, atol=1e-12)
    assert len(bench.d) >= len(want) - 1


def test_a_shared_manoeuvre_is_no_difference() -> None:
    rng = np.random.default_rng(2)
    a_t, b_t = np.arange(0.001, 60.0, 0.025), np.arange(0.011, 60.0, 0.02)

    def flight(t: Array) -> Array:
        move = np.sin(0.8 * t)[:, None] * np.array([2.0, 3.0, 8.0, 0.5, 0.3, 0.3])
        return still(rng, t) + move

    z = np.array(Bench().fly([(a_t, flight(a_t)), (b_t, flight(b_t))]).z)
    assert np.abs(z[25:]).max() < 6.0


@pytest.mark.parametrize(("axis", "size"), [(0, 1.0), (2, -1.0), (4, 0.03)])
def test_a_step_is_seen_within_half_a_second_on_its_axis_alone(axis: int, size: float) -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.001, 60.0, 0.025)
    u, v = still(rng, t), still(rng, t)
    u[t > 40.0, axis] += size
    z = np.array(Bench().fly([(t, u), (t + 0.003, v)]).z)
    ticks = TICK_S * np.arange(2, len(z) + 2)
    peak = np.abs(z).max(axis=1)
    first = ticks[(peak[:, axis] > 6.0).argmax()]
    assert 40.0 < first <= 40.5
    assert np.sign(z[-1, 2, axis]) == np.sign(size)
    assert np.delete(peak[25:], axis, axis=1).max() < 6.0


def test_turn_on_biases_are_no_fault() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0.001, 60.0, 0.025)
    z = np.array(Bench().fly([(t, still(rng, t) + 0.3), (t, still(rng, t))]).z)
    assert np.abs(z[25:]).max() < 6.0


def test_threshold_grows_with_the_noise_of_the_differences() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0.001, 120.0, 0.025)
    loud = still(rng, t, 4.0)
    z = np.array(Bench().fly([(t, loud), (t, still(rng, t, 4.0))]).z)
    assert np.abs(z[25:]).max() < 6.0


def stuck(t: Array, u: Array, axis: int, from_s: float) -> float:
    """How improbable the rest of an axis is at the end of a series."""
    u = u.copy()
    u[t > from_s, axis] = u[np.searchsorted(t, from_s), axis]
    bench = Bench().fly([(t, u), (t, u)])
    return difference.improbable_rest(bench.noise, 0, axis, float(t[-1]))


def test_a_value_that_stands_still_is_stuck_but_not_at_once() -> None:
    rng = np.random.default_rng(6)
    t = np.arange(0.001, 30.0, 0.025)
    u = np.round(still(rng, t) / 0.01) * 0.01
    assert stuck(t, u, 1, 27.0) > 1.0
    assert stuck(t, u, 1, 29.5) < 1.0


def test_a_quiet_coarse_gyro_that_repeats_itself_is_not_stuck() -> None:
    """Nine of ten readings equal the last: two seconds of rest are no news."""
    rng = np.random.default_rng(7)
    t = np.arange(0.001, 60.0, 0.025)
    u = still(rng, t)
    u[:, 5] = 0.001 * (rng.random(len(t)) < 0.05)
    assert stuck(t, u, 5, 58.0) < 1.0


def test_noise_state_holds_the_mean_square_second_difference() -> None:
    rng = np.random.default_rng(8)
    t = np.arange(0.001, 60.0, 0.025)
    bench = Bench().fly([(t, still(rng, t, 0.2)), (t, still(rng, t, 0.2))])
    rms = np.sqrt(bench.noise[0, difference.N_DIFF2, :3] / 6.0)
    np.testing.assert_allclose(rms, 0.2, rtol=0.25)
