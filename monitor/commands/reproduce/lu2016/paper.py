"""lu2016 as a whole: its studies in the paper's order, and what they come to."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.lu2016 import (
    closed_loop,
    fault_walk,
    open_loop,
    rates,
    recorded,
    simulated,
)
from monitor.commands.reproduce.study import (
    Chapter,
    Claim,
    Figure,
    Job,
    Paper,
    Result,
    Results,
    Scope,
    Table,
    Text,
)

__all__ = ["PAPER"]

Floats = NDArray[np.float64]

STUDIES: Final = {
    "simulated": (simulated, "Simulated disturbances (sections 3.4, 3.5)"),
    "fault_walk": (fault_walk, "The choice of Q^f and the printed equations (section 3.1)"),
    "closed_loop": (closed_loop, "Closed against open loop (sections 3.2, 3.3)"),
    "open_loop": (open_loop, "Three flights with faults written in (sections 4, 5)"),
    "recorded": (recorded, "Faults written into recorded flights (section 5)"),
    "rates": (rates, "Satellite receivers of several rates (section 5.4)"),
}
"""Module and heading of each, by the first part of its jobs' names."""


def jobs(scope: Scope) -> list[Job]:
    """All studies' jobs."""
    return [job for study, _ in STUDIES.values() for job in study.jobs(scope)]


def work(job: Job) -> Result:
    """Done by the study that the job's name begins with."""
    study, _ = STUDIES[job.name.partition("/")[0]]
    done: Result = study.work(job)
    return done


def chapter(results: Results, scope: Scope) -> Chapter:
    """All studies, one after the other."""
    blocks: list[Table | Figure | Text] = []
    claims: list[Claim] = []
    for key, (study, heading) in STUDIES.items():
        own = _of(results, key)
        blocks += [Text(heading), *study.blocks(own, scope)]
        claims += study.claims(own, scope)
    return Chapter(
        title="Nonlinear aircraft sensor fault reconstruction in the presence of disturbances"
        " validated by real flight data",
        reference="P. Lu, E. van Kampen, C. de Visser, Q. Chu, Control Engineering Practice 49"
        " (2016) 112-128",
        summary=_summary(results, claims),
        blocks=blocks,
        claims=claims,
    )


def _summary(results: Results, claims: list[Claim]) -> str:
    held, part, fails = (
        sum(c.outcome == word for c in claims)
        for word in ("holds", "holds in part", "does not hold")
    )
    ground, air = (
        simulated.median(results, "turbulence", model, "atsekf", "rmse")[:3]
        for model in ("GS", "AS")
    )
    quiet, error, _, observer = fault_walk.at_equal_noise(_of(results, "fault_walk"))
    rate = {hz: rates.mean_error(_of(results, "rates"), hz) for hz in (100, 1)}
    return (
        "Rebuilt: the adaptive two-stage filter (ATSEKF), its form without adaption (IOTSEKF) and"
        " a sliding-mode observer, each on the ground-speed and the airspeed model, with the six"
        " simultaneous faults of Table 2, on synthetic flights of our own: the paper's simulator"
        " and recordings are not public, and it shows its results as lines without numbers."
        f" Of {len(claims)} statements {held} hold, {part} hold in part, {fails} do not;"
        f" {len(claims) - held - part - fails} could not be tried."
        f" In turbulence the ground-speed model reconstructs the accelerometer faults to"
        f" {_range(ground)} m/s² RMS, the airspeed model to {_range(air)}. At equal noise"
        f" ({quiet:.3f} m/s² when nothing is broken) the ATSEKF errs by {error:.2f} m/s² over the"
        f" faults, the observer by {observer:.2f}. The ground speed of 1 Hz that the paper"
        " interpolates is the weak point: used as it comes, as in flight, it takes the"
        f" accelerometer errors from {rate[100]:.2f} to {rate[1]:.2f} m/s²."
    )


def _of(results: Results, key: str) -> Results:
    """Results of one study."""
    return {name: r for name, r in results.items() if name.startswith(f"{key}/")}


def _range(values: Floats) -> str:
    return f"{values.min():.2f} to {values.max():.2f}"


PAPER: Final = Paper("lu2016", jobs, work, chapter)
