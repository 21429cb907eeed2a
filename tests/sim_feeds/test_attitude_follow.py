"""The deviation of an attitude that follows a faulty IMU, against the solution of its equation."""

from math import cos, exp, radians, sin

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from links.samples import Batch, empty_rows
from sim_feeds.attitude_follow import STANDARD_GRAVITY, AttitudeFollows
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.injection import Injection, RowInjector
from sim_feeds.rotation import matrix_from_euler, matrix_from_quaternion, quaternion_from_matrix

ON = 2.0
TAU = 4.0
DW = radians(3.0)


def steady(yaw_rad: float = 0.0, roll_rad: float = 0.0, seconds: float = 60.0) -> Batch:
    """An IMU at 50 Hz and an attitude at 10 Hz that stand still; attitude half a step later."""
    imu, attitude = (
        empty_rows("imu0", round(50 * seconds)),
        empty_rows("attitude", round(10 * seconds)),
    )
    imu["t_us"] = np.arange(len(imu)) * 20_000
    attitude["t_us"] = np.arange(len(attitude)) * 100_000 + 10_000
    imu["acc_m_s2"] = [0.0, 0.0, -STANDARD_GRAVITY]
    matrix = matrix_from_euler(np.array([roll_rad]), np.array([0.0]), np.array([yaw_rad]))
    attitude["q_ned_from_frd"] = quaternion_from_matrix(matrix)[0]
    order = np.argsort(np.concatenate([imu["t_us"], attitude["t_us"]]), kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    imu["seq"], attitude["seq"] = place[: len(imu)], place[len(imu) :]
    return Batch({"imu0": imu, "attitude": attitude})


def followed(batch: Batch, *faults: Fault, tau_s: float = TAU) -> np.ndarray:
    injection = Injection(faults, AttitudeFollows(tilt_s=tau_s, heading_s=2.0 * tau_s))
    return RowInjector(injection, 0, 0).apply(batch).rows["attitude"]


def deviation(batch: Batch, rows: np.ndarray) -> np.ndarray:
    """Rotation vectors in NED from the recorded attitude to the followed one, (n, 3)."""
    old = matrix_from_quaternion(batch.rows["attitude"]["q_ned_from_frd"])
    E = matrix_from_quaternion(rows["q_ned_from_frd"]) @ np.swapaxes(old, 1, 2)
    axis = np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], 1)
    size = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(0.5 * size, 0.5 * (np.trace(E, axis1=1, axis2=2) - 1.0))
    return axis * np.divide(angle, size, out=np.zeros_like(size), where=size > 0.0)[:, None]


@pytest.mark.parametrize(("axis", "k", "tau"), [("x", 0, TAU), ("y", 1, TAU), ("z", 2, 2 * TAU)])
def test_a_gyro_fault_tilts_to_tau_times_the_fault(axis, k, tau):
    batch = steady()
    rows = followed(batch, Fault(f"imu0.gyro_{axis}", FaultKind.BIAS, ON, size=DW))
    t = batch.rows["attitude"]["t_us"] * 1e-6
    expected = np.zeros((len(t), 3))
    expected[:, k] = tau * DW * (1.0 - np.exp(-np.clip(t - ON, 0.0, None) / tau))
    assert_allclose(deviation(batch, rows), expected, atol=1e-12)
    assert_allclose(rows["rate_rad_s"][:, k], np.where(t >= ON, DW, 0.0))


def test_after_the_fault_the_deviation_decays():
    batch = steady()
    rows = followed(batch, Fault("imu0.gyro_x", FaultKind.BIAS, ON, 10.0, size=DW))
    t = batch.rows["attitude"]["t_us"] * 1e-6
    psi = deviation(batch, rows)[:, 0]
    reached = TAU * DW * (1.0 - exp(-(10.0 - ON) / TAU))
    after = t >= 10.0
    assert_allclose(psi[after], reached * np.exp(-(t[after] - 10.0) / TAU), atol=2e-10)
    assert_array_equal(rows["rate_rad_s"][after], 0.0)


def test_a_yawed_aircraft_tilts_about_the_axis_of_its_own_gyro():
    yaw = radians(50.0)
    batch = steady(yaw_rad=yaw)
    psi = deviation(batch, followed(batch, Fault("imu0.gyro_x", FaultKind.BIAS, ON, size=DW)))[-1]
    assert_allclose(psi, TAU * DW * np.array([cos(yaw), sin(yaw), 0.0]), atol=1e-6)


def test_an_accelerometer_fault_tilts_to_where_the_false_force_hangs():
    batch = steady()
    ahead = followed(batch, Fault("imu0.acc_x", FaultKind.BIAS, ON, size=1.0))
    right = followed(batch, Fault("imu0.acc_y", FaultKind.BIAS, ON, size=1.0))
    tilt = 1.0 / STANDARD_GRAVITY
    assert_allclose(deviation(batch, ahead)[-1], [0.0, tilt, 0.0], atol=1e-6)  # nose up
    assert_allclose(deviation(batch, right)[-1], [-tilt, 0.0, 0.0], atol=1e-6)  # left wing down
    for rows in (ahead, right):
        assert_array_equal(rows["rate_rad_s"], 0.0)
    # So much that the faulty force, seen in the false attitude, is vertical.
    force = matrix_from_quaternion(ahead["q_ned_from_frd"])[-1] @ [1.0, 0.0, -STANDARD_GRAVITY]
    assert abs(force[0]) < 0.01


def test_a_vertical_accelerometer_fault_tilts_nothing_in_level_flight():
    batch = steady()
    rows = followed(batch, Fault("imu0.acc_z", FaultKind.BIAS, ON, size=3.0))
    assert_allclose(deviation(batch, rows), 0.0, atol=1e-12)


def test_without_a_fault_the_attitude_is_the_recorded_one():
    batch = steady(0.3, 0.2)
    rows = followed(batch, Fault("imu0.gyro_x", FaultKind.BIAS, 1000.0, size=DW))
    assert rows.tobytes() == batch.rows["attitude"].tobytes()
    other = followed(batch, Fault("imu1.gyro_x", FaultKind.BIAS, ON, size=DW))
    assert other.tobytes() == batch.rows["attitude"].tobytes()


def test_an_imu_that_drops_out_drives_nothing_more():
    batch = steady()
    faults = [
        Fault("imu0.gyro_x", FaultKind.BIAS, ON, 6.0, size=DW),
        Fault("imu0", FaultKind.DROPOUT, 4.0, 6.0),
    ]
    psi = deviation(batch, followed(batch, *faults))[:, 0]
    t = batch.rows["attitude"]["t_us"] * 1e-6
    assert t[np.argmax(psi)] == pytest.approx(4.0, abs=0.11)
    assert psi[-1] < 1e-6
