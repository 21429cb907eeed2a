"""A few trials of the campaign in ``alfa_injection.py``: it works, and finds the gross ones."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import pytest

from monitor.settings import load

SCRIPT = Path(__file__).with_name("alfa_injection.py")


@pytest.fixture(scope="module")
def campaign():
    import sys

    spec = importlib.util.spec_from_file_location("alfa_injection", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def test_a_pitot_30_percent_off_is_found_within_a_minute(campaign, shared_data):
    some = replace(campaign.PITOT[0], step_s=25.0)
    tallies, false = campaign.run(some, shared_data, load(None, None))
    assert false == []
    for tally in tallies.values():
        assert tally.trials >= 3
        assert tally.missed == []
        assert (tally.blamed, tally.misled) == (0, 0)


def test_a_real_imu_that_breaks_is_found_and_no_other_is_blamed(campaign, shared_data):
    first, _ = campaign.imu_experiments(campaign.TWO_IMUS, "two IMUs", True)
    some = replace(first, flights=(campaign.ENGINE,), step_s=45.0)
    tallies, false = campaign.run(some, shared_data, load(None, None))
    assert false == []
    assert sum(t.trials for t in tallies.values()) >= 12
    assert sum(sum(t.later) for t in tallies.values()) == sum(
        len(t.later) for t in tallies.values()
    )
    assert not any(t.wrong for t in tallies.values())


def test_wilson_bounds_are_those_of_the_textbook(campaign):
    low, high = campaign.wilson(9, 10)
    assert (low, high) == (pytest.approx(0.5958, abs=1e-3), pytest.approx(0.9821, abs=1e-3))
    assert campaign.wilson(0, 10)[0] == pytest.approx(0.0, abs=1e-12)
