"""wan2018 Figs. 3 to 5 and Theorem 1: scenario file, quick version, words that follow numbers."""

import copy

import numpy as np
import pytest

from monitor.commands.reproduce.study import Figure, Scope, Table
from monitor.commands.reproduce.wan2018 import residual, runaway, sensitivity, wind
from monitor.commands.reproduce.wan2018.schemes import SCHEMES, run_scheme
from sim_feeds.faults import KNOT_M_S
from sim_feeds.papers.wan2018_figures import conditions

SCOPE = Scope(quick=True)
STUDIES = (wind, runaway, residual, sensitivity)


@pytest.fixture(scope="module")
def results(quickly):
    return quickly("wan2018")[0]


def test_the_winds_are_those_of_the_file():
    c = conditions()
    for name, peak_kt in (("1", 55), ("2", 95), ("3", 140)):
        flight = c.healthy(name, 1)
        along = flight.x[:, 2] / KNOT_M_S
        assert np.median(along[flight.t_s > 20.0]) == pytest.approx(peak_kt, abs=1.0)
        second = np.abs(along[21:] - along[:-21]) / (21 * 0.048)
        assert second.max() < 16.0, "kt/s, turbulence included"
        assert flight.cas_true_m_s[0] / KNOT_M_S == pytest.approx(350, abs=2)
        assert flight.truth.height_m[0] / 0.3048 == pytest.approx(5000)


def test_the_runaway_begins_at_20_s_and_lasts_370_samples():
    c = conditions()
    flight = c.runaway("1", -15.0, 2)
    off = (flight.cas_m_s - flight.cas_true_m_s[:, None]).mean(axis=1) / KNOT_M_S
    assert np.abs(off[flight.t_s < 20.0]).max() < 2.0
    assert off[flight.t_s < 24.0][-1] == pytest.approx(-60.0, abs=3.0)
    assert (flight.t_s >= 20.0).sum() >= c.window_samples


def test_flights_of_the_theorem_differ_and_repeat():
    c = conditions()
    a, b, again = (c.sensitivity_flight(k, 0) for k in (0, 1, 0))
    assert a.q_w != b.q_w
    np.testing.assert_array_equal(a.flight.cas_m_s, again.flight.cas_m_s)
    assert not a.vanes
    assert c.sensitivity_flight(c.sensitivity.flights, 0).vanes


def test_watching_residuals_decides_nothing_and_changes_no_healthy_run():
    flight = conditions().healthy("1", 3)
    for scheme in SCHEMES:
        watched = run_scheme(scheme, flight, 0.1, decide=False)
        decided = run_scheme(scheme, flight, 0.1)
        assert not watched.faulty.any()
        if not decided.faulty.any():
            np.testing.assert_allclose(watched.J, decided.J, rtol=1e-9)


def test_bounds_find_what_freedom_absorbs(results):
    fig4 = results["runaway/fig4"]
    for method in ("EKF", "UMHE"):
        assert np.isnan(fig4[method]["delay_s"]).all()
        assert (fig4[method]["peak_kt"] < 12.0).all()
    assert (fig4["CMHE"]["delay_s"] < 6.5).all()
    assert (np.abs(fig4["CMHE"]["at_bound_s"] - 4.0) < 1.0).all()
    assert (fig4["ours"]["delay_s"] < 6.0).all()
    assert (fig4["ours"]["end_error_kt"] < 5.0).all()
    assert not fig4["ours"]["released"].any()


def test_theorem_1_holds_nowhere_and_the_lasting_gain_everywhere(results):
    w = results["sensitivity/00"]
    assert (w["least"] < 0).all()
    assert (w["least_sensors"] < 0).all()
    assert (w["most_weighted"] < 1e-6).all()
    assert (w["gain"] > w["gain_free"] + 0.01).all()
    np.testing.assert_allclose(w["gain"], w["gain_by_solving"], atol=1e-3)
    cas = w["output"] == sensitivity.CAS
    np.testing.assert_allclose(w["gain"][cas], 1.0, atol=1e-3)
    assert (w["after_free"][cas] < 0.5).all()


def test_the_quick_version_is_drawn_and_told(results):
    for study in STUDIES:
        blocks = study.blocks(results, SCOPE)
        assert any(isinstance(b, Table) for b in blocks)
        for block in blocks:
            if isinstance(block, Figure):
                from matplotlib.figure import Figure as Canvas

                block.draw(Canvas(figsize=block.size_in))
            if isinstance(block, Table) and block.columns[-1].startswith("why"):
                assert all(str(row[-1]).endswith(".") for row in block.rows)
        assert study.summary(results).endswith(".")
        assert all(claim.because for claim in study.claims(results, SCOPE))


def test_the_words_follow_the_numbers(results):
    spoilt = copy.deepcopy(results)
    spoilt["wind/3"]["CMHE"][:] = spoilt["wind/3"]["UMHE"]
    spoilt["runaway/fig4"]["UMHE"]["delay_s"][:] = 3.0
    for case in residual.CASES:
        spoilt[residual.key_of(case)]["CMHE"]["rms_kt"][:] = 1.0
    spoilt["sensitivity/00"]["least"][:] = 1.0
    spoilt["sensitivity/00"]["gain"][:] = 0.0
    for study in STUDIES:
        was = [c.outcome for c in study.claims(results, SCOPE)]
        now = [c.outcome for c in study.claims(spoilt, SCOPE)]
        assert was != now
