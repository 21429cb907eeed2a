"""Tables of the wang2020 chapter."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from monitor.commands.reproduce.study import Cell, Table
from monitor.commands.reproduce.wang2020.found import Found, Spread
from monitor.commands.reproduce.wang2020.methods import DEPLOYED_MEMORY_S
from monitor.commands.reproduce.wang2020.printed import FIG6_WITHIN, TABLE3, TABLE4, Row
from monitor.commands.reproduce.wang2020.scores import SHARES
from sim_feeds.papers.wang2020 import wang2020_scenario

__all__ = ["NAMES", "PRINTED_AS", "ROUNDING", "agreeing_correlation", "laplace_within", "tables"]

NAMES: Final = {
    "rakf": "RAKF",
    "rakf-single": "RAKF, one factor for all channels",
    "rakf-channel": "RAKF, each channel tested alone",
    "classic": "classic KF correction",
    "bank": "classic KF, a filter for each condition",
    "chi-square": "chi-square window",
    "proposed": "proposed, as printed",
    "predicted": "proposed, prediction kept on a rejection",
    "no-delta": "proposed, without Delta",
    "all-faulty": "with j = 0, without Delta",
    "health": "with j = 0 and health memory of 0.5 s",
    "deployed": f"with j = 0 and health memory of {DEPLOYED_MEMORY_S:g} s",
    "clairvoyant": "clairvoyant Kalman filter",
}
"""Method -> what the report calls it."""

PRINTED_AS: Final = {
    "rakf": "rakf",
    "rakf-single": "rakf",
    "rakf-channel": "rakf",
    "classic": "classic",
    "bank": "classic",
    "chi-square": "chi-square",
    "proposed": "proposed",
}
"""Method -> the row of the paper's Table 3 that it is a reading of."""

ROUNDING: Final = 1e-6
"""Estimates closer than this (relative) are the same."""

ERROR_COLUMNS: Final = (
    "mean error, ours [%]",
    "10-90 % of runs",
    "paper",
    "a95, ours [%²]",
    "10-90 % of runs",
    "paper",
)


def tables(found: Found) -> dict[str, Table]:
    """All tables by name."""
    made = (
        _table3(found),
        _table4(found),
        _ours(found),
        _fig6(found),
        _channels(found),
        _settings(found),
    )
    return {table.name.removeprefix("wang2020-"): table for table in made}


def _cells(mean: Spread, a95: Spread, paper: Row | None) -> list[Cell]:
    return [
        mean.median,
        f"{mean.low:.2g} to {mean.high:.2g}",
        None if paper is None else paper.mean,
        a95.median,
        f"{a95.low:.3g} to {a95.high:.3g}",
        None if paper is None else paper.a95,
    ]


def _stands(spread: Spread, value: float) -> str:
    """Where the paper's value lies among our runs."""
    if value > spread.values.max():
        return "above all our runs"
    if value < spread.values.min():
        return "below all our runs"
    return f"within our runs ({spread.below(value):.0%} are at or below it)"


def _table3(found: Found) -> Table:
    rows: list[list[Cell]] = []
    for method, row in PRINTED_AS.items():
        paper = TABLE3[row]
        mean, a95 = found.spread(method, "mean"), found.spread(method, "a95")
        rows.append([NAMES[method], *_cells(mean, a95, paper), _why3(method, found)])
    return Table(
        name="wang2020-table3",
        caption="Table 3: errors of four methods, in several readings where the paper leaves them "
        f"open; median and 10-90 % of {found.runs} runs of 10 s, the paper's one run beside them.",
        columns=("method", *ERROR_COLUMNS, "why they differ"),
        rows=rows,
    )


def _why3(method: str, found: Found) -> str:
    paper = TABLE3[PRINTED_AS[method]]
    mean, a95 = found.spread(method, "mean"), found.spread(method, "a95")
    where = (
        f"The paper's one run has a mean error {_stands(mean, paper.mean)} and an area "
        f"{_stands(a95, paper.a95)}"
    )
    match method:
        case "classic" if found.classic_apart < ROUNDING:
            return (
                "The correction is algebraically the proposed one: computed with the classic gain "
                f"the estimates differ by at most {found.classic_apart:.0e} (relative) in all runs,"
                " so the paper's figure must have a cause that it does not tell."
            )
        case "bank":
            return (
                f"{where}; this is the same row read as what the paper calls it, multiple-model "
                "estimation: filters that never take up the merged estimate."
            )
        case "chi-square":
            return (
                f"{where}; the paper gives window and alpha but no equations, and what its test "
                "makes of a channel's variance is our reading."
            )
        case "rakf":
            return (
                f"{where}; the paper names reference [12], window and alpha, and does not say how "
                "the test and the factors of R are shared among the channels: a factor for each "
                "channel, one test of all."
            )
        case "rakf-single":
            return f"{where}; the same with one factor, which doubts good channels with bad ones."
        case "rakf-channel":
            return f"{where}; the same with a test for each channel, close to leaving it out."
        case _:
            return f"{where}; inputs and draws of its run are not printed."


def _table4(found: Found) -> Table:
    rows: list[list[Cell]] = []
    for law, paper in TABLE4.items():
        mean, a95 = found.spread("proposed", "mean", law), found.spread("proposed", "a95", law)
        why = (
            f"The paper's one run has a mean error {_stands(mean, paper.mean)} and an area "
            f"{_stands(a95, paper.a95)}"
        )
        if law == "laplace":
            why += (
                "; the printed standard deviations put "
                f"{laplace_within():.1%} within the limits that the text gives to 95 %"
            )
        rows.append([law, *_cells(mean, a95, paper), f"{why}."])
    return Table(
        name="wang2020-table4",
        caption="Table 4: the proposed method, as printed, under three laws of output noise; the "
        "filter keeps the Gaussian's R.",
        columns=("noise", *ERROR_COLUMNS, "why they differ"),
        rows=rows,
    )


def _ours(found: Found) -> Table:
    """Every method against the clairvoyant filter, in every noise."""
    rows: list[list[Cell]] = []
    for method in NAMES:
        mean, a95 = found.spread(method, "mean"), found.spread(method, "a95")
        row: list[Cell] = [NAMES[method], mean.median, a95.median]
        row.append(f"{a95.low:.3g} to {a95.high:.3g}")
        row.append(found.ratio(method, "clairvoyant").median)
        row.append(float(np.median(found.each(method, "nees"))))
        for law in ("laplace", "cauchy"):
            known = method in found.methods(law)
            row.append(found.spread(method, "a95", law).median if known else None)
        rows.append(row)
    return Table(
        name="wang2020-methods",
        caption="Every method beside the clairvoyant Kalman filter, which is told at every sample "
        "which channels work and so is the limit in Gaussian noise (in Cauchy noise it is not: it "
        "believes outliers). The normalised squared error is 2 when a filter's covariance is "
        "honest. Medians over the runs; the ratio is the median of the ratios of one run.",
        columns=(
            "method",
            "mean error [%]",
            "a95 [%²]",
            "10-90 % of runs",
            "a95 to clairvoyant",
            "normalised squared error",
            "a95, Laplace",
            "a95, Cauchy",
        ),
        rows=rows,
    )


def agreeing_correlation() -> float:
    """Correlation of the errors at which Fig. 6's extents give Table 3's area."""
    a, b = (within[1] for within in FIG6_WITHIN)
    uncorrelated = math.pi * a * b
    return math.sqrt(max(1.0 - (TABLE3["proposed"].a95 / uncorrelated) ** 2, 0.0))


def laplace_within() -> float:
    """Share of Table 4's Laplace noise within three of Table 1's standard deviations."""
    noise = wang2020_scenario().noise
    scale = noise["laplace"][0] / math.sqrt(2.0)
    return 1.0 - math.exp(-3.0 * noise["gaussian"][0] / scale)


def _fig6(found: Found) -> Table:
    extent = np.median(found.each("proposed", "extent"), axis=0)
    within = {m: np.median(found.each(m, "within"), axis=0) for m in ("proposed", "deployed")}
    rows: list[list[Cell]] = []
    for i, speed in enumerate(("LPC", "HPC")):
        spread = found.each("proposed", "extent")[:, i]
        for j, share in enumerate(SHARES):
            paper = FIG6_WITHIN[i][j]
            why = f"The paper's one run lies {_stands(Spread(spread[:, j]), paper)}"
            if within["proposed"][i, j] < 0.6 * extent[i, j]:
                why += "; most errors are far smaller than the ellipse, few are large"
            rows.append(
                [
                    speed,
                    f"{share:.0%}",
                    float(extent[i, j]),
                    paper,
                    float(within["proposed"][i, j]),
                    float(within["deployed"][i, j]),
                    f"{why}.",
                ]
            )
    return Table(
        name="wang2020-within",
        caption="Numbers under Fig. 6: half-extents of the confidence ellipses, and beside them "
        "the absolute errors that this share of the samples does not exceed; medians over the runs."
        f" The paper's 95 % extents give its area of {TABLE3['proposed'].a95:g} %² only if its two "
        f"errors correlate with {agreeing_correlation():.2f}.",
        columns=(
            "speed",
            "share",
            "ellipse, ours [%]",
            "paper [%]",
            "not exceeded, as printed [%]",
            f"not exceeded, memory {DEPLOYED_MEMORY_S:g} s [%]",
            "why they differ",
        ),
        rows=rows,
    )


def _channels(found: Found) -> Table:
    """How often a faulty output is believed, and a good one not."""
    rows: list[list[Cell]] = []
    hidden = []
    for method in ("proposed", "chi-square", "all-faulty", "health", "deployed"):
        row: list[Cell] = [NAMES[method]]
        for key in ("missed", "false"):
            row += [100.0 * float(v) for v in np.nanmean(found.each(method, key), axis=0)]
        hidden.append(float(np.nanmean(found.each(method, "missed"), axis=0)[-1]))
        rows.append(row)
    short = ("LPC", "HPC", "generator", "bleed")
    return Table(
        name="wang2020-channels",
        caption="Which outputs are believed (probability above one half), per cent of samples; "
        "means over the runs. Behind the bleed channel's noise of 5 % of full scale every method "
        f"overlooks at least {min(hidden):.0%} of the faults.",
        columns=(
            "method",
            *(f"faulty but believed: {name} [%]" for name in short),
            *(f"good but doubted: {name} [%]" for name in short),
        ),
        rows=rows,
    )


def _settings(found: Found) -> Table:
    limit = found.settings["clairvoyant"]
    rows: list[list[Cell]] = []
    for name, area in found.settings.items():
        ratio = Spread(area.values / limit.values)
        spread = f"{area.low:.3g} to {area.high:.3g}"
        rows.append([name, area.median, spread, ratio.median])
    return Table(
        name="wang2020-settings",
        caption="What lambda and the memory matter, on seeds that no other table uses; the memory "
        f"of {DEPLOYED_MEMORY_S:g} s was chosen on seeds 5000-5199.",
        columns=("form", "a95 [%²]", "10-90 % of runs", "a95 to clairvoyant"),
        rows=rows,
    )
