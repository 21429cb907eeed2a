"""wang2020: what is run, and what the chapter says."""

from __future__ import annotations

from typing import Final

from monitor.commands.reproduce.study import Chapter, Paper, Results, Scope, Text
from monitor.commands.reproduce.wang2020 import runs
from monitor.commands.reproduce.wang2020.claims import AIM, claims
from monitor.commands.reproduce.wang2020.figures import figures
from monitor.commands.reproduce.wang2020.found import Found
from monitor.commands.reproduce.wang2020.methods import DEPLOYED_MEMORY_S
from monitor.commands.reproduce.wang2020.tables import NAMES, PRINTED_AS, tables

__all__ = ["PAPER"]


def chapter(results: Results, scope: Scope) -> Chapter:
    """Tables and figures in the paper's order, then what this project adds."""
    found = Found(results)
    table, figure = tables(found), figures(found)
    return Chapter(
        title="A robust state estimation method for unknown, time-varying and featureless "
        "aircraft sensor failures",
        reference="H. Wang, D. Liu, T. Chen, X. Qin, IEEE Access 8 (2020)",
        summary=_summary(found),
        blocks=[
            Text(
                "One run of the simulation (section IV-A, B)",
                "Engine (19), noises of Table 1, faults of Table 2. The paper prints neither its "
                "inputs nor its draws: each seed gives inputs, process noise, output noise and "
                "faults of their own, and every method sees the same.",
            ),
            *(figure[name] for name in ("fig3", "fig4", "fig5", "fig6")),
            table["within"],
            Text("Comparison with other methods (section IV-C)", _comparison(found)),
            table["table3"],
            figure["fig7"],
            figure["spread"],
            Text("Noise that is not Gaussian (section IV-D)"),
            table["table4"],
            figure["fig8"],
            figure["fig9"],
            Text(
                "What the corrections bring",
                "j = 0 lets all channels be faulty at once, so that no threshold Delta is needed; "
                "the health h replaces lambda with what has been seen of each channel lately.\n\n"
                f"The memory of 0.5 s is the reference data's; {DEPLOYED_MEMORY_S:g} s was chosen "
                "on other seeds.",
            ),
            table["methods"],
            figure["health"],
            table["channels"],
            table["settings"],
        ],
        claims=claims(found),
    )


def _summary(found: Found) -> str:
    printed, own = found.ratio("proposed", "clairvoyant"), found.ratio("deployed", "clairvoyant")
    area = found.spread("proposed", "a95")
    others = [m for m, row in PRINTED_AS.items() if row in ("chi-square", "rakf")]
    best = min(others, key=lambda name: found.spread(name, "a95").median)
    against = found.ratio("proposed", best)
    order = "smaller" if against.median < 1.0 else "larger"
    held = [c.outcome for c in claims(found)]
    classic = (
        "The gain over the classic Kalman correction cannot be reproduced: the two are one filter. "
        if "not reproducible" in held
        else ""
    )
    return (
        f"Rebuilt: the two-spool engine with failing channels, the proposed filter as printed and "
        f"with its corrections, and the three methods it is compared with, on {found.runs} seeds "
        f"where the paper shows one run. As printed the method's 95 % error ellipse is "
        f"{area.words()} %² (median and 10-90 %), {order} in the median than that of the best it "
        f"is compared with ({NAMES[best]}; smaller in {against.below(1.0):.0%} of the runs) and "
        f"{printed.median:.3g} times that of a filter that knows which channels work. With the "
        f"all-faulty combination and a health memory of {DEPLOYED_MEMORY_S:g} s it is "
        f"{own.median:.3g} times that one's (aim: {AIM:g}). {classic}Of {len(held)} statements "
        f"{held.count('holds')} hold, {held.count('holds in part')} in part."
    )


def _comparison(found: Found) -> str:
    apart = found.classic_apart
    return (
        "Proposed and classic correction are computed independently: the information form through "
        "the compiled filter's scalar corrections, the classic gain in numpy. Their estimates "
        f"differ by at most {apart:.0e}, relative. The paper also calls this method an extended "
        "multiple-model estimation; a bank of one classic filter for each condition, merged in the "
        "output only, stands below as the other reading.\n\n"
        "The chi-square window sums normalised squared innovations of 99 accepted samples and the "
        "new one against the 95 % value of chi-square; RAKF multiplies R by how much larger than "
        "expected the last 200 innovations were, whenever chi-square of the innovation exceeds its "
        "99 % value. Its source has two forms of the factor and the paper names neither; they and "
        "a test for each channel stand below."
    )


PAPER: Final = Paper("wang2020", runs.jobs, runs.work, chapter, needs=("scipy",))
