"""The runs of wan2016: each scenario healthy and faulty, in two forms of the scheme.

"ours" is :class:`estimators.triplex.Triplex` as it is deployed (exact model, ground speed measured,
latch, remembered wind); "as printed" is the paper's own scheme: its simplified model without a
ground speed measurement, and the fault logic word for word; "in flight" is the watch of the
monitor (:mod:`.deployed`).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import APPROXIMATE
from estimators.air_data_mhe import AirDataTuning
from estimators.triplex import Triplex, TriplexRecord, TriplexTuning
from monitor.commands.reproduce.study import Job, Result, Scope
from monitor.commands.reproduce.wan2016.deployed import DeployedRecord, run_deployed
from sim_feeds.faults import KNOT_M_S
from sim_feeds.papers.wan import LongitudinalExperiment
from sim_feeds.papers.wan2016 import table1

__all__ = ["ALL_FORMS", "FORMS", "ONSETS_S", "SCALES", "jobs", "work"]

Floats = NDArray[np.float64]

PAPER: Final = "wan2016"
FORMS: Final = ("ours", "as printed")
ALL_FORMS: Final = (*FORMS, "in flight")
SHOWN: Final = ("3", "7")
"""Scenarios whose course the paper draws (its Figs. 2 and 3)."""
SCALES: Final = (0.4, 1.0, 2.0, 4.0, 10.0)
"""Runaway of scenario 6 as multiples of the file's rate."""
ONSETS_S: Final = tuple(float(t) for t in range(12, 42, 4))
"""Onsets tried in scenarios 6 and 7: before, during and after the ramp of the wind."""
_NO_GROUND_SPEED_STD: Final = 1e6
_FIRST_S: Final = 1.0
"""The estimate may settle for so long before its errors count."""


def jobs(scope: Scope) -> list[Job]:
    """One job for each scenario, and two that vary it."""
    names = [row.name for row in table1().scenario]
    seeds = 2 if scope.quick else 10
    out = [
        Job(PAPER, f"scenario/{name}", {"do": "scenario", "name": name, "seeds": seeds}, scope.seed)
        for name in names
    ]
    tries, step = (1, 3) if scope.quick else (4, 1)
    sweeps = [("6", "scale", SCALES), ("6", "onset_s", ONSETS_S), ("7", "onset_s", ONSETS_S)]
    for name, varied, values in sweeps:
        what = {"do": varied, "name": name, "seeds": tries, "values": list(values[::step])}
        key = "rate" if varied == "scale" else "onset"
        out.append(Job(PAPER, f"{key}/{name}", what, scope.seed))
    return out


def work(job: Job) -> Result:
    """Do one of the jobs of :func:`jobs`."""
    name, seeds = job.what["name"], range(100 * job.seed, 100 * job.seed + job.what["seeds"])
    if job.what["do"] == "scenario":
        return _scenario(name, seeds)
    normal = table1().onset_s
    values = job.what["values"]
    tried = [(v, normal) if job.what["do"] == "scale" else (1.0, v) for v in values]
    per_value: dict[str, list[Result]] = {form: [] for form in FORMS}
    for scale, onset in tried:
        flights = [table1().experiment(name, s, scale=scale, onset_s=onset) for s in seeds]
        for form in FORMS:
            per_value[form].append(_joined([_judge(f, _run(form, f), onset) for f in flights]))
    out: Result = {form: _joined(per_value[form]) for form in FORMS}
    out["values"] = values
    return out


def _scenario(name: str, seeds: range) -> Result:
    table, out = table1(), Result()
    kinds: dict[str, dict[str, Any]] = {
        "H": {"faulty": False},
        "F": {},
        "steady": {"without": ["ramp"]},
    }
    for key, options in kinds.items():
        runs: dict[str, list[Result]] = {form: [] for form in ALL_FORMS}
        for seed in seeds:
            flight = table.experiment(name, seed, **options)
            for form in ALL_FORMS:
                record = _run(form, flight, seed)
                runs[form].append(_judge(flight, record, table.onset_s))
                if key == "F" and name in SHOWN and form == "ours" and seed == seeds[0]:
                    out["course"] = _course(flight, record)
        out[key] = {form: _joined(runs[form]) for form in ALL_FORMS}
    few = seeds[:4]
    quiet = [table.experiment(name, s, faulty=False, noise="quiet") for s in few]
    out["quiet"] = _joined([_healthy(flight) for flight in quiet])
    smooth = [
        table.experiment(name, s, faulty=False, noise="quiet", without=["dryden"]) for s in few
    ]
    out["smooth"] = _joined([_healthy(flight) for flight in smooth])
    return out


def _healthy(flight: LongitudinalExperiment) -> Result:
    return _judge(flight, _run("ours", flight), np.inf)


def _run(form: str, flight: LongitudinalExperiment, seed: int = 0) -> Any:
    """A record with ``alpha``, ``cas`` and ``faulty``."""
    if form == "in flight":
        return run_deployed(flight, seed)
    x0, theta = flight.x[0], flight.theta
    inertial = np.column_stack([theta[:, 0], flight.v_z_m_s])
    if form == "ours":
        triplex = Triplex.start(x0, theta[0])
    else:
        R_std = (_NO_GROUND_SPEED_STD, *AirDataTuning().R_std[1:])
        weights = AirDataTuning(model=APPROXIMATE, R_std=R_std)
        triplex = Triplex.start(x0, theta[0], weights, TriplexTuning.as_printed())
    return triplex.run(inertial, flight.aoa_rad, flight.cas_m_s, theta)


def _judge(
    flight: LongitudinalExperiment, record: TriplexRecord | DeployedRecord, onset_s: float
) -> Result:
    """Errors, and for each of six sensors when it was flagged, and what became of it."""
    t = flight.t_s
    counts = t >= _FIRST_S
    aoa = np.degrees(np.abs(record.alpha - flight.x[:, 0]))[counts]
    cas = np.abs(record.cas - flight.cas_true_m_s)[counts] / KNOT_M_S
    flagged = record.faulty.reshape(-1, 6)
    broken = flight.faulty.any(axis=0)
    found = flagged.any(axis=0)
    first_s = np.where(found, t[flagged.argmax(axis=0)], np.nan)
    dropped = (np.diff(flagged.astype(int), axis=0) < 0).any(axis=0)
    return {
        "errors": np.array([f(e) for e in (aoa, cas) for f in (np.nanmax, np.nanmean)]),
        "delay_s": np.where(broken, first_s - onset_s, np.nan),
        "blamed": found & ~broken,
        "blamed_at_s": np.where(found & ~broken, first_s - onset_s, np.nan),
        "released": dropped & broken,
        "broken": broken,
        "size": _sizes(flight, onset_s),
    }


def _sizes(flight: LongitudinalExperiment, onset_s: float) -> Floats:
    """How far each sensor is off after the onset, mean of three samples, (6,) [deg, kt]."""
    at = int(np.searchsorted(flight.t_s, min(onset_s, flight.t_s[-4])))
    three = slice(at, at + 3)
    vanes = np.degrees(flight.aoa_rad - flight.x[:, :1])[three].mean(axis=0)
    pitots = (flight.cas_m_s - flight.cas_true_m_s[:, None])[three].mean(axis=0) / KNOT_M_S
    sizes: Floats = np.abs(np.concatenate([vanes, pitots]))
    return sizes


def _joined(runs: list[Result]) -> Result:
    """Each entry of all runs, stacked along a new first axis."""
    return {key: np.stack([run[key] for run in runs]) for key in runs[0]}


def _course(flight: LongitudinalExperiment, record: TriplexRecord) -> Result:
    """What Figs. 2 and 3 of the paper draw."""
    return {
        "t_s": flight.t_s,
        "aoa_deg": np.degrees(flight.aoa_rad),
        "cas_kt": flight.cas_m_s / KNOT_M_S,
        "aoa_true_deg": np.degrees(flight.x[:, 0]),
        "cas_true_kt": flight.cas_true_m_s / KNOT_M_S,
        "aoa_hat_deg": np.degrees(record.alpha),
        "cas_hat_kt": record.cas / KNOT_M_S,
        "wind_kt": flight.x[:, 2:] / KNOT_M_S,
        "wind_hat_kt": record.x[:, 2:] / KNOT_M_S,
        "faulty": record.faulty.reshape(-1, 6),
    }
