"""How good the estimates of a run are; errors in per cent of full scale, as the paper has them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.study import Result
from monitor.commands.reproduce.wang2020.methods import Estimates
from sim_feeds.papers.wang2020 import EngineExperiment, wang2020_scenario

__all__ = [
    "SHARES",
    "chi_square_2",
    "ellipse_area",
    "errors_percent",
    "expected_std_percent",
    "named_after_s",
    "score",
]

Array = NDArray[np.float64]

SHARES: Final = (0.68, 0.95)
"""Of Fig. 6's confidence ellipses."""


def chi_square_2(share: float) -> float:
    """Value below which chi-square with two degrees is with this probability."""
    return -2.0 * math.log(1.0 - share)


def ellipse_area(errors: Array, share: float = 0.95) -> float:
    """Area of the confidence ellipse of errors (N, 2) about their mean [squared unit]."""
    spread = np.cov(errors.T)
    return math.pi * chi_square_2(share) * math.sqrt(max(float(np.linalg.det(spread)), 0.0))


def errors_percent(estimates: Estimates, run: EngineExperiment) -> Array:
    """Estimate minus truth, (N, 2) [% of full scale]."""
    return 100.0 * (estimates.x - run.x)


def expected_std_percent(P: Array) -> Array:
    """delta_exp of (20) from covariances (N, 2, 2) [% of full scale]."""
    trace: Array = np.trace(P, axis1=1, axis2=2)
    return 100.0 * np.sqrt(trace / 2.0)


def score(estimates: Estimates, run: EngineExperiment) -> Result:
    """Everything that the tables need of one method and one run.

    Returns
    -------
    dict
        ``mean`` norm of the mean error [%], ``a95`` area of the 95 % ellipse [%^2], ``extent``
        (2, 2) half-extents of the 68 and 95 % ellipses, by speed [%], ``within`` (2, 2) absolute
        errors that 68 and 95 % of the samples do not exceed [%],
        ``nees`` mean normalised squared error (2 when P is honest), ``delta`` median delta_exp
        before and after the permanent faults [%], and where the method says which channels it
        believes, ``missed`` and ``false``: (4,) shares of faulty outputs believed and of good ones
        not believed.
    """
    e = errors_percent(estimates, run)
    late = run.t_s > wang2020_scenario().permanent_from_s
    delta = expected_std_percent(estimates.P)
    weighted = np.linalg.solve(estimates.P, (e / 100.0)[:, :, None])[:, :, 0]
    scores: Result = {
        "mean": float(np.linalg.norm(e.mean(axis=0))),
        "a95": ellipse_area(e),
        "extent": np.outer(e.std(axis=0), [math.sqrt(chi_square_2(share)) for share in SHARES]),
        "within": np.quantile(np.abs(e), SHARES, axis=0).T,
        "nees": float(((e / 100.0) * weighted).sum(axis=1).mean()),
        "delta": np.array([np.median(delta[~late]), np.median(delta[late])]),
    }
    if estimates.works is not None:
        believed = estimates.works > 0.5
        scores["missed"] = _share(believed, ~run.works)
        scores["false"] = _share(~believed, run.works)
    return scores


def _share(event: NDArray[np.bool_], among: NDArray[np.bool_]) -> Array:
    """Share of the samples in `among` that have the event, by channel; NaN where there are none."""
    with np.errstate(invalid="ignore"):
        share: Array = (event & among).sum(axis=0) / among.sum(axis=0)
    return share


def named_after_s(health: Array, run: EngineExperiment) -> Array:
    """Time from the permanent fault until a dead channel's health is below one half, (2,) [s]."""
    s = wang2020_scenario()
    after = run.t_s > s.permanent_from_s + 0.5 * s.sample_s
    low = health[np.ix_(after, list(s.permanent))] < 0.5  # type: ignore[arg-type]
    first = np.where(low.any(axis=0), low.argmax(axis=0), len(low))
    times: Array = s.sample_s * (first + 1.0)
    return np.where(low.any(axis=0), times, np.nan)
