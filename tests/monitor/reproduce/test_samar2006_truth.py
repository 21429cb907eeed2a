"""The flights of samar2006, examined: the study runs, and its verdicts can be bad."""

import numpy as np
import pytest

from monitor.commands.reproduce.samar2006 import truth
from monitor.commands.reproduce.study import Results, Scope, Table

pytest.importorskip("jsbsim", reason="the extra sim is not installed")

QUICK = Scope(quick=True)


@pytest.fixture(scope="module")
def flown() -> Results:
    return {job.name: truth.work(job) for job in truth.jobs(QUICK)}


def outcomes(results: Results) -> list[str]:
    return [claim.outcome for claim in truth.claims(results, QUICK)]


def test_the_flights_are_possible_ones(flown):
    table, figure = truth.blocks(flown, QUICK)
    assert isinstance(table, Table)
    assert len(table.rows) == len(flown) == 2
    for row in table.rows:
        velocity, bound = row[1], row[2]
        assert 0.0 < velocity < bound == 2e-3
    assert figure.name == "samar2006-spectrum"
    assert outcomes(flown) == ["holds", "holds"]


def test_all_airs_fly_in_the_full_version():
    full = truth.jobs(Scope())
    assert {job.name for job in full} == {f"truth/{air}" for air in truth.AIR}
    assert all(job.what["seconds"] == 300.0 for job in full)


def test_an_aircraft_off_its_path_is_told(flown):
    lost = dict(flown)
    lost["truth/strong"] = {**flown["truth/strong"], "beside_m": 120.0}
    assert outcomes(lost) == ["does not hold", "holds"]


def test_turbulence_of_another_spectrum_is_told(flown):
    """Half of the power gone in the last bands, as with filters of low order."""
    strong = flown["truth/strong"]
    met = np.array(strong["met"])
    met[:, -2:] *= 0.45
    assert outcomes({**flown, "truth/strong": {**strong, "met": met}}) == ["holds", "does not hold"]


def test_nothing_flown_claims_nothing():
    assert truth.claims({}, QUICK) == []
    assert truth.blocks({}, QUICK) == []
