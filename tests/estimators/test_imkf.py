"""The intermittent-measurement filter: oracle, closed forms, twins, properties, broken channels."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.baselines.numpy_twins_imkf import BatchedTwin, LoopTwin
from estimators.imkf import IntermittentFilter, LinearModel, Settings, Status

FEW = settings(max_examples=25, deadline=None)


@pytest.fixture(scope="module")
def file(oracle):
    with np.load(oracle / "imkf.npz") as archive:
        return {key: archive[key] for key in archive.files}


def model_of(file):
    A, B, C, Q, R = (file[k] for k in "ABCQR")
    return LinearModel(A=A, B=B, C=C, Q=Q, r=np.diag(R), dt_s=0.01)


def variants(file):
    lam = tuple(file["lam"].tolist())
    printed = Settings.paper(lam, float(file["delta"]))
    free = replace(printed, variation_limit=math.inf)
    return {
        "paper": printed,
        "rejpred": replace(printed, on_rejection="predict"),
        "nodelta": free,
        "zero_nodelta": replace(free, all_faulty=True),
        "mem50": replace(free, all_faulty=True, memory_s=0.5),
    }


def close(ours, expected):
    """Within 1e-10 of the largest value: entries that are zero but for rounding have no digits."""
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["paper", "rejpred", "nodelta", "zero_nodelta", "mem50"])
def test_oracle(file, name):
    setting = variants(file)[name]
    own = IntermittentFilter(model_of(file), setting, file["x0"], file["P0"])
    track = own.run(file["u"][0], file["y"][0], weights=True)
    x = file[f"{name}_x"]
    np.testing.assert_allclose(track.x, x.reshape(track.x.shape), rtol=1e-10)
    if name == "mem50":
        close(track.works, file["mem50_w"].reshape(track.works.shape))
        return
    close(track.P, file[f"{name}_P"][0])
    close(track.weights[:, 0 if setting.all_faulty else 1 :], file[f"{name}_w"][0])
    close(track.weights.sum(axis=1), np.ones(len(track.x)))
    rejections = np.count_nonzero(track.status == Status.REJECTED)
    assert (rejections > 0) == math.isfinite(setting.variation_limit)


def test_oracle_in_revolutions_per_minute(file):
    X, Y = file["rpm_scale_state"], file["rpm_scale_y"]
    setting = replace(variants(file)["zero_nodelta"], ranges=tuple(Y.tolist()))
    model = model_of(file).scaled(X, np.ones(2), Y)
    own = IntermittentFilter(model, setting, file["x0"] * X, X[:, None] * file["P0"] * X)
    track = own.run(file["u"][0], file["y"][0] * Y)
    np.testing.assert_allclose(track.x, file["rpm_x"], rtol=1e-10)


def drawn(seed, n, m, missing=0.2):
    """A stable random system, inputs and outputs of which some are missing and some are wild."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A *= 0.95 / max(np.abs(np.linalg.eigvals(A)))
    L = 0.1 * rng.standard_normal((n, n))
    model = LinearModel(
        A=A,
        B=rng.standard_normal((n, 2)),
        C=rng.standard_normal((m, n)),
        Q=L @ L.T + 1e-4 * np.eye(n),
        r=rng.uniform(1e-4, 1e-1, m),
        dt_s=0.02,
    )
    N = 30
    u = rng.standard_normal((N, 2))
    x, states = np.zeros(n), []
    for k in range(N):
        x = A @ x + model.B @ u[k] + rng.multivariate_normal(np.zeros(n), model.Q)
        states.append(x)
    y = np.array(states) @ model.C.T + np.sqrt(model.r) * rng.standard_normal((N, m))
    wild = rng.random(y.shape) < 0.2
    y[wild] = rng.uniform(-5.0, 5.0, wild.sum())
    y[rng.random(y.shape) < missing] = np.nan
    fault_free = tuple(rng.uniform(0.5, 0.99, m).tolist())
    return model, u, y, fault_free, tuple(rng.uniform(2.0, 20.0, m).tolist())


FORMS = {
    "paper": {"all_faulty": False, "memory_s": None, "variation_limit": 1.0},
    "predicted": {
        "all_faulty": False,
        "memory_s": None,
        "variation_limit": 1.0,
        "on_rejection": "predict",
    },
    "all faulty": {"memory_s": None},
    "health": {"memory_s": 0.3},
}


@pytest.mark.parametrize("twin", [LoopTwin, BatchedTwin])
@pytest.mark.parametrize("form", FORMS)
@FEW
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), m=st.integers(1, 5))
def test_twins(twin, form, seed, n, m):
    model, u, y, fault_free, ranges = drawn(seed, n, m)
    setting = Settings(fault_free=fault_free, ranges=ranges, **FORMS[form])
    own = IntermittentFilter(model, setting, np.zeros(n), np.eye(n))
    other = twin(model, setting, np.zeros(n), np.eye(n))
    track = own.run(u, y, weights=True)
    for k in range(len(y)):
        other.step(u[k], y[k])
        np.testing.assert_allclose(track.x[k], other.x, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(track.P[k], other.P, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(track.works[k], other.w, atol=1e-7)
        assert (track.status[k] == Status.REJECTED) == other.rejected
    np.testing.assert_allclose(own.health, other.h, atol=1e-7)


@FEW
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 3),
    m=st.integers(1, 8),
    size=st.floats(0.0, 1e9),
)
def test_estimates_stay_sound_whatever_the_outputs(seed, n, m, size):
    model, u, y, fault_free, ranges = drawn(seed, n, m)
    rng = np.random.default_rng(seed)
    y[rng.random(y.shape) < 0.3] *= size
    u[5], y[7], y[9] = np.nan, np.inf, -np.inf
    own = IntermittentFilter(
        model, Settings(fault_free=fault_free, ranges=ranges), np.zeros(n), np.eye(n)
    )
    track = own.run(u, y, weights=True)
    assert np.isfinite(track.x).all()
    assert np.isfinite(track.ln_evidence).all()
    np.testing.assert_array_equal(track.P, track.P.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(track.P).min() >= -1e-12 * track.P.max()
    np.testing.assert_allclose(track.weights.sum(axis=1), 1.0)
    assert track.works.min() >= 0.0
    assert track.works.max() <= 1.0 + 1e-12
    assert track.status[5] == Status.HELD
    assert track.status[7] == track.status[9] == Status.MISSING


@FEW
@given(seed=st.integers(0, 2**32 - 1), cuts=st.lists(st.integers(0, 30), max_size=5))
def test_any_split_gives_the_same_estimates(seed, cuts):
    model, u, y, fault_free, ranges = drawn(seed, 2, 4)
    setting = Settings(fault_free=fault_free, ranges=ranges, variation_limit=0.5)
    whole = IntermittentFilter(model, setting, np.zeros(2), np.eye(2)).run(u, y)
    own = IntermittentFilter(model, setting, np.zeros(2), np.eye(2))
    edges = [0, *sorted(cuts), len(y)]
    parts = [own.run(u[a:b], y[a:b]) for a, b in itertools.pairwise(edges)]
    for name in ("x", "P", "works", "health", "ln_evidence", "all_faulty", "status"):
        joined = np.concatenate([getattr(p, name) for p in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)


@FEW
@given(
    seed=st.integers(0, 2**32 - 1),
    scale=st.lists(st.floats(1e-3, 1e4), min_size=8, max_size=8),
)
def test_units_do_not_matter(seed, scale):
    model, u, y, fault_free, ranges = drawn(seed, 2, 4)
    X, U, Y = np.array(scale[:2]), np.array(scale[2:4]), np.array(scale[4:])
    setting = Settings(fault_free=fault_free, ranges=ranges)
    wide = replace(setting, ranges=tuple((np.array(ranges) * Y).tolist()))
    one = IntermittentFilter(model, setting, np.zeros(2), np.eye(2)).run(u, y)
    two = IntermittentFilter(
        model.scaled(X, U, Y), wide, np.zeros(2), np.diag(X**2)
    ).run(u * U, y * Y)  # fmt: skip
    np.testing.assert_allclose(two.x / X, one.x, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(two.works, one.works, atol=1e-8)
    present = np.isfinite(y)
    shift = (present * np.log(Y)).sum(axis=1)
    np.testing.assert_allclose(two.ln_evidence + shift, one.ln_evidence, rtol=1e-7, atol=1e-7)


def single(**changes):
    """One state that halves at each sample, measured by one channel."""
    model = LinearModel(
        A=np.array([[0.5]]), B=np.array([[1.0]]), C=np.array([[2.0]]), Q=np.array([[0.1]]),
        r=np.array([0.2]), dt_s=1.0,
    )  # fmt: skip
    setting = {"fault_free": (0.9,), "ranges": (4.0,), "memory_s": None, **changes}
    return IntermittentFilter(model, Settings(**setting), [1.0], [[0.4]])


def test_two_hypotheses_by_hand():
    """Prediction 0.5 + 0.3 = 0.8, variance 0.1 + 0.1; s = 4 * 0.2 + 0.2 = 1; innovation 0.5."""
    own = single()
    track = own.run([[0.3]], [[2.1]], weights=True)
    density = math.exp(-0.5 * 0.5**2) / math.sqrt(2.0 * math.pi)
    works, fails = 0.9 * density, 0.1 / 4.0
    w = works / (works + fails)
    corrected, variance = 0.8 + 0.4 * 0.5, 0.2 - 0.4**2
    assert track.works[0, 0] == pytest.approx(w, rel=1e-12)
    assert track.weights[0] == pytest.approx([1.0 - w, w], rel=1e-12)
    assert track.all_faulty[0] == pytest.approx(1.0 - w, rel=1e-12)
    assert track.ln_evidence[0] == pytest.approx(math.log(works + fails), rel=1e-12)
    x = w * corrected + (1.0 - w) * 0.8
    assert own.state[0] == pytest.approx(x, rel=1e-12)
    spread = w * (corrected - x) ** 2 + (1.0 - w) * (0.8 - x) ** 2
    P = w * variance + (1.0 - w) * 0.2 + spread
    assert own.cov[0, 0] == pytest.approx(P, rel=1e-12)
    reading, std = own.outputs
    assert reading[0] == pytest.approx(2.0 * x)
    assert std[0] == pytest.approx(2.0 * math.sqrt(P))


def test_health_follows_over_its_memory():
    own = single(memory_s=10.0, fault_free=(0.5,))
    w = single(fault_free=(0.5,)).run([[0.3]], [[2.1]]).works[0, 0]
    own.step([0.3], [2.1])
    assert own.health[0] == pytest.approx(0.5 + (w - 0.5) / 10.0, rel=1e-12)


def test_certain_channels_make_it_the_kalman_filter(file):
    model, u = model_of(file), file["u"][0]
    y = np.where(file["ok"][0], file["y"][0], np.nan)
    certain = Settings(fault_free=(1.0,) * 4, memory_s=None)
    track = IntermittentFilter(model, certain, file["x0"], file["P0"]).run(u, y)
    x, P = file["x0"], file["P0"]
    for k in range(200):
        x, P = model.A @ x + model.B @ u[k], model.A @ P @ model.A.T + model.Q
        on = np.isfinite(y[k])
        C = model.C[on]
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + np.diag(model.r[on]))
        x = x + K @ (y[k, on] - C @ x)
        P = (np.eye(2) - K @ C) @ P @ (np.eye(2) - K @ C).T + K @ np.diag(model.r[on]) @ K.T
        np.testing.assert_allclose(track.x[k], x, rtol=1e-10)
        np.testing.assert_allclose(track.P[k], P, rtol=1e-6, atol=1e-14)


def test_statuses_say_what_happened():
    own = single()
    assert own.step([0.3], [2.1]) is Status.OK
    before, cov = own.state, own.cov
    assert own.step([0.3], [np.nan]) is Status.MISSING
    assert own.state == pytest.approx(0.5 * before + 0.3)
    assert own.cov[0, 0] == pytest.approx(0.25 * cov[0, 0] + 0.1)
    twin = single()
    twin.step([0.3], [2.1])
    twin.step([0.3], [np.nan])
    assert own.step([np.nan], [2.1]) is Status.HELD
    twin.step([0.3], [2.1])
    assert own.state == twin.state
    hopeless = single(all_faulty=False, fault_free=(0.0,))
    assert hopeless.step([0.3], [2.1]) is Status.IMPOSSIBLE
    assert hopeless.state == pytest.approx(0.8)
    assert own.step([np.nan], [np.nan]) is Status.HELD


def test_a_prediction_that_nothing_corrects_is_no_jump():
    """From 1 to the prediction 0.8 is more than the limit, but nothing was corrected."""
    own = single(all_faulty=False, fault_free=(0.0,), variation_limit=0.1)
    track = own.run([[0.3]], [[2.1]])
    assert track.status[0] == Status.IMPOSSIBLE
    assert own.state == pytest.approx(0.8)


@pytest.mark.parametrize(("keep", "x", "P"), [("keep", 1.0, 0.4), ("predict", 0.8, 0.2)])
def test_a_jump_is_rejected(keep, x, P):
    own = single(all_faulty=False, variation_limit=0.5, on_rejection=keep)
    assert own.step([0.3], [20.0]) is Status.REJECTED
    assert own.state == pytest.approx(x)
    assert own.cov[0, 0] == pytest.approx(P)


def test_four_outliers_at_once_leave_the_prediction(file):
    """Where the printed form has 0 / 0."""
    own = IntermittentFilter(model_of(file), variants(file)["mem50"], [0.5, 0.5], file["P0"])
    model, u = own.model, [0.5, 0.5]
    expected = model.A @ [0.5, 0.5] + model.B @ u
    track = own.run([u], [[40.0, 40.0, 40.0, 40.0]])
    np.testing.assert_allclose(track.x[0], expected, rtol=1e-9)
    assert track.all_faulty[0] > 1.0 - 1e-9
    paper = IntermittentFilter(model, variants(file)["nodelta"], [0.5, 0.5], file["P0"])
    track = paper.run([u], [[40.0, 40.0, 40.0, 40.0]])
    assert np.isfinite(track.x).all()
    assert track.ln_evidence[0] < -745.0


@pytest.mark.parametrize("kind", ["dead", "random"])
def test_one_broken_channel_is_named_and_nothing_else_moves(file, kind):
    model = model_of(file)
    rng = np.random.default_rng(4)
    N = 1000
    t_s = 0.01 * np.arange(1, N + 1)
    u = 0.5 + 0.2 * np.sin(2.0 * np.pi * np.outer(t_s, [0.2, 0.3]))
    x = np.empty((N, 2))
    now = np.array([0.5, 0.5])
    for k in range(N):
        x[k] = now = model.A @ now + model.B @ u[k] + 0.01 * rng.standard_normal(2)
    y = x @ model.C.T + np.sqrt(model.r) * rng.standard_normal((N, 4))
    setting = Settings(fault_free=(0.9, 0.9, 0.95, 0.95))
    clean = IntermittentFilter(model, setting, x[0], file["P0"]).run(u, y)
    assert (clean.health[200:] > 0.9).all()
    broken, on = y.copy(), t_s > 5.0
    broken[on, 1] = {"dead": 0.0, "random": rng.random(on.sum())}[kind]
    track = IntermittentFilter(model, setting, x[0], file["P0"]).run(u, broken)
    named_s = t_s[on & (track.health[:, 1] < 0.5)][0] - 5.0
    assert named_s < {"dead": 0.4, "random": 0.6}[kind]
    others = np.ones(4, dtype=bool)
    others[1] = False
    assert (track.health[200:, others] > 0.9).all()
    moved = np.abs(track.x - clean.x)[on].max(axis=0)
    assert moved[1] < 0.02
    assert moved[0] < 0.002


def test_a_channel_that_comes_back_is_believed_again(file):
    model = model_of(file)
    N = 1500
    x = np.linalg.solve(np.eye(2) - model.A, model.B @ [0.5, 0.5])
    y = np.tile(model.C @ x, (N, 1))
    y[300:800, 0] = 0.1
    setting = Settings(fault_free=(0.9, 0.9, 0.95, 0.95))
    track = IntermittentFilter(model, setting, x, file["P0"]).run(np.full((N, 2), 0.5), y)
    assert track.health[799, 0] < 0.05
    back_s = 0.01 * (np.flatnonzero(track.health[800:, 0] > 0.5)[0] + 1)
    assert back_s < 1.0
    np.testing.assert_allclose(track.x[-1], x, atol=1e-3)


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"C": np.ones((9, 2)), "r": np.ones(9)}, "9 channels"),
        ({"r": np.array([1.0, 0.0, 1.0, 1.0])}, "positive"),
        ({"Q": np.ones((3, 3))}, "Q has shape"),
        ({"A": np.full((2, 2), np.nan)}, "A is not finite"),
        ({"dt_s": 0.0}, "sample time"),
    ],
)
def test_models_that_make_no_sense(file, what, message):
    with pytest.raises(ValueError, match=message):
        replace(model_of(file), **what)


@pytest.mark.parametrize(
    "what",
    [
        {"fault_free": (1.2,)},
        {"ranges": (0.0,)},
        {"memory_s": 0.0},
        {"health_floor": 0.0},
        {"variation_limit": 0.0},
        {"fault_free": (0.9, 0.9)},
        {"ranges": (1.0, 1.0)},
    ],
)
def test_settings_that_make_no_sense(what):
    with pytest.raises(ValueError):
        single(**what)


def test_rows_must_match():
    with pytest.raises(ValueError, match="2 inputs for 1 outputs"):
        single().run([[0.1], [0.2]], [[0.3]])
