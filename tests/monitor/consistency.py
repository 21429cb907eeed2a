"""How honest the sigmas of the reconstructed air data are, on synthetic flights with known truth.

``python -m tests.monitor.consistency [--seeds N] [--only WORD]`` prints, for every class of
aircraft, set of sensors, wind and quantity: the rms error, the mean sigma, and the share of errors
inside two sigmas. Of Gaussian errors 95.4 % lie inside.

A share alone can be bought with wide sigmas; so the ratio of rms error to rms sigma is shown beside
it, which is 1 for sigmas of the right size.

The truth of the wind is the *mean* wind at the aircraft's height, without turbulence; that of the
others is what the air does to the aircraft at that moment, gusts included.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.mavlink import Decoder
from links.samples import Batch, Rows
from links.vocabulary import State
from monitor.pipeline import Pipeline
from monitor.settings import load as load_settings
from monitor.verdict import Verdict
from monitor.watch.air import AirWatch
from sim_feeds.player import frames_of
from sim_feeds.scenario import Flight, Scenario
from sim_feeds.wind import Route, Wind

Floats = NDArray[np.float64]

QUANTITIES = ("cas", "tas", "aoa", "ssa", "wind_n", "wind_e", "wind_d")
SETTLED_S = 60.0
"""Seconds after take-off from which errors count."""


@dataclass(frozen=True)
class Case:
    """A kind of flight: aircraft, sensors, wind, fault."""

    name: str
    aircraft: str
    pitots: int
    vanes: int
    wind_m_s: float
    rough: float = 1.0
    fault: tuple[dict[str, Any], ...] = ()
    minutes: float = 5.0

    def scenario(self, seed: int) -> Scenario:
        """The flight of one seed: its circuit, wind direction and errors differ."""
        rng = np.random.default_rng([seed, 77])
        speed, agl, bank, straight = _LEGS[self.aircraft]
        legs: list[dict[str, Any]] = []
        total = 0.0
        while total < 60.0 * self.minutes:
            length = straight * rng.uniform(0.6, 1.6)
            angle = float(rng.choice([-1.0, 1.0]) * rng.uniform(60.0, 200.0))
            legs.append({"do": "level", "duration_s": length})
            if rng.random() < 0.25:
                rate = float(rng.choice([-1.0, 1.0]) * 0.05 * speed)
                legs.append({"do": "climb", "rate_m_s": rate, "duration_s": 25.0})
                legs.append({"do": "climb", "rate_m_s": -rate, "duration_s": 25.0})
                total += 50.0
            if rng.random() < 0.25:
                legs.append({"do": "speed", "speed_m_s": float(speed * rng.uniform(0.88, 1.15))})
            legs.append({"do": "turn", "angle_deg": angle, "bank_deg": bank})
            total += length + math.radians(abs(angle)) * speed / (
                9.8 * math.tan(math.radians(bank))
            )
        toward = float(rng.uniform(0.0, 360.0))
        rising = {"kind": "constant", "speed_m_s": 0.0, "toward_deg": 0.0}
        wind: list[dict[str, Any]] = [rising | {"down_m_s": float(0.4 * rng.standard_normal())}]
        if self.wind_m_s > 0.0:
            near = self.rough * self.wind_m_s * (6.1 / 300.0) ** 0.15
            wind += [
                {"kind": "shear", "speed_m_s": self.wind_m_s, "toward_deg": toward},
                {"kind": "dryden", "wind_6m_m_s": near, "high_std_m_s": 0.15 * near},
            ]
        return Scenario.model_validate(
            {
                "title": self.name,
                "aircraft": self.aircraft,
                "seed": seed,
                "start": {"speed_m_s": speed, "agl_m": agl, "heading_deg": 20.0},
                "leg": legs,
                "wind": wind,
                "fault": list(self.fault),
                "imu": {"count": 1},
                "airspeed": {"count": self.pitots, "scale_error": _SCALE_ERROR[self.aircraft]},
                "aoa": {"count": self.vanes, "rate_hz": 20.0},
            }
        )


_LEGS = {
    # airspeed, height, bank, seconds of a straight
    "small-uav": (20.0, 120.0, 30.0, 20.0),
    "light-aircraft": (50.0, 500.0, 25.0, 25.0),
    "transport": (150.0, 1500.0, 25.0, 25.0),
}
_SCALE_ERROR = {"small-uav": 0.05, "light-aircraft": 0.05, "transport": 0.01}
"""Std of a pitot's calibration with its installation [1]."""
SENSORS = (
    ("small-uav", 1, 0),
    ("small-uav", 2, 0),
    ("light-aircraft", 1, 1),
    ("transport", 3, 3),
)
WINDS = (("calm", 0.0, 1.0), ("6 m/s", 6.0, 1.0), ("12 m/s", 12.0, 1.0), ("12 rough", 12.0, 1.8))


def healthy_cases() -> Iterator[Case]:
    """Every class of aircraft in every wind."""
    for aircraft, pitots, vanes in SENSORS:
        for word, wind, rough in WINDS:
            name = f"{aircraft} {pitots}+{vanes} {word}"
            yield Case(name, aircraft, pitots, vanes, wind, rough)


FAULT_S = 150.0
FOUND_S = 30.0
"""From so long after the fault errors count: the slowest of these faults is found by then."""


def faulty_cases() -> Iterator[Case]:
    """Flights on which no trustworthy pitot is left, or one of two; judged from the fault on."""
    dead = {"kind": "dead", "start_s": FAULT_S}
    low = {"kind": "scale", "fraction": -0.25, "start_s": FAULT_S}
    runaway = {"kind": "runaway", "rate_kt_per_s": -15.0, "start_s": FAULT_S}
    first = {"sensor": "airspeed0"}
    every = tuple(runaway | {"sensor": f"airspeed{i}"} for i in range(3))
    yield Case("small-uav 1+0 dead", "small-uav", 1, 0, 6.0, fault=(dead | first,))
    yield Case("small-uav 2+0 low", "small-uav", 2, 0, 12.0, fault=(low | first,))
    yield Case("light-aircraft 1+1 dead", "light-aircraft", 1, 1, 12.0, fault=(dead | first,))
    yield Case("transport 3+3 runaway", "transport", 3, 3, 12.0, fault=every)


@dataclass(frozen=True)
class Result:
    """What one flight showed."""

    flight: Flight
    t_s: Floats
    estimates: Rows
    errors: dict[str, Floats]
    stds: dict[str, Floats]
    verdicts: list[Verdict]

    def after(self, start_s: float, end_s: float = math.inf) -> dict[str, tuple[Floats, Floats]]:
        """Errors and sigmas of a time span, where known."""
        on = (self.t_s >= start_s) & (self.t_s < end_s)
        out = {}
        for q in QUANTITIES:
            e, s = self.errors[q][on], self.stds[q][on]
            known = np.isfinite(e) & np.isfinite(s)
            out[q] = (e[known], s[known])
        return out


def batch_of(flight: Flight) -> Batch:
    """The flight's MAVLink, decoded."""
    decoder = Decoder()
    return Batch.concatenate([decoder.feed(b"".join(f for _, f in frames_of(flight)))])


def mean_wind(flight: Flight) -> Floats:
    """Wind without turbulence along the flight, (n, 3) [m/s, NED]."""
    truth = flight.truth
    steady = Wind([w.component() for w in flight.scenario.wind if w.kind != "dryden"])
    route = Route(truth.t_s, truth.agl_m, truth.tas_m_s, truth.euler_rad[:, 2])
    return steady.velocity(route, np.random.default_rng(0))


def examine(flight: Flight, batch: Batch | None = None) -> Result:
    """Run the air watch over a flight and compare with truth."""
    settings = load_settings(flight.scenario.aircraft)
    pipeline = Pipeline(settings, watches=[AirWatch(settings.air, settings.triplex, settings.vane)])
    steps = [pipeline.feed(batch_of(flight) if batch is None else batch), pipeline.finish()]
    rows = np.concatenate([s.estimates["air"] for s in steps if "air" in s.estimates])
    t = rows["t_us"] * 1e-6 - flight.scenario.start.boot_s
    truth = flight.truth
    wind = mean_wind(flight)
    true = {
        "cas": truth.cas_m_s,
        "tas": truth.tas_m_s,
        "aoa": truth.aoa_rad,
        "ssa": truth.ssa_rad,
        "wind_n": wind[:, 0],
        "wind_e": wind[:, 1],
        "wind_d": wind[:, 2],
    }
    errors, stds = {}, {}
    for q in QUANTITIES:
        if q.startswith("wind"):
            axis = "ned".index(q[-1])
            value, std = rows["wind_ned_m_s"][:, axis], rows["wind_std_ned_m_s"][:, axis]
        else:
            unit = "rad" if q in ("aoa", "ssa") else "m_s"
            value, std = rows[f"{q}_{unit}"], rows[f"{q}_std_{unit}"]
        errors[q] = value - np.interp(t, truth.t_s, true[q])
        stds[q] = std
    verdicts = [v for s in steps for v in s.verdicts]
    return Result(flight, t, rows, errors, stds, verdicts)


@dataclass
class Tally:
    """Errors and sigmas of one quantity, pooled."""

    e2: float = 0.0
    s2: float = 0.0
    inside: int = 0
    n: int = 0

    def add(self, e: Floats, s: Floats) -> None:
        """Count errors ``e`` with sigmas ``s``."""
        self.e2 += float((e * e).sum())
        self.s2 += float((s * s).sum())
        self.inside += int((np.abs(e) <= 2.0 * s).sum())
        self.n += len(e)

    @property
    def share(self) -> float:
        """Share inside two sigmas."""
        return self.inside / self.n if self.n else math.nan

    @property
    def rms(self) -> float:
        """Root mean square error."""
        return math.sqrt(self.e2 / self.n) if self.n else math.nan

    @property
    def sigma(self) -> float:
        """Root mean square sigma."""
        return math.sqrt(self.s2 / self.n) if self.n else math.nan


def line(name: str, tallies: dict[str, Tally]) -> str:
    """One row of the table: share (rms error / rms sigma) per quantity."""
    cells = []
    for q, t in tallies.items():
        k = math.degrees(1.0) if q in ("aoa", "ssa") else 1.0
        cells.append(f"{t.share:5.3f} {k * t.rms:5.2f}/{k * t.sigma:5.2f}")
    return f"{name:28s} " + " | ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    print(f"{'':28s} " + " | ".join(f"{q:>17s}" for q in QUANTITIES))
    pooled = {q: Tally() for q in QUANTITIES}
    for case in (*healthy_cases(), *faulty_cases()):
        if args.only not in case.name:
            continue
        tallies = {q: Tally() for q in QUANTITIES}
        faulty: set[str] = set()
        for seed in range(1, args.seeds + 1):
            result = examine(case.scenario(seed).fly(seed))
            start_s = FAULT_S + FOUND_S if case.fault else SETTLED_S
            for q, (e, s) in result.after(start_s).items():
                tallies[q].add(e, s)
                if not case.fault:
                    pooled[q].add(e, s)
            faulty |= {v.sensor for v in result.verdicts if v.state is State.FAULTY}
        print(
            line(case.name, tallies) + (f" FAULTY {sorted(faulty)}" if faulty else ""), flush=True
        )
    print(line("pooled, healthy", pooled))


if __name__ == "__main__":
    main()
