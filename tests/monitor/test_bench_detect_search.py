"""Bounds on shares and rates, and the search for the smallest size, with judges that are known."""

import math
from collections import Counter

import numpy as np
import pytest

from monitor.commands.bench_detect.bounds import rate_upper, share_lower
from monitor.commands.bench_detect.search import Outcome, misses_allowed, search

LADDER = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)


# ----------------------------------------------------------------------------- bounds


@pytest.mark.parametrize(("found", "trials", "share"), [(20, 20, 0.8609), (59, 59, 0.9505)])
def test_all_found_proves_the_nth_root_of_five_percent(found, trials, share):
    assert share_lower(found, trials) == pytest.approx(share, abs=1e-4)
    assert share_lower(found, trials) == pytest.approx(0.05 ** (1 / trials), abs=1e-9)


def test_nineteen_of_twenty_prove_less_than_eighty_percent():
    assert share_lower(19, 20) == pytest.approx(0.7839, abs=1e-4)  # Clopper-Pearson tables
    assert share_lower(0, 20) == 0.0


@pytest.mark.parametrize(("events", "mean"), [(0, 2.9957), (1, 4.7439), (2, 6.2958), (10, 16.9622)])
def test_poisson_bound_of_the_tables(events, mean):
    assert rate_upper(events, 1.0) == pytest.approx(mean, abs=1e-4)
    assert rate_upper(events, 4.0) == pytest.approx(mean / 4.0, abs=1e-4)


def test_without_healthy_time_there_is_no_bound():
    assert math.isinf(rate_upper(0, 0.0))


# ----------------------------------------------------------------------------- search


def found_from(least: dict[float, float]):
    """A judge that finds every fault of ``least[window]`` and more within that window."""

    def judged(size: float, trial: int) -> Outcome:
        windows = [w for w, s in least.items() if size >= s]
        return Outcome(named_s=min(windows, default=math.inf))

    return judged


@pytest.mark.parametrize("wide", LADDER)
@pytest.mark.parametrize("narrow", LADDER)
def test_a_sharp_judge_gives_its_own_sizes(wide, narrow):
    wide, narrow = min(wide, narrow), max(wide, narrow)
    found = search(LADDER, (10.0, 60.0), 20, found_from({60.0: wide, 10.0: narrow}))
    assert found.smallest == {60.0: wide, 10.0: narrow}


def test_what_is_never_found_has_no_size():
    found = search(LADDER, (10.0, 60.0), 20, lambda size, trial: Outcome())
    assert found.smallest == {60.0: None, 10.0: None}
    assert all(len(rung.outcomes) == 2 for rung in found.rungs)  # given up at the second miss


def test_a_known_probability_gives_its_size_within_a_rung():
    rng = np.random.default_rng(5)
    middle, slope = 2.2, 6.0  # P(found) = 0.95 at 2.2 * 19 ** (1 / 6) = 3.59
    true = middle * 19.0 ** (1.0 / slope)

    def judged(size: float, trial: int) -> Outcome:
        return Outcome(
            named_s=5.0 if rng.random() < 1 / (1 + (middle / size) ** slope) else math.inf
        )

    sizes = tuple(round(1.25**k, 4) for k in range(-2, 14))
    smallest = [search(sizes, (10.0,), 200, judged).smallest[10.0] for _ in range(20)]
    assert all(s is not None for s in smallest)
    assert true / 1.4 < np.median([s for s in smallest if s]) < true * 1.4
    assert sum(true / 1.3 < s < true * 1.6 for s in smallest if s) >= 18


def test_one_miss_of_twenty_passes_and_two_do_not():
    assert (misses_allowed(20), misses_allowed(19), misses_allowed(40)) == (1, 0, 2)

    def missing(count: int):
        return lambda size, trial: Outcome(named_s=math.inf if trial < count else 1.0)

    assert search((1.0,), (10.0,), 20, missing(1)).smallest == {10.0: 1.0}
    assert search((1.0,), (10.0,), 20, missing(2)).smallest == {10.0: None}


def test_every_rung_has_the_same_trials():
    asked = Counter()

    def judged(size: float, trial: int) -> Outcome:
        asked[size, trial] += 1
        return Outcome(named_s=1.0 if size >= 3.0 else math.inf)

    found = search(LADDER, (10.0, 30.0, 60.0), 20, judged)
    assert set(asked.values()) == {1}
    assert max(len(r.outcomes) for r in found.rungs if r.size < 3.0) == 2
    assert {len(r.outcomes) for r in found.rungs if r.size >= 3.0} == {20}
