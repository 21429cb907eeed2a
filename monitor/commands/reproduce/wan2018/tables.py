"""What the wan2018 chapter shows of the parametric runs: Tables III and IV, Fig. 6."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from monitor.commands.reproduce.study import Figure, Results, Scope, Table, Text
from monitor.commands.reproduce.wan2018.parametric_runs import OURS, SCHEMES, TUNING_SEEDS
from monitor.commands.reproduce.wan2018.scores import MEMORY_S
from monitor.commands.reproduce.wan2018.statistics import (
    CHANNELS,
    PAPER,
    PAPER_ERRORS,
    SOON_S,
    Channel,
    channel_of,
    errors_of,
    judged_runs,
    memory_of,
    sensors_of,
)
from sim_feeds.papers.wan import WAN_SAMPLE_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["blocks"]

MARGINS: Final = (3.0, 30.0)
"""Shown of an example beyond the true values, deg and kt; readings may go further."""
EXAMPLES: Final = {
    "jamming": ("wan2018-fig6a", "Fig. 6(a): jammed vanes and pitots"),
    "nrz": ("wan2018-fig6b", "Fig. 6(b): non-return to zero of all three pitots"),
}


def blocks(results: Results, scope: Scope) -> list[Table | Figure | Text]:
    """Tables and figures, with what was run."""
    runs, small, fresh = (judged_runs(results, which) for which in ("main", "small", "fresh"))
    n_healthy = sum(r["category"] == "healthy" for r in runs)
    hours = sum(r["duration_s"] for r in runs) / 3600.0
    shown: list[Table | Figure | Text] = [
        Text(
            "Parametric runs",
            f"{len(runs)} runs, {n_healthy} of them fault-free, {hours:.1f} h in all: flight "
            f"points, manoeuvres, winds and faults {_source(scope)} Whatever was tuned was tuned "
            f"on runs of seeds {' and '.join(map(str, TUNING_SEEDS))}.\n\n"
            "A fault counts as visible when an observer who knows the true air data, but not the "
            "wind, would confirm it by the paper's rule: 2.9 deg or 12 kt rms over 10 samples, 8 "
            "of 10 times. Where all three sensors of a kind are broken, only what no wind within "
            "120 kt (40 kt vertically) and 15 kt/s explains is visible.\n\n"
            "`constrained`, `unconstrained` and `ekf` are three estimators in our fault logic "
            "with the same weights and thresholds; `as printed` is the constrained one in the "
            "paper's own logic, without latch, remembered wind and a sensor's own signs.",
        ),
        _table_iii(runs),
        *(_table_iv(runs, ch) for ch in range(2)),
        _kinds(runs),
        _memory(runs),
        _delays_figure(runs),
    ]
    if small and fresh:
        shown.append(_others(small, fresh))
    if "parametric/examples" in results:
        examples = results["parametric/examples"]
        shown += [_example(kind, examples[kind]) for kind in EXAMPLES]
    return shown


def _source(scope: Scope) -> str:
    """Where the runs of a scope come from."""
    if scope.seed:
        return "are drawn by `sim_feeds.papers.wan2018` from another seed than the committed ones."
    return (
        "stand in `sim_feeds/papers/wan2018_runs.jsonl`, which was committed before anything was "
        "tuned; the module beside it says how they were drawn."
    )


def _table_iii(runs: Sequence[dict[str, Any]]) -> Table:
    rows: list[list[Any]] = []
    for (health, name), paper in PAPER_ERRORS.items():
        unit = "deg" if name == "alpha" else "kt"
        quantity = "AOA" if name == "alpha" else "VCAS"
        by_scheme = {s: errors_of(runs, s, name, health == "healthy") for s in SCHEMES}
        for k, statistic in enumerate(("max", "mean")):
            ours = by_scheme[OURS][k]
            rows.append(
                [
                    f"{'fault-free' if health == 'healthy' else 'faulty'}, {statistic} |error| "
                    f"{quantity} [{unit}]",
                    *(by_scheme[s][k] for s in SCHEMES),
                    paper[k],
                    _why_error(health, name, statistic, ours, paper[k]),
                ]
            )
    return Table(
        "wan2018-table3",
        "Table III: estimation errors. The airspeed counts while a pitot is left, as in the paper.",
        ["quantity", *SCHEMES, "paper", "why they differ"],
        rows,
    )


def _why_error(health: str, name: str, statistic: str, ours: float, paper: float) -> str:
    if ours <= paper:
        return "Ours is not larger."
    if statistic == "mean" and health == "faulty":
        return (
            "Without vanes the vertical wind is angle of attack, W_z/V; and the mean of the "
            "fault-free runs is larger before."
            if name == "alpha"
            else "Airspeeds that fall or rise with all pitots until they are found."
        )
    if statistic == "mean":
        return (
            "Our sensors have noise (0.2 deg, 0.8 kt) and our air has turbulence of up to 3 kt "
            "rms, below which no mean of absolute errors gets; the paper prints neither."
        )
    if health == "healthy":
        return "The strongest of our gusts; the paper's wind profiles are not printed."
    if name == "cas":
        return (
            "Pitots that run away alike, or the last good-looking one of three, more slowly than "
            "the wind may change are taken for wind until its bounds are reached; the paper's draw "
            "cannot have had such a run."
        )
    return "The vanes are wrong until they are found; the size of that error is the fault's."


ROWS: Final = (
    ("FAR [%]", "far"),
    ("MDR of visible faults [%]", "mdr"),
    ("MDR of all faults drawn [%]", "mdr_all"),
    ("FIR [%]", "fir"),
    ("faulty sensor released [%]", "released"),
    ("max delay from the onset [s]", "max_s"),
    ("mean delay from the onset [s]", "mean_s"),
    (f"mean delay, visible within {SOON_S:.0f} s [s]", "mean_soon_s"),
    ("max delay since visible [s]", "max_wait_s"),
)


def _table_iv(runs: Sequence[dict[str, Any]], ch: int) -> Table:
    by_scheme = {s: channel_of(runs, s, ch) for s in SCHEMES}
    ours, paper = by_scheme[OURS], PAPER[ch]
    printed: dict[str, float | None] = {
        "far": paper.far,
        "mdr": paper.mdr,
        "mdr_all": paper.mdr,
        "fir": paper.fir,
        "max_s": paper.max_s,
        "mean_s": paper.mean_s,
    }
    rows = [
        [
            title,
            *(getattr(by_scheme[s], key) for s in SCHEMES),
            printed.get(key),
            _why_rate(key, ours, printed.get(key)),
        ]
        for title, key in ROWS
    ]
    return Table(
        f"wan2018-table4-{CHANNELS[ch].lower()}",
        f"Table IV, {CHANNELS[ch]}: rates in percent of the fault-free or the faulty runs; delays "
        "until the last sensor of a run whose fault is visible is found.",
        ["quantity", *SCHEMES, "paper", "why they differ"],
        rows,
    )


def _why_rate(key: str, ours: Channel, paper: float | None) -> str:
    value = getattr(ours, key)
    if paper is None:
        return "The paper does not report it."
    if value == paper:
        return "They do not."
    if value < paper:
        return "Ours is lower."
    if key == "mdr_all":
        return (
            "The low ends of Table II stay under the thresholds whatever the estimator does: 0.5 "
            "deg and 10 % of a few degrees under 2.9 deg, 10 kt under 12 kt."
        )
    if key in ("max_s", "mean_s"):
        visible = ours.visible_s[ours.delays_s.argmax()]
        return (
            f"Run {ours.slowest} alone takes {ours.max_s:.1f} s; no observer with the paper's rule "
            f"who does not know the wind could have seen its fault before {visible:.1f} s."
        )
    return "Ours is higher: other flights, winds and draws of faults."


def _kinds(runs: Sequence[dict[str, Any]]) -> Table:
    rows: list[list[Any]] = []
    for ch, channel in enumerate(CHANNELS):
        ours, printed = (sensors_of(runs, s, ch) for s in (OURS, "as printed"))
        for kind, (broken, visible, found_visible, found) in ours.items():
            rows.append([channel, kind, broken, visible, found_visible, found, printed[kind][3]])
    return Table(
        "wan2018-kinds",
        "Broken sensors by fault type. A jam or noise that no residual shows is found by the "
        "sensor's own readings, which stand still or leap.",
        ["channel", "fault", "sensors", "visible", "of these found", "found", "found as printed"],
        rows,
    )


def _memory(runs: Sequence[dict[str, Any]]) -> Table:
    faulty = [r for r in runs if r["category"] != "healthy"]
    rows: list[list[Any]] = []
    for (low, high), (n, mean, worst, inside) in zip(
        pairwise(MEMORY_S), memory_of(faulty, OURS), strict=True
    ):
        found = [mean, worst, 100.0 * inside] if n else [None] * 3
        rows.append([f"{low:.0f}-{high:.0f}", n * WAN_SAMPLE_S, *found])
    return Table(
        "wan2018-memory",
        "Airspeed told without any pitot (configurations III and IV), by the age of the held wind; "
        "the paper tells none. The wind of these runs goes on changing by up to 60 kt at a time.",
        [
            "age [s]",
            "flown [s]",
            "mean |error| [kt]",
            "max |error| [kt]",
            "within told 3 sigma [%]",
        ],
        rows,
    )


def _others(small: Sequence[dict[str, Any]], fresh: Sequence[dict[str, Any]]) -> Table:
    sets = {"small faults": small, "fresh draws": fresh}
    channels = {
        f"{name}, {CHANNELS[ch]}": channel_of(runs, OURS, ch)
        for name, runs in sets.items()
        for ch in range(2)
    }
    rows: list[list[Any]] = [
        [title, *(getattr(c, key) for c in channels.values())] for title, key in ROWS
    ]
    rows[0][1:3] = [None, None]  # the small ones have no fault-free run
    return Table(
        "wan2018-others",
        f"The constrained estimator elsewhere. Small faults: the same {len(small)} faulty flights, "
        "sizes and rates drawn log-uniformly over the ranges of Table II. Fresh draws: "
        f"{len(fresh)} runs of other seeds, drawn as those above; nothing was tuned on them.",
        ["quantity", *channels],
        rows,
    )


def _delays_figure(runs: Sequence[dict[str, Any]]) -> Figure:
    by_scheme = {s: [channel_of(runs, s, ch).delays_s for ch in range(2)] for s in SCHEMES}

    def draw(canvas: Canvas) -> None:
        for ch, axes in enumerate(canvas.subplots(1, 2, sharey=True)):
            for scheme, delays in by_scheme.items():
                d = np.sort(delays[ch])
                share = 100.0 * np.arange(1, len(d) + 1) / max(len(d), 1)
                style = "-" if scheme == OURS else "--"
                axes.step(np.maximum(d, 0.1), share, style, where="post", label=scheme)
            axes.axvline(PAPER[ch].mean_s, color="0.5", linewidth=0.8)
            axes.axvline(PAPER[ch].max_s, color="0.5", linewidth=0.8, linestyle=":")
            axes.set_xscale("log")
            axes.set_xlabel(f"{CHANNELS[ch]} delay from the onset [s]")
            axes.grid(visible=True)
        canvas.axes[0].set_ylabel("faulty runs found [%]")
        canvas.axes[0].legend()

    return Figure(
        "wan2018-delays",
        "Runs in which the last visible fault has been found, over the time since the onset. Grey: "
        "the paper's mean (solid) and maximum (dotted) of Table IV.",
        draw,
    )


def _example(kind: str, e: dict[str, Any]) -> Figure:
    name, caption = EXAMPLES[kind]

    def draw(canvas: Canvas) -> None:
        t = np.asarray(e["t_s"])
        rows = (
            ("AOA [deg]", "vanes_deg", "alpha_deg", "alpha_told_deg", 0),
            ("VCAS [kt]", "pitots_kt", "cas_kt", "cas_told_kt", 1),
        )
        for axes, (label, sensors, true, told, ch) in zip(canvas.subplots(1, 2), rows, strict=True):
            axes.plot(t, np.asarray(e[sensors]), color="0.75", linewidth=0.8)
            axes.plot(t, np.asarray(e[true]), color="black", label="true")
            axes.plot(t, np.asarray(e[told]), "C0", label="told")
            faulty = np.asarray(e["faulty"])[:, ch].any(axis=1)
            if faulty.any():
                found = t[int(faulty.argmax())]
                axes.axvline(found, color="C1", linewidth=0.8, label="first found")
            clear = np.asarray(e[true])
            axes.set_ylim(clear.min() - MARGINS[ch], clear.max() + MARGINS[ch])
            axes.set_xlabel("t [s]")
            axes.set_ylabel(label)
        canvas.axes[0].legend()

    return Figure(
        name,
        f"{caption} (run {e['number']}, onset at {e['onset_s']:.1f} s). Grey: the sensors' "
        "readings.",
        draw,
    )
