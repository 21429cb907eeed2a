"""A lone vane against the angle of attack of attitude and wind: filter, explanations, checks."""

import math

import numpy as np
import pytest

from estimators import air_vane as vane
from estimators.air_vane import new_vanes, run
from estimators.air_vane_filter import CONSIDERED, GATE, vane_update
from monitor.settings.vane import VaneSettings
from monitor.watch.air_vane import limits

DEG = math.radians(1.0)
LIMITS = limits(VaneSettings())


def twin(x, P, a, r, R, phi, q_b, q_g):
    """Schmidt's filter in matrices: the scale has a variance and no gain."""
    F = np.diag([1.0, 1.0, phi])
    x, P = F @ x, F @ P @ F.T + np.diag([q_b, 0.0, q_g])
    H = np.array([1.0, a, 1.0])
    S = H @ P @ H + R
    e = r - H @ x
    nu = abs(e) / math.sqrt(S)
    tail = 0.5 * nu**2 if nu <= GATE else GATE * (nu - 0.5 * GATE)
    S_used = S * max(nu / GATE, 1.0)
    K = P @ H / S_used
    K[1] = 0.0
    full = P @ H / S_used
    P_new = P - np.outer(full, H @ P)
    P_new[1, 1] = P[1, 1]
    return x + K * e, P_new, -0.5 * math.log(2.0 * math.pi * S) - tail


def test_the_kernel_is_schmidts_filter() -> None:
    rng = np.random.default_rng(1)
    x, P = np.zeros(3), np.diag([0.07, 0.2, 0.02]) ** 2
    y, Q = x.copy(), P.copy()
    for k in range(300):
        a, r = 0.05 * rng.standard_normal(), 0.03 * rng.standard_normal()
        r += 0.4 if k % 50 == 49 else 0.0
        args = (a, r, 0.01**2, 0.98, 1e-8, 1e-5)
        got = vane_update(x, P, *args)
        y, Q, expected = twin(y, Q, *args)
        assert got == pytest.approx(expected, abs=1e-9)
        np.testing.assert_allclose(x, y, atol=1e-12)
        np.testing.assert_allclose(P, Q, atol=1e-14)
        assert np.linalg.eigvalsh(P).min() > -1e-12
    assert x[CONSIDERED] == 0.0
    assert P[CONSIDERED, CONSIDERED] == pytest.approx(0.04)


def flight(change=None, *, seconds=160.0, tas=50.0, gust=0.8 * DEG, seed=0, pause=None):
    """Events of one vane at 20 Hz and estimates at 5 Hz; a changes with the flown speed."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.05)
    a = (3.0 + 1.5 * np.sin(2 * np.pi * t / 40.0)) * DEG
    g = np.zeros(len(t))
    keep = math.exp(-0.05 / 8.0)
    for k in range(1, len(t)):
        g[k] = keep * g[k - 1] + gust * math.sqrt(1 - keep**2) * rng.standard_normal()
    shown = 1.15 * a + 1.2 * DEG + g + 0.2 * DEG * rng.standard_normal(len(t))
    if change is not None:
        shown = change(t, shown)
    e = np.arange(0, len(t) - 3, 4)
    if pause is not None:
        e = e[(t[e] < pause[0]) | (t[e] > pause[1])]
    times = np.concatenate([[-0.01], t, t[e]])
    order = np.argsort(np.concatenate([[-0.01], t, t[e] + 0.11]), kind="stable")
    code = np.repeat([vane.EV_PHASE, vane.EV_VANE, vane.EV_AIR], [1, len(t), len(e)])
    value = np.zeros((len(times), 3))
    value[0, 0] = 1.0
    value[1 : 1 + len(t), 0] = shown
    value[1 + len(t) :] = np.column_stack([a[e], np.full(len(e), 1.2 * DEG), np.full(len(e), tas)])
    return times[order], code[order], np.zeros(len(times), np.int64), value[order]


def judged(events, cuts=()):
    """(state, time, cause) of every change."""
    state, out = new_vanes(), []
    for part in np.split(np.arange(len(events[0])), cuts):
        log = np.empty((3 * len(part) + 8, vane.N_LOG))
        tests = np.empty((len(part), vane.N_TEST))
        n, _ = run(state, LIMITS, *(e[part] for e in events), log, tests)
        out += [(g[vane.G_STATUS], g[vane.G_T], g[vane.G_CAUSE]) for g in log[:n]]
    return out


def faults(events):
    return [(t, cause) for status, t, cause in judged(events) if status == vane.FAULTY]


@pytest.mark.parametrize("seed", range(4))
def test_a_healthy_vane_is_learnt_and_stays(seed: int) -> None:
    said = judged(flight(seed=seed))
    assert [status for status, _, _ in said] == [vane.UNMONITORED, vane.OK]
    assert 25.0 < said[-1][1] < 45.0


@pytest.mark.parametrize(
    ("change", "cause", "within_s"),
    [
        (lambda t, x: x + 6.0 * DEG, vane.SHIFT, 10.0),
        (lambda t, x: x - 6.0 * DEG, vane.SHIFT, 10.0),
        (lambda t, x: x + 0.5 * DEG * (t - 80.0), vane.SHIFT, 40.0),
        (lambda t, x: np.full_like(x, 4.0 * DEG), vane.CONSTANT, 16.0),
        (lambda t, x: x + 3.0 * DEG * np.sin(40.0 * t**2), vane.SCATTER, 8.0),
        (lambda t, x: x + 25.0 * DEG, vane.GROSS, 4.0),
    ],
    ids=["up", "down", "ramp", "stuck", "noise", "gross"],
)
def test_a_broken_vane_is_found(change, cause: float, within_s: float) -> None:
    (t, found), *more = faults(flight(lambda t, x: np.where(t > 80.0, change(t, x), x)))
    assert not more
    assert found == cause
    assert 80.0 < t < 80.0 + within_s


def test_a_vertical_gust_is_no_fault() -> None:
    def gust(t, x):
        rise = np.clip((t - 80.0) / 1.0, 0.0, 1.0) - np.clip((t - 84.0) / 1.0, 0.0, 1.0)
        return x + np.arctan(6.0 / 50.0) * rise

    assert not faults(flight(gust))


def test_an_updraft_that_stays_within_the_bound_is_no_fault() -> None:
    lasting = np.arctan(0.8 * LIMITS.updraft_m_s / 50.0)
    assert not faults(flight(lambda t, x: x + np.where((t > 80.0) & (t < 130.0), lasting, 0.0)))


def test_a_vane_that_recovers_is_readmitted_once_and_its_offset_was_not_spoilt() -> None:
    said = judged(flight(lambda t, x: x + np.where((t > 60.0) & (t < 90.0), 7.0 * DEG, 0.0)))
    assert [s for s, _, _ in said] == [vane.UNMONITORED, vane.OK, vane.FAULTY, vane.OK]
    assert 90.0 < said[-1][1] < 120.0


def test_without_estimates_the_vane_is_not_judged() -> None:
    said = judged(flight(pause=(80.0, 100.0)))
    assert [s for s, _, _ in said] == [
        vane.UNMONITORED, vane.OK, vane.UNMONITORED, vane.UNMONITORED, vane.OK,
    ]  # fmt: skip
    assert 84.0 < said[2][1] < 86.0
    assert said[3][1] == pytest.approx(100.2, abs=0.2)


def test_where_the_stream_is_cut_changes_nothing() -> None:
    events = flight(lambda t, x: x + np.where(t > 80.0, 6.0 * DEG, 0.0), pause=(50.0, 60.0))
    whole = judged(events)
    assert repr(judged(events, range(1, len(events[0]), 7))) == repr(whole)


def test_late_estimates_change_nothing_but_their_place() -> None:
    t, code, index, value = flight(lambda t, x: x + np.where(t > 80.0, 6.0 * DEG, 0.0))
    late = np.where(code == vane.EV_AIR, t + 1.5, t)
    order = np.argsort(late, kind="stable")
    assert repr(judged((t[order], code[order], index, value[order]))) == repr(
        judged((t, code, index, value))
    )
