"""The filter bank as a stream: any split, late and slow measurements, what the windows estimate."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from estimators import ins_bank as bank
from estimators.attitude import dcm_from_quaternion, quaternion_from_euler
from estimators.imu_evidence import log_likelihood, single_axis
from estimators.ins_bank_model import ATT, F_ACC, INS

Array = NDArray[np.float64]
Events = tuple[Array, NDArray[np.int64], Array]

LAT = 0.9
G = 9.81298
SPEED = 25.0

TUNING = bank.Tuning(
    noise_density=np.array([0.03] * 3 + [0.001] * 3),
    scale_error=np.full(6, 0.005),
    fault_density=np.array([0.003] * 3 + [0.0002] * 3),
    turn_on_std=np.array([0.3] * 3 + [0.01] * 3),
    ref_std=np.array([[8.0, 8.0, 0.2, 3.0], [0.015, 0.015, 0.05, 3.0]]),
    ref_tau=np.array([[300.0, 300.0, 60.0, 40.0], [30.0, 30.0, 60.0, 40.0]]),
    gps_std_m_s=0.12,
    gps_down_std_m_s=0.3,
    baro_std_m=0.4,
    tilt_std_rad=0.005,
    heading_std_rad=0.01,
    slip_std_rad=0.05,
    gust_std_m_s=1.0,
    window_s=np.array([1.6, 4.8, 14.4, 43.2]),
    tick_s=0.2,
    max_rate_rad_s=2.5,
    interest_sigma=4.5,
    interest_size=np.array([0.15] * 3 + [0.005] * 3),
    difference_sigma=6.0,
    single_sigma=6.0,
    attitude_independent=False,
    noise_ln=np.log(16.0),
)


def attitudes(t: Array) -> tuple[Array, Array]:
    """Heading and bank of a level flight that weaves, coordinated."""
    psi = 0.3 + 0.9 * np.sin(0.3 * t)
    return psi, np.arctan2(SPEED * 0.27 * np.cos(0.3 * t), G)


def velocity(t: Array) -> Array:
    psi, _ = attitudes(t)
    return SPEED * np.column_stack([np.cos(psi), np.sin(psi), 0.0 * t])


def quaternions(t: Array) -> Array:
    psi, phi = attitudes(t)
    return np.array([quaternion_from_euler(a, 0.0, b) for a, b in zip(phi, psi, strict=True)])


def inputs(t: Array) -> Array:
    """Specific force and rates, by differences of attitude and velocity over a millisecond.

    The turning earth is left out: its 7e-5 rad/s is a slow bias to the filters.
    """
    eps = 5e-4
    out = np.empty((len(t), 6))
    accel = (velocity(t + eps) - velocity(t - eps)) / (2.0 * eps) - np.array([0.0, 0.0, G])
    pairs = zip(quaternions(t - eps), quaternions(t + eps), quaternions(t), strict=True)
    for i, (before, after, now) in enumerate(pairs):
        R, D = dcm_from_quaternion(now), dcm_from_quaternion(before).T @ dcm_from_quaternion(after)
        out[i, :3] = R.T @ accel[i]
        out[i, 3:] = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / (4 * eps)
    return out


def flight(
    end_s: float = 60.0,
    fault: tuple[int, float, float] | None = None,
    seed: int = 1,
    gps_late_s: float = 0.0,
    imu_noise: float = 0.05,
) -> Events:
    """Events of one IMU at 40 Hz, GPS at 5 Hz, height and attitude at 10 Hz."""
    rng = np.random.default_rng(seed)
    parts = []
    t = np.arange(10.0, end_s, 0.025) + 0.001
    u = inputs(t) + np.repeat([imu_noise, 0.05 * imu_noise], 3) * rng.standard_normal((len(t), 6))
    if fault is not None:
        axis, size, from_s = fault
        u[t > from_s, axis] += size
    parts.append((t, np.zeros(len(t)), u))
    t = np.arange(10.0, end_s, 0.2) + 0.013
    vel = velocity(t) + 0.08 * rng.standard_normal((len(t), 3))
    fine = np.arange(10.0, end_s + 0.3, 0.005)
    flown = np.cumsum(0.005 * velocity(fine), axis=0)
    lat = LAT + np.interp(t, fine, flown[:, 0]) / 6371000.0
    lon = 0.1 + np.interp(t, fine, flown[:, 1]) / (6371000.0 * math.cos(LAT))
    gps = np.column_stack([vel[:, :2], np.full(len(t), np.nan), lat, 0 * t + 300.0, lon, 0 * t])
    parts.append((t + gps_late_s, np.full(len(t), bank.GPS), gps))
    t = np.arange(10.0, end_s, 0.1) + 0.007
    height = (300.0 + 0.2 * rng.standard_normal(len(t)))[:, None]
    parts.append((t, np.full(len(t), bank.BARO), height))
    parts.append((t + 0.001, np.full(len(t), bank.ATTITUDE), quaternions(t + 0.001)))
    parts.append((np.array([10.5]), np.array([float(bank.PHASE)]), np.ones((1, 1))))
    values = [np.pad(v, ((0, 0), (0, bank.EVENT_WIDTH - v.shape[1]))) for _, _, v in parts]
    t_s = np.concatenate([p[0] for p in parts])
    order = np.argsort(t_s, kind="stable")
    kind = np.concatenate([p[1] for p in parts]).astype(np.int64)
    return t_s[order], kind[order], np.ascontiguousarray(np.concatenate(values)[order])


def fly(events: Events, cuts: list[int] | None = None, n_imus: int = 1) -> tuple[bank.Bank, Array]:
    """Run a bank over events, in pieces cut at the given event numbers."""
    b = bank.make_bank(n_imus, TUNING)
    t_s, kind, values = events
    ticks, used = np.zeros((2000, n_imus, bank.TICK_WIDTH)), np.zeros(1, dtype=np.int64)
    edges = [0, *sorted(cuts or []), len(t_s)]
    for lo, hi in pairwise(edges):
        at = 0
        piece = t_s[lo:hi], kind[lo:hi], values[lo:hi]
        while at < hi - lo:
            at = bank.run(b, TUNING, *piece, at, ticks, used, False)
            if b.clock[bank.C_STOPPED] == 1.0:
                b.clock[bank.C_STOPPED] = b.clock[bank.C_CHANGED] = 0.0
                bank.roll(b, TUNING)
    return b, ticks[: int(used[0])]


SHORT = flight(20.0)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(0, len(SHORT[0])), max_size=40))
def test_any_split_of_the_stream_gives_the_same_bits(cuts: list[int]) -> None:
    whole, ticks = fly(SHORT)
    pieces, ticks_too = fly(SHORT, cuts)
    for name, a, c in zip(bank.Bank._fields, whole, pieces, strict=True):
        np.testing.assert_array_equal(a, c, err_msg=name)
    np.testing.assert_array_equal(ticks, ticks_too)


def test_a_healthy_flight_is_consistent() -> None:
    """Innovations no larger than their covariance, statistics below five sigma, biases small."""
    b, ticks = fly(flight(100.0))
    assert 0.2 < b.nis[INS] < 1.2
    _, z = single_axis(b.L[:, :-1], b.Y[:, :-1], b.start_nis[:, :-1])
    assert np.abs(z).max() < 4.5
    last = ticks[-1, 0]
    np.testing.assert_allclose(last[1:4], 0.0, atol=4.0 * np.sqrt(last[7:10]).max())
    np.testing.assert_allclose(last[4:7], 0.0, atol=0.005)


@pytest.mark.parametrize("mode", [INS, ATT])
@pytest.mark.parametrize(
    ("axis", "size"), [(0, 1.0), (1, -1.0), (2, 0.7), (3, 0.05), (4, -0.05), (5, 0.1)]
)
def test_the_windows_name_the_axis_and_its_size(mode: int, axis: int, size: float) -> None:
    """Six seconds after a step that a window happens to start with: axis, sign and size."""
    b, _ = fly(flight(63.7, fault=(axis, size, 57.65)))
    f, z = single_axis(b.L[mode, :-1], b.Y[mode, :-1], b.start_nis[mode, :-1])
    w = int(np.argmin(np.abs(b.start_s[mode, :-1] - 57.6)))
    assert abs(z[w, axis]) > 6.0
    assert np.abs(z[w]).argmax() == axis
    assert f[w, axis] == pytest.approx(size, rel=0.3)


def test_accepting_a_fault_moves_it_into_the_state() -> None:
    b, _ = fly(flight(64.0, fault=(0, 1.0, 60.0)))
    f, z = single_axis(b.L[INS, :-1], b.Y[INS, :-1], b.start_nis[INS, :-1])
    w = int(np.abs(z[:, 0]).argmax())
    before = b.P[INS].copy()
    axes = np.array([1.0, 0, 0, 0, 0, 0])
    taken = bank.accept(b, INS, w, axes, np.zeros(6), np.full(6, np.inf), 64.0)
    assert taken[0] == pytest.approx(f[w, 0])
    assert b.x[INS, F_ACC] == pytest.approx(1.0, abs=0.35)
    assert (np.linalg.eigvalsh(b.P[INS] - before) > -1e-9).all()
    assert not b.L[INS, :-1].any()


def test_a_course_explains_an_oscillation_that_a_step_does_not() -> None:
    """Driven by the fault's own course, the last window is sure of it; its opposite is not."""
    b = bank.make_bank(1, TUNING)
    t_s, kind, values = flight(66.0)
    course = np.where(t_s > 58.0, 1.5 * np.sin(0.5 * np.pi * (t_s - 58.0)), 0.0)
    values = values.copy()
    values[kind == 0, 0] += course[kind == 0]
    ticks, used = np.zeros((2000, 1, bank.TICK_WIDTH)), np.zeros(1, dtype=np.int64)
    at, driven = 0, 0.0
    while at < len(t_s):
        at = bank.run(b, TUNING, t_s, kind, values, at, ticks, used, True)
        b.clock[bank.C_STOPPED] = b.clock[bank.C_CHANGED] = 0.0
        now = float(b.clock[bank.C_NOW])
        if math.isnan(b.start_s[INS, -1]) and now > 58.0:
            bank.mark(b, now)
        if not math.isnan(b.start_s[INS, -1]):
            value = 1.5 * math.sin(0.5 * math.pi * (now - 58.0))
            bank.drive(b, 0, np.array([value - driven, 0, 0, 0, 0, 0]))
            driven = value
        bank.roll(b, TUNING)
    axis = np.array([1.0, 0, 0, 0, 0, 0])
    args = b.L[INS, -1], b.Y[INS, -1]
    assert log_likelihood(*args, axis, 1.0) > 15.0
    assert log_likelihood(*args, -axis, 1.0) < -15.0


def test_latency_that_is_not_taken_off_shows_in_the_innovations() -> None:
    """In a turn a velocity stamped 0.2 s late is wrong by a m/s: validity times matter."""
    prompt, _ = fly(flight(60.0))
    late, _ = fly(flight(60.0, gps_late_s=0.2))
    assert late.nis[ATT] > 2.0 * prompt.nis[ATT]


def test_a_receiver_that_contradicts_itself_is_not_used() -> None:
    t_s, kind, values = flight(40.0)
    values = values.copy()
    jump = (kind == bank.GPS) & (t_s > 38.0)
    values[jump, 3] += 100.0 / 6371000.0
    b, _ = fly((t_s, kind, values))
    assert b.clock[bank.C_GPS_BAD_S] > 40.0
    assert np.isnan(b.aligned_s).all()


def test_a_hole_in_the_samples_ends_the_alignment_until_the_next_attitude() -> None:
    t_s, kind, values = flight(40.0)
    keep = (kind != 0) | (t_s < 30.0) | (t_s > 31.0)
    b, _ = fly((t_s[keep], kind[keep], values[keep]))
    assert 31.0 < b.aligned_s[INS] < 31.5
