"""The air-data filters and their bank: twins, closed forms, derivatives, ages of explanations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators import air_data_3d as air
from estimators import air_data_3d_bank as bank_module
from estimators import air_data_3d_lanes as lanes
from estimators.air_data_3d_bank import (
    WIND_CHANGED,
    WindBounds,
    accept_wind,
    adopt,
    bank_step,
    clear,
    new_bank,
    spawn,
)
from estimators.air_data_3d_evidence import JudgeLimits, convicted
from estimators.baselines import numpy_twins_air3d as twin

NO_GATE = 1e9


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A state, a covariance, a ground velocity, a wing direction and three readings."""
    rng = np.random.default_rng(seed)
    x = np.concatenate((rng.normal(0, 4, 3), rng.normal(0, 1, 3), rng.normal(0, 0.1, 4)))
    A = rng.normal(0, 0.3, (10, 10))
    P = A @ A.T + 1e-3 * np.eye(10)
    V = np.array([15.0, 8.0, -1.0]) + rng.normal(0, 2, 3)
    e_y = rng.normal(0, 1, 3)
    y = np.log(18.0) + rng.normal(0, 0.1, 3)
    return x, P, V, e_y / np.linalg.norm(e_y), y


@pytest.mark.parametrize("seed", range(5))
def test_predict_is_its_twin(seed: int) -> None:
    x, P, *_ = problem(seed)
    q = np.linspace(1e-4, 1e-3, 10)
    want_x, want_P = twin.predict(x, P, 0.9, q)
    air.predict(x, P, 0.9, q)
    np.testing.assert_allclose(x, want_x, rtol=1e-14)
    np.testing.assert_allclose(P, want_P, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("e", [0.1, 5.0, -40.0])
def test_scalar_update_is_its_twin_within_and_beyond_the_gate(e: float) -> None:
    x, P, _, e_y, _ = problem(1)
    H = np.concatenate((e_y, e_y, [0.3, 0.0, -1.0, 2.0]))
    want_x, want_P, want = twin.huber_update(x, P, H, e, 0.5, 3.0)
    got = air.scalar_update(x, P, H, e, 0.5, 3.0)
    assert got == pytest.approx(want, rel=1e-12)
    np.testing.assert_allclose(x, want_x, rtol=1e-12)
    np.testing.assert_allclose(P, want_P, atol=1e-12)


@pytest.mark.parametrize("use", range(1, 8))
def test_mean_and_contrasts_equal_the_joint_update(use: int) -> None:
    x, P, V, _, y = problem(use)
    m = use.bit_count()
    want_x, want_P, want = twin.pitot_joint_update(x, P, V, y, use, -0.03, 2e-3, 5e-4)
    got = air.pitot_update(x, P, V, y, use, -0.03, 2e-3, 5e-4, NO_GATE)
    np.testing.assert_allclose(x, want_x, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(P, want_P, atol=1e-12)
    # the mean is the orthonormal combination divided by sqrt(m): its density is sqrt(m) higher
    assert got - 0.5 * np.log(m) == pytest.approx(want, rel=1e-10)


def test_lateral_derivative_against_finite_differences() -> None:
    x, _, V, e_y, _ = problem(3)
    step, R = 1e-5, 1e6
    for k in range(10):
        delta = np.zeros(10)
        delta[k] = step
        fd = twin.lateral_model(x + delta, V, e_y) - twin.lateral_model(x - delta, V, e_y)
        P = np.zeros((10, 10))
        P[k, k] = 1.0
        updated = x.copy()
        air.lateral_update(updated, P, V, e_y, R, NO_GATE)
        # gain = H_k / (H_k^2 + R) of the innovation -h: R is so large that H_k^2 drops out
        H_k = (updated[k] - x[k]) * R / -twin.lateral_model(x, V, e_y)
        assert H_k == pytest.approx(fd / (2 * step), rel=1e-3, abs=1e-5)


def test_pitot_derivative_against_finite_differences_without_gust() -> None:
    x, _, V, _, y = problem(4)
    x[3:6] = 0.0
    step, R, ln_sigma = 1e-5, 1e6, -0.05
    for k in range(8):
        delta = np.zeros(10)
        delta[k] = step
        fd = (
            twin.pitot_model(x + delta, V, ln_sigma)[0]
            - twin.pitot_model(x - delta, V, ln_sigma)[0]
        )
        P = np.zeros((10, 10))
        P[k, k] = 1.0
        updated = x.copy()
        air.pitot_update(updated, P, V, y, 0b001, ln_sigma, R, 0.0, NO_GATE)
        H_k = (updated[k] - x[k]) * R / (y - twin.pitot_model(x, V, ln_sigma))[0]
        assert H_k == pytest.approx(fd / (2 * step), rel=1e-3, abs=1e-5)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_covariance_stays_symmetric_and_positive(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, P, V, e_y, y = problem(seed % 1000)
    for _ in range(50):
        air.predict(x, P, 0.96, np.full(10, 1e-5))
        air.lateral_update(x, P, V, e_y, 1.0, 3.0)
        y = y + rng.normal(0, 0.3, 3)
        air.pitot_update(x, P, V, y, int(rng.integers(0, 8)), 0.0, 1e-3, 1e-4, 3.0)
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 0.0


def started_bank(seed: int = 0):
    bank = new_bank()
    x, P, V, e_y, y = problem(seed)
    bank.x[:], bank.P[:] = x, P
    return bank, V, e_y, y


def hypothesis(bank, g: int, h: int) -> tuple[np.ndarray, np.ndarray]:
    """State and covariance of hypothesis h of a generation."""
    half = np.triu(bank.hP[h, :, :, g])
    return bank.hx[h, :, g].copy(), half + np.triu(half, 1).T


def test_bank_step_runs_every_filter_as_its_twin() -> None:
    bank, V, e_y, y = started_bank()
    spawn(bank, 0.0, 0b011, 1.0, 6.0, 150.0)
    q, phi, R_lat, R_common, R_own = np.full(10, 1e-4), 0.96, 1.5, 2e-3, 5e-4
    filters = {None: (bank.x.copy(), bank.P.copy())}
    filters |= {h: hypothesis(bank, 0, h) for h in range(4)}
    log_likelihood = {}
    for h, (x, P) in filters.items():
        x, P = twin.predict(x, P, phi, q)
        if h == WIND_CHANGED:
            along = (V - filters[None][0][:3])[:2]
            P[:2, :2] += 3e-4 * np.outer(along, along)
        shifted = [6 + i for i in range(2) if h is not None and h >> i & 1]
        P[np.ix_(shifted, shifted)] += 3e-4
        H = np.array(
            [
                (twin.lateral_model(x + d, V, e_y) - twin.lateral_model(x - d, V, e_y)) / 2e-6
                for d in 1e-6 * np.eye(10)
            ]
        )
        x, P, first = twin.huber_update(x, P, H, -twin.lateral_model(x, V, e_y), R_lat, NO_GATE)
        x, P, second = twin.pitot_joint_update(x, P, V, y, 0b011, 0.0, R_common, R_own)
        filters[h], log_likelihood[h] = (x, P), first + second
    bank_step(bank, 0.2, phi, q, 3e-4, V, e_y, R_lat, y, 0b011, 0.0, R_common, R_own, NO_GATE)
    np.testing.assert_allclose(bank.x, filters[None][0], rtol=1e-6, atol=1e-7)
    for h in range(4):
        x, P = hypothesis(bank, 0, h)
        np.testing.assert_allclose(x, filters[h][0], rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(P, filters[h][1], atol=1e-6)
        assert bank.L[0, h] == pytest.approx(log_likelihood[h] - log_likelihood[None], abs=1e-6)
    assert (bank.L[0, 4:] == -np.inf).all()


@given(st.integers(0, 2**32 - 1), st.integers(0, 7), st.sampled_from([NO_GATE, 0.5]))
@settings(max_examples=20, deadline=None)
def test_every_lane_is_the_filter_alone_to_the_last_bit(seed: int, use: int, gate: float) -> None:
    rng = np.random.default_rng(seed)
    alone = [problem(int(rng.integers(1000)))[:2] for _ in range(lanes.LANES)]
    x = np.stack([a[0] for a in alone], axis=-1)
    P = np.stack([np.triu(a[1]) for a in alone], axis=-1)
    *_, V, e_y, y = problem(seed % 1000)
    room, q = lanes.new_lanes(), rng.uniform(0.0, 1e-3, 10)
    lanes.predict_lanes(x, P, 0.96, q)
    lanes.lateral_lanes(room, x, P, V, e_y, 1.5, gate)
    lateral = room.ln.copy()
    lanes.pitot_lanes(room, x, P, V, y, use, -0.05, 2e-3, 5e-4, gate)
    for g, (x_g, P_g) in enumerate(alone):
        air.predict(x_g, P_g, 0.96, q)
        assert lateral[g] == air.lateral_update(x_g, P_g, V, e_y, 1.5, gate)
        assert room.ln[g] == air.pitot_update(x_g, P_g, V, y, use, -0.05, 2e-3, 5e-4, gate)
        np.testing.assert_array_equal(x[:, g], x_g)
        np.testing.assert_array_equal(P[:, :, g], np.triu(P_g))


def test_generations_stay_spaced_logarithmically_and_reach_back() -> None:
    bank, *_ = started_bank()
    for t in range(400):
        spawn(bank, float(t), 0b1, 1.0, 6.0, 150.0)
        if t < 200:
            continue
        ages = np.sort(t + 1.0 - bank.born)
        assert ages[0] == 1.0
        assert 75.0 < ages[-1] <= 152.0
        assert (ages[1:] / ages[:-1]).max() < 2.6


def test_evidence_is_its_twin_and_parsimony_prefers_few() -> None:
    bank, *_ = started_bank()
    rng = np.random.default_rng(2)
    bank.born[:] = np.arange(14.0)
    bank.L[:] = rng.normal(0, 10, bank.L.shape)
    top, where = np.empty(8), np.empty(8, np.int64)
    bank_module.survey(bank, WindBounds(1e9, 1e9, 1e9, 1.0), 20.0, top, where)
    for mask in range(1, 8):
        want = twin.evidence(bank.L, mask)
        assert bank_module.evidence(top, mask) == pytest.approx(want, abs=1e-12)
    np.testing.assert_array_equal(where, bank.L.argmax(0))
    top[:] = [0.0, 30.0, 2.0, 31.0, -np.inf, -np.inf, -np.inf, -np.inf]
    assert bank_module.parsimony(top, 0b01) == pytest.approx(1.0)
    assert bank_module.parsimony(top, 0b10) == pytest.approx(29.0)


def test_explanations_beyond_the_wind_bound_do_not_compete() -> None:
    bank, *_ = started_bank()
    spawn(bank, 0.0, 0b1, 1.0, 6.0, 150.0)
    bank.L[0, :2] = 50.0, 10.0
    x, start = bank.hx[WIND_CHANGED, :, 0], bank.ref_wind[0].copy()
    bounds = WindBounds(horizontal_m_s=30.0, vertical_m_s=8.0, change_m_s=10.0, base_s=20.0)

    def competes(t: float, wind: np.ndarray, down: float = 0.0) -> bool:
        x[:2], x[2] = wind, down
        bank.ref_wind[0] = start
        bank.hx[1, :3, 0] = *start, 0.0
        top, where = np.empty(8), np.empty(8, np.int64)
        bank_module.survey(bank, bounds, t, top, where)
        assert top[1] == 10.0
        return bool(top[WIND_CHANGED] == 50.0)

    unit = np.array([0.6, 0.8])
    assert competes(1.0, start)
    assert not competes(1.0, start, 8.1)
    assert not competes(1.0, start, -8.1)
    assert competes(1.0, start + 9.9 * unit)
    assert not competes(1.0, start + 10.1 * unit)
    assert not competes(20.0, start + 10.1 * unit)
    assert competes(80.0, start + 19.9 * unit)
    assert not competes(80.0, start + 20.1 * unit)
    assert not competes(1000.0, 30.1 * unit)


LIMITS = JudgeLimits(
    margin_one=8.0,
    margin_all=15.0,
    margin_single=6.0,
    margin_wind=6.0,
    confirm_s=1.0,
    min_shift=0.075,
    wind=WindBounds(1e9, 1e9, 1e9, 1.0),
    learnt_scale_std=0.045,
    lost_scale_std=0.07,
    readmit_shift=0.04,
    readmit_unlearnt=0.15,
    readmit_s=10.0,
    suspect_clear_s=5.0,
)


def verdict_of(
    L: list[float],
    shifts: dict[int, list[float]],
    active: int,
    gust: float,
    *,
    fitted: int = 0,
    t: float = 1.0,
) -> int:
    """Pitots convicted by log-likelihoods of the first explanations with these shifts of k."""
    bank, *_ = started_bank()
    spawn(bank, 0.0, active, 1.0, 6.0, 150.0)
    bank.L[0, : len(L)] = L
    for h, shift in shifts.items():
        bank.hx[h, 6 : 6 + len(shift), 0] = bank.ref[0, : len(shift)] + shift
    top, where = np.empty(8), np.empty(8, np.int64)
    bank_module.survey(bank, LIMITS.wind, 1.0, top, where)
    return convicted(t, LIMITS, bank, top, where, active, fitted or active, gust)


@pytest.mark.parametrize(
    ("L", "both", "want"),
    [
        ([0.0, 12.0, 2.0, 13.0], [0.15, 0.15], 0b01),  # one explains all but little
        ([0.0, 12.0, 2.0, 20.0], [0.15, 0.15], 0b00),  # both do better, but not by 15
        ([0.0, 12.0, 2.0, 30.0], [0.15, 0.15], 0b11),
        ([0.0, 12.0, 2.0, 30.0], [0.15, -0.15], 0b00),  # one cause moves both alike
        ([0.0, 12.0, 2.0, 30.0], [0.15, -0.05], 0b01),  # the other hardly moves
    ],
)
def test_blame_falls_on_as_few_as_explain_it(L: list[float], both: list[float], want: int) -> None:
    shifts = {1: [0.2, 0.0], 2: [0.0, -0.2], 3: both}
    assert verdict_of(L, shifts, 0b11, 0.02) == want


@pytest.mark.parametrize(("gust", "want"), [(0.02, 1), (0.12, 0)])
def test_a_lone_pitot_is_measured_against_the_gusts(gust: float, want: int) -> None:
    assert verdict_of([0.0, 7.0], {1: [0.15]}, 0b01, gust) == want
    assert verdict_of([0.0, 9.0, 0.0, 0.0], {1: [0.15, 0.0]}, 0b11, gust) == 1


def test_the_last_pitot_left_is_blamed_on_more_than_one_that_flew_alone() -> None:
    assert verdict_of([0.0, 9.0], {1: [0.15]}, 0b01, 0.02) == 1
    assert verdict_of([0.0, 9.0], {1: [0.15]}, 0b01, 0.02, fitted=0b11) == 0
    assert verdict_of([0.0, 16.0], {1: [0.15]}, 0b01, 0.02, fitted=0b11) == 1


def test_a_slow_fault_of_all_pitots_is_left_to_the_long_horizon() -> None:
    assert verdict_of([0.0, 30.0], {1: [0.15]}, 0b01, 0.02, t=50.0) == 1
    assert verdict_of([0.0, 30.0], {1: [0.15]}, 0b01, 0.02, t=100.0) == 0
    assert verdict_of([0.0, 30.0, 0.0, 0.0], {1: [0.15, 0.0]}, 0b11, 0.02, t=100.0) == 1


def test_adopting_a_shift_rolls_back_the_wind_and_the_scale() -> None:
    bank, *_ = started_bank()
    before = bank.x.copy()
    spawn(bank, 0.0, 0b11, 1.0, 6.0, 150.0)
    bank.x[:3] += 5.0  # what a fault has done to the master since
    bank.hx[1, 6, 0] -= 0.4  # while the explanation followed the shift
    adopt(bank, 0, 1)
    np.testing.assert_allclose(bank.x, before)
    assert bank.P[6, 6] == bank.ref_var[0, 0]
    assert np.isnan(bank.born).all()


def test_adopting_a_changed_wind_keeps_the_others_competing() -> None:
    bank, *_ = started_bank()
    spawn(bank, 0.0, 0b1, 1.0, 6.0, 150.0)
    bank.L[0, :2] = 9.0, 12.0
    accept_wind(bank, 0)
    assert bank.L[0, 0] == 0.0
    assert bank.L[0, 1] == 3.0
    clear(bank)
    assert (bank.L == -np.inf).all()
