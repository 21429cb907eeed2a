"""The scheme of wan2018 as printed: its equations by hand, and what its weights do."""

import numpy as np
import pytest

from estimators.air_data_mhe import AirDataMHE, AirDataTuning
from estimators.baselines.numpy_twins_air import fuse, outputs, residual_rms, transition
from estimators.baselines.triplex_as_printed import PrintedLogic, run_as_printed

from .longitudinal_truth import KT, fly

ONSET_S = 10.0


def _run(flight, logic=None, **tuning):
    estimator = AirDataMHE(AirDataTuning(**tuning), flight.x0, flight.theta[0])
    return run_as_printed(
        estimator,
        flight.x0,
        logic or PrintedLogic(),
        flight.inertial,
        flight.vanes,
        flight.pitots,
        flight.theta,
    )


def _step(flight, sensors, size_m_s):
    flight.pitots[np.ix_(flight.t >= ONSET_S, sensors)] += size_m_s


def test_residuals_and_evaluation_follow_the_equations():
    """(17) against the model's one-step prediction, (18) over the last ten samples."""
    flight = fly(8.0, 1)
    record = _run(flight)
    for k in (40, 90, 150):
        ahead = transition(1, record.x[k - 1], np.zeros(4), flight.theta[k - 1], 0.048)
        h = outputs(1, np.asarray(ahead, dtype=float), flight.theta[k])
        np.testing.assert_allclose(record.r[k, 0], flight.vanes[k] - h[2], atol=1e-12)
        np.testing.assert_allclose(record.r[k, 1], flight.pitots[k] - h[3], atol=1e-9)
        for i in range(3):
            expected = residual_rms(record.r[k - 9 : k + 1, 1, i])
            assert record.J[k, 1, i] == pytest.approx(expected, rel=1e-12)


def test_the_fused_value_is_the_weighted_mean():
    """One step of the estimator fed with (19) by hand gives the recorded state."""
    flight = fly(4.0, 2)
    record = _run(flight)
    k = 60
    estimator = AirDataMHE(AirDataTuning(), flight.x0, flight.theta[0])
    floor = PrintedLogic().floor_share * np.array([np.radians(2.9), 12 * KT])
    for j in range(k + 1):
        fused = [
            fuse(v, np.maximum(record.J[j, c], floor[c]), np.ones(3), np.zeros(3))[0]
            for c, v in enumerate((flight.vanes[j], flight.pitots[j]))
        ]
        x = estimator.step(np.array([*flight.inertial[j], *fused]), np.ones(4), flight.theta[j])
    np.testing.assert_allclose(record.x[k], x, rtol=1e-9)


def test_two_of_three_are_found_and_come_back_without_a_latch():
    flight = fly(30.0, 3)
    _step(flight, [0, 1], 30 * KT)
    flight.pitots[flight.t >= 20.0] = flight.pitots[flight.t >= 20.0].min(axis=1, keepdims=True)
    record = _run(flight)
    faulty = record.faulty[:, 1]
    found = flight.t[faulty.argmax(axis=0)]
    assert not faulty[:, 2].any()
    assert (found[:2] > ONSET_S).all()
    assert (found[:2] < ONSET_S + 0.5).all()
    assert not faulty[-1].any(), "there is no latch"


def test_two_that_creep_away_together_may_vote_the_healthy_one_out():
    """Trap of (19): at 1.5 kt/s chance decides which side's weight wins; at 5 kt/s it does not."""
    voted_out = {}
    for rate in (1.5, 5.0):
        voted_out[rate] = 0
        for seed in range(4):
            flight = fly(25.0, seed, gust_std=0.3, shear=0.0)
            since = np.maximum(flight.t - ONSET_S, 0.0)
            flight.pitots[:, :2] -= rate * KT * since[:, None]
            faulty = _run(flight).faulty[:, 1]
            assert not faulty[flight.t < ONSET_S].any()
            assert faulty.any()
            voted_out[rate] += int(faulty[:, 2].any())
    assert 0 < voted_out[1.5]
    assert voted_out[5.0] == 0


def test_residuals_can_be_watched_without_deciding():
    flight = fly(20.0, 5)
    _step(flight, [0, 1, 2], 40 * KT)
    watched = _run(flight, PrintedLogic(decide=False))
    assert not watched.faulty.any()
    assert (watched.J[flight.t > ONSET_S][5, 1] > 12 * KT).all()
