"""lu2016 section 3: Table 2's faults in calm air, shear and turbulence, by four estimators.

One job is one draw of one wind. The figures are of the first draw, the tables medians of all.
"""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.lu2016.methods import MODELS, all_estimates, scores
from monitor.commands.reproduce.lu2016.published import AXES, UNITS, shown
from monitor.commands.reproduce.lu2016.simulated_shown import (
    BANK_DEG,
    WINDS,
    blocks,
    lines_of,
    median,
)
from monitor.commands.reproduce.study import Claim, Job, Outcome, Result, Results, Scope, decided

if TYPE_CHECKING:
    from sim_feeds.papers.lu2016 import ImuExperiment

__all__ = ["blocks", "claims", "jobs", "median", "work"]

Floats = NDArray[np.float64]

EVERY: Final = 4
"""Samples of the figures: 25 Hz."""
EXTRA: Final = ("straight", "banked")
"""Flights that answer one question each, see :func:`_flight`."""


def jobs(scope: Scope) -> list[Job]:
    """One a wind and draw, and those of :data:`EXTRA`."""
    from sim_feeds.papers.lu2016_runs import runs

    section = runs().simulated
    seeds = [scope.drawn(seed) for seed in section.chosen(scope.quick)]
    kinds = [*section.winds, *EXTRA]
    return [
        Job("lu2016", f"simulated/{kind}/{seed}", {"kind": kind, "drawn": seed == seeds[0]}, seed)
        for kind in kinds
        for seed in seeds
    ]


def work(job: Job) -> Result:
    """Errors of every method with both models, and the lines of the first draw."""
    flight = _flight(job.what["kind"], job.seed)
    found: dict[str, Any] = {}
    lines: dict[str, dict[str, Floats]] = {}
    for name, model in MODELS.items():
        estimates = all_estimates(flight, model, flight.y_ground if name == "GS" else flight.y_air)
        found[name] = scores(estimates, flight)
        lines[name] = {method: f[::EVERY] for method, f in estimates.items()}
    if job.what["drawn"]:
        late = slice(1, None, EVERY)
        found["lines"] = {
            "t_s": flight.t_s[late],
            "f": flight.f[late],
            "wind": flight.wind_ned_m_s[late],
            **lines,
        }
    return found


def _flight(kind: str, seed: int) -> ImuExperiment:
    """The flight of a job.

    ``straight`` flies north, level, in the shear, whose wind has no east component: does f_Ay then
    feel it? ``banked`` turns steadily.
    """
    from sim_feeds.papers.lu2016 import lu2016_experiment, lu2016_plan

    if kind == "straight":
        return lu2016_experiment("shear", seed, plan=lu2016_plan(heading_rad=0.0))
    if kind == "banked":
        plan = lu2016_plan().orbit(41.0, radians(BANK_DEG))
        return lu2016_experiment("calm", seed, plan=plan)
    return lu2016_experiment(kind, seed)  # type: ignore[arg-type]


def claims(results: Results, scope: Scope) -> list[Claim]:
    """What sections 3.4 and 3.5 say."""
    return [
        _unbiased(results),
        _same_in_any_wind(results),
        _wind_on_the_airspeed_model(results),
        _side_force_in_shear(results),
        _gyros_alike(results),
        _observer_noisier(results),
    ]


def graded(parts: list[bool]) -> Outcome:
    """All hold, some, none."""
    return decided(all(parts), any(parts))


def _unbiased(results: Results) -> Claim:
    worst = np.max([np.abs(median(results, w, "GS", "atsekf", "bias")) for w in WINDS], axis=0)
    size = np.sqrt(np.mean(lines_of(results, "calm")["f"] ** 2, axis=0)) * np.sqrt(2.0)
    share = worst / size
    k = int(np.argmax(share))
    return Claim(
        "Section 3.3: with the ground-speed model all six faults are estimated in an unbiased"
        " sense.",
        graded([bool(v < 0.05) for v in share]),
        f"The mean error from 5 s after the onset to the end is at most {100 * share[k]:.1f} % of"
        f" the fault's root mean square, for {AXES[k]} ({shown(worst)[k]:.3f} {UNITS[k]}); f_Ay,"
        f" which drifts by 0.1 m/s² per second, is followed with a mean error of {worst[1]:.3f}"
        " m/s².",
    )


def _same_in_any_wind(results: Results) -> Claim:
    calm = median(results, "calm", "GS", "atsekf", "rmse")
    change = [
        float(np.abs(median(results, w, "GS", "atsekf", "rmse") / calm - 1.0).max())
        for w in ("shear", "turbulence")
    ]
    return Claim(
        "Sections 3.4 and 3.5: the estimates of the ground-speed model follow the faults in shear"
        " and turbulence as in calm air.",
        graded([v < 0.05 for v in change]),
        f"The largest change of any axis' RMSE against calm air is {100 * change[0]:.1f} % in shear"
        f" and {100 * change[1]:.1f} % in turbulence.",
    )


def _wind_on_the_airspeed_model(results: Results) -> Claim:
    ratio = {
        w: median(results, w, "AS", "atsekf", "rmse")[:3]
        / median(results, w, "GS", "atsekf", "rmse")[:3]
        for w in WINDS
    }
    return Claim(
        "Sections 2.2, 3.4, 3.5: with the airspeed model changing wind passes for accelerometer"
        " faults.",
        graded([bool(np.all(ratio[w] > 2.0)) for w in ("shear", "turbulence")]),
        "Its accelerometer RMSE is "
        + "; ".join(f"{r.min():.1f} to {r.max():.1f} times in {w}" for w, r in ratio.items())
        + " that of the ground-speed model.",
    )


def _side_force_in_shear(results: Results) -> Claim:
    straight, calm, turning = (
        float(median(results, kind, "AS", "atsekf", "rmse")[1])
        for kind in ("straight", "calm", "shear")
    )
    return Claim(
        "Section 3.4: the shear has no side wind (v_w = 0), so f_Ay of the airspeed model is not"
        " influenced.",
        graded([straight < 1.1 * calm, turning < 1.1 * calm]),
        f"RMSE of f_Ay {straight:.3f} m/s² flying straight along the wind against {calm:.3f} in"
        f" calm air, but {turning:.3f} on the flight whose heading leaves the wind's axis.",
    )


def _gyros_alike(results: Results) -> Claim:
    ratio = np.concatenate(
        [
            median(results, w, "AS", "atsekf", "rmse")[3:]
            / median(results, w, "GS", "atsekf", "rmse")[3:]
            for w in WINDS
        ]
    )
    far = float(np.abs(ratio - 1.0).max())
    return Claim(
        "Sections 3.4 and 3.5: the gyro faults are estimated alike with both models, whatever the"
        " wind.",
        graded([far < 0.1]),
        f"Their RMSEs differ by at most {100 * far:.1f} % over three winds and three axes.",
    )


def _observer_noisier(results: Results) -> Claim:
    raw, low, ours = (
        median(results, "turbulence", "GS", m, "quiet") for m in ("smo", "smo-low", "atsekf")
    )
    error_low, error = (
        median(results, "turbulence", "GS", m, "rmse")[:3] for m in ("smo-low", "atsekf")
    )
    return Claim(
        "Sections 3.4 and 3.5: the standard deviations of the sliding-mode observer are"
        " significantly larger than the ATSEKF's, and still larger after a low-pass.",
        graded([bool(np.all(raw > 3.0 * ours)), bool(np.all(low > ours))]),
        f"Accelerometers: raw {np.min(raw[:3] / ours[:3]):.0f} to"
        f" {np.max(raw[:3] / ours[:3]):.0f} times, low-passed"
        f" {np.min(low[:3] / ours[:3]):.1f} to {np.max(low[:3] / ours[:3]):.1f} times the"
        " ATSEKF's. What the paper does not show: with this low-pass its RMSE over Table 2 is"
        f" {_listed(error_low)} m/s² against {_listed(error)}, for it is less late.",
    )


def _listed(values: Floats) -> str:
    return ", ".join(f"{v:.2f}" for v in values)
