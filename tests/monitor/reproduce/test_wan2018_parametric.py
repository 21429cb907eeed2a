"""The parametric runs of wan2018: what can be seen, how runs are judged, words that follow."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest

from monitor.commands.reproduce.study import Figure, Scope, Table
from monitor.commands.reproduce.wan2018 import parametric
from monitor.commands.reproduce.wan2018.parametric_runs import (
    OURS,
    SCHEMES,
    run_scheme,
    start_state,
)
from monitor.commands.reproduce.wan2018.scores import (
    ALPHA_TH_DEG,
    CAS_TH_KT,
    score,
    visible_from_s,
)
from monitor.commands.reproduce.wan2018.statistics import channel_of, judged_runs
from sim_feeds.faults import KNOT_M_S
from sim_feeds.papers.wan2018 import read_runs, run_experiment

SCOPE = Scope(quick=True)
CALM = replace(
    read_runs()[0],
    category="I",
    duration_s=60.0,
    manoeuvres=[["level", 60.0]],
    steady_kt=[20.0, 0.0, 0.0],
    changes=[],
    turbulence_kt=0.3,
)


def _fault(sensor, kind, size=0.0, rate=0.0):
    return {
        "sensor": sensor,
        "kind": kind,
        "start_s": 20.0,
        "size": size,
        "rate": rate,
        "hz": 1.0,
    }


def _flown(*faults):
    run = replace(CALM, faults=list(faults))
    return run, run_experiment(run)


@pytest.fixture(scope="module")
def results(quickly):
    return quickly("wan2018")[0]


@pytest.mark.parametrize(("prefix", "limit"), [("aoa", ALPHA_TH_DEG), ("airspeed", CAS_TH_KT)])
def test_a_lone_bias_is_visible_from_the_threshold_on(prefix, limit):
    ch = 0 if prefix == "aoa" else 1
    for share, seen in ((0.9, False), (1.1, True), (5.0, True)):
        _, w = _flown(_fault(f"{prefix}1", "bias", size=share * limit))
        visible = visible_from_s(w)
        assert np.isfinite(visible[ch, 1]) == seen
        assert np.isnan(np.delete(visible.ravel(), 3 * ch + 1)).all()
        if seen:
            assert 20.3 < visible[ch, 1] < 21.0


def test_what_a_wind_within_its_bounds_explains_is_not_visible():
    """Alike on all pitots: 10 kt/s is wind until 120 kt are reached; 30 kt/s is not."""

    def slowest(rate):
        _, w = _flown(*(_fault(f"airspeed{i}", "runaway", rate=rate) for i in range(3)))
        return visible_from_s(w)[1].max() - 20.0

    # 20 kt of tail wind now, and at this height 10 kt of CAS are 13.5 kt of wind: 7.4 s to 120 kt,
    # and from there to 12 kt of CAS
    assert 8.5 < slowest(-10.0) < 10.0
    assert slowest(-30.0) < 2.0
    _, lone = _flown(_fault("airspeed0", "runaway", rate=-10.0))
    assert visible_from_s(lone)[1, 0] - 20.0 < 2.0


def test_the_first_readings_give_the_state():
    _, w = _flown()
    x = start_state(w)
    assert np.degrees(abs(x[0] - w.x[0, 0])) < 0.6
    assert np.abs(x[2:] - w.x[0, 2:]).max() < 4.0


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_run_is_judged(scheme):
    run, w = _flown(_fault("aoa0", "bias", size=8.0), _fault("airspeed2", "bias", size=-40.0))
    record = run_scheme(scheme, w)
    told = score(run, w, record)
    found = np.array(told["found_s"])
    assert np.isfinite(found).tolist() == [[True, False, False], [False, False, True]]
    assert (found[np.isfinite(found)] < 0.6).all()
    assert not np.any(told["wrongly"])
    assert told["remembered_s"] is None
    record.faulty[:50, 1, 1] = True  # before the onset: a false isolation
    record.faulty[-50:, 0, 0] = False  # let go while its fault lasts
    spoilt = score(run, w, record)
    assert np.array(spoilt["wrongly"]).tolist() == [[False] * 3, [False, True, False]]
    assert np.array(spoilt["released"]).tolist() == [[True, False, False], [False] * 3]


def test_the_airspeed_is_told_without_a_pitot():
    run, w = _flown(*(_fault(f"airspeed{i}", "jamming", size=90.0) for i in range(3)))
    told = score(run, w, run_scheme(OURS, w))
    assert told["remembered_s"] > 20.0
    samples, total, worst, inside = np.sum(told["memory"], axis=0)
    assert samples * 0.048 == pytest.approx(40.0, abs=1.0)
    assert total / samples < 3.0
    assert inside == samples
    assert worst < 10.0


def test_the_quick_version_finds_every_visible_fault(results):
    runs = judged_runs(results)
    assert len(runs) >= 13
    for ch in range(2):
        ours = channel_of(runs, OURS, ch)
        assert ours.far == ours.fir == ours.mdr == ours.released == 0.0
        assert ours.max_wait_s < 1.0
        assert len(ours.delays_s) >= 3


def test_the_same_seed_gives_the_same_and_another_seed_other_runs(results):
    job = parametric.jobs(SCOPE)[0]
    again = parametric.work(replace(job, what={**job.what, "runs": job.what["runs"][:1]}))
    assert json.dumps(again["runs"][0]) == json.dumps(results[job.name]["runs"][0])
    assert parametric.jobs(Scope(quick=True, seed=1))[0].digest() != job.digest()


def test_all_blocks_are_drawn_and_words_follow_numbers(results):
    from matplotlib.figure import Figure as Canvas

    blocks = parametric.blocks(results, SCOPE)
    names = [b.name for b in blocks if isinstance(b, Table | Figure)]
    assert len(names) == len(set(names)) >= 8
    for block in blocks:
        if isinstance(block, Figure):
            block.draw(Canvas(figsize=block.size_in))
    good = {c.statement: c.outcome for c in parametric.claims(results, SCOPE)}
    spoilt = copy.deepcopy(results)
    for result in spoilt.values():
        for run in result.get("runs", ()):
            told = run["schemes"][OURS]
            told["wrongly"] = [[True] * 3] * 2
            told["released"] = [[True] * 3] * 2
            told["found_s"] = (np.array(told["found_s"]) + 60.0).tolist()
    bad = {c.statement: c.outcome for c in parametric.claims(spoilt, SCOPE)}
    changed = [s for s in good if good[s] != bad[s]]
    assert good["Table IV: no false alarm."] == "holds"
    assert bad["Table IV: no false alarm."] == "does not hold"
    assert len(changed) >= 4
    assert parametric.summary(results) != parametric.summary(spoilt)


def test_winds_are_within_what_the_estimator_is_told():
    for run in [r for r in read_runs() if r.set == "main"][::60]:
        w = run_experiment(run)
        assert np.abs(w.x[:, 2]).max() < 120 * KNOT_M_S
        assert np.abs(w.x[:, 3]).max() < 40 * KNOT_M_S
