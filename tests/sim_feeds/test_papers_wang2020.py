"""The engine of wang2020: the scenario file, and runs that have what it says."""

import numpy as np
import pytest

from sim_feeds.papers.wang2020 import NOISE_LAWS, wang2020_experiment, wang2020_scenario


def test_scenario_is_that_of_the_oracle(oracle):
    s, file = wang2020_scenario(), np.load(oracle / "imkf.npz")
    for name, ours in (("A", s.A), ("B", s.B), ("C", s.C), ("Q", s.Q), ("R", np.diag(s.R))):
        np.testing.assert_allclose(ours, file[name], rtol=1e-12, err_msg=name)
    np.testing.assert_array_equal(s.filter_start, file["x0"])
    np.testing.assert_array_equal(s.filter_fault_free, file["lam"])
    np.testing.assert_array_equal(s.speed_rpm, file["rpm_scale_state"])
    assert s.variation_limit == file["delta"]
    assert len(s.outputs) == len(s.C) == len(s.fault_free) == 4


def test_a_run_obeys_the_model():
    s, e = wang2020_scenario(), wang2020_experiment(3)
    assert e.x.shape == e.u.shape == (1000, 2)
    assert e.t_s[0] == pytest.approx(0.01)
    assert e.t_s[-1] == pytest.approx(10.0)
    before = np.vstack([s.start, e.x[:-1]])
    w = e.x - before @ s.A.T - e.u @ s.B.T
    np.testing.assert_allclose(w.std(axis=0), s.process_std, rtol=0.1)
    assert np.abs(np.corrcoef(w.T)[0, 1]) < 0.1
    assert e.u.min() > 0.0
    assert e.u.max() < 1.0


def test_speeds_stay_on_the_dimensionless_scale_on_which_faults_are_drawn():
    spread = np.array([[e.x.min(), e.x.max()] for e in map(wang2020_experiment, range(20))])
    assert spread.min() > 0.0
    assert spread.max() < 1.0


@pytest.mark.parametrize("law", NOISE_LAWS)
def test_noise_of_working_channels(law):
    s, e = wang2020_scenario(), wang2020_experiment(5, law)
    for i in range(4):
        v = (e.y[:, i] - e.x @ s.C[i])[e.works[:, i]]
        if law == "cauchy":
            # half of a Cauchy variable's probability lies within its scale
            assert np.median(np.abs(v)) == pytest.approx(s.noise[law][i], rel=0.2)
        else:
            assert v.std() == pytest.approx(s.noise[law][i], rel=0.15)


def test_faults_follow_table_2_and_two_channels_die_at_5_s():
    s, runs = wang2020_scenario(), [wang2020_experiment(seed) for seed in range(20)]
    works = np.array([e.works for e in runs])
    early = runs[0].t_s < 5.005
    assert early.sum() == 500
    np.testing.assert_allclose(works[:, early].mean(axis=(0, 1)), s.fault_free, atol=0.01)
    assert not works[:, ~early, :2].any()
    np.testing.assert_allclose(works[:, ~early, 2:].mean(axis=(0, 1)), s.fault_free[2:], atol=0.01)
    broken = np.concatenate([e.y[~e.works] for e in runs])
    assert broken.min() >= 0.0
    assert broken.max() <= 1.0
    assert broken.mean() == pytest.approx(0.5, abs=0.01)


def test_the_law_of_noise_moves_neither_engine_nor_faults():
    a, b = wang2020_experiment(7), wang2020_experiment(7, "cauchy")
    np.testing.assert_array_equal(a.x, b.x)
    np.testing.assert_array_equal(a.works, b.works)
    np.testing.assert_array_equal(a.y[~a.works], b.y[~b.works])
    assert not np.array_equal(wang2020_experiment(8).x, a.x)
