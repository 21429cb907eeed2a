"""A six-degree-of-freedom flight read by the instruments of the kinematic vehicle."""

import numpy as np
import pytest

from sim_feeds import earth
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.sensors import Airspeed, Imu
from sim_feeds.sixdof import SixDofFlight, fly_aerosonde
from sim_feeds.sixdof.aerosonde import STEP_S
from sim_feeds.sixdof.as_truth import as_truth

pytest.importorskip("jsbsim", reason="the extra sim is not installed")


@pytest.fixture(scope="module")
def flight() -> SixDofFlight:
    return fly_aerosonde(seed=6, wind_share=0.22, duration_s=30.0, record_s=STEP_S)


def test_acceleration_is_the_derivative_of_velocity(flight):
    truth = as_truth(flight)
    a, v = truth.acc_ned_m_s2, truth.vel_ned_m_s
    gained = np.cumsum((a[1:] + a[:-1]) * (STEP_S / 2.0), axis=0)
    miss = (v[1:] - v[0]) - gained
    assert np.abs(miss[200:] - miss[:-200]).max() < 0.01


def test_the_air_triangle_closes(flight):
    """JSBSim's airspeed and angles against those of velocity, wind and attitude."""
    truth = as_truth(flight)
    u, v, w = truth.air_frd_m_s.T
    speed = np.linalg.norm(truth.air_frd_m_s, axis=1)
    np.testing.assert_allclose(speed, truth.tas_m_s, atol=1e-6)
    np.testing.assert_allclose(np.arctan2(w, u), truth.aoa_rad, atol=1e-7)
    np.testing.assert_allclose(np.arcsin(v / speed), truth.ssa_rad, atol=1e-7)


def test_the_atmosphere_is_the_standard_one(flight):
    np.testing.assert_allclose(earth.density(flight.height_m), flight.density_kg_m3, rtol=1e-4)
    truth = as_truth(flight)
    equivalent = flight.tas_m_s * np.sqrt(flight.density_kg_m3 / 1.225)
    np.testing.assert_allclose(truth.cas_m_s, equivalent, rtol=2e-3)


def test_instruments_read_it_and_break_on_it(flight):
    truth = as_truth(flight)
    quiet = {name: 0.0 for name in Imu.model_fields if "noise" in name or "bias" in name}
    imu = Imu(**quiet | {"acc_walk_m_s2": 0.0, "gyro_walk_deg_s": 0.0})
    fault = Fault("imu0.acc_z", FaultKind.BIAS, 10.0, size=2.0)
    series = imu.sample(truth, 0, [fault], seed=1)
    expected = np.interp(series.valid_s, truth.t_s, truth.specific_force_m_s2[:, 2])
    expected += np.where(series.valid_s >= 10.0, 2.0, 0.0)
    np.testing.assert_allclose(series.values[:, 2], expected, atol=1e-9)
    cas = Airspeed().sample(truth, 0, [], seed=1).values[:, 0]
    assert np.all(np.isfinite(cas))
