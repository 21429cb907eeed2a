"""Flights to break sensors in: synthetic ones of three airframe classes, and recorded ones.

A flight is decoded once to a :class:`~links.samples.Batch` and kept as a file, so that every
process reads it back within milliseconds. The synthetic flights differ in route, heading, wind and
turbulence; each is determined by the class, the seed and its number.
"""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from math import radians, tan
from pathlib import Path
from typing import Any, Final

import numpy as np

from links.logs import LogError, open_log
from links.mavlink import Decoder
from links.samples import Batch, Rows
from links.vocabulary import Rejection
from monitor.commands.common import Refused
from monitor.commands.processes import Step
from monitor.settings import Settings
from sim_feeds.earth import STANDARD_GRAVITY_M_S2
from sim_feeds.player import frames_of
from sim_feeds.scenario import Flight as FlownScenario
from sim_feeds.scenario import Scenario, load

__all__ = [
    "CLASSES",
    "Flight",
    "Order",
    "fly",
    "instruments",
    "plan",
    "recorded",
    "restore",
    "store",
    "synthetic",
]


@dataclass(frozen=True, slots=True)
class Flight:
    """Samples of one flight.

    Attributes
    ----------
    name
        File name, or class and number; says the wind of a synthetic one.
    batch
        All rows.
    first_us
        Vehicle time of the first record [us].
    """

    name: str
    batch: Batch
    first_us: int

    @property
    def last_us(self) -> int:
        """Vehicle time of the last row [us]."""
        return max(int(rows["t_us"].max()) for rows in self.batch.rows.values() if len(rows))

    @property
    def duration_s(self) -> float:
        """From the first record to the last row [s]."""
        return (self.last_us - self.first_us) / 1e6

    def count(self, quantity: str) -> int:
        """How many instruments of a quantity say something (never all zero)."""
        return sum(
            sensor.rstrip("0123456789") == quantity and _says_something(rows)
            for sensor, rows in self.batch.rows.items()
        )


@dataclass(frozen=True, slots=True)
class AirClass:
    """How an airframe class is flown.

    Attributes
    ----------
    base
        Scenario that gives the instruments and the autopilot.
    wind_m_s, wind_6m_m_s
        Upper ends of the mean wind aloft, and of the wind at 20 ft that drives the turbulence.
    bank_deg, level_s
        Ranges of the bank of turns and of the time of straight legs.
    climb_m_s, climb_s, cruise_m_s
        Climb after take-off; range of the airspeeds.
    load_g
        Largest pull of a load doublet.
    descent_s
        Of the landing.
    pitots, vanes
        Carried.
    own_attitude
        Whether the attitude comes from references with gyros of their own.
    """

    base: str
    wind_m_s: float
    wind_6m_m_s: float
    bank_deg: tuple[float, float]
    level_s: tuple[float, float]
    climb_m_s: float
    climb_s: float
    cruise_m_s: tuple[float, float]
    load_g: float
    descent_s: float
    pitots: int
    vanes: int
    own_attitude: bool = False


CLASSES: Final = {
    "small-uav": AirClass(
        "small-uav-healthy",
        wind_m_s=12.0,
        wind_6m_m_s=8.0,
        bank_deg=(20.0, 40.0),
        level_s=(8.0, 40.0),
        climb_m_s=2.5,
        climb_s=25.0,
        cruise_m_s=(17.0, 23.0),
        load_g=0.3,
        descent_s=60.0,
        pitots=2,
        vanes=0,
    ),
    "light-aircraft": AirClass(
        "light-aircraft-vane",
        wind_m_s=15.0,
        wind_6m_m_s=8.0,
        bank_deg=(15.0, 30.0),
        level_s=(15.0, 50.0),
        climb_m_s=4.0,
        climb_s=40.0,
        cruise_m_s=(42.0, 55.0),
        load_g=0.4,
        descent_s=60.0,
        pitots=2,
        vanes=0,
    ),
    "transport": AirClass(
        "transport-healthy",
        wind_m_s=25.0,
        wind_6m_m_s=8.0,
        bank_deg=(15.0, 28.0),
        level_s=(15.0, 50.0),
        climb_m_s=9.0,
        climb_s=60.0,
        cruise_m_s=(105.0, 130.0),
        load_g=0.3,
        descent_s=90.0,
        pitots=3,
        vanes=3,
        own_attitude=True,
    ),
}
"""Airframe class -> how it is flown here; the class is also the profile that it is judged with."""

GOLDEN: Final = 0.6180339887498949

_FIXED: Final = ("title", "aircraft", "imu", "airspeed", "baro", "gps", "autopilot", "aoa")
"""Sections of the base scenario that are kept."""


def plan(name: str, seed: int, number: int, minutes: float) -> Scenario:
    """A healthy flight of a class: random route and heading, some wind and turbulence; it lands.

    Parameters
    ----------
    name
        Key of :data:`CLASSES`.
    seed, number
        Determine every bit.
    minutes
        Time of the legs between take-off and landing.
    """
    how = CLASSES[name]
    which = list(CLASSES).index(name)
    rng = np.random.default_rng([seed, which, number])
    # The golden ratio spreads any number of flights evenly over the winds, from another start per
    # seed.
    calm = float(np.random.default_rng([seed, which]).random())
    windy = (calm + number * GOLDEN) % 1.0

    def override(table: dict[str, Any]) -> None:
        for key in [key for key in table if key not in _FIXED]:
            del table[key]
        wind = windy * how.wind_m_s
        table["title"] = f"{name} {number + 1}, wind {wind:.0f} m/s"
        table["start"] = {"heading_deg": round(float(rng.uniform(0.0, 360.0)), 1)}
        table["seed"] = int(rng.integers(2**31))
        table["airspeed"]["count"] = how.pitots
        table.setdefault("aoa", {})["count"] = how.vanes
        table["leg"] = _route(how, rng, 60.0 * minutes)
        table["wind"] = [
            {
                "kind": "shear",
                "speed_m_s": round(wind, 2),
                "toward_deg": round(float(rng.uniform(0.0, 360.0)), 1),
                "reference_m": 100.0 if how.wind_m_s <= 12.0 else 300.0,
            },
            # A stronger wind is as a rule a rougher one (MIL-F-8785C scales turbulence with it).
            {
                "kind": "dryden",
                "wind_6m_m_s": round(windy * how.wind_6m_m_s, 2),
            },
        ]

    return load(how.base, override)


def _route(how: AirClass, rng: np.random.Generator, seconds: float) -> list[dict[str, Any]]:
    """Wait, take off, climb, fly legs and turns for a time, land."""

    def between(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 1)

    speed = between(*how.cruise_m_s)
    legs: list[dict[str, Any]] = [
        {"do": "wait", "duration_s": 10.0},
        {"do": "take-off"},
        {"do": "climb", "rate_m_s": how.climb_m_s, "duration_s": how.climb_s},
        {"do": "speed", "speed_m_s": speed},
    ]
    left_s = seconds - how.climb_s
    up = 0
    while left_s > 0.0:
        angle, bank = between(60.0, 200.0), between(*how.bank_deg)
        level_s = between(*how.level_s)
        sense = 1 if rng.random() < 0.5 else -1
        legs.append({"do": "turn", "angle_deg": sense * angle, "bank_deg": bank})
        legs.append({"do": "level", "duration_s": level_s})
        left_s -= level_s + radians(angle) * speed / (STANDARD_GRAVITY_M_S2 * tan(radians(bank)))
        draw = rng.random()
        if draw < 0.2:
            speed = between(*how.cruise_m_s)
            legs.append({"do": "speed", "speed_m_s": speed})
        elif draw < 0.4:
            sense = -1 if up > 0 else 1
            up += sense
            legs.append(
                {"do": "climb", "rate_m_s": 0.5 * sense * how.climb_m_s, "duration_s": 30.0}
            )
            left_s -= 30.0
        elif draw < 0.5:
            legs.append({"do": "load-doublet", "load_g": between(0.5 * how.load_g, how.load_g)})
    return [*legs, {"do": "land", "descent_s": how.descent_s}, {"do": "wait", "duration_s": 10.0}]


def synthetic(scenario: Scenario, settings: Settings) -> Flight:
    """The scenario flown, sent as MAVLink and decoded again."""
    flown: FlownScenario = scenario.fly()
    decoder = Decoder(settings.links.decoder_options())
    stream = b"".join(frame for _, frame in frames_of(flown))
    batch = Batch.concatenate([decoder.feed(stream), decoder.finish()])
    return Flight(scenario.title, batch, round(scenario.start.boot_s * 1e6))


@dataclass(frozen=True, slots=True)
class Order:
    """A synthetic flight to be flown to a file; the fields are those of :func:`plan`."""

    name: str
    seed: int
    number: int
    minutes: float
    settings: Settings
    file: Path


def fly(order: Order, step: Step) -> None:
    """Fly and store."""
    planned = plan(order.name, order.seed, order.number, order.minutes)
    store(synthetic(planned, order.settings), order.file)
    step()


def recorded(path: Path, settings: Settings) -> Flight:
    """A log, decoded.

    Raises
    ------
    Refused
        It cannot be read as a log, or nothing in it is of use.
    """
    try:
        log = open_log(path, settings.links.decoder_options())
        batch = Batch.concatenate(log)
    except LogError as error:
        raise Refused(str(error)) from None
    if not any(s.startswith(("imu", "airspeed")) for s in batch.rows):
        raise Refused(f"{path} holds no sample of an IMU or a pitot")
    return Flight(path.name, batch, log.info.first_t_us)


def store(flight: Flight, file: Path) -> None:
    """Keep a flight as a file."""
    rejected: Counter[tuple[str, Rejection]] = flight.batch.rejected
    file.write_bytes(
        pickle.dumps((flight.name, dict(flight.batch.rows), rejected, flight.first_us))
    )


def restore(file: Path) -> Flight:
    """The flight of a file that :func:`store` wrote."""
    name, rows, rejected, first_us = pickle.loads(file.read_bytes())
    return Flight(name, Batch(rows, rejected), first_us)


def _says_something(rows: Rows) -> bool:
    names = [n for n in rows.dtype.names or () if n not in ("seq", "t_us")]
    return any(bool(np.any(rows[n] != 0)) for n in names)


def instruments(flights: Iterable[Flight]) -> tuple[int, int, int]:
    """Pitots, IMUs and vanes that every one of the flights has."""
    each = [(f.count("airspeed"), f.count("imu"), f.count("aoa")) for f in flights]
    pitots, imus, vanes = (min(counts) for counts in zip(*each, strict=True))
    return pitots, imus, vanes
