"""The papers' experiments: sampling, noise, truth relations, faults."""

import numpy as np
import pytest

from sim_feeds.faults import KNOT_M_S, Fault, FaultKind
from sim_feeds.papers.lu2016 import (
    LU2016_AIR_STD,
    LU2016_GROUND_STD,
    LU2016_U_STD,
    lu2016_experiment,
)
from sim_feeds.papers.wan import (
    WAN_SAMPLE_S,
    wan_experiment,
)


@pytest.mark.parametrize("air", ["calm", "shear", "turbulence"])
def test_lu2016_sampling_noise_and_truth(air, oracle):
    e = lu2016_experiment(air, seed=1)
    assert e.u_m.shape == (4001, 6)
    np.testing.assert_allclose(np.diff(e.t_s), 0.01, atol=1e-9)
    clean = lu2016_experiment(air, seed=1, u_std=np.zeros(6), faults=[])
    np.testing.assert_allclose((e.u_m - e.f - clean.u_m).std(axis=0), LU2016_U_STD, rtol=0.05)
    np.testing.assert_allclose((e.y_ground - e.x_ground).std(axis=0), LU2016_GROUND_STD, rtol=0.05)
    for name, u_std, y_std in (
        ("atsekf_GS", LU2016_U_STD, LU2016_GROUND_STD),
        ("atsekf_AS", LU2016_U_STD, LU2016_AIR_STD),
    ):
        data = np.load(oracle / f"{name}.npz")
        np.testing.assert_allclose(np.diag(data["Q"]), u_std**2, rtol=1e-6)
        np.testing.assert_allclose(np.diag(data["R"]), y_std**2, rtol=1e-6)
    u, v, w = e.x_air[:, :3].T
    V = np.sqrt(u**2 + v**2 + w**2)
    expected = np.column_stack([V, np.arctan2(w, u), np.arcsin(v / V)])
    np.testing.assert_allclose(
        (e.y_air[:, :3] - expected).std(axis=0), LU2016_AIR_STD[:3], rtol=0.05
    )
    moved = np.ptp(e.wind_ned_m_s, axis=0).max()
    assert (moved == 0.0) == (air == "calm")


def test_lu2016_faults_act_from_10_to_30_s():
    e = lu2016_experiment(seed=2)
    on = (e.t_s > 9.995) & (e.t_s < 29.995)
    assert not e.f[~on].any()
    np.testing.assert_allclose(e.f[on, 0], 3.0)
    np.testing.assert_allclose(e.f[on, 1], 0.1 * (e.t_s[on] - 10.0), atol=1e-9)
    np.testing.assert_allclose(e.f[on, 2], 4.0 * np.sin(0.5 * np.pi * e.t_s[on]), atol=1e-9)


def test_wan_experiment_closes_the_wind_triangle():
    """wan2018 (8)-(10) with the algorithm's signs, up to what the lateral turbulence adds."""
    e = wan_experiment([], seed=1)
    np.testing.assert_allclose(np.diff(e.t_s), WAN_SAMPLE_S, atol=1e-9)
    alpha, V_g, W_x, W_z = e.x.T
    angle = alpha - e.truth.euler_rad[:, 1]
    s, c = np.sin(angle), np.cos(angle)
    a, b = W_x * c + W_z * s, W_x * s - W_z * c
    np.testing.assert_allclose(-a + np.sqrt(V_g**2 - b**2), e.truth.tas_m_s, atol=0.03)
    sink = e.truth.tas_m_s * s + W_z
    np.testing.assert_allclose(sink, e.truth.vel_ned_m_s[:, 2], atol=0.03)
    assert np.ptp(W_x) > 12.0
    assert np.ptp(W_z) > 2.5
    assert not e.faulty.any()


def test_three_airspeeds_running_away():
    fall = -15.0 * KNOT_M_S
    faults = [Fault(f"airspeed{i}", FaultKind.RUNAWAY, 20.0, rate=fall) for i in range(3)]
    e = wan_experiment(faults, seed=1)
    at = int(np.searchsorted(e.t_s, 25.0))
    off = e.cas_m_s[at] - e.cas_true_m_s[at]
    np.testing.assert_allclose(off, fall * (e.t_s[at] - 20.0), atol=1.5)
    assert (e.cas_m_s >= 0.0).all()
