"""What wang2020 states, and what became of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from monitor.commands.reproduce.study import Claim, decided
from monitor.commands.reproduce.wang2020.found import Found, Spread
from monitor.commands.reproduce.wang2020.methods import DEPLOYED_MEMORY_S
from monitor.commands.reproduce.wang2020.printed import (
    AREA_REDUCTION,
    FIG6_WITHIN,
    MEAN_REDUCTION,
    MEMORY_KB,
    OPERATIONS,
    TABLE4,
)
from monitor.commands.reproduce.wang2020.tables import NAMES, PRINTED_AS, ROUNDING

__all__ = ["AIM", "claims"]

AIM: Final = 1.4
"""Area of the deployed form's ellipse over the clairvoyant filter's: what this project aims at."""
MARGIN: Final = 1.25
"""A number of ours within this factor of the paper's supports it."""


def claims(found: Found) -> list[Claim]:
    """All claims in the paper's order, then this project's aim."""
    judges: tuple[Callable[[Found], Claim], ...] = (
        _observable,
        _estimated,
        _expected_std,
        _cost,
        lambda f: _reduced(f, "rakf"),
        _classic,
        lambda f: _reduced(f, "chi-square"),
        _mean_errors,
        _noise,
        _cauchy,
        _guessed,
        _units,
        _threshold,
        _aim,
    )
    return [judge(found) for judge in judges]


def _observable(found: Found) -> Claim:
    each = [bool(v) for v in found.shown["observable"]]
    return Claim(
        "Section IV-A: the state is observable from any one of the four channels",
        decided(all(each), any(each)),
        f"{sum(each)} of {len(each)} channels observe both speeds alone (rank of C, CA).",
    )


def _estimated(found: Found) -> Claim:
    ours = np.median(found.each("proposed", "extent"), axis=0)
    fits = ours <= MARGIN * np.asarray(FIG6_WITHIN)
    numbers = ", ".join(f"{v:.2g}" for v in ours.ravel())
    return Claim(
        "Fig. 6: LPC errors within 6 % (68 %) and 11 % (95 %), HPC within 0.6 % and 1 %",
        decided(bool(fits.all()), bool(fits.any())),
        f"Half-extents of our ellipses are {numbers} % (median of {found.runs} runs); "
        f"{fits.sum()} of 4 are at most {MARGIN:g} times the paper's.",
    )


def _expected_std(found: Found) -> Claim:
    before, after = np.median(found.each("proposed", "delta"), axis=0)
    nees = float(np.median(found.each("proposed", "nees")))
    whole = after > 1.5 * before and nees < 2.0 * MARGIN
    return Claim(
        "Fig. 5: the expected standard deviation rises when two sensors die, and quantifies the "
        "uncertainty",
        decided(whole, after > 1.5 * before),
        f"It rises from {before:.2g} to {after:.2g} %, but the errors are larger than it says: "
        f"the normalised squared error is {nees:.3g}, honest would be 2."
        if not whole
        else f"It rises from {before:.2g} to {after:.2g} %, normalised squared error {nees:.3g}.",
    )


def _cost(found: Found) -> Claim:
    kilobytes = found.shown["nbytes"] / 1e3
    return Claim(
        f"Section IV-B: {OPERATIONS} operations and {MEMORY_KB} kB an iteration fit embedded "
        "computers",
        decided(kilobytes <= MEMORY_KB),
        f"Model and filter take {kilobytes:.2g} kB here; what an iteration takes depends on "
        "the machine and is measured by `mavsentry bench --only imkf_step`.",
    )


def _reduced(found: Found, than: str) -> Claim:
    paper = AREA_REDUCTION[than]
    readings = [method for method, row in PRINTED_AS.items() if row == than]
    ours = {method: found.reduction("a95", method) for method in readings}
    better = {method: found.ratio("proposed", method).below(1.0) for method in readings}
    numbers = ", ".join(
        f"{ours[m]:.0f} % smaller in the median than with the {NAMES[m]} and smaller in "
        f"{better[m]:.0%} of the runs"
        for m in readings
    )
    return Claim(
        f"Table 3: the error ellipse is {paper} % smaller than that of the {NAMES[than]}",
        decided(
            all(ours[m] >= paper / MARGIN and better[m] > 0.9 for m in readings),
            any(ours[m] > 0.0 for m in readings),
        ),
        f"It is {numbers}. With j = 0 and health memory: {_with_memory(found, readings)} % "
        "smaller.",
    )


def _with_memory(found: Found, methods: Sequence[str]) -> str:
    area = found.spread("deployed", "a95").median
    smaller = [100.0 * (1.0 - area / found.spread(m, "a95").median) for m in methods]
    return ", ".join(f"{v:.0f}" for v in smaller)


def _classic(found: Found) -> Claim:
    same = found.classic_apart < ROUNDING
    reduction = found.reduction("a95", "bank")
    because = (
        "The two corrections are one in exact arithmetic, and here their estimates agree to "
        f"{found.classic_apart:.0e} (relative) in all {found.runs} runs: there is nothing to gain."
        if same
        else f"The estimates of the two corrections differ by {found.classic_apart:.0e}."
    )
    return Claim(
        f"Table 3: the error ellipse is {AREA_REDUCTION['classic']} % smaller than with the classic"
        " Kalman correction",
        "not reproducible"
        if same
        else decided(found.reduction("a95", "classic") >= AREA_REDUCTION["classic"] / MARGIN),
        f"{because} Beside a bank of classic filters that are merged in the output only (the "
        f"paper's word is extended MMAE) it is {reduction:.0f} % smaller"
        + (": what gains is the merged estimate in the next prediction." if reduction > 0 else "."),
    )


def _mean_errors(found: Found) -> Claim:
    ours = {than: found.reduction("mean", than) for than in MEAN_REDUCTION}
    paper = ", ".join(f"{v} ({NAMES[than]})" for than, v in MEAN_REDUCTION.items())
    numbers = ", ".join(f"{round(v)} ({NAMES[than]})" for than, v in ours.items())
    spread = found.spread("proposed", "mean")
    holds = [v > 0.5 * MEAN_REDUCTION[than] for than, v in ours.items()]
    return Claim(
        f"Table 3: mean errors are smaller by {paper} per cent",
        decided(all(holds), any(holds)),
        f"In the median by {numbers} per cent. A run's mean error is between {spread.low:.2g} and "
        f"{spread.high:.2g} % in 80 % of the runs, so that one run cannot rank methods by it.",
    )


def _noise(found: Found) -> Claim:
    area = {law: found.spread("proposed", "a95", law).median for law in TABLE4}
    laplace, cauchy = (area[law] / area["gaussian"] for law in ("laplace", "cauchy"))
    paper = [TABLE4[law].a95 / TABLE4["gaussian"].a95 for law in ("laplace", "cauchy")]
    little, much = laplace < 2.0, cauchy > 2.0
    because = "" if much else ": the outliers of Cauchy noise are weighed away like faults"
    return Claim(
        "Table 4: Laplace noise costs little accuracy, Cauchy noise much",
        decided(little and much, little or much),
        f"The ellipse grows {laplace:.2f} and {cauchy:.2f} times (paper {paper[0]:.1f} and "
        f"{paper[1]:.1f}){because}.",
    )


def _cauchy(found: Found) -> Claim:
    ratio = Spread(
        found.each("proposed", "a95", "cauchy") / found.each("chi-square", "a95", "gaussian")
    )
    return Claim(
        "Section IV-D: in Cauchy noise it still compares with the chi-square window in Gaussian "
        "noise",
        decided(ratio.median < MARGIN),
        f"Its ellipse is {ratio.words()} times that one's.",
    )


def _guessed(found: Found) -> Claim:
    settings = found.settings
    printed = [
        settings[f"printed, {name} lambda"].median for name in ("guessed", "true", "one half")
    ]
    own = [
        settings[f"health 0.5 s, {name} lambda"].median for name in ("guessed", "true", "one half")
    ]
    change = [max(v) / min(v) for v in (printed, own)]
    return Claim(
        "Section II: a rough guess of lambda is enough",
        decided(change[0] < MARGIN, change[1] < MARGIN),
        "With the guessed, the true and 0.5 for every channel the printed form's ellipse is "
        f"{', '.join(f'{v:.3g}' for v in printed)} %², with health memory "
        f"{', '.join(f'{v:.3g}' for v in own)} %²: memory makes lambda a starting value.",
    )


def _units(found: Found) -> Claim:
    units = found.units
    without = float(np.max(units["without_apart"]))
    with_ranges = float(np.max(units["with_apart"]))
    return Claim(
        "Eq. (14): the weights are the probabilities of the fault conditions",
        decided(without < ROUNDING),
        "It compares densities of different dimension, so they depend on the unit: in revolutions "
        f"per minute the estimates move by up to {without:.2g} of full scale and the ellipse is "
        f"{np.median(units['without_a95']):.3g} %². With 1 / range for each faulty channel they "
        f"stay the same to {with_ranges:.0e}.",
    )


def _threshold(found: Found) -> Claim:
    samples, rejected = found.printed("samples"), found.printed("rejected")
    caught, none = found.printed("rejected_all_faulty"), found.printed("all_faulty")
    needless = rejected - caught
    laws = tuple(TABLE4)
    underflows = sum(found.printed("underflows", law) for law in laws)
    of_all = sum(found.printed("samples", law) for law in laws)
    return Claim(
        "Section III-C: the threshold Delta avoids the rare cases where all sensors fail",
        decided(caught > 0.9 * none and needless < 0.1 * rejected, caught > 0.5 * none),
        f"It rejects {rejected / samples:.1%} of the samples; in {caught / max(rejected, 1):.1%} of"
        f" these all channels are faulty, and it catches {caught} of {none} such samples. The "
        "all-faulty combination j = 0 needs no threshold. Not added as logarithms, (14) would be "
        f"0 / 0 in {underflows} of {of_all} samples under the three laws of noise.",
    )


def _aim(found: Found) -> Claim:
    ratio = {m: found.ratio(m, "clairvoyant") for m in ("proposed", "health", "deployed")}
    named = found.named_s
    return Claim(
        f"This project's aim: an ellipse at most {AIM:g} times the clairvoyant filter's",
        decided(
            ratio["deployed"].median <= AIM and ratio["health"].median <= AIM,
            ratio["deployed"].median <= AIM,
        ),
        f"{ratio['deployed'].words()} times with j = 0 and a memory of {DEPLOYED_MEMORY_S:g} s "
        f"(median and 10-90 % of runs), {ratio['health'].words()} with 0.5 s, as printed "
        f"{ratio['proposed'].words()}. A channel that dies is below health 0.5 after "
        f"{np.nanmedian(named):.2g} s in the median and {np.nanmax(named):.2g} s at most.",
    )
