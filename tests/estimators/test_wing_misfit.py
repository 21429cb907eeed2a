"""Residuals that no difference between the wings explains, and what their mean says."""

from __future__ import annotations

import numpy as np
import pytest

from estimators.wing_misfit import Misfit, unlike_rows

RNG = np.random.default_rng(5)


def unlike(y: np.ndarray, S: np.ndarray) -> np.ndarray:
    out = np.empty(len(y))
    unlike_rows(y, S, out)
    return out


def test_it_is_the_rest_of_least_squares() -> None:
    y, S = RNG.standard_normal((40, 6)), RNG.standard_normal((40, 6, 4))
    D = S[:, :, :2] - S[:, :, 2:]
    rest = [one - d @ np.linalg.lstsq(d, one, rcond=None)[0] for one, d in zip(y, D, strict=True)]
    np.testing.assert_allclose(unlike(y, S), np.square(rest).sum(axis=1) / 4.0, rtol=1e-9)


def test_a_difference_between_the_wings_leaves_it_alone() -> None:
    y, S = RNG.standard_normal((40, 6)), RNG.standard_normal((40, 6, 4))
    damaged = y + (S[:, :, :2] - S[:, :, 2:]) @ np.array([30.0, -80.0])
    np.testing.assert_allclose(unlike(damaged, S), unlike(y, S), rtol=1e-6)


def test_of_noise_it_is_one() -> None:
    S = np.tile(RNG.standard_normal((6, 4)), (4000, 1, 1))
    assert unlike(RNG.standard_normal((4000, 6)), S).mean() == pytest.approx(1.0, abs=0.05)


def test_a_row_that_is_not_finite_says_nothing() -> None:
    y, S = np.ones((3, 6)), RNG.standard_normal((3, 6, 4))
    y[1, 2] = np.nan
    S[2, 0, 0] = np.inf
    assert np.isnan(unlike(y, S)).tolist() == [False, True, True]


def test_the_mean_decides_from_the_first_rows_on() -> None:
    misfit = Misfit(3.0, 4, 8)
    assert [misfit.note(v) for v in (9.0, np.nan, 1.0, 9.0)] == [None] * 4
    assert misfit.note(1.0) is False  # 5
    assert misfit.note(0.0) is False  # 4
    assert [misfit.note(0.0) for _ in range(9)] == [False] * 9  # 2.5 at the end: not half


def test_it_fits_again_below_half_the_limit_and_then_no_more_is_asked() -> None:
    misfit = Misfit(3.0, 2, 6)
    assert [misfit.note(v) for v in (4.0, 4.0, 0.0, 0.0, 0.0, 0.0, 99.0)] == [
        None, False, False, False, False, True, True,
    ]  # fmt: skip
    settled = Misfit(3.0, 2, 6)
    settled.note(1.0)
    settled.note(1.0)
    settled.settle()
    assert settled.note(1e6) is True
