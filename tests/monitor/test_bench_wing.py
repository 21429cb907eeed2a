"""The wing benchmark's contenders solve the same programme."""

import numpy as np
import pytest

from monitor.commands.bench_cases.wing import Windows, cases, clarabel_peer, piqp_peer

pytest.importorskip("scipy")


@pytest.mark.parametrize("make", [clarabel_peer, piqp_peer])
def test_peer_reaches_our_optimum_and_never_a_lower_one(make):
    pytest.importorskip(make.__name__.removesuffix("_peer"))
    windows = Windows(20)
    cost, newest = windows.solver()()
    its_cost, its_newest = make(windows)()
    np.testing.assert_allclose(its_cost, cost, rtol=1e-7)
    np.testing.assert_allclose(its_newest, newest, atol=5e-3)
    assert (its_cost - cost >= -1e-8 * np.abs(cost)).all()


def test_windows_are_different_programmes():
    windows = Windows(20)
    _, newest = windows.solver()()
    assert np.ptp(newest[:, 0]) > 5.0


def test_cases_name_what_is_measured():
    assert [case.name for case in cases()] == ["mhmap_n50", "mhmap_n200"]
