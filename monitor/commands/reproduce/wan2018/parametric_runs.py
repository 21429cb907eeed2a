"""The 249 parametric runs of wan2018 VI-B, by four schemes: Tables III and IV, and its Fig. 6.

=============  ==================================================================================
constrained    the bounded horizon in the fault logic of :mod:`estimators.triplex`
unconstrained  the same without bounds
ekf            an extended Kalman filter in the same logic
as printed     the bounded horizon in the paper's own logic, without what ours adds to it
=============  ==================================================================================

All have the same weights, thresholds and bounds; those were chosen on runs of other seeds than the
ones reported here (:data:`TUNING_SEEDS`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_mhe import KT, AirDataTuning
from estimators.triplex import EstimatorName, Triplex, TriplexRecord, TriplexTuning
from monitor.commands.reproduce.study import Job, Result, Scope
from monitor.commands.reproduce.wan2018.scores import (
    UNITS,
    WIND_BOUNDS_KT,
    score,
    visible_from_s,
)
from sim_feeds import earth
from sim_feeds.papers.wan import WAN_SAMPLE_S, LongitudinalExperiment
from sim_feeds.papers.wan2018 import SEED, Run, draw_runs, read_runs, run_experiment

__all__ = ["OURS", "SCHEMES", "TUNING_SEEDS", "WEIGHTS", "jobs", "runs_of", "work"]

Floats = NDArray[np.float64]

SCHEMES: Final[dict[str, tuple[EstimatorName, TriplexTuning]]] = {
    "constrained": ("constrained", TriplexTuning()),
    "unconstrained": ("unconstrained", TriplexTuning()),
    "ekf": ("ekf", TriplexTuning()),
    "as printed": ("constrained", TriplexTuning.as_printed()),
}
OURS: Final = "constrained"
TUNING_SEEDS: Final = (1, 2)
WEIGHTS: Final = AirDataTuning(
    Q_std=(float(np.radians(1.0)), 0.5, 1.0, 1.0),
    wind_bound_m_s=(WIND_BOUNDS_KT[0] * KT, WIND_BOUNDS_KT[1] * KT),
)
"""q_w = 1, the paper's of Fig. 4: a wind of 15 kt/s is followed within 5 kt."""
RUNS_A_JOB: Final = 11
FRESH_DRAWS: Final = 2
"""Further draws of 249 runs that the constrained estimator flies; nothing was tuned on them."""
QUICK_EVERY: Final = 18
EXAMPLES: Final = {"jamming": "I", "nrz": "III"}
"""Kinds and categories of the two runs that Fig. 6 shows."""
EXAMPLE_POINTS: Final = 900


def runs_of(scope: Scope) -> list[Run]:
    """The runs of a scope: those committed, or another seed's; if quick, a few of them."""
    runs = read_runs() if scope.seed == 0 else draw_runs(SEED + scope.seed)
    return [r for r in runs if r.set == "main"][::QUICK_EVERY] if scope.quick else runs


def jobs(scope: Scope) -> list[Job]:
    """Batches of runs, of mixed lengths so that they take alike; and the two examples."""
    runs, draw = runs_of(scope), SEED + scope.seed
    numbers = {name: [r.number for r in runs if r.set == name] for name in ("main", "small")}
    out = [
        *_batches("main", numbers["main"], draw, list(SCHEMES), RUNS_A_JOB),
        *_batches("small", numbers["small"], draw, [OURS], 2 * RUNS_A_JOB),
    ]
    if not scope.quick:
        for k in range(1, FRESH_DRAWS + 1):
            out += _batches(f"fresh{k}", numbers["main"], draw + k, [OURS], 2 * RUNS_A_JOB)
    what = {"examples": EXAMPLES, "draw": draw}
    return [*out, Job("wan2018", "parametric/examples", what, draw)]


def _batches(
    name: str, numbers: list[int], draw: int, schemes: list[str], size: int
) -> Iterator[Job]:
    """Jobs of about ``size`` runs each, all of one draw."""
    n = min(len(numbers), max(1, round(len(numbers) / size)))
    which = "small" if name == "small" else "main"
    for k in range(n):
        what = {"set": which, "runs": numbers[k::n], "draw": draw, "schemes": schemes}
        yield Job("wan2018", f"parametric/{name}-{k:02d}", what, draw)


def work(job: Job) -> Result:
    """Fly the runs of one job and judge its schemes on each."""
    what, draw = job.what, job.what["draw"]
    runs = read_runs() if draw == SEED else draw_runs(draw)
    if "examples" in what:
        return {kind: _example(runs, draw, kind, c) for kind, c in what["examples"].items()}
    wanted = {(what["set"], n) for n in what["runs"]}
    chosen = [r for r in runs if (r.set, r.number) in wanted]
    return {"runs": [_judged(run, draw, what["schemes"]) for run in chosen]}


def start_state(w: LongitudinalExperiment) -> Floats:
    """State [alpha, V_g, W_x, W_z] that the first readings of all sensors give, (4,)."""
    V_g, pitch, height = w.theta[0, 0], w.theta[0, 1], w.theta[0, 5]
    alpha = float(np.median(w.aoa_rad[0]))
    impact = earth.impact_pressure_of_cas(float(np.median(w.cas_m_s[0])))
    V_t = float(
        earth.true_airspeed(impact, earth.static_pressure(height), earth.temperature(height))
    )
    north = np.sqrt(V_g**2 - w.v_z_m_s[0] ** 2) - V_t * np.cos(pitch - alpha)
    return np.array([alpha, V_g, north, w.v_z_m_s[0] + V_t * np.sin(pitch - alpha)])


def run_scheme(scheme: str, w: LongitudinalExperiment) -> TriplexRecord:
    """One of :data:`SCHEMES` over one run."""
    estimator, tuning = SCHEMES[scheme]
    triplex = Triplex.start(start_state(w), w.theta[0], WEIGHTS, tuning, estimator)
    inertial = np.column_stack([w.theta[:, 0], w.v_z_m_s])
    return triplex.run(inertial, w.aoa_rad, w.cas_m_s, w.theta)


def _judged(run: Run, draw: int, schemes: list[str]) -> dict[str, Any]:
    """One run by the schemes."""
    w = run_experiment(run, draw)
    return {
        "number": run.number,
        "set": run.set,
        "category": run.category,
        "duration_s": run.duration_s,
        "kinds": {f["sensor"]: f["kind"] for f in run.faults},
        "visible_s": (visible_from_s(w) - run.onset_s).tolist(),
        "schemes": {name: score(run, w, run_scheme(name, w)) for name in schemes},
    }


def _example(runs: list[Run], draw: int, kind: str, category: str) -> dict[str, Any]:
    """Time series of the first run in which both channels, or all pitots, break in this way."""
    likely = [r for r in runs if r.category == category]
    run = next((r for r in likely if _shows(r, kind)), likely[0])
    w = run_experiment(run, draw)
    record = run_scheme(OURS, w)
    first = max(int((run.onset_s - 20.0) / WAN_SAMPLE_S), 0)
    part = slice(first, min(first + int(60.0 / WAN_SAMPLE_S), len(w.t_s)))
    step = max(1, (part.stop - part.start) // EXAMPLE_POINTS)
    keep = np.arange(part.start, part.stop, step)
    deg, kt = UNITS
    return {
        "number": run.number,
        "onset_s": run.onset_s,
        "t_s": w.t_s[keep],
        "vanes_deg": w.aoa_rad[keep] / deg,
        "pitots_kt": w.cas_m_s[keep] / kt,
        "alpha_deg": w.x[keep, 0] / deg,
        "cas_kt": w.cas_true_m_s[keep] / kt,
        "alpha_told_deg": record.alpha[keep] / deg,
        "cas_told_kt": record.cas[keep] / kt,
        "faulty": record.faulty[keep],
    }


def _shows(run: Run, kind: str) -> bool:
    """As in the paper: vanes and pitots break alike, or all pitots and no vane."""
    vanes = [f["kind"] for f in run.faults if f["sensor"].startswith("aoa")]
    pitots = [f["kind"] for f in run.faults if f["sensor"].startswith("airspeed")]
    if run.category == "III":
        return not vanes and pitots == [kind] * 3
    return kind in vanes and kind in pitots
