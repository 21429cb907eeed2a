"""The flights of samar2006: which are flown, with which damage, and what each is for.

``samar2006.toml`` beside this file lists them. Flying one takes JSBSim (extra ``sim``).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np

from sim_feeds.papers.bundled import text_of
from sim_feeds.sixdof import SixDofFlight, WingFault, fly_aerosonde

__all__ = ["Case", "Plan", "fly", "plan", "wrong_numbers"]

WIND_STREAM = 17
MODEL_STREAM = 19


@dataclass(frozen=True, slots=True)
class Case:
    """Damage that a flight suffers.

    Attributes
    ----------
    name, what
        Key, and the words for tables.
    faults
    """

    name: str
    what: str
    faults: tuple[WingFault, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """The scenario file.

    Attributes
    ----------
    duration_s
        Of each flight.
    wind_share
        Least and largest wind, as a share of the airspeed.
    seeds
        Purpose -> seeds of its flights: "covariance", "alarm", "healthy", "faulty".
    wrong_share
        By how much the coefficients of a wrong model are off.
    models
        Purpose -> seeds of wrong models: "alarm", "reported".
    cases
        By name.
    """

    duration_s: float
    wind_share: tuple[float, float]
    seeds: Mapping[str, tuple[int, ...]]
    wrong_share: float
    models: Mapping[str, tuple[int, ...]]
    cases: Mapping[str, Case]


@cache
def plan() -> Plan:
    """The scenario file of this package."""
    table: dict[str, Any] = tomllib.loads(text_of("samar2006.toml"))
    cases = [
        Case(one["name"], one["what"], tuple(WingFault(**fault) for fault in one["faults"]))
        for one in table["case"]
    ]
    low, high = table["wind_share"]
    models = dict(table["models"])
    share = float(models.pop("wrong_share"))
    return Plan(
        duration_s=table["duration_s"],
        wind_share=(low, high),
        seeds={purpose: tuple(seeds) for purpose, seeds in table["seeds"].items()},
        wrong_share=share,
        models={purpose: tuple(seeds) for purpose, seeds in models.items()},
        cases={case.name: case for case in cases},
    )


@lru_cache(maxsize=20)
def fly(seed: int, case: str | None = None) -> SixDofFlight:
    """One flight of the plan; the last twenty are remembered.

    Parameters
    ----------
    seed
        Of wind and turbulence.
    case
        Name of the damage; None flies healthy.

    Raises
    ------
    sim_feeds.sixdof.EngineMissing
        JSBSim is not installed: show the message.
    """
    chosen = plan()
    share = np.random.default_rng([seed, WIND_STREAM]).uniform(*chosen.wind_share)
    faults = chosen.cases[case].faults if case else ()
    return fly_aerosonde(faults, seed=seed, wind_share=float(share), duration_s=chosen.duration_s)


def wrong_numbers(
    numbers: Mapping[str, float], coefficients: tuple[str, ...], seed: int | None
) -> dict[str, float]:
    """An airframe's numbers with the coefficients off by the plan's share; None changes nothing."""
    out = dict(numbers)
    if seed is not None:
        signs = np.random.default_rng([seed, MODEL_STREAM]).choice([-1.0, 1.0], len(coefficients))
        for name, sign in zip(coefficients, signs, strict=True):
            out[name] = numbers[name] * (1.0 + sign * plan().wrong_share)
    return out
