"""The long horizon: stages against their epochs, windows against dense twins, bounds, arrival."""

import numpy as np
import pytest

from estimators import air_horizon as horizon
from estimators.air_data_3d_noise import ACC, GUST_STD, N_NOISE, R_COMMON, R_LATERAL, R_OWN
from estimators.air_horizon import (
    CHANGED_S,
    H_STAGES,
    NH,
    WIND_WALKED,
    HorizonLevels,
    LongHorizon,
    new_long_horizon,
    push_stage,
    start_horizon,
)
from estimators.air_horizon_judge import turned
from estimators.air_horizon_solve import solve_explanations
from estimators.air_horizon_stage import (
    N_STAGE,
    Z_AIR,
    Z_COMMON,
    Z_EY,
    Z_LATERAL_VAR,
    Z_M,
    Z_OWN,
    Z_T,
    StageLevels,
    add_epoch,
    begin,
    close,
)
from estimators.baselines import numpy_twins_horizon as twin

LN_SIGMA = -0.05
STAGE = StageLevels(3.0, 2, timing_s=0.08, lateral_m_s=0.2, common=0.005, own=0.003)
LEVELS = HorizonLevels(
    iterations=1,
    kappa=0.1,
    n_kappa=3,
    n_qp=4,
    gust_tau_s=10.0,
    wind_walk_changed=0.5,
    scale_walk=5e-4,
    rate_walk=4e-5,
    wind_max_m_s=30.0,
    down_max_m_s=2.0,
    change_max_m_s=15.0,
    scale_max=0.7,
    margin_one=10.0,
    margin_all=12.0,
    margin_wind=6.0,
    confirm_s=1.0,
    min_shift=0.075,
)
UNBOUNDED = LEVELS._replace(wind_max_m_s=1e9, down_max_m_s=1e9, change_max_m_s=1e9, scale_max=1e9)
K = 5
"""First scale in the horizon's state."""


def noise_levels() -> np.ndarray:
    noise = np.zeros(N_NOISE)
    noise[[R_LATERAL, R_COMMON, R_OWN, GUST_STD, ACC]] = 1.2, 3e-4, 4e-5, 0.6, 2.0
    return noise


def fly(
    stages: int,
    *,
    wind: np.ndarray | None = None,
    k_rate: float = 0.0,
    use: int = 0b011,
    seed: int = 0,
) -> tuple[list[np.ndarray], list[list[twin.Epoch]]]:
    """Finished stages of a circle at 18 m/s, and the epochs that made them."""
    rng = np.random.default_rng(seed)
    W = np.array([4.0, -3.0, 0.0]) if wind is None else wind
    rows, all_epochs = [], []
    stage, row = np.zeros(N_STAGE), np.zeros(N_STAGE)
    for s in range(stages):
        epochs = []
        begin(stage, np.array([3.5, -2.6, 0.1]))
        for e in range(15):
            t = 3.0 * s + 0.2 * e
            yaw, roll = 0.25 * t, 0.2
            air = 18.0 * np.array([np.cos(yaw), np.sin(yaw), 0.02])
            V = air + W + rng.normal(0.0, 0.1, 3)
            e_y = np.array([-np.sin(yaw) * np.cos(roll), np.cos(yaw) * np.cos(roll), np.sin(roll)])
            y = LN_SIGMA + np.log(18.0) - np.array([0.03, 0.05, 0.0]) + rng.normal(0, 0.01, 3)
            y[0] -= k_rate * t
            epochs.append((V, e_y, y))
            add_epoch(stage, t, 0.2, V, e_y, y, use, LN_SIGMA, noise_levels(), 0.08, 0.002, 8e-5)
        close(stage, STAGE, row)
        rows.append(row.copy())
        all_epochs.append(epochs)
    return rows, all_epochs


def arrival() -> tuple[np.ndarray, np.ndarray]:
    """State and covariance of a bank that knows the wind to 1 m/s and the scale to 4 %."""
    x = np.array([3.0, -2.0, 0.1, 0.1, -0.2, 0.0, 0.02, 0.04, 0.0, 0.01])
    A = np.random.default_rng(3).normal(0.0, 0.1, (10, 10))
    S = np.diag([1.0, 1.0, 0.3, 0.6, 0.6, 0.3, 0.04, 0.04, 0.1, 0.02])
    return x, S @ (np.eye(10) + A @ A.T) @ S


def window(rows: list[np.ndarray], levels: HorizonLevels, N: int = 20) -> LongHorizon:
    z = new_long_horizon(N)
    start_horizon(z, *arrival())
    for row in rows:
        push_stage(z, levels, row)
    return z


def transitions(rows: list[np.ndarray], levels: HorizonLevels, h: int):
    """A and B between the stages, from the equations."""
    A, B = [], []
    for _ in rows[1:]:
        phi, v = horizon.gust_stage(3.0, levels.gust_tau_s)
        F, G = np.eye(NH), np.zeros((NH, NH))
        F[3, 3] = F[4, 4] = phi
        walk2 = 15 * 0.002 + (0.25 * 3.0 if h == WIND_WALKED else 0.0)
        gust = 0.6 * np.sqrt(v * (1 - phi**2))
        scale = levels.scale_walk * np.sqrt(3.0)
        std = [*[np.sqrt(walk2)] * 2, np.sqrt(15 * 8e-5), gust, gust, *[scale] * 3]
        np.fill_diagonal(G, [*std, 1e-4 * np.sqrt(3.0), 0.0])
        if 0 < h < WIND_WALKED:
            G[9, 9] = levels.rate_walk * np.sqrt(3.0)
            for i in range(3):
                F[K + i, 9] = 3.0 * (h >> i & 1)
        A.append(F)
        B.append(G)
    return A, B


def dense(z: LongHorizon, rows: list[np.ndarray], levels: HorizonLevels, h: int, x_lin: np.ndarray):
    """Joint prior, rows and posterior of a window linearised at x_lin."""
    prior = twin.joint_prior(z.x_p, z.P, *transitions(rows, levels, h))
    C, ry = np.zeros((len(rows), 4, NH)), np.zeros((len(rows), 4))
    for i, row in enumerate(rows):
        horizon.stage_rows(row, x_lin[i], C[i], ry[i])
    H, y = twin.gaussian(C, ry)
    return prior, (H, y), twin.posterior(*prior, H, y)


@pytest.mark.parametrize("wind", [(3.5, -2.6, 0.1), (5.0, -4.0, 0.3), (1.0, 0.0, 0.0)])
def test_a_stage_says_what_its_epochs_say(wind: tuple[float, float, float]) -> None:
    rows, epochs = fly(1)
    x = np.array([*wind, 0.3, -0.2, 0.04, 0.02, 0.0, 0.015, 0.0])
    C, ry = np.zeros((4, NH)), np.zeros(4)
    horizon.stage_rows(rows[0], x, C, ry)
    e = ry - C @ x
    W, g = x[:3], np.array([0.3, -0.2, 0.0])
    W0 = np.array([3.5, -2.6, 0.1])
    lateral = twin.lateral_mean(epochs[0], W + g, 0.015, W0)
    assert e[0] * np.sqrt(rows[0][Z_LATERAL_VAR]) == pytest.approx(lateral, abs=1e-12)
    calm = twin.pitot_mean(epochs[0], W, LN_SIGMA, x[K : K + 3])
    blown = twin.pitot_mean(epochs[0], W0 + g, LN_SIGMA, x[K : K + 3])
    still = twin.pitot_mean(epochs[0], W0, LN_SIGMA, x[K : K + 3])
    both = calm + blown - still
    third = (np.linalg.norm(W - W0) + 0.4) ** 3 / 18.0**3
    mean = e[1] * np.sqrt(rows[0][Z_COMMON] + rows[0][Z_OWN] / 2)
    assert mean == pytest.approx(both[:2].mean(), abs=third + 3e-4)
    contrast = e[2] * np.sqrt(rows[0][Z_OWN])
    assert contrast == pytest.approx((calm[0] - calm[1]) / np.sqrt(2), abs=1e-12)
    assert (C[3] == 0.0).all()
    assert rows[0][Z_T] == pytest.approx(2.8)


@pytest.mark.parametrize("wind", [(3.5, -2.6, 0.1), (7.0, -4.0, 0.0)])
def test_the_rows_of_a_stage_are_derivatives(wind: tuple[float, float, float]) -> None:
    rows, epochs = fly(1)
    x = np.array([*wind, 0.0, 0.0, 0.04, 0.02, 0.0, 0.015, 0.0])
    C, ry = np.zeros((4, NH)), np.zeros(4)
    horizon.stage_rows(rows[0], x, C, ry)
    w = 1.0 / np.sqrt(rows[0][Z_COMMON] + rows[0][Z_OWN] / 2)
    distance = np.linalg.norm(np.subtract(wind, (3.5, -2.6, 0.1)))
    for a in range(2):
        step = np.zeros(3)
        step[a] = 1e-4
        high = twin.pitot_mean(epochs[0], x[:3] + step, LN_SIGMA, np.zeros(3))[0]
        low = twin.pitot_mean(epochs[0], x[:3] - step, LN_SIGMA, np.zeros(3))[0]
        slope = -(high - low) / 2e-4
        assert C[1, a] / w == pytest.approx(slope, abs=2.0 * distance**2 / 18.0**3 + 1e-6)


@pytest.mark.parametrize("dt", [0.5, 3.0, 8.0])
def test_a_stage_of_gust_has_the_variance_and_the_power_of_the_gust(dt: float) -> None:
    phi, v = horizon.gust_stage(dt, 10.0)
    t = np.linspace(0.0, dt, 2001)[:-1]
    lag = np.abs(t[:, None] - t[None, :])
    assert v == pytest.approx(np.exp(-lag / 10.0).mean(), rel=2e-3)
    far = sum(phi**k for k in range(1, 2000))
    assert v * (1.0 + 2.0 * far) * dt == pytest.approx(2.0 * 10.0, rel=1e-6)


@pytest.mark.parametrize("h", [0, 1, 2, 3, WIND_WALKED])
def test_a_free_window_is_the_dense_least_squares_solution(h: int) -> None:
    rows, _ = fly(20, k_rate=1e-3)
    z = window(rows, UNBOUNDED)
    x_lin = z.x[h].copy()
    _, _, (x, P, L) = dense(z, rows, UNBOUNDED, h, x_lin)
    assert solve_explanations(z, UNBOUNDED, 1 << h)
    np.testing.assert_allclose(z.x[h].ravel(), x, atol=1e-7)
    np.testing.assert_allclose(z.end_P[h], P[-NH:, -NH:], atol=1e-9)
    assert z.L[h] == pytest.approx(L, abs=1e-6)


def test_the_log_likelihood_tells_a_drift_from_a_wind() -> None:
    rows, _ = fly(20, k_rate=1e-3)
    z = window(rows, LEVELS)
    for _ in range(2):
        solve_explanations(z, LEVELS, 0b1111 | 1 << WIND_WALKED)
    assert z.L.argmax() == 1
    assert z.x[1, -1, K] - z.x[1, 0, K] == pytest.approx(1e-3 * 57.0, abs=0.015)


def test_relinearising_converges_where_the_first_guess_was_poor() -> None:
    rows, _ = fly(20)
    z = window(rows, UNBOUNDED)
    moves = []
    for _ in range(4):
        before = z.x[0].copy()
        solve_explanations(z, UNBOUNDED, 1)
        moves.append(np.abs(z.x[0] - before).max())
    assert moves[1] < 0.1
    assert moves[3] < 1e-4
    np.testing.assert_allclose(z.x[0, -1, :2], [4.0, -3.0], atol=0.4)


def test_a_wind_that_has_changed_lately_walks_only_lately() -> None:
    rows, _ = fly(20)
    z = window(rows, UNBOUNDED)
    lately = WIND_WALKED + len(CHANGED_S) - 1
    solve_explanations(z, UNBOUNDED, 1 << lately)
    std = z.B[:19, 0, 0]
    recent = np.array([row[Z_T] for row in rows[1:]]) > rows[-1][Z_T] - CHANGED_S[-1]
    assert recent.sum() == 14
    np.testing.assert_allclose(std[recent], np.sqrt(15 * 0.002 + 0.25 * 3.0))
    np.testing.assert_allclose(std[~recent], np.sqrt(15 * 0.002))


TIGHT = UNBOUNDED._replace(wind_max_m_s=3.2)


def test_bounds_hold_and_the_bounded_cost_is_counted() -> None:
    rows, _ = fly(20)
    z = window(rows, TIGHT)
    free = window(rows, UNBOUNDED)
    solve_explanations(free, UNBOUNDED, 1)
    assert free.x[0, -1, 0] > 3.5
    assert solve_explanations(z, TIGHT, 1)
    assert np.abs(z.x[0, :, :2]).max() < 3.2
    assert z.L[0] < free.L[0] - 1.0


def test_the_change_of_the_wind_is_bounded_from_the_arrival() -> None:
    x, P = arrival()
    P[:2, :] = P[:, :2] = 0.0
    P[0, 0] = P[1, 1] = 0.01
    levels = UNBOUNDED._replace(change_max_m_s=0.5)
    rows, _ = fly(20, wind=np.array([7.0, -3.0, 0.0]))
    z = new_long_horizon(20)
    start_horizon(z, x, P)
    for row in rows:
        push_stage(z, levels, row)
    solve_explanations(z, UNBOUNDED, 1 << WIND_WALKED)
    assert z.x[WIND_WALKED, -1, 0] > 5.0
    solve_explanations(z, levels, 1 << WIND_WALKED)
    assert z.x[WIND_WALKED, :, 0].max() < 3.0 + 0.5 + 3.0 * 0.1


def test_the_bounded_window_is_an_independent_solvers() -> None:
    casadi = pytest.importorskip("casadi")
    rows, _ = fly(8)
    z = window(rows, TIGHT, N=8)
    x_lin = z.x[0].copy()
    (mean, cov), (H, y), _ = dense(z, rows, TIGHT, 0, x_lin)
    # The rate never moves without a drift and its prior is tiny: it stays out of the other solver.
    keep = np.array([i for i in range(8 * NH) if i % NH != 9])
    prior = np.linalg.inv(cov[np.ix_(keep, keep)])
    hessian = prior + H[:, keep].T @ H[:, keep]
    gradient = -prior @ mean[keep] - H[:, keep].T @ y
    bound = np.where(np.isin(keep % NH, (0, 1)), 3.2, np.inf)
    scale = 1.0 / np.sqrt(np.diag(hessian))
    problem = {
        "h": casadi.DM(hessian * np.outer(scale, scale)).sparsity(),
        "a": casadi.Sparsity(0, len(keep)),
    }
    qp = casadi.conic("qp", "qrqp", problem, {"print_iter": False, "print_header": False})
    solved = qp(
        h=hessian * np.outer(scale, scale),
        g=gradient * scale,
        lbx=-bound / scale,
        ubx=bound / scale,
    )
    want = np.array(solved["x"]).ravel() * scale
    assert solve_explanations(z, TIGHT, 1)
    got = z.x[0].ravel()[keep]
    sigma = np.sqrt(np.diag(np.linalg.inv(hessian)))
    assert (np.abs(got - want) / sigma).max() < 0.05
    J = 0.5 * want @ hessian @ want + gradient @ want
    J_got = 0.5 * got @ hessian @ got + gradient @ got
    assert J_got - J < 0.05


def test_the_arrival_counts_every_stage_once() -> None:
    """A short horizon that has let go of 25 stages knows what a window of all 33 knows."""
    rows, _ = fly(33)
    for row in rows:
        row[Z_M : Z_M + 3] = 0.0  # a linear measurement: the closed form is exact
    z = window(rows[:8], UNBOUNDED, N=8)
    for row in rows[8:]:
        solve_explanations(z, UNBOUNDED, 1)
        push_stage(z, UNBOUNDED, row)
    solve_explanations(z, UNBOUNDED, 1)
    long = window(rows, UNBOUNDED, N=33)
    _, _, (x, P, _) = dense(long, rows, UNBOUNDED, 0, long.x[0])
    assert z.memory[H_STAGES] == 8
    np.testing.assert_allclose(z.x[0].ravel(), x[-8 * NH :], atol=1e-6)
    np.testing.assert_allclose(z.end_P[0], P[-NH:, -NH:], atol=1e-8)
    wind_std = np.sqrt(P[-NH, -NH])
    assert wind_std == pytest.approx(np.sqrt(z.end_P[0, 0, 0]), rel=1e-4)


def test_a_pitot_that_is_missing_from_a_stage_is_not_used() -> None:
    rows, _ = fly(3, use=0b010)
    C, ry = np.zeros((4, NH)), np.zeros(4)
    horizon.stage_rows(rows[0], np.zeros(NH), C, ry)
    assert C[1, K + 1] < 0.0
    assert (C[:, [K, K + 2]] == 0.0).all()
    assert (C[2:] == 0.0).all()
    rows, _ = fly(3, use=0)
    horizon.stage_rows(rows[0], np.zeros(NH), C, ry)
    assert (C[1:] == 0.0).all()
    assert rows[0][Z_AIR] == pytest.approx(18.0, abs=1.5)


def test_what_is_not_a_number_is_reported_and_competes_no_more() -> None:
    rows, _ = fly(10)
    rows[4][Z_AIR] = np.nan
    z = window(rows, LEVELS)
    assert not solve_explanations(z, LEVELS, 1)
    assert z.L[0] == -np.inf


def test_a_turn_is_one_of_45_degrees_since_then() -> None:
    z = new_long_horizon(20)
    z.memory[H_STAGES] = 10.0
    for j, heading_deg in enumerate((90.0, 50.0, 12.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 0.0)):
        heading = np.radians(heading_deg)
        z.stages[j, Z_T] = 3.0 * j
        z.stages[j, Z_EY : Z_EY + 2] = -0.9 * np.sin(heading), 0.9 * np.cos(heading)
    assert turned(z, 3.0)
    assert not turned(z, 4.0)
