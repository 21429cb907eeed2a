"""What the intermittent-measurement filter is compared with: chi-square window and RAKF."""

import numpy as np
import pytest

from estimators.baselines.chi_square_window import ChiSquareWindowFilter, chi_square_limits
from estimators.baselines.fault_condition_bank import FaultConditionBank
from estimators.baselines.rakf import RobustAdaptiveFilter
from estimators.imkf import IntermittentFilter, LinearModel, Settings

pytest.importorskip("scipy")

MODEL = LinearModel(
    A=np.array([[0.97, 0.01], [0.01, 0.98]]),
    B=np.array([[0.01], [0.02]]),
    C=np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]),
    Q=1e-4 * np.eye(2),
    r=np.array([1e-6, 1e-6, 2.5e-3]),
    dt_s=0.01,
)
X0, P0 = np.array([0.5, 0.5]), 1e-4 * np.eye(2)


def healthy(N, seed=0):
    rng = np.random.default_rng(seed)
    u = np.full((N, 1), 0.5)
    x, states = X0, np.empty((N, 2))
    for k in range(N):
        states[k] = x = MODEL.A @ x + MODEL.B @ u[k] + 0.01 * rng.standard_normal(2)
    return u, states, states @ MODEL.C.T + np.sqrt(MODEL.r) * rng.standard_normal((N, 3))


def test_limits_are_those_of_the_tables():
    limits = chi_square_limits(100, 0.05)
    assert limits[[0, 3, 99]] == pytest.approx([3.8415, 9.4877, 124.342], rel=1e-4)
    assert chi_square_limits(4, 0.01)[3] == pytest.approx(13.2767, rel=1e-5)


@pytest.mark.parametrize("kind", [ChiSquareWindowFilter, RobustAdaptiveFilter])
def test_without_an_alarm_it_is_the_kalman_filter(kind):
    u, _, y = healthy(100)
    kalman = IntermittentFilter(MODEL, Settings(fault_free=(1.0,) * 3, memory_s=None), X0, P0)
    own = kind(MODEL, X0, P0, alpha=1e-12)
    for k in range(100):
        own.step(u[k], y[k])
        kalman.step(u[k], y[k])
        np.testing.assert_allclose(own.x, kalman.state, rtol=1e-9)
        np.testing.assert_allclose(own.P, kalman.cov, rtol=1e-6, atol=1e-14)


def test_window_leaves_out_a_large_error_and_overlooks_a_small_one():
    u, x, y = healthy(300)
    own = ChiSquareWindowFilter(MODEL, X0, P0)
    for k in range(299):
        own.step(u[k], y[k])
        assert len(own.windows[0]) <= 99
    sigma = np.sqrt((MODEL.C @ (MODEL.A @ own.P @ MODEL.A.T + MODEL.Q) @ MODEL.C.T)[0, 0] + 1e-6)
    predicted = (MODEL.A @ own.x + MODEL.B @ u[299])[0]
    room = chi_square_limits(100, 0.05)[-1] - sum(own.windows[0])
    assert 2.0 < np.sqrt(room) < 8.0
    for share, believed in ((0.99, True), (1.01, False)):
        twin = ChiSquareWindowFilter(MODEL, own.x, own.P)
        twin.windows = [past.copy() for past in own.windows]
        y_bad = y[299].copy()
        y_bad[0] = predicted + share * np.sqrt(room) * sigma
        twin.step(u[299], y_bad)
        assert twin.works[0] == believed
        assert len(twin.windows[0]) == 99
        if not believed:
            assert abs(twin.x[0] - x[299, 0]) < 5.0 * sigma
            assert twin.windows[0] == own.windows[0]


def test_readings_of_rakf_adapt_what_they_say():
    u, _, y = healthy(300)
    y[250:, 1] += 0.2
    factors = {}
    for reading in ("multiple", "single", "channel"):
        own = RobustAdaptiveFilter(MODEL, X0, P0, reading=reading)
        for k in range(251):
            own.step(u[k], y[k])
        assert own.detected
        factors[reading] = own.factor
    assert factors["single"].min() == factors["single"].max() >= 1.0
    assert factors["channel"][0] == 1.0
    assert factors["channel"][1] > 20.0
    assert factors["multiple"][1] > factors["multiple"][0]


def test_rakf_raises_the_noise_of_the_channel_that_is_wrong():
    u, x, y = healthy(400)
    y[200:, 1] += 0.2
    own = RobustAdaptiveFilter(MODEL, X0, P0)
    kalman = IntermittentFilter(MODEL, Settings(fault_free=(1.0,) * 3, memory_s=None), X0, P0)
    for k in range(400):
        own.step(u[k], y[k])
        kalman.step(u[k], y[k])
        if k == 200:
            assert own.detected
            assert own.factor[1] > 20.0
            assert own.factor[0] < 0.2 * own.factor[1]
    assert (own.factor >= 1.0).all()
    assert abs(own.x[1] - x[399, 1]) < abs(kalman.state[1] - x[399, 1])


def test_each_filter_of_a_bank_is_the_kalman_filter_of_its_channels():
    u, _, y = healthy(50)
    own = FaultConditionBank(MODEL, np.array([0.9, 0.8, 0.7]), X0, P0)
    certain = Settings(fault_free=(1.0,) * 3, memory_s=None)
    singles = [IntermittentFilter(MODEL, certain, X0, P0) for _ in own.Gamma]
    for k in range(50):
        own.step(u[k], y[k])
        for j, single in enumerate(singles):
            single.step(u[k], np.where(own.Gamma[j] == 1, y[k], np.nan))
            np.testing.assert_allclose(own.xj[j], single.state, rtol=1e-9)
            np.testing.assert_allclose(own.Pj[j], single.cov, rtol=1e-6, atol=1e-13)


def test_a_bank_merges_its_first_sample_as_the_proposed_method_does():
    """Before anything is fed back the two are one."""
    u, _, y = healthy(1)
    y[0, 0] += 0.1
    printed = Settings.paper((0.9, 0.8, 0.7), np.inf)
    proposed = IntermittentFilter(MODEL, printed, X0, P0)
    bank = FaultConditionBank(MODEL, np.array([0.9, 0.8, 0.7]), X0, P0)
    track = proposed.run(u, y)
    bank.step(u[0], y[0])
    np.testing.assert_allclose(bank.x, track.x[0], rtol=1e-10)
    np.testing.assert_allclose(bank.P, track.P[0], rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(bank.w, track.works[0], rtol=1e-8)
