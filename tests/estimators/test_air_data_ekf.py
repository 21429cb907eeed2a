"""The EKF that the paper compares with: filterpy against Algorithm 2 on a window of two."""

import numpy as np
import pytest

from estimators.air_data_2d import EXACT, air_outside, linearise
from estimators.air_data_mhe import ROW_Q, ROW_R, AirDataTuning
from estimators.mhe import SOLVED, barrier_qp, work_size

from .longitudinal_truth import fly

pytest.importorskip("filterpy")
from estimators.baselines.air_data_ekf import AirDataEKF


def test_one_step_is_the_unconstrained_window_of_two():
    """Prior (x, P), no data at the first stage, all data at the second: MAP equals the EKF."""
    flight = fly(5.0, 0)
    tuning = AirDataTuning(model=EXACT, N=2, constrained=False)
    table = tuning.table()
    ekf = AirDataEKF(tuning, flight.x0, flight.theta[0])
    for k in range(1, 40):
        y = np.array([*flight.inertial[k], flight.vanes[k, 0], flight.pitots[k, 0]])
        x, P = ekf.filter.x.copy(), ekf.filter.P.copy()
        theta = flight.theta[k - 1 : k + 1]
        A, B, C = np.zeros((3, 2, 4, 4))
        air, F, h = np.empty(2), np.empty((2, 4)), np.empty((2, 4))
        moved = x
        for i in range(2):
            air_outside(theta[i, 5], 0.0, air)
            linearise(EXACT, moved, np.zeros(4), theta[i], air, 0.048, F[i], A[i], B[i], h[i], C[i])
            moved = F[0].copy()
        C[0] = 0.0
        ry = np.array([np.zeros(4), y - h[1]])
        inf = np.full((2, 4), np.inf)
        dx, du, work = np.zeros((2, 4)), np.zeros((1, 4)), np.empty(work_size(2, 4, 4, 4))
        status = barrier_qp(
            P, table[ROW_Q], table[ROW_R], A[:1], B[:1], C, np.zeros((1, 4)), np.zeros(4),
            np.zeros((1, 4)), ry, -inf, inf, -inf[:1], inf[:1], 1.0, 1, 1, dx, du, work,
        )  # fmt: skip
        assert status == SOLVED
        newest = ekf.step(y, np.ones(4), flight.theta[k])
        np.testing.assert_allclose(newest, F[0] + dx[1], rtol=1e-9, atol=1e-9)


def test_the_ekf_follows_a_healthy_flight_and_absorbs_a_common_fault():
    flight = fly(40.0, 1, gust_std=0.5)
    flight.pitots[flight.t > 20.0] -= 15.0
    ekf = AirDataEKF(AirDataTuning(), flight.x0, flight.theta[0])
    x = []
    for k in range(len(flight.t)):
        y = np.array([*flight.inertial[k], flight.vanes[k].mean(), flight.pitots[k].mean()])
        x.append(ekf.step(y, np.ones(4), flight.theta[k]))
    x = np.array(x)
    healthy = (flight.t > 10.0) & (flight.t < 20.0)
    assert np.abs(x[healthy, 2] - flight.wind[healthy, 0]).mean() < 0.6
    assert np.degrees(np.abs(x[healthy, 0] - flight.alpha[healthy])).mean() < 0.2
    assert x[-1, 2] - flight.wind[-1, 0] > 13.0


def test_its_own_wind_noise_can_be_given():
    flight = fly(2.0, 1)
    ekf = AirDataEKF(AirDataTuning(), flight.x0, flight.theta[0], q_w=7.0)
    assert ekf.Q[2, 2] == ekf.Q[3, 3] == 7.0
    assert ekf.Q[1, 1] != 7.0
