"""wan2018 Theorem 1 on windows with active bounds: as stated, and what holds in its place.

Each flight has all three sensors of a channel running away; the converged constrained horizon is
stepped until a bound is active. Windows are taken at that very sample, which is the theorem's own
case, and half a second later. See :mod:`estimators.fault_sensitivity` for the equations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_mhe import AirDataMHE, AirDataTuning
from estimators.baselines.numpy_twins_air import outputs, transition
from estimators.fault_sensitivity import ActiveBounds, LinearWindow, active_bounds, linear_window
from monitor.commands.reproduce.study import (
    Claim,
    Figure,
    Job,
    Outcome,
    Result,
    Results,
    Scope,
    Table,
    Text,
)
from sim_feeds.faults import KNOT_M_S
from sim_feeds.papers.wan2018_figures import SensitivityFlight, conditions

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["blocks", "claims", "jobs", "summary", "work"]

Floats = NDArray[np.float64]

PER_JOB: Final = 8
"""Flights of one job."""
BEFORE_S: Final = 10.0
"""Bounds that are active before the onset are the flight's own doing: not counted."""
CAS_BOUND_KT: Final = 120.0
AFTER_SAMPLES: Final = 20
"""Samples (one second) over which the arrival mean may follow the fault."""
STEP: Final = {2: 1e-4, 3: 0.02}
"""Fault added to an output for the difference quotient [rad, m/s]."""
ALPHA, CAS = 2, 3
EQUAL: Final = 1e-6
"""Differences of sensitivities below this are none: bounds are active to 1e-6 only."""


def jobs(scope: Scope) -> list[Job]:
    """Flights in groups; the quick version takes four of the pitots and two of the vanes."""
    draws = conditions().sensitivity
    n = draws.flights + draws.vane_flights
    groups = [list(range(k, min(k + PER_JOB, n))) for k in range(0, n, PER_JOB)]
    if scope.quick:
        groups = [[0, 1, 3, 4, draws.flights, draws.flights + 1]]
    return [
        Job("wan2018", f"sensitivity/{k:02d}", {"flights": group}, scope.seed)
        for k, group in enumerate(groups)
    ]


def work(job: Job) -> Result:
    """Windows of some flights, each a row of every entry."""
    rows = []
    for number in job.what["flights"]:
        rows += _windows(number, conditions().sensitivity_flight(number, job.seed))
    return {key: np.array([row[key] for row in rows]) for key in (rows[0] if rows else {})}


def _windows(number: int, drawn: SensitivityFlight) -> list[dict[str, Any]]:
    flight, draws = drawn.flight, conditions().sensitivity
    bound = draws.vertical_bound_kt if drawn.vanes else CAS_BOUND_KT
    q = float(np.sqrt(drawn.q_w))
    tuning = AirDataTuning(
        N=drawn.horizon,
        Q_std=(*AirDataTuning().Q_std[:2], q, q),
        wind_bound_m_s=(CAS_BOUND_KT * KNOT_M_S, bound * KNOT_M_S),
        converged=True,
        sqp_iterations=20,
    )
    estimator = AirDataMHE(tuning, flight.x[0], flight.theta[0])
    readings = np.column_stack(
        [
            flight.theta[:, 0],
            flight.v_z_m_s,
            flight.aoa_rad.mean(axis=1),
            flight.cas_m_s.mean(axis=1),
        ]
    )
    wanted, rows = (0, draws.later_samples), []
    first = None
    for k in range(len(flight.t_s) - 1):
        estimator.step(readings[k], np.ones(4), flight.theta[k])
        if flight.t_s[k] < BEFORE_S:
            continue
        active = active_bounds(estimator)
        if first is None and active.count:
            first = k
        if first is not None and k - first in wanted and active.count:
            output = ALPHA if drawn.vanes else CAS
            row = _window(estimator, active, flight.theta[k + 1], output)
            rows.append(row | {"flight": number, "late": k > first, "horizon": drawn.horizon})
        if first is not None and k - first >= max(wanted):
            break
    return rows


def _window(
    estimator: AirDataMHE, active: ActiveBounds, theta_next: Floats, output: int
) -> dict[str, Any]:
    """Everything asked of one window."""
    window = linear_window(estimator, theta_next)
    S, S_a = window.S(), window.S(active)
    sensors = window.sensor_columns()
    weights = np.sqrt(np.concatenate([window.V, np.ones(4)]))
    nested = [active.first(n) for n in range(active.count + 1)]
    gains = np.array([window.lasting_gain(output, some) for some in nested])
    norms = np.array([_row_norm(window, some, output) for some in nested])
    return {
        "output": output,
        "active": active.count,
        "least": _extremes(S_a, S)[0],
        "least_sensors": _extremes(S_a[:, sensors], S[:, sensors])[0],
        "most_weighted": _extremes(S_a * weights, S * weights)[1],
        "row": float(S_a[output] @ S_a[output]),
        "row_free": float(S[output] @ S[output]),
        "gain": gains[-1],
        "gain_free": gains[0],
        "after": window.lasting_gain_after(output, AFTER_SAMPLES, active),
        "after_free": window.lasting_gain_after(output, AFTER_SAMPLES),
        "older_change": float(np.abs(gains[1:] - gains[1]).max()),
        "more_raise_norm": bool((np.diff(norms) > -EQUAL).all()),
        "gain_by_solving": _by_solving(estimator, theta_next, output),
    }


def _extremes(S_a: Floats, S: Floats) -> tuple[float, float]:
    """Least and greatest eigenvalue of S_a S_a' - S S'."""
    values = np.linalg.eigvalsh(S_a @ S_a.T - S @ S.T)
    return float(values[0]), float(values[-1])


def _row_norm(window: LinearWindow, active: ActiveBounds, output: int) -> float:
    row = window.S(active)[output]
    return float(row @ row)


def _by_solving(estimator: AirDataMHE, theta_next: Floats, output: int) -> float:
    """The lasting gain as a difference quotient: the window solved with a little more fault."""
    t = estimator.tuning
    # the vanes drift up, the pitots down: more of the same keeps the active bounds active
    step = STEP[output] * (1.0 if output == ALPHA else -1.0)
    predictions = []
    for fault in (0.0, step):
        other = AirDataMHE(t, estimator.x[0], estimator.theta[0])
        other.window[:] = estimator.window
        other.y[:, output] += fault
        for _ in range(3):
            other.solve()
        ahead = transition(t.model, other.x[-1], np.zeros(4), other.theta[-1], t.t_s)
        predictions.append(
            float(outputs(t.model, np.asarray(ahead, dtype=float), theta_next)[output])
        )
    return 1.0 - (predictions[1] - predictions[0]) / step


def _all(results: Results) -> Result:
    parts = [results[name] for name in sorted(results) if name.startswith("sensitivity/")]
    parts = [p for p in parts if p]
    return {key: np.concatenate([p[key] for p in parts]) for key in parts[0]}


def _groups(windows: Result) -> list[tuple[str, NDArray[np.bool_]]]:
    cas, late = windows["output"] == CAS, windows["late"]
    return [
        ("airspeeds, first active sample", cas & ~late),
        ("airspeeds, half a second later", cas & late),
        ("vanes, first active sample", ~cas & ~late),
        ("vanes, half a second later", ~cas & late),
    ]


def blocks(results: Results, scope: Scope) -> list[Table | Figure | Text]:
    """Table and figure of the windows."""
    w = _all(results)
    rows: list[list[Any]] = []
    for name, use in _groups(w):
        n = int(use.sum())
        if not n:
            continue
        rows.append(
            [
                name,
                n,
                int((w["least"][use] >= -EQUAL).sum()),
                int((w["row"][use] >= w["row_free"][use] - EQUAL).sum()),
                int((w["most_weighted"][use] <= EQUAL).sum()),
                float(np.median(w["gain"][use])),
                float(np.median(w["gain_free"][use])),
                float(np.median(w["after"][use])),
                float(np.median(w["after_free"][use])),
                float(np.abs(w["gain"] - w["gain_by_solving"])[use].max()),
            ]
        )
    table = Table(
        "wan2018-theorem1",
        "Theorem 1 on windows with active bounds. Stated: S_a S_a' >= S S', as matrices and for "
        "the failing sensor's row alone; reversed: the same in the metric of V, where it must turn "
        "round. The gain is the share of a lasting fault that the residual shows, at the first "
        "window and after one second, medians; the last column is the largest difference from "
        "solving the window again with more fault",
        ["windows", "number", "stated holds", "stated holds, its row", "reversed holds",
         "gain, bounds", "gain, free", "after 1 s, bounds", "after 1 s, free",
         "worst difference to solving"],
        rows,
        digits=4,
    )  # fmt: skip
    return [_words(), table, _figure(w)]


def _words() -> Text:
    return Text(
        "Theorem 1: fault sensitivity with active bounds",
        "The theorem compares the residual's sensitivity to faults, S = [-K, 1], with and without "
        "active bounds and concludes S_a S_a' >= S S'. But S S' = 1 + K K', and a bound takes "
        "freedom from the estimate and so shrinks K, the part of a fault that the prediction "
        "follows. The appendix goes from V - J_1 X_a J_1' >= V - J_1 X J_1' to the products, which "
        "does not follow where the matrices stand between factors; in the metric of V the "
        "contrary holds always. S S' adds up how strongly each single reading moves the residual: "
        "an estimate that follows a sensor moves its residual in both directions.\n\n"
        "A monitor waits for faults that last. For those, what counts is 1 minus the sum of K over "
        "the window: with the wind at its bound the prediction cannot follow and all of the fault "
        "stays in the residual, without bounds the wind takes it up, most of it within a second.",
    )


def _figure(w: Result) -> Figure:
    def draw(canvas: Canvas) -> None:
        left, right = canvas.subplots(1, 2)
        for k, (output, word) in enumerate(((CAS, "airspeeds"), (ALPHA, "vanes"))):
            use = w["output"] == output
            left.plot(
                w["row_free"][use], w["row"][use], ls="", marker="os"[k], ms=4, mfc="none",
                color=f"C{k}", label=word,
            )  # fmt: skip
            for key, marker in (("gain", "os"[k]), ("after", "x+"[k])):
                right.plot(
                    w[f"{key}_free"][use], w[key][use], ls="", marker=marker, ms=4, mfc="none",
                    color=f"C{k}",
                    label=f"{word}, {'at once' if key == 'gain' else 'after 1 s'}",
                )  # fmt: skip
        ends = [1.0, float(w["row_free"].max()) * 1.05]
        left.plot(ends, ends, color="0.6", lw=0.8)
        left.set_xlabel("$S S'$ of the failing sensor, free")
        left.set_ylabel("$S_a S_a'$, bounds active")
        left.set_title("as stated: points above the line")
        right.plot([0.0, 1.0], [0.0, 1.0], color="0.6", lw=0.8)
        right.set_xlabel("gain to a lasting fault, free")
        right.set_ylabel("gain, bounds active")
        right.set_title("as it holds")
        left.legend()
        right.legend(loc="lower right")

    return Figure(
        "wan2018-theorem1-windows",
        "Each window with active bounds: left the theorem's measure, right the share of a lasting "
        "fault that the residual shows",
        draw,
    )


def claims(results: Results, scope: Scope) -> list[Claim]:
    """The theorem's two sentences, and what holds."""
    w = _all(results)
    n = len(w["gain"])
    held = int((w["least"] >= -EQUAL).sum())
    rows = int((w["row"] >= w["row_free"] - EQUAL).sum())
    turned = int((w["most_weighted"] <= EQUAL).sum())
    raised = int((w["gain"] > w["gain_free"]).sum())
    cas = w["output"] == CAS
    gain, free = (float(np.median(w[key][cas])) for key in ("gain", "gain_free"))
    after, after_free = (float(np.median(w[key][cas])) for key in ("after", "after_free"))
    more_norm = int(w["more_raise_norm"].sum())
    return [
        Claim(
            "Theorem 1: with active bounds S_a S_a' >= S S'",
            _outcome(held, n),
            f"On {held} of {n} windows ({rows} for the failing sensor's own row); in the metric of "
            f"V it is reversed on {turned}, as X_a <= X demands.",
        ),
        Claim(
            "Theorem 1: more active bounds give a larger S S'",
            _outcome(more_norm, n),
            f"Adding the active bounds one by one never lowered it on {more_norm} of {n} windows.",
        ),
        Claim(
            "What Theorem 1 is for: active bounds raise the sensitivity (to a fault that lasts)",
            _outcome(raised, n),
            f"On {raised} of {n} windows; for the airspeeds the residual shows {gain:.3f} of the "
            f"fault against {free:.3f} at once, and {after:.3f} against {after_free:.3f} after one "
            "second. The newest state's bound does it; the older ones change it by "
            f"{w['older_change'].max():.1e} at most.",
        ),
    ]


def _outcome(held: int, n: int) -> Outcome:
    return "holds" if held == n else "does not hold" if 2 * held < n else "holds in part"


def summary(results: Results) -> str:
    """One sentence for the chapter's summary."""
    w = _all(results)
    cas = w["output"] == CAS
    return (
        f"Theorem 1 held as stated on {int((w['least'] >= -EQUAL).sum())} of {len(w['gain'])} "
        "windows with active bounds; what holds is the gain to a lasting fault, "
        f"{np.median(w['gain'][cas]):.3f} against {np.median(w['gain_free'][cas]):.3f} without "
        "bounds."
    )
