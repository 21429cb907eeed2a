"""The 249 parametric runs of wan2018 section VI-B: which flights, winds and faults they are.

The runs stand in ``wan2018_runs.jsonl`` beside this module, one a line, in the paper's units; they
were drawn by :func:`draw_runs` with :data:`SEED`. What the paper prints is kept: 140 fault-free
runs, 47, 22, 25 and 15 faulty ones in the categories of its Table I, 60 to 700 s long, airspeeds of
160 to 360 kt, winds of at most 120 kt that change by at most 15 kt/s, the faults of its Table II.

What it does not print is chosen here:

* Sizes and rates are uniform over the ranges of Table II. (Log-uniform ones put nearly half of the
  biases below the paper's thresholds, with which its zero missed detections cannot be. A second
  set of the same 109 flights, "small", has log-uniform ones.)
* All faults of a run begin together. The sensors of a channel break in one way, in half of the runs
  with the same size (a common cause), else each with its own.
* Horizontal winds reach 120 kt above 25,000 ft and 40 kt at the ground. Vertical ones come and go
  and stay below 30 kt, or an eighth of the airspeed: 120 kt of downdraft is 37 degrees of angle of
  attack at 160 kt. No wind change takes more than a fifth of the airspeed at once.
* Manoeuvres stay in the vertical plane, as the paper's model does: levels, climbs and descents,
  load factor doublets, speed changes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from math import exp, pi, radians
from typing import Any, Final

import numpy as np

from sim_feeds import earth
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.faults import KNOT_M_S, Fault, FaultKind
from sim_feeds.flightplan import FlightPlan
from sim_feeds.papers.bundled import text_of
from sim_feeds.papers.wan import LongitudinalExperiment, wan_experiment
from sim_feeds.profile import PEAK_SLOPE
from sim_feeds.wind import FOOT_M, Component, Constant, Dryden, Gust, Ramp, Wind

__all__ = [
    "CATEGORIES",
    "SEED",
    "Run",
    "draw_runs",
    "read_runs",
    "run_experiment",
    "runs_as_text",
]

SEED: Final = 2018
"""Of the committed runs. Thresholds are tuned on runs of other seeds."""
CATEGORIES: Final = {"healthy": 140, "I": 47, "II": 22, "III": 25, "IV": 15}
"""wan2018 VI-B: runs of each category of its Table I."""
RUNS_FILE: Final = "wan2018_runs.jsonl"

WIND_KT: Final = 120.0
WIND_LOW_KT: Final = 40.0
WIND_RATE_KT_S: Final = 15.0
VERTICAL_WIND_KT: Final = 30.0
KINDS: Final = ("oscillation", "jamming", "bias", "runaway", "nrz", "noise")
RANGES: Final[dict[tuple[str, str], tuple[float, float]]] = {
    ("aoa", "size"): (0.5, 25.0),
    ("aoa", "hz"): (0.5, 1.0),
    ("aoa", "rate"): (0.2, 25.0),
    ("aoa", "noise"): (1.0, 2.0),
    ("airspeed", "size"): (10.0, 200.0),
    ("airspeed", "hz"): (0.5, 4.0),
    ("airspeed", "rate"): (0.5, 50.0),
    ("airspeed", "noise"): (10.0, 20.0),
}
"""wan2018 Table II: deg and deg/s for a vane, kt and kt/s for an airspeed, Hz."""
NRZ_SHARE: Final = 0.1
PITCH_OVER_S2_M: Final = 2.4
"""Time that a climb needs to begin and end, per its vertical speed."""
AXES: Final = "xyz"


@dataclass(frozen=True, slots=True)
class Run:
    """One run, in the paper's units.

    Attributes
    ----------
    number
        Its own within the set; also the seed of noise and turbulence, with the set's.
    set
        "main" or "small".
    category
        "healthy", or of wan2018 Table I.
    duration_s, altitude_ft, cas_kt
        Length, and where and how fast it begins.
    weight_kt
        Equivalent airspeed at which the aircraft flies level at 3 degrees.
    manoeuvres
        ``["level", s]``, ``["load", g]``, ``["climb", m/s, s]``, ``["speed", share]``, in turn.
    steady_kt
        Wind (x along the flight, y across, z down) at the beginning.
    changes
        ``["ramp", axis, start s, duration s, change kt]`` or ``["gust", axis, start s, rise s,
        hold s, peak kt]``.
    turbulence_kt
        Standard deviation on each axis.
    faults
        ``{"sensor", "kind", "start_s", "size" deg or kt, "rate" 1/s, "hz"}``.
    """

    number: int
    set: str
    category: str
    duration_s: float
    altitude_ft: float
    cas_kt: float
    weight_kt: float
    manoeuvres: list[list[Any]]
    steady_kt: list[float]
    changes: list[list[Any]]
    turbulence_kt: float
    faults: list[dict[str, Any]]

    @property
    def onset_s(self) -> float:
        """When the faults begin; the end of a healthy run."""
        return min((f["start_s"] for f in self.faults), default=self.duration_s)


def read_runs() -> list[Run]:
    """The committed runs: 249 of the main set, then 109 of the small one."""
    text = text_of(RUNS_FILE)
    return [Run(**json.loads(line)) for line in text.splitlines() if line]


def runs_as_text(runs: Iterable[Run]) -> str:
    """What stands in the file."""
    return "".join(json.dumps(asdict(r)) + "\n" for r in runs)


def draw_runs(seed: int) -> list[Run]:
    """Runs of both sets from one seed."""
    main: list[Run] = []
    for category, count in CATEGORIES.items():
        for _ in range(count):
            rng = np.random.default_rng([seed, len(main)])
            main.append(_draw(rng, len(main), category))
    small = [
        replace(r, set="small", faults=_faults(rng, r.category, r.onset_s, log=True))
        for r in main
        if r.category != "healthy"
        for rng in [np.random.default_rng([seed, r.number, 1])]
    ]
    return main + small


def run_experiment(run: Run, seed: int = SEED) -> LongitudinalExperiment:
    """Fly one run; ``seed`` is that of the draw."""
    height = run.altitude_ft * FOOT_M
    tas = _tas_m_s(run.cas_kt, height)
    airframe = replace(AIRFRAMES["transport"], cruise_m_s=run.weight_kt * KNOT_M_S)
    plan = FlightPlan(airframe, speed_m_s=tas, height_m=height)
    for name, *values in run.manoeuvres:
        match name:
            case "level":
                plan.level(*values)
            case "load":
                plan.load_doublet(*values)
            case "climb":
                plan.climb_at(*values)
            case "speed":
                plan.change_speed(values[0] * tas)
            case _:
                raise ValueError(f"run {run.number}: no manoeuvre is called {name!r}")
    parts: list[Component] = [Constant(np.array(run.steady_kt) * KNOT_M_S)]
    for name, axis, start_s, *values in run.changes:
        unit = np.eye(3)[AXES.index(axis)] * KNOT_M_S
        if name == "ramp":
            parts.append(Ramp(start_s, start_s + values[0], values[1] * unit))
        else:
            parts.append(Gust(start_s, values[0], values[1], values[2] * unit))
    std = run.turbulence_kt * KNOT_M_S
    parts.append(Dryden(fixed_std_m_s=std, fixed_scale_m=530.0))
    faults = [_fault(f) for f in run.faults]
    return wan_experiment(
        faults,
        seed=seed * 1000 + run.number,
        plan=plan,
        wind=Wind(parts),
        duration_s=run.duration_s,
    )


def _fault(f: dict[str, Any]) -> Fault:
    """A line's fault in SI units."""
    kind = FaultKind(f["kind"])
    unit = radians(1.0) if f["sensor"].startswith("aoa") else KNOT_M_S
    size = f["size"] if kind is FaultKind.NRZ else f["size"] * unit
    return Fault(
        f["sensor"], kind, f["start_s"], size=size, rate=f["rate"] * unit, period_s=1.0 / f["hz"]
    )


def _tas_m_s(cas_kt: float, height_m: float) -> float:
    return float(earth.true_airspeed_of_cas(cas_kt * KNOT_M_S, height_m))


def _draw(rng: np.random.Generator, number: int, category: str) -> Run:
    """One run of the main set."""
    altitude = rng.uniform(1000.0, 38000.0)
    slowest = 160.0 + 60.0 * altitude / 38000.0
    cas = rng.uniform(slowest, 360.0)
    while _tas_m_s(cas, altitude * FOOT_M) > 255.0:  # about Mach 0.85 high up
        cas = rng.uniform(slowest, 360.0)
    duration = float(np.round(exp(rng.uniform(np.log(60.0), np.log(700.0))), 1))
    if category != "healthy":
        duration = max(duration, 90.0)
    tas = _tas_m_s(cas, altitude * FOOT_M)
    run = Run(
        number=number,
        set="main",
        category=category,
        duration_s=duration,
        altitude_ft=round(altitude),
        cas_kt=round(cas, 1),
        weight_kt=round(rng.uniform(205.0, 245.0), 1),
        manoeuvres=_manoeuvres(rng, tas, altitude, duration),
        steady_kt=[],
        changes=[],
        turbulence_kt=round(exp(rng.uniform(np.log(0.2), np.log(3.0))), 2),
        faults=[],
    )
    steady, changes = _wind(rng, run, tas)
    onset = round(rng.uniform(25.0, max(0.6 * duration, duration - 120.0)), 2)
    return replace(
        run,
        steady_kt=steady,
        changes=changes,
        faults=_faults(rng, category, onset, log=False),
    )


def _manoeuvres(
    rng: np.random.Generator, tas: float, altitude_ft: float, duration_s: float
) -> list[list[Any]]:
    """A manoeuvre every minute or so, until the flight is over."""
    out: list[list[Any]] = []
    used = 0.0
    slowed = False
    while used < duration_s:
        wait = round(rng.uniform(3.0, 50.0), 1)
        out.append(["level", wait])
        used += wait
        match rng.integers(4):
            case 0:
                load = rng.uniform(0.1, 0.4) * (1.0 if rng.random() < 0.5 else -1.0)
                out.append(["load", round(load, 3)])
                used += 8.0
            case 1 | 2:
                up = -1.0 if altitude_ft > 30000.0 or rng.random() < 0.4 else 1.0
                rate = rng.uniform(0.02, 0.06) * tas
                last = PITCH_OVER_S2_M * rate + rng.uniform(5.0, 35.0)
                if up < 0.0 and altitude_ft * FOOT_M - rate * last < 300.0:
                    up = 1.0
                out.append(["climb", round(up * rate, 2), round(last, 1)])
                altitude_ft += up * rate * last / FOOT_M
                used += last
            case _:
                share = 1.0 if slowed else rng.uniform(0.88, 1.05)
                slowed = not slowed
                out.append(["speed", round(share, 3)])
                used += 0.1 * tas
    return out


def _wind(rng: np.random.Generator, run: Run, tas: float) -> tuple[list[float], list[list[Any]]]:
    """Steady wind and its changes, within what the module's docstring promises."""
    largest = WIND_LOW_KT + (WIND_KT - WIND_LOW_KT) * min(run.altitude_ft / 25000.0, 1.0)
    room = largest - 4.0 * run.turbulence_kt
    swing_kt = 0.2 * tas / KNOT_M_S
    level = rng.uniform(-0.9, 0.9) * room
    steady = [round(level, 1), round(rng.uniform(-0.5, 0.5) * room, 1), 0.0]
    changes: list[list[Any]] = []
    fastest = WIND_RATE_KT_S - run.turbulence_kt
    surge = AIRFRAMES["transport"].surge_s
    at = rng.uniform(5.0, 20.0)
    while at < run.duration_s - 5.0:
        change = rng.uniform(5.0, 60.0) * (1.0 if rng.random() < 0.5 else -1.0)
        if abs(level + change) > room:
            change = -change
        change = float(np.clip(level + change, -room, room)) - level
        peak_rate = exp(rng.uniform(np.log(0.5), np.log(fastest)))
        lasts = PEAK_SLOPE * abs(change) / peak_rate + 0.5
        felt = abs(change) * surge / lasts * (1.0 - exp(-lasts / surge))
        change *= min(1.0, swing_kt / max(felt, 1e-9))
        level += change
        changes.append(["ramp", "x", round(at, 1), round(lasts, 2), round(change, 2)])
        at += lasts + rng.uniform(2.0, 60.0)
    at = rng.uniform(5.0, 40.0)
    highest = min(VERTICAL_WIND_KT, 0.125 * tas / KNOT_M_S) - 4.0 * min(run.turbulence_kt, 2.0)
    while at < run.duration_s - 5.0:
        peak = rng.uniform(0.1, 1.0) * highest * (1.0 if rng.random() < 0.5 else -1.0)
        peak_rate = exp(rng.uniform(np.log(0.5), np.log(fastest)))
        rise = 0.5 * pi * abs(peak) / peak_rate + 0.2
        hold = rng.uniform(0.0, 20.0)
        values = [round(v, 2) for v in (rise, hold, peak)]
        changes.append(["gust", "z", round(at, 1), *values])
        at += 2.0 * rise + hold + rng.uniform(5.0, 90.0)
    across = rng.uniform(-20.0, 20.0)
    lasts = round(PEAK_SLOPE * abs(across) / rng.uniform(1.0, fastest) + 1.0, 2)
    changes.append(["ramp", "y", round(rng.uniform(5.0, 50.0), 1), lasts, round(across, 2)])
    return steady, changes


def _faults(
    rng: np.random.Generator, category: str, onset_s: float, log: bool
) -> list[dict[str, Any]]:
    """Which sensors break, and how."""
    if category == "healthy":
        return []
    n_aoa = 3 if category in ("II", "IV") else int(rng.integers(3))
    n_cas = 3 if category in ("III", "IV") else int(rng.integers(3))
    while n_aoa + n_cas == 0:
        n_aoa, n_cas = int(rng.integers(3)), int(rng.integers(3))
    out = []
    for channel, n in (("aoa", n_aoa), ("airspeed", n_cas)):
        kind = str(rng.choice(KINDS))
        common = rng.random() < 0.5
        first = _one(rng, channel, kind, log)
        for i in sorted(int(i) for i in rng.permutation(3)[:n]):
            own = first if common else _one(rng, channel, kind, log)
            out.append({"sensor": f"{channel}{i}", "kind": kind, "start_s": onset_s, **own})
    return out


def _one(rng: np.random.Generator, channel: str, kind: str, log: bool) -> dict[str, float]:
    """Size, rate and frequency of one fault."""

    def between(what: str) -> float:
        low, high = RANGES[channel, what]
        if log:
            return float(exp(rng.uniform(np.log(low), np.log(high))))
        return float(rng.uniform(low, high))

    sign = 1.0 if rng.random() < 0.5 else -1.0
    size, rate, hz = 0.0, 0.0, 1.0
    match kind:
        case "oscillation":
            size, hz = between("size"), between("hz")
        case "jamming":
            # an airspeed cannot jam below zero
            size = between("size") * (sign if channel == "aoa" else 1.0)
        case "bias":
            size = sign * between("size")
        case "runaway":
            rate = sign * between("rate")
        case "nrz":
            size = sign * NRZ_SHARE
        case _:
            size = between("noise")
    return {"size": round(size, 3), "rate": round(rate, 3), "hz": round(hz, 3)}
