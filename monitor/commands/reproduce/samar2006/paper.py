"""The samar2006 chapter."""

from __future__ import annotations

import numpy as np

from monitor.commands.reproduce.samar2006 import truth, work
from monitor.commands.reproduce.samar2006.claims import claims, found_of, worst_final
from monitor.commands.reproduce.samar2006.figures import figures
from monitor.commands.reproduce.samar2006.scheme import RIGHT
from monitor.commands.reproduce.samar2006.tables import (
    gathered,
    healthy_table,
    models_of,
    observability_table,
    settings_table,
    steps_table,
    variants_table,
)
from monitor.commands.reproduce.study import Chapter, Job, Paper, Result, Results, Scope, Text
from sim_feeds.papers.samar2006 import plan

__all__ = ["PAPER"]

TITLE = "Embedded estimation of fault parameters in an unmanned aerial vehicle"
REFERENCE = (
    "S. Samar, D. Gorinevsky, S. P. Boyd: Embedded Estimation of Fault Parameters in an Unmanned "
    "Aerial Vehicle. IEEE International Conference on Control Applications, 2006."
)


def jobs(scope: Scope) -> list[Job]:
    """The estimates, and the flights themselves examined."""
    return [*work.jobs(scope), *truth.jobs(scope)]


def perform(job: Job) -> Result:
    """Do one job."""
    return truth.work(job) if job.name.startswith("truth/") else work.work(job)


def chapter(results: Results, scope: Scope) -> Chapter:
    """The chapter from the results of all jobs."""
    tables = [
        settings_table(),
        healthy_table(results),
        steps_table(results),
        variants_table(results),
        observability_table(results),
    ]
    text = Text(
        "How to read the flags",
        "What wind leaves in the estimates after Q has taken out its proportions is the same on "
        "both wings. A wing is therefore flagged on its own estimate only above what healthy "
        "flights reach, and on its excess over the other wing's at a fraction of that. The paper "
        "flags nothing; it shows estimates.",
    )
    return Chapter(
        TITLE,
        REFERENCE,
        _summary(results),
        [
            *figures(results),
            *truth.blocks(results, scope),
            tables[0],
            text,
            *tables[1:],
        ],
        [*claims(results), *truth.claims(results, scope)],
    )


def _summary(results: Results) -> str:
    models = models_of(results, "faulty/right-lift-step")
    wrong = [m for m in models if m != RIGHT]
    healthy = models_of(results, "healthy")
    flags = {m: list(gathered(results, "healthy", m, "flagged").max(axis=1)) for m in healthy}
    right_flags = sum(flags[RIGHT])
    wrong_flags = sum(sum(flags[m]) for m in healthy if m != RIGHT)
    of_wrong = sum(len(flags[m]) for m in healthy if m != RIGHT)
    lift = found_of(results, "right-lift-step", models, 0)
    small = found_of(results, "left-lift-step", models, 2)
    error, _ = worst_final(results, [RIGHT], [0, 2])
    drag, drag_worst = worst_final(results, [RIGHT], [1, 3])
    drags = np.concatenate([gathered(results, "healthy", m, "most")[:, [1, 3]] for m in healthy])
    return (
        "An Aerosonde flown by JSBSim in wind of "
        f"{plan().wind_share[0]:.0%} to {plan().wind_share[1]:.0%} of its airspeed was watched by "
        "a prediction model of its own, and the faults of its wings estimated by the monotone "
        "moving horizon. "
        f"A step of 10 % in the right wing's lift is flagged in {lift[0]} of {lift[1]} flights "
        f"(right and wrong models) after a median {lift[2]:.1f} s, one of 5 % in the left wing's "
        f"in {small[0]} of {small[1]} after {small[2]:.1f} s. Healthy flights raise {right_flags} "
        f"flags in {len(flags[RIGHT])} with the right model and {wrong_flags} in {of_wrong} with "
        f"coefficients wrong by {plan().wrong_share:.0%}. "
        f"With the right model the lift of a damaged wing ends within a median {error:.1f} %, its "
        f"drag within {drag:.1f} % (at worst {drag_worst:.0f} %): drag is nearly unobservable "
        f"in wind, and a healthy aircraft's estimate of it reaches {drags.max():.0f} %. "
        + (
            "The printed prior and a small R keep errors for good; the form that charges growth "
            "from the earlier estimate, with R = 1 %^2, does not."
            if _forgets(results)
            else "The printed prior and a small R did no harm in these flights."
        )
        + ("" if wrong else " Wrong models were not run.")
    )


def _forgets(results: Results) -> bool:
    data = results["variants"]
    kept, ours = (
        np.abs(data[k][RIGHT]["right-lift-step"]["final_error"]).max()
        for k in ("prior as printed, R 1e-4 %^2", "as deployed")
    )
    return bool(kept > 1.5 * ours)


PAPER = Paper("samar2006", jobs, perform, chapter, needs=("jsbsim",))
