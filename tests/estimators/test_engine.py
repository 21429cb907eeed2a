"""Kernels of the engine watch against closed forms: models, fit, power line, grid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimators import engine_power as power
from estimators import engine_ticks as et
from estimators.engine_fit import Record, fit_single_shaft, simulate
from estimators.engine_model import envelope, features, free_shaft, single_shaft, two_spool
from estimators.engine_power import PowerRules, evidence, forget, learn, mean_power

A = np.array([[0.9683, 0.0094], [0.0124, 0.9781]])
B = np.array([[0.0112, 0.0188], [0.0091, 0.0001]])
RULES = PowerRules(glide_ratio=10.0, power_s=3.0, tick_s=0.05)


def test_two_spool_samples_compose_to_one_step() -> None:
    """Five samples of the paper's model, in its own units, are one step of ours, in rpm."""
    shafts, scale = np.array([0, 1, 1]), np.array([11000.0, 11500.0])
    model = two_spool(A, B, 0.01, 0.01, tuple(scale), shafts, np.full(3, 20.0), 0.05)
    x, u = np.array([0.6, 0.5]), np.array([0.45, 0.5])
    stepped, Q = x.copy(), np.zeros((2, 2))
    for _ in range(5):
        stepped, Q = A @ stepped + B @ u, A @ Q @ A.T + 1e-4 * np.eye(2)
    ours = model.linear.A @ (scale * x) + model.linear.B @ u
    np.testing.assert_allclose(ours, scale * stepped, rtol=1e-13)
    np.testing.assert_allclose(model.linear.Q, scale[:, None] * Q * scale, rtol=1e-12)
    np.testing.assert_allclose(model.linear.C @ ours, (scale * stepped)[shafts], rtol=1e-13)
    np.testing.assert_allclose(model.linear.r, 400.0)


def test_a_single_shaft_settles_on_its_curve_with_its_time_constant() -> None:
    c = (100.0, 6000.0, -500.0, 8.0, 2.0)
    model = single_shaft(0.4, c, 50.0, 3.0, np.array([20.0]), 8000.0, 0.05).linear
    u = features(np.array([0.5]), np.array([20.0]))[0]
    steady = 100.0 + 3000.0 - 125.0 + 160.0 + 20.0
    x = np.zeros(2)
    for _ in range(8):  # one time constant
        x = model.A @ x + model.B @ u
    assert x[0] == pytest.approx(steady * (1.0 - math.exp(-1.0)))
    # the error's variance stays what it is said to be
    rho = model.A[1, 1]
    assert rho * rho * 50.0**2 + model.Q[1, 1] == pytest.approx(50.0**2)


def test_a_free_shaft_reads_as_its_state() -> None:
    model = free_shaft(np.array([10.0, 20.0]), 7000.0, 0.05)
    np.testing.assert_array_equal(model.linear.C, [[1.0], [1.0]])
    assert model.linear.Q[0, 0] == pytest.approx((0.13 * 7000.0) ** 2 * 0.05)


def test_the_envelope_is_that_of_the_last_rows_wherever_they_were_cut() -> None:
    x = np.random.default_rng(4).standard_normal((50, 2))
    past = np.full((3, 2), np.nan)
    parts = [envelope(past, np.ascontiguousarray(p)) for p in np.split(x, (1, 2, 30))]
    least, most = (np.concatenate(side) for side in zip(*parts, strict=True))
    for k in range(50):
        np.testing.assert_array_equal(least[k], x[max(k - 3, 0) : k + 1].min(axis=0))
        np.testing.assert_array_equal(most[k], x[max(k - 3, 0) : k + 1].max(axis=0))


def records(noise: float, error: float, memory_s: float) -> list[Record]:
    """Three flights of an engine that the model can be, with readings at 5 Hz."""
    rng, out = np.random.default_rng(1), []
    for seed in range(3):
        k = np.arange(4000)
        t = 0.55 + 0.2 * np.sin(0.031 * k + seed) * np.sign(np.sin(0.0123 * k))
        V = 22.0 + 3.0 * np.sin(0.011 * k + 2.0 * seed)
        y = simulate(Record(t, V, t[:, None]), 0.6, np.array([200.0, 5000.0, 0.0, 30.0, 0.0]), 0.05)
        rho = math.exp(-0.05 / memory_s)
        b = np.zeros(len(k))
        for i in range(1, len(k)):
            b[i] = rho * b[i - 1] + error * math.sqrt(1.0 - rho * rho) * rng.standard_normal()
        read = np.full((len(k), 1), np.nan)
        read[::4, 0] = (y + b + noise * rng.standard_normal(len(k)))[::4]
        out.append(Record(t, V, read))
    return out


def test_the_fit_finds_the_engine_that_made_the_readings() -> None:
    fit = fit_single_shaft(records(noise=15.0, error=40.0, memory_s=2.0), 0.05)
    assert fit.time_constant_s == pytest.approx(0.6, rel=0.25)
    c = np.array(fit.coefficients)
    V, t = 22.0, np.array([0.4, 0.6])
    curve = c[0] + c[1] * t + c[2] * t**2 + c[3] * V + c[4] * t * V
    np.testing.assert_allclose(curve, 200.0 + 5000.0 * t + 30.0 * V, rtol=0.01)
    assert fit.noise_rpm[0] == pytest.approx(15.0, rel=0.4)
    assert 35.0 < fit.error_rpm < 65.0
    assert fit.error_time_s == pytest.approx(2.0, rel=0.5)
    assert fit.explained > 0.99
    assert fit.crossed_rpm < 1.2 * fit.rms_rpm


def test_what_a_fit_cannot_use_is_said() -> None:
    k = np.arange(400)
    still = Record(np.full(400, 0.5), np.full(400, 20.0), np.full((400, 1), 3000.0))
    with pytest.raises(ValueError, match="throttle hardly moves"):
        fit_single_shaft([still], 0.05)
    few = Record(0.5 + 0.1 * np.sin(k), np.full(400, 20.0), np.full((400, 1), np.nan))
    with pytest.raises(ValueError, match="too few"):
        fit_single_shaft([few], 0.05)
    read = np.where(k < 200, 3000.0 + 5.0 * k, np.nan)[:, None]
    half = Record(0.5 + 0.1 * np.sin(k), np.full(400, 20.0), read)
    with pytest.raises(ValueError, match="in a part of these flights only"):
        fit_single_shaft([half], 0.05)


def flown(throttle: np.ndarray, noise: float = 0.8) -> np.ndarray:
    """Power line learnt from a flight with p = -2.5 + 6 t."""
    m, rng = np.zeros(power.N_POWER), np.random.default_rng(5)
    forget(m)
    p = p_g = 0.0
    for t in throttle:
        # noise correlated over the averaging time, as of a filtered derivative
        p += 0.05 / 3.0 * (-p) + noise * math.sqrt(0.1 / 3.0) * rng.standard_normal()
        p_g += 0.05 / 3.0 * (-p_g) + 2.0 * noise * math.sqrt(0.1 / 3.0) * rng.standard_normal()
        line = -2.5 + 6.0 * t
        learn(m, RULES, 25.0, t, line + p, line + p_g)
    return m


def test_the_power_line_is_learnt_and_the_noisier_power_counts_less() -> None:
    m = flown(0.45 + 0.25 * np.sin(0.01 * np.arange(4000)))
    for t in (0.2, 0.6):
        assert m[power.P_A] + m[power.P_B] * t == pytest.approx(-2.5 + 6.0 * t, abs=0.6)
    assert m[power.P_S2G] > 2.0 * m[power.P_S2]
    both, var = mean_power(m, 0.0, 3.0)
    assert 0.0 < both < 1.0
    assert var < m[power.P_S2]


@pytest.mark.parametrize("runs", [True, False])
def test_the_evidence_tells_a_stopped_engine_from_a_running_one(runs: bool) -> None:
    m = flown(0.45 + 0.25 * np.sin(0.01 * np.arange(4000)))
    ratio = could = 0.0
    for k in range(200):
        tau = 0.05 * k
        p = -2.5 + 6.0 * 0.5 * (1.0 if runs else 1.0 - 0.6 * (1.0 - math.exp(-tau / 3.0)))
        says, able = evidence(m, RULES, 0.5, p, p, tau)
        ratio, could = ratio + says, could + able
    assert (ratio < -5.0) if runs else (ratio > 5.0)
    assert could == pytest.approx(abs(ratio), rel=0.5)


def test_an_idle_throttle_tells_nothing() -> None:
    m = flown(0.45 + 0.25 * np.sin(0.01 * np.arange(4000)))
    assert evidence(m, RULES, 0.0, -2.5, -2.5, 5.0) == (0.0, 0.0)


def ticks() -> tuple[et.Ticks, et.TickRules]:
    return et.new_ticks(1000.0, 2000.0), et.TickRules(0.05, 3.0, np.full(4, -1, np.int64))


def gathered(events: list[tuple[float, int, int, float, float]], cuts: tuple[int, ...] = ()):
    """Steps of events (t, code, index, value, second value); servo pulses as value on channel 5."""
    memory, rules = ticks()
    tables, ys, last = [], [], 0.0
    for part in np.split(np.array(events), cuts):
        if not len(part):
            continue
        t = np.ascontiguousarray(part[:, 0])
        pwm = np.zeros((len(part), 16))
        pwm[:, 4] = part[:, 3]
        code = part[:, 1].astype(np.int64)
        index = part[:, 2].astype(np.int64)
        index[code == et.EV_SERVO] = np.flatnonzero(code == et.EV_SERVO)
        size = et.ticks_bound(t, last, rules.tick_s)
        last = float(t[-1])
        table, y = np.empty((size, et.N_TABLE)), np.empty((size, et.N_CHANNELS))
        n = et.gather(
            memory, rules, t, code, index, np.ascontiguousarray(part[:, 3:5]), pwm, table, y
        )
        tables.append(table[:n])
        ys.append(y[:n])
    return np.concatenate(tables), np.concatenate(ys)


def climb(rate_m_s: float) -> list[tuple[float, int, int, float, float]]:
    """Twenty seconds at 20 m/s, climbing; throttle on output 5 as the parameters say."""
    out = [(0.0, et.EV_PARAM, 16 * et.PARAM_FUNCTION + 4, 70.0, 0.0),
           (0.0, et.EV_PARAM, 16 * et.PARAM_MIN + 4, 1100.0, 0.0),
           (0.0, et.EV_PARAM, 16 * et.PARAM_MAX + 4, 1900.0, 0.0),
           (0.0, et.EV_PARAM, 16 * et.PARAM_REVERSED + 4, 1.0, 0.0),
           (0.0, et.EV_PHASE, 0, 1.0, 0.0)]  # fmt: skip
    for k in range(200):
        t = 0.1 * k + 0.01
        out += [(t, et.EV_SERVO, 0, 1300.0, 0.0), (t, et.EV_CAS, 0, 20.0, 0.0),
                (t, et.EV_GPS, 0, 18.0, 0.0), (t, et.EV_BARO, 0, 100.0 + rate_m_s * t, 0.0),
                (t + 0.02, et.EV_SPOOL, 3, 5000.0 + k, 0.0)]  # fmt: skip
    return out


def test_a_steady_climb_is_its_power_and_parameters_map_the_throttle() -> None:
    table, y = gathered(climb(3.0))
    last = table[-1]
    assert last[et.X_P] == pytest.approx(3.0, abs=0.1)
    assert last[et.X_PG] == pytest.approx(3.0, abs=0.1)
    assert last[et.X_THROTTLE] == pytest.approx(0.75)
    assert last[et.X_AIRSPEED] == 20.0
    assert last[et.X_FLYING] == 1.0
    readings = y[:, 3]
    np.testing.assert_array_equal(readings[np.isfinite(readings)], 5000.0 + np.arange(199))


def test_the_grid_does_not_depend_on_the_cuts_and_skips_pauses() -> None:
    events = climb(1.0)
    events = [e for e in events if not 8.0 < e[0] < 10.0]
    events += [(9000.0 + t, *rest) for t, *rest in climb(1.0)[5:]]
    whole, y = gathered(events)
    cut, z = gathered(events, tuple(range(3, len(events), 7)))
    np.testing.assert_array_equal(cut, whole)
    np.testing.assert_array_equal(z, y)
    assert len(whole) < 1000  # 40 s of flight and five seconds of the pause
    assert whole[-1, et.X_T] > 9019.0
