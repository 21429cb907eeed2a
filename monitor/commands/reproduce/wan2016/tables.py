"""Tables and figures of the wan2016 chapter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from monitor.commands.reproduce.study import Figure, Result, Results, Table, Text
from monitor.commands.reproduce.wan2016.printed import DELAYS_S, ERRORS
from monitor.commands.reproduce.wan2016.reasons import (
    delay_of,
    median,
    why_delay,
    why_faulty,
    why_healthy,
)
from monitor.commands.reproduce.wan2016.scenarios import ALL_FORMS, FORMS
from sim_feeds.papers.wan2016 import table1

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["blocks"]

NAMES: Final = ("vanes", "airspeeds")
QUANTITIES: Final = (("AOA", "deg"), ("VCAS", "kt"))


def blocks(results: Results) -> list[Table | Figure | Text]:
    """Everything between the summary and the claims."""
    return [
        Text(
            "What was run",
            "Heights, calibrated airspeeds, manoeuvres, which sensors fail and how are those of "
            "Table 1, in `sim_feeds/papers/wan2016.toml`, which was committed before anything ran "
            "on it. Sizes of the faults, their onset (20 s into 60 s) and the winds but for "
            "scenarios 3 and 7 are not printed; thresholds are wan2018's 2.9 deg and 12 kt, as "
            "wan2016's are lost in the text. The seeds give noise and turbulence. "
            '"As printed" is the paper\'s own logic and model, "ours" the triplex estimator with '
            'the exact model, latch and remembered wind, and "in flight" the watch of the monitor, '
            "which knows three dimensions and learns for 15 s before it judges.\n\n"
            "1v repeats scenario 1 with vanes that are off by their whole value.",
        ),
        _errors(0, results),
        _errors(1, results),
        _delays(results),
        _forms(results),
        _causes(results),
        _course("3", "2", results),
        _course("7", "3", results),
        _sweep("rate/6", "wan2016-rate", "runaway rate [kt/s]", results),
        _sweep("onset/6", "wan2016-onset6", "onset [s]", results),
        _sweep("onset/7", "wan2016-onset7", "onset [s]", results),
    ]


def _scenarios(results: Results) -> list[tuple[str, Result]]:
    names = [row.name for row in table1().scenario]
    return [(name, results[f"scenario/{name}"]) for name in names]


def _errors(channel: int, results: Results) -> Table:
    quantity, unit = QUANTITIES[channel]
    columns = ["run"]
    for statistic in ("max", "mean"):
        columns += [f"{statistic} [{unit}] ours", "10-90 %", "paper"]
    rows: list[list[Any]] = []
    for name, result in _scenarios(results):
        for health in "HF":
            if name == "1v" and health == "H":
                continue
            run = f"{name}-{health}"
            runs = result[health]["ours"]
            low, high = np.percentile(runs["errors"], [10, 90], axis=0)
            row: list[Any] = [run]
            for k in (2 * channel, 2 * channel + 1):
                printed = ERRORS[run][k] if run in ERRORS else None
                row += [median(runs)[k], f"{low[k]:.2g}-{high[k]:.2g}", printed]
            why = why_healthy if health == "H" else why_faulty
            rows.append([*row, why(name, channel, result)])
    return Table(
        f"wan2016-table2-{quantity.lower()}",
        f"Table 2, left half: absolute estimation errors of {quantity}, medians and 10-90 % over "
        f"{_seeds(results)} seeds; H healthy, F faulty",
        [*columns, "why they differ"],
        rows,
        digits=2,
    )


def _delays(results: Results) -> Table:
    rows: list[list[Any]] = []
    for row in table1().scenario:
        runs = results[f"scenario/{row.name}"]["F"]
        for channel, group in enumerate((row.vanes, row.pitots)):
            if group is None:
                continue
            ours = delay_of(runs["ours"], channel)
            found = np.isfinite(ours)
            spread = "–"
            if found.any():
                low, high = np.percentile(ours[found], [10, 90])
                spread = f"{low:.2f}-{high:.2f}"
            rows.append(
                [
                    f"{row.name}-F",
                    f"{len(group.sensors)} {NAMES[channel]}, {group.kind.value}",
                    float(np.median(ours)) if found.all() else None,
                    spread,
                    f"{found.sum()} of {len(ours)}",
                    _median_delay(runs["as printed"], channel),
                    DELAYS_S[row.name][channel] if row.name in DELAYS_S else None,
                    why_delay(row, channel, results),
                ]
            )
    return Table(
        "wan2016-table2-delays",
        "Table 2, right half: detection delay of the slowest of the sensors that fail together; "
        "a dash where a run missed one",
        ["run", "what fails", "ours [s]", "10-90 %", "runs that found all", "as printed [s]",
         "paper [s]", "why they differ"],
        rows,
    )  # fmt: skip


def _median_delay(runs: Result, channel: int) -> float | None:
    delays = delay_of(runs, channel)
    return float(np.median(delays)) if np.isfinite(delays).all() else None


def _forms(results: Results) -> Table:
    rows: list[list[Any]] = []
    for name, result in _scenarios(results):
        for form in ALL_FORMS:
            runs, steady = result["F"][form], result["steady"][form]
            errors = median(runs)
            rows.append(
                [
                    f"{name}-F",
                    form,
                    _count(result["H"][form]["blamed"]),
                    _count(np.isnan(runs["delay_s"]) & runs["broken"]),
                    _count(runs["blamed"]),
                    _count(steady["blamed"]),
                    _count(runs["released"]),
                    errors.aoa_mean_deg,
                    errors.cas_mean_kt,
                    errors.cas_max_kt,
                ]
            )
    return Table(
        "wan2016-forms",
        f"Three forms of the scheme, of {_seeds(results)} runs each: how many raised a false "
        "alarm without faults, missed a faulty sensor, blamed a healthy one (also where the wind "
        "does not ramp), or released a faulty one while its fault lasted; a scenario's three rows "
        "belong together",
        ["run", "form", "false alarms (H)", "missed", "blamed a healthy one",
         "the same, steady wind", "released", "AOA mean [deg]", "VCAS mean [kt]", "VCAS max [kt]"],
        rows,
        digits=2,
    )  # fmt: skip


def _count(flags: Any) -> int:
    """Runs with any flag."""
    return int(flags.any(axis=1).sum())


def _causes(results: Results) -> Table:
    rows: list[list[Any]] = []
    for name, result in _scenarios(results):
        if name == "1v":
            continue
        stages = [median(result["H"]["ours"]), median(result["quiet"]), median(result["smooth"])]
        row: list[Any] = [f"{name}-H"]
        for key in ("aoa_mean_deg", "cas_mean_kt"):
            row += [getattr(s, key) for s in stages] + [getattr(ERRORS[f"{name}-H"], key)]
        rows.append(row)
    steps = ["as flown", "a tenth of the noise", "no turbulence either", "paper"]
    return Table(
        "wan2016-causes",
        "What the healthy errors are made of: mean AOA error [deg] and mean VCAS error [kt], "
        "median over the seeds",
        ["run", *(f"AOA, {s}" for s in steps), *(f"VCAS, {s}" for s in steps)],
        rows,
        digits=2,
    )


def _seeds(results: Results) -> int:
    return len(results["scenario/1"]["H"]["ours"]["errors"])


def _course(name: str, number: str, results: Results) -> Figure:
    course = results[f"scenario/{name}"]["course"]

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots(3, 1, sharex=True)
        t = course["t_s"]
        for axis, key, label in ((axes[0], "aoa", "AOA [deg]"), (axes[1], "cas", "VCAS [kt]")):
            unit = "deg" if key == "aoa" else "kt"
            first = 0 if key == "aoa" else 3
            for i in range(3):
                axis.plot(t, course[f"{key}_{unit}"][:, i], lw=0.5, color="0.7")
            axis.plot(t, course[f"{key}_true_{unit}"], color="black", label="true")
            axis.plot(t, course[f"{key}_hat_{unit}"], color="C0", lw=0.9, label="estimate")
            _mark_detections(axis, t, course["faulty"][:, first : first + 3])
            axis.set_ylabel(label)
        for k, word in enumerate(("horizontal", "vertical")):
            axes[2].plot(t, course["wind_kt"][:, k], color="black", ls=("-", "--")[k])
            axes[2].plot(
                t, course["wind_hat_kt"][:, k], color="C0", lw=0.9, ls=("-", "--")[k], label=word
            )
        axes[2].set_ylabel("wind [kt]")
        axes[2].set_xlabel("time [s]")
        axes[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
        axes[2].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)

    return Figure(
        f"wan2016-fig{number}",
        f"Fig. {number}: scenario {name}-F, first seed, ours; grey the three sensors, dotted the "
        "moments at which a sensor is found faulty",
        draw,
        (8.0, 5.0),
    )


def _mark_detections(axis: Axes, t: Any, faulty: Any) -> None:
    """Dotted verticals at the moments of detection."""
    for sensor in faulty.T:
        if sensor.any():
            axis.axvline(t[sensor.argmax()], color="C3", ls=":", lw=0.9)


def _sweep(key: str, name: str, label: str, results: Results) -> Figure:
    sweep, scenario = results[key], key.partition("/")[2]
    row = table1().named(scenario)
    values = np.asarray(sweep["values"])
    is_rate = key.startswith("rate")
    if is_rate and row.pitots is not None:
        values = values * (row.pitots.rate_kt_s or 0.0)

    def draw(canvas: Canvas) -> None:
        delays, shares = canvas.subplots(1, 2)
        for k, form in enumerate(FORMS):
            runs = sweep[form]
            delay = runs["delay_s"][:, :, 3:5].max(axis=2)
            blamed = runs["blamed"].any(axis=2).mean(axis=1)
            for run in delay.T:
                delays.plot(values, run, marker="os"[k], ms=4 - k, ls="", color=f"C{k}")
            shares.plot(values, 100.0 * blamed, marker="os"[k], ms=4, color=f"C{k}", label=form)
        if is_rate:
            delays.axhline(DELAYS_S[scenario][1] or 0.0, color="0.5", ls=":", label="paper")
            delays.legend()
            for axis in (delays, shares):
                axis.set_xscale("log")
                axis.set_xticks(values, [f"{v:g}" for v in values])
                axis.minorticks_off()
        delays.set_ylabel("delay [s], where found")
        delays.margins(y=0.1)
        delays.set_ylim(bottom=0.0)
        shares.set_ylabel("healthy one blamed [% of runs]")
        shares.set_ylim(-5.0, 105.0)
        shares.legend()
        for axis in (delays, shares):
            axis.set_xlabel(label)

    what = "the runaway rate" if is_rate else "the moment of the onset (the wind ramps 15-25 s)"
    return Figure(
        name,
        f"Beyond the paper: scenario {scenario}-F, its two airspeeds, against {what}",
        draw,
    )
