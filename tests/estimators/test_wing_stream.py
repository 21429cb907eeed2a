"""Wing faults on a stream: covariance, wind, accelerometers, deviations, and any split."""

from __future__ import annotations

import itertools
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from estimators.wing_force import FORCE_STATE, T_LAST, force_rows
from estimators.wing_model import AERODYNAMIC, FAULTS, INPUTS, Airframe, inputs_of, predict_rows
from estimators.wing_noise import noise_row, whiten_rows
from estimators.wing_spread import spread_rows
from estimators.wing_stream import WingRun, WingStream, WingTuning
from estimators.wing_wind import WIND_STATE, own_wind
from links.airframes import load_airframe

Array = NDArray[np.float64]

AIRFRAME = Airframe.of(load_airframe("aerosonde"))
NAMES = [field.name for field in fields(Airframe)]
SHARE = 0.15
STD = np.array([SHARE * abs(getattr(AIRFRAME, n)) * (n in AERODYNAMIC) for n in NAMES])
FLOOR = np.array([0.03, 0.03, 0.03, 0.01, 0.01, 0.01])
SPEED, RHO = 25.0, 1.2


def tuning(**other: float) -> WingTuning:
    values = {
        "gust_m_s": 0.8, "tas_std_m_s": 0.3, "tilt_std_rad": 0.002, "share": 0.005,
        "tau_wind_s": 10.0, "tau_acc_s": 4.0, "period_s": 0.5, "contradiction_m_s2": 0.4,
        "N": 50, "lam_percent": 3.0, "R_percent2": 1.0,
    }  # fmt: skip
    return WingTuning(coefficient_std=STD, floor=FLOOR, **(values | other))


def level(n: int, *, yaw: float = 0.6) -> Array:
    """Input rows of straight flight in still air."""
    alpha = 0.04
    heading = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return inputs_of(
        euler_rad=np.tile([0.0, alpha, yaw], (n, 1)),
        vel_ned_m_s=np.tile(SPEED * heading, (n, 1)),
        rate_rad_s=np.zeros((n, 3)),
        surfaces_rad=np.tile([-0.1, 0.0, 0.0], (n, 1)),
        prop_rad_s=np.full(n, 450.0),
        wind_ned_m_s=np.zeros((n, 3)),
        density_kg_m3=np.full(n, RHO),
        height_m=np.zeros(n),
        tas_m_s=np.full(n, SPEED),
    )


def flight(seed: int, n: int = 1600, damage: tuple[int, float, float] | None = None) -> tuple:
    """Ticks of 50 ms whose accelerations are the model's own, gusts and a step of damage added."""
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(n)
    x = level(n)
    gust = np.zeros((n, 3))
    for k in range(1, n):
        gust[k] = 0.97 * gust[k - 1] + 0.2 * rng.standard_normal(3)
    met = x.copy()
    met[:, 13:16] = gust
    f = np.zeros((n, 4))
    if damage is not None:
        f[t >= damage[1], damage[0]] = damage[2]
    phi = np.empty((n, 6))
    predict_rows(AIRFRAME.row(), met, f, phi)
    # an aircraft held on its path: what is not its trim shows in the rates and the specific force
    trim = np.empty((1, 6))
    predict_rows(AIRFRAME.row(), x[:1], np.zeros((1, 4)), trim)
    return t, x, phi - trim


def test_noise_is_the_sum_of_its_causes() -> None:
    x = level(1)[0]
    Q, none = np.empty((6, 6)), np.zeros(len(STD))
    noise_row(AIRFRAME.row(), none, x, 1.0, 0.0, 0.0, 0.0, np.zeros(6), Q)
    phi, moved = np.empty((1, 6)), np.empty((1, 6))
    predict_rows(AIRFRAME.row(), x[None], np.zeros((1, 4)), phi)
    expected = np.zeros((6, 6))
    for axis in range(3):
        gusty = x.copy()
        gusty[13 + axis] += 1.0
        predict_rows(AIRFRAME.row(), gusty[None], np.zeros((1, 4)), moved)
        expected += np.outer(moved - phi, moved - phi)
    np.testing.assert_allclose(Q, expected, rtol=1e-12, atol=1e-12)


def test_every_unknown_widens_the_noise() -> None:
    x, before, after = level(1)[0], np.empty((6, 6)), np.empty((6, 6))
    base = (AIRFRAME.row(), np.zeros(len(STD)), x, 0.8, 0.3, 0.002, 0.005, FLOOR)
    noise_row(*base, before)
    for change in ((1, STD), (3, 1.6), (4, 0.6), (5, 0.02), (6, 0.1), (7, 2.0 * FLOOR)):
        wider = list(base)
        wider[change[0]] = change[1]
        noise_row(*wider, after)
        assert (np.diag(after) >= np.diag(before)).all()
        assert np.trace(after) > np.trace(before)


def test_whitened_rows_have_the_noise_taken_out() -> None:
    x = level(1)
    Q = np.empty((6, 6))
    args = (AIRFRAME.row(), STD, x[0], 0.8, 0.3, 0.002, 0.005, FLOOR)
    noise_row(*args, Q)
    rng = np.random.default_rng(0)
    y, S = rng.standard_normal((1, 6)), rng.standard_normal((1, 6, 4))
    y0, S0 = y.copy(), S.copy()
    lost = whiten_rows(*args[:2], x, *args[3:], y, S, np.empty((1, 2)))
    assert lost == 0
    inverse = np.linalg.inv(Q)
    assert y[0] @ y[0] == pytest.approx(y0[0] @ inverse @ y0[0])
    np.testing.assert_allclose(S[0].T @ S[0], S0[0].T @ inverse @ S0[0], rtol=1e-9)


def test_a_row_that_is_lost_says_nothing_at_all() -> None:
    x = level(2)
    x[1, 16] = np.inf
    y, S, lasting = np.ones((2, 6)), np.ones((2, 6, 4)), np.empty((2, 2))
    assert whiten_rows(AIRFRAME.row(), STD, x, 0.8, 0.3, 0.002, 0.005, FLOOR, y, S, lasting) == 1
    assert np.isfinite(S[0]).all()
    assert np.isnan(y[1]).all()
    assert np.isnan(S[1]).all()


def test_known_coefficients_leave_no_lasting_difference() -> None:
    x, y, lasting = level(1), np.zeros((1, 6)), np.empty((1, 2))
    S, phi, hurt = np.empty((1, 6, 4)), np.empty((1, 6)), np.empty((1, 6))
    predict_rows(AIRFRAME.row(), x, np.zeros((1, 4)), phi)
    for j in range(4):
        predict_rows(AIRFRAME.row(), x, np.eye(4)[j : j + 1], hurt)
        S[:, :, j] = hurt - phi
    args = (x, 0.8, 0.3, 0.002, 0.005, FLOOR)
    whiten_rows(AIRFRAME.row(), np.zeros(len(STD)), *args, y, S.copy(), lasting)
    assert (lasting == 0.0).all()
    whiten_rows(AIRFRAME.row(), STD, *args, y, S.copy(), lasting)
    assert 0.2 < lasting[0, 0] < 5.0


def test_wind_is_found_and_level() -> None:
    n = 2000
    x = level(n)
    x[:, 3] += 4.0
    x[:, 4] -= 2.0
    t = 0.05 * np.arange(n)
    own_wind(AIRFRAME.row(), t, x, 10.0, np.zeros(WIND_STATE))
    np.testing.assert_allclose(x[-1, 13:16], [4.0, -2.0, 0.0], atol=0.05)


def test_accelerometers_take_the_place_of_the_velocity() -> None:
    """With a rolled-off attitude, d is the gravity that the velocity's slope does not show."""
    n, tilt = 400, 0.01
    x, t = level(n), 0.05 * np.arange(n)
    x[:, 0] = tilt
    acc = np.tile([0.0, 0.0, -9.80665], (n, 1))
    state, d = np.zeros(FORCE_STATE), np.empty((n, 3))
    state[T_LAST] = np.nan
    force_rows(t, x, acc, 4.0, state, d)
    n_mean = t[-1] / 60.0
    bias = 9.80665 * tilt * n_mean / (n_mean + 2.0)
    assert d[-1, 1] + bias == pytest.approx(9.80665 * tilt * np.cos(0.04), abs=4e-3)


def test_without_accelerometers_nothing_changes() -> None:
    n = 100
    state, d = np.zeros(FORCE_STATE), np.empty((n, 3))
    state[T_LAST] = np.nan
    force_rows(0.05 * np.arange(n), level(n), np.full((n, 3), np.nan), 4.0, state, d)
    assert (d == 0.0).all()


def test_deviation_of_one_direction_alone() -> None:
    """Four orthogonal signatures of length s over N rows: sigma = sqrt(kappa / N) / s."""
    N, s, kappa = 20, 0.1, 9.0
    S = np.zeros((2 * N, 6, 4))
    S[:, range(4), range(4)] = s
    std = np.empty((2 * N, 6))
    spread_rows(S, kappa, np.zeros((N, 4, 4)), np.zeros(1), std)
    np.testing.assert_allclose(std[-1, :4], np.sqrt(kappa / N) / s)
    np.testing.assert_allclose(std[-1, 4:], np.sqrt(2.0 * kappa / N) / s)
    np.testing.assert_allclose(std[0, :4], np.sqrt(kappa) / s)


def run_all(t: Array, x: Array, acc: Array, cuts: list[int]) -> WingRun:
    stream = WingStream(AIRFRAME, tuning())
    edges = [0, *sorted(cuts), len(t)]
    parts = [stream.run(t[a:b], x[a:b], acc[a:b]) for a, b in itertools.pairwise(edges) if b > a]
    joined = [np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(WingRun)]
    return WingRun(*joined)


def damaged(which: int, size: float) -> tuple[Array, Array, Array]:
    """Rates that integrate the angular accelerations and specific force that shows the others."""
    t, x, phi = flight(3, damage=(which, 40.0, size))
    trim = np.empty((len(t), 6))
    predict_rows(AIRFRAME.row(), x, np.zeros((len(t), 4)), trim)
    acc = trim[:, :3] + phi[:, :3]
    acc[:, 0] += 9.80665 * np.sin(0.04)
    acc[:, 2] -= 9.80665 * np.cos(0.04)
    x[:, 6:9] = np.cumsum(np.vstack([np.zeros(3), 0.05 * (phi + trim)[:-1, 3:]]), axis=0)
    return t, x, acc


@given(st.lists(st.integers(1, 1599), max_size=8))
@settings(max_examples=15, deadline=None)
def test_any_split_gives_the_same_estimates(cuts: list[int]) -> None:
    t, x, acc = damaged(0, 10.0)
    whole, pieces = run_all(t, x, acc, []), run_all(t, x, acc, cuts)
    for field in fields(WingRun):
        one, other = getattr(whole, field.name), getattr(pieces, field.name)
        assert np.array_equal(one, other, equal_nan=True), field.name


def test_contradicting_accelerometers_are_not_used() -> None:
    t, x = 0.05 * np.arange(1600), level(1600)
    acc = np.tile([0.0, 0.0, -9.80665], (len(t), 1))
    acc[t > 40.0, 1] += 3.0
    run = WingStream(AIRFRAME, tuning()).run(t, x, acc)
    assert run.trusted[run.t_s < 40.0].all()
    assert not run.trusted[run.t_s > 42.0].any()
    lift = run.std[:, 4]
    before, since = lift[run.t_s < 40.0][-1], run.t_s - 42.0
    assert (lift[1:] >= lift[:-1])[since[1:] > 0.0].all()
    assert lift[since > 12.5][0] > 1.2 * before
    assert np.isinf(run.std[since > 26.0]).all()  # nothing in the window is believed


def test_faults_and_inputs_are_those_of_the_model() -> None:
    assert len(FAULTS) == 4
    assert level(2).shape == (2, INPUTS)
