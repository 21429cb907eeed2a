"""The tables of samar2006. The paper prints settings and pictures; its pictures have no numbers."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.wing_faults import EXTRA, LAM_PERCENT, R_PERCENT2, WINDOW, Thresholds
from estimators.wing_model import FAULTS
from monitor.commands.reproduce.samar2006.scheme import RIGHT, Scheme
from monitor.commands.reproduce.samar2006.work import VARIANTS
from monitor.commands.reproduce.study import Results, Table
from sim_feeds.papers.samar2006 import plan

__all__ = [
    "NAMES", "cases", "gathered", "healthy_table", "model_word", "observability_table",
    "settings_table", "steps_table", "variants_table",
]  # fmt: skip

Array = NDArray[np.float64]

NAMES: Final = ("right lift", "right drag", "left lift", "left drag")


def gathered(results: Results, prefix: str, model: str, key: str) -> Array:
    """Rows of a key over all jobs of a kind that ran the model."""
    parts = [results[n][model][key] for n in sorted(results) if n.startswith(prefix)]
    return np.concatenate(parts)


def models_of(results: Results, prefix: str) -> list[str]:
    """Models that a kind of job ran."""
    first = next(results[n] for n in sorted(results) if n.startswith(prefix))
    return [m for m in first if isinstance(first[m], dict)]


def model_word(model: str) -> str:
    """How tables call a prediction model."""
    return "right" if model == RIGHT else f"wrong by {plan().wrong_share:.0%}, {model}"


def cases(results: Results) -> list[str]:
    """Names of the cases flown, in the order of the scenario file."""
    return [name for name in plan().cases if f"faulty/{name}" in results]


def settings_table() -> Table:
    """Every setting that the paper prints, ours beside it."""
    s = Scheme()
    rows: list[list[Any]] = [
        ["samples of the simulation [s]", 0.05, 0.05, "Recorded at the paper's step; JSBSim "
         "integrates at 5 ms, because a servo is faster than 50 ms."],
        ["rows of the estimator [s]", s.period_s, 0.5, "The same."],
        ["horizon N", float(WINDOW), 50.0, "The same."],
        ["time constant of the known wind [s]", s.tau_wind_s, 10.0, "The same."],
        ["time constant of F_a [s]", s.tau_acc_s, 4.0, "The same."],
        ["flight [s]", plan().duration_s, 300.0, "The same."],
        ["wind, least [% of airspeed]", 100 * plan().wind_share[0], 20.0, "The same."],
        ["wind, largest [% of airspeed]", 100 * plan().wind_share[1], 25.0, "The same."],
        ["Q", f"healthy flights' second moments + {EXTRA:.0%} of the diagonal",
         "a tuning parameter", "The paper prints none; its residuals are far from independent."],
        ["lambda [%]", LAM_PERCENT, None, "The paper prints none."],
        ["R [%^2]", R_PERCENT2, None, "The paper prints none; a small one keeps errors for good."],
        ["prior on the last point", "from the estimate before", "from the first point",
         "As printed a fault that is the same all through the window costs nothing."],
        ["aircraft", "JSBSim, our file; electric", "AeroSim; piston engine, burns fuel",
         "AeroSim is a closed product; mass is constant here."],
        ["guidance", "course controller", "model-predictive, each 2 s",
         "The paper calls the autopilot's details not relevant."],
        ["axes of the accelerations", "body", "earth",
         "In body axes Q and the signatures do not turn with the course."],
    ]  # fmt: skip
    return Table(
        "samar2006-settings",
        "Section IV: settings, ours beside the paper's.",
        ("setting", "ours", "paper", "why they differ"),
        rows,
    )


def healthy_table(results: Results) -> Table:
    """Largest estimates in healthy flights, where thresholds were set and where they are tested."""
    t = Thresholds()
    rows: list[list[Any]] = []
    for purpose, words in (("alarm", "set on"), ("healthy", "reported")):
        for model in models_of(results, purpose):
            most = gathered(results, purpose, model, "most")
            apart = gathered(results, purpose, model, "apart")
            flags = gathered(results, purpose, model, "flagged")
            rows.append(
                [
                    words, model_word(model), len(most),
                    float(most[:, [0, 2]].max()), float(most[:, [1, 3]].max()),
                    float(apart[:, [0, 2]].max()), float(apart[:, [1, 3]].max()),
                    int(flags.any(axis=1).sum()),
                ]
            )  # fmt: skip
    return Table(
        "samar2006-healthy",
        "Healthy flights: largest estimates over all flights. Flagged is lift above "
        f"{t.lift:g} % or {t.lift_apart:g} % above the other wing's, drag above {t.drag:g} % or "
        f"{t.drag_apart:g} % above and {t.leak:g} % more for each percent between the lifts. These "
        "limits were set on the flights and wrong models of the first rows only. The paper shows "
        "no healthy flight.",
        ("flights", "model", "number", "lift [%]", "drag [%]", "lift, apart [%]",
         "drag, apart [%]", "flights with a flag"),
        rows,
    )  # fmt: skip


def steps_table(results: Results) -> Table:
    """Delays and final errors of every case and fault, right model and wrong ones together."""
    rows: list[list[Any]] = []
    for case in cases(results):
        result = results[f"faulty/{case}"]
        models = models_of(results, f"faulty/{case}")
        for group, chosen in (("right", [RIGHT]), ("wrong", [m for m in models if m != RIGHT])):
            if not chosen:
                continue
            delay, half, final, wrong = (
                np.concatenate([result[m][key] for m in chosen])
                for key in ("delay_s", "half_s", "final_error", "wrong")
            )
            for i in range(4):
                if not np.isfinite(result["onset_s"][i]):
                    continue
                found = np.isfinite(delay[:, i])
                rate = result["rate_percent_s"][i]
                late = float(np.median(delay[found, i])) if found.any() else None
                rows.append(
                    [
                        case, NAMES[i], group, f"{found.sum()} of {len(found)}", late,
                        float(delay[found, i].max()) if found.any() else None,
                        late * rate if late is not None and rate > 0.0 else None,
                        _median(half[:, i]),
                        float(np.median(final[:, i])), float(np.abs(final[:, i]).max()),
                        f"{wrong.any(axis=1).sum()} of {len(wrong)}",
                    ]
                )  # fmt: skip
    return Table(
        "samar2006-faults",
        "Each fault of each case: flights where it is flagged, seconds from its onset to the flag, "
        "the size that a ramp has by then, seconds until the estimate of a step is half of it, and "
        "the error of the estimate at the end of the flight (median and largest). Fig. 7 of the "
        "paper shows one flight and prints no number.",
        ("case", "fault", "model", "flagged", "delay, median [s]", "delay, largest [s]",
         "ramp at the flag [%]", "half found [s]", "final error, median [%]",
         "final error, largest [%]", "flights with a healthy part flagged"),
        rows,
    )  # fmt: skip


def _median(values: Array) -> float | None:
    found = values[np.isfinite(values)]
    return float(np.median(found)) if 2 * len(found) > len(values) else None


def variants_table(results: Results) -> Table:
    """What each choice of the scheme does."""
    rows: list[list[Any]] = []
    data = results["variants"]
    for label in VARIANTS:
        for model, one in data[label].items():
            most = one["most"]
            final = [
                float(np.abs(one[case]["final_error"]).max()) if case in one else None
                for case in ("right-lift-step", "right-drag-ramp", "simultaneous")
            ]
            rows.append(
                [
                    label, model_word(model), float(max(most[0], most[2])),
                    float(max(most[1], most[3])), float(max(most[4], most[6])),
                    float(max(most[5], most[7])), one["right-lift-step"]["half_s"], *final,
                ]
            )  # fmt: skip
    return Table(
        "samar2006-variants",
        "One choice of the scheme changed at a time: largest estimates of healthy flights, seconds "
        "until half of a 10 % step of the right lift is found, and the largest final error of any "
        "of the four estimates in three cases.",
        ("variant", "model", "healthy lift [%]", "healthy drag [%]", "lift, apart [%]",
         "drag, apart [%]", "half of the step [s]", "final error, lift step [%]",
         "final error, drag ramp [%]", "final error, three at once [%]"),
        rows,
    )  # fmt: skip


def observability_table(results: Results) -> Table:
    """Singular values of the signatures and the spread of a constant fault's estimate."""
    shown = results["shown"]
    S = shown["S"][len(shown["S"]) // 2]
    _, values, Vt = np.linalg.svd(S)
    rows: list[list[Any]] = []
    for k, value in enumerate(values):
        direction = ", ".join(
            f"{v:+.2f} {name}" for v, name in zip(Vt[k], NAMES, strict=True) if abs(v) > 0.1
        )
        std = {m: shown["std"][m][k] for m in shown["std"]}
        rows.append([float(value), direction, FAULTS[k], *(float(v) for v in std.values())])
    return Table(
        "samar2006-observability",
        "Singular values and directions of the signatures in mid-flight, and, for each fault, the "
        f"standard deviation of a constant level estimated over {WINDOW} rows of residuals as "
        "correlated as ours are. The paper says that observability is the only limit and does not "
        "show it.",
        ("singular value [m/s^2, rad/s^2 per %]", "direction", "fault",
         *(f"std, model {model_word(m)} [%]" for m in shown["std"])),
        rows,
    )  # fmt: skip
