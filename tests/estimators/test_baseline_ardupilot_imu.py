"""EKF3's lanes and the comparison of IMUs before arming."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from estimators.baselines import ardupilot_imu as lanes
from estimators.baselines.ardupilot_imu import ArduPilotImus

SPEED_M_S, EARTH_M, G0 = 20.0, 6_371_000.0, 9.80665
ARMED_S, FAULT_S = 10.0, 60.0

Events = tuple[np.ndarray, np.ndarray, np.ndarray]


def flight(
    seconds: float = 100.0,
    *,
    acc: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gyro: tuple[float, float, float] = (0.0, 0.0, 0.0),
    count: int = 2,
    from_s: float = FAULT_S,
    receiver: float = 0.0,
) -> Events:
    """Straight and level north at 20 m/s, IMUs at 40 Hz; IMU 0 is wrong from ``from_s`` on.

    ``receiver`` is an error that the receiver's velocity has instead [m/s].
    """
    rng = np.random.default_rng(1)
    rows: list[tuple[int, int, list[float]]] = []
    for i in range(round(40 * seconds)):
        t_us, t = 25_000 * i, 0.025 * i
        wrong = 1.0 if t >= from_s else 0.0
        for k in range(count):
            u = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -G0])
            u[:3] += 0.003 * rng.standard_normal(3)
            u[3:] += 0.05 * rng.standard_normal(3)
            if k == 0:
                u[:3] += wrong * np.array(gyro)
                u[3:] += wrong * np.array(acc)
            rows.append((t_us, lanes.SAMPLE + k, list(u)))
        if i % 4 == 0:
            rows.append((t_us, lanes.HEADING, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
            rows.append((t_us, lanes.BARO, [100.0 + 0.1 * rng.standard_normal(), 0, 0, 0, 0, 0]))
        if i % 8 == 0:
            speed = SPEED_M_S + wrong * receiver + 0.05 * rng.standard_normal()
            lat = 0.8 + SPEED_M_S * t / EARTH_M
            rows.append((t_us, lanes.FIX, [speed, 0.0, lat, 0.1, 200.0, 3.0]))
        if t_us == round(ARMED_S * 1e6):
            rows.append((t_us, lanes.ARMED, [1.0, 0, 0, 0, 0, 0]))
    return (
        np.array([r[0] for r in rows]),
        np.array([r[1] for r in rows]),
        np.array([r[2] for r in rows]),
    )


@pytest.mark.parametrize(
    ("fault", "within_s"),
    [
        ({"acc": (0.0, 0.0, 5.0)}, 1.2),
        ({"acc": (0.0, 0.0, 2.0)}, 2.6),
        ({"gyro": (0.08, 0.0, 0.0)}, 5.0),
        ({"gyro": (0.0, 0.08, 0.0)}, 5.0),
    ],
)
def test_a_wrong_imu_is_left_for_the_other(
    fault: dict[str, tuple[float, float, float]], within_s: float
) -> None:
    out = ArduPilotImus().step(*flight(80.0, **fault))
    switches = out[out[:, 1] == lanes.SWITCHED]
    assert switches[0, 2] == 1
    assert 0.0 < switches[0, 0] * 1e-6 - FAULT_S < within_s


def test_a_small_bias_a_healthy_pair_and_a_lone_imu_switch_nothing() -> None:
    assert len(ArduPilotImus().step(*flight(80.0, acc=(0.0, 0.0, 0.3)))) == 0
    assert len(ArduPilotImus().step(*flight(80.0))) == 0
    assert len(ArduPilotImus().step(*flight(80.0, acc=(0.0, 0.0, 5.0), count=1))) == 0


def test_a_wrong_receiver_is_no_reason_to_switch() -> None:
    imus = ArduPilotImus()
    assert len(imus.step(*flight(80.0, receiver=12.0))) == 0
    assert imus.lost_s > 5.0


def test_only_before_arming_a_difference_is_reported() -> None:
    early = ArduPilotImus().step(*flight(20.0, acc=(0.0, 1.0, 0.0), from_s=2.0))
    assert early[0, 1] == lanes.INCONSISTENT
    assert early[0, 0] * 1e-6 == pytest.approx(2.0, abs=0.1)
    late = ArduPilotImus().step(*flight(30.0, acc=(0.0, 1.0, 0.0), from_s=15.0))
    assert lanes.INCONSISTENT not in late[:, 1]


def test_covariance_step_against_dense_matrices() -> None:
    rng = np.random.default_rng(2)
    s = np.zeros(lanes._LANE)
    s[lanes.DT] = 0.1
    s[lanes.FSUM : lanes.FSUM + 3] = f = rng.standard_normal(3)
    A = rng.standard_normal((15, 15))
    P = A @ A.T
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    F = np.eye(15)
    F[3:6, 0:3] = 0.1 * np.eye(3)
    F[0:3, 6:9] = -np.array([[0, -f[2], f[1]], [f[2], 0, -f[0]], [-f[1], f[0], 0]])
    F[0:3, 12:15] = F[6:9, 9:12] = -0.1 * R
    grown = np.zeros(15)
    for at, psd in (
        (0, lanes.ACC_PSD),
        (6, lanes.GYRO_PSD),
        (9, lanes.GYRO_BIAS_PSD),
        (12, lanes.ACC_BIAS_PSD),
    ):
        grown[at : at + 3] = 0.1 * psd
    expected = F @ P @ F.T + np.diag(grown)
    lanes._covariance(s, P, R)
    np.testing.assert_allclose(P, expected, atol=1e-12)


def test_any_split_of_the_stream_says_the_same() -> None:
    events = flight(75.0, acc=(0.0, 0.0, 5.0))
    whole = ArduPilotImus().step(*events)
    imus = ArduPilotImus()
    edges = [0, 1, 2, 4000, 4001, 9000, len(events[0])]
    parts = [imus.step(*(e[a:b] for e in events)) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
