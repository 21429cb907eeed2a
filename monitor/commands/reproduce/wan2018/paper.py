"""The wan2018 chapter: its studies one after another."""

from __future__ import annotations

from monitor.commands.reproduce.study import Chapter, Job, Paper, Result, Results, Scope
from monitor.commands.reproduce.wan2018 import parametric, residual, runaway, sensitivity, wind

__all__ = ["PAPER"]

TITLE = "wan2018: fault-tolerant air data by a constrained moving horizon"
REFERENCE = (
    "Y. Wan, T. Keviczky: Real-time fault-tolerant moving horizon air data estimation for the "
    "RECONFIGURE benchmark. IEEE Transactions on Control Systems Technology 27(3), 997-1011, 2019."
)
INTRODUCTION = (
    "Rebuilt are Figs. 2 to 6, Tables III and IV and Theorem 1, on a synthetic transport; the "
    "paper's simulator, winds and part of its weights are not public."
)
STUDIES = {
    "wind": wind,
    "runaway": runaway,
    "residual": residual,
    "sensitivity": sensitivity,
    "parametric": parametric,
}
"""In the order of the paper; the first part of a job's name is its study."""


def jobs(scope: Scope) -> list[Job]:
    """All studies' jobs, the long ones first."""
    return [job for study in reversed(STUDIES.values()) for job in study.jobs(scope)]


def work(job: Job) -> Result:
    """Hand the job to its study."""
    result: Result = STUDIES[job.name.partition("/")[0]].work(job)
    return result


def chapter(results: Results, scope: Scope) -> Chapter:
    """All studies in the paper's order."""
    studies = list(STUDIES.values())
    return Chapter(
        TITLE,
        REFERENCE,
        " ".join([INTRODUCTION, *(study.summary(results) for study in studies)]),
        [block for study in studies for block in study.blocks(results, scope)],
        [claim for study in studies for claim in study.claims(results, scope)],
    )


PAPER = Paper("wan2018", jobs, work, chapter)
