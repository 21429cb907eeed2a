"""The committed runs of wan2018 VI-B: what the draw gives, within what the paper says."""

from collections import Counter

import numpy as np
import pytest

from sim_feeds.faults import KNOT_M_S
from sim_feeds.papers.wan2018 import (
    CATEGORIES,
    SEED,
    draw_runs,
    read_runs,
    run_experiment,
    runs_as_text,
)

RUNS = read_runs()
MAIN = [r for r in RUNS if r.set == "main"]


def _broken(run, prefix):
    return sum(f["sensor"].startswith(prefix) for f in run.faults)


def test_the_file_is_what_the_draw_gives():
    assert runs_as_text(RUNS) == runs_as_text(draw_runs(SEED))


def test_categories_are_those_of_table_i():
    assert len(MAIN) == 249
    assert Counter(r.category for r in MAIN) == CATEGORIES
    for run in RUNS:
        n_aoa, n_cas = _broken(run, "aoa"), _broken(run, "airspeed")
        lost = {(False, False): "I", (True, False): "II", (False, True): "III", (True, True): "IV"}
        expected = lost[n_aoa == 3, n_cas == 3] if n_aoa + n_cas else "healthy"
        assert run.category == expected
        assert 60.0 <= run.duration_s <= 700.0
        assert 160.0 <= run.cas_kt <= 360.0
        assert 20.0 <= run.onset_s <= run.duration_s - 30.0 or not run.faults
        # one way of breaking a channel
        assert len({(f["sensor"][:3], f["kind"]) for f in run.faults}) <= 2


def test_sizes_are_those_of_table_ii():
    for run in RUNS:
        for f in run.faults:
            vane, kind = f["sensor"].startswith("aoa"), f["kind"]
            size, rate = abs(f["size"]), abs(f["rate"])
            if kind == "nrz":
                assert size == 0.1
            elif kind == "runaway":
                assert (0.2 if vane else 0.5) <= rate <= (25.0 if vane else 50.0)
            elif kind == "noise":
                assert (1.0 if vane else 10.0) <= size <= (2.0 if vane else 20.0)
            else:
                assert (0.5 if vane else 10.0) <= size <= (25.0 if vane else 200.0)
    kinds = Counter(f["kind"] for r in MAIN for f in r.faults)
    assert len(kinds) == 6
    assert min(kinds.values()) > 15


def test_the_small_set_flies_the_same_with_smaller_faults():
    small = [r for r in RUNS if r.set == "small"]
    assert len(small) == 109
    by_number = {r.number: r for r in MAIN}
    for run in small:
        assert run.changes == by_number[run.number].changes
        assert run.onset_s == by_number[run.number].onset_s

    def median(runs):
        vanes = [f for r in runs for f in r.faults if f["sensor"].startswith("aoa")]
        return np.median([abs(f["rate"]) for f in vanes if f["kind"] == "runaway"])

    assert median(small) < 0.5 * median(MAIN)


@pytest.mark.parametrize("run", MAIN[10::48], ids=lambda r: f"run {r.number}")
def test_flights_keep_the_bounds_of_wind_and_airspeed(run):
    w = run_experiment(run)
    wind_kt = w.truth.wind_ned_m_s / KNOT_M_S
    assert np.abs(wind_kt[:, 0]).max() < 120.0
    assert np.abs(wind_kt[:, 2]).max() < 40.0
    back = 21  # one second: turbulence has no rate from sample to sample
    rate = np.abs(wind_kt[back:] - wind_kt[:-back]) / (back * 0.048)
    assert rate.max() < 15.0
    assert 140.0 < w.cas_true_m_s.min() / KNOT_M_S
    assert w.cas_true_m_s.max() / KNOT_M_S < 400.0
    assert np.degrees(np.abs(w.truth.aoa_rad)).max() < 14.0
    assert w.faulty.any(axis=0).sum() == len(run.faults)
