"""A flight as a file: aircraft, manoeuvres, wind, instruments, faults; validated, bit-reproducible.

``load("demo")`` finds a bundled scenario, ``load("my/flight.toml")`` a file. A scenario with a seed
determines every bit of the flight, of the sensor readings and of the frames.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from math import radians
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, ValidationError, model_validator

from links.vocabulary import GYRO_ACC_AXES
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.autopilot import Autopilot, Navigation
from sim_feeds.faults import KNOT_M_S, PLUMBING, Fault, FaultKind
from sim_feeds.flightplan import FlightPlan
from sim_feeds.legs import Leg, WindPart
from sim_feeds.section import Strict
from sim_feeds.sensors import GPS_AXES, Airspeed, Aoa, Baro, Gps, Imu, Series
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Wind

__all__ = ["FaultEntry", "Flight", "Scenario", "ScenarioError", "bundled", "load"]

BUNDLE: Final = "scenarios"


class ScenarioError(ValueError):
    """A scenario cannot be used; the message says where and why, in one line per problem."""


_UNITS: Final[dict[str, dict[str, float]]] = {
    "acc": {"m_s2": 1.0},
    "gyro": {"rad_s": 1.0, "deg_s": radians(1.0)},
    "airspeed": {"m_s": 1.0, "kt": KNOT_M_S},
    "aoa": {"rad": 1.0, "deg": radians(1.0)},
    "baro": {"pa": 1.0},
    "gps": {"m_s": 1.0},
}
"""Quantity of a sensor -> units in which a fault's size may be written, as factors to SI."""

_NEEDS: Final = {
    FaultKind.BIAS: "size",
    FaultKind.OSCILLATION: "size",
    FaultKind.NOISE: "size",
    FaultKind.JAMMING: "size",
    FaultKind.DRIFT: "rate",
    FaultKind.RUNAWAY: "rate",
    FaultKind.SCALE: "fraction",
    FaultKind.NRZ: "fraction",
    FaultKind.ICING: "fraction_per_s",
}


class FaultEntry(Strict):
    """One fault: ``size_<unit>`` or ``rate_<unit>_per_s`` in a unit that fits the sensor.

    bias, oscillation, noise and jamming need a size; drift and runaway a rate; scale and nrz a
    ``fraction``; icing a ``fraction_per_s``.
    """

    sensor: str
    kind: FaultKind
    start_s: float = Field(ge=0.0)
    end_s: float | None = Field(None, gt=0.0)
    size_m_s2: float | None = None
    size_rad_s: float | None = None
    size_deg_s: float | None = None
    size_m_s: float | None = None
    size_kt: float | None = None
    size_rad: float | None = None
    size_deg: float | None = None
    size_pa: float | None = None
    rate_m_s2_per_s: float | None = None
    rate_rad_s_per_s: float | None = None
    rate_deg_s_per_s: float | None = None
    rate_m_s_per_s: float | None = None
    rate_kt_per_s: float | None = None
    rate_rad_per_s: float | None = None
    rate_deg_per_s: float | None = None
    rate_pa_per_s: float | None = None
    limit_m_s2: float | None = Field(None, gt=0.0)
    limit_deg_s: float | None = Field(None, gt=0.0)
    limit_m_s: float | None = Field(None, gt=0.0)
    limit_kt: float | None = Field(None, gt=0.0)
    limit_deg: float | None = Field(None, gt=0.0)
    fraction: float | None = Field(None, description="Of the reading: -0.2 reads 20 % low.")
    fraction_per_s: float | None = Field(None, gt=0.0)
    period_s: float = Field(2.0, gt=0.0)
    drain_s: float = Field(1.5, gt=0.0)

    @property
    def quantity(self) -> str:
        """Key of the units that its size may have; empty for a whole instrument."""
        base, _, axis = self.sensor.partition(".")
        if axis in GYRO_ACC_AXES and re.fullmatch(r"imu[0-3]", base):
            return axis.split("_")[0]
        if axis in GPS_AXES and re.fullmatch(r"gps[01]", base):
            return "gps"
        if not axis and re.fullmatch(r"(airspeed|aoa|baro)[0-2]", base):
            return base[:-1]
        if not axis and re.fullmatch(r"imu[0-3]|gps[01]", base):
            return ""
        raise ValueError(
            f"{self.sensor!r} is no sensor: imu0.acc_x ... imu3.gyro_z, airspeed0..2, aoa0..2, "
            "baro0..2, gps0.vel_n, or for a dropout imu0, gps0"
        )

    @model_validator(mode="after")
    def _fits(self) -> FaultEntry:
        quantity = self.quantity
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s {self.end_s:g} is not after start_s {self.start_s:g}")
        if not quantity and self.kind not in (FaultKind.DROPOUT, FaultKind.OUTAGE):
            raise ValueError(f"{self.sensor} as a whole can only drop out; name one of its axes")
        if self.kind is FaultKind.OUTAGE and not re.fullmatch(r"gps[01]", self.sensor):
            raise ValueError("an outage is a fault of gps0 or gps1")
        if self.kind in PLUMBING and quantity != "airspeed":
            raise ValueError(f"{self.kind} is a fault of an airspeed sensor's tubes")
        fitting = _UNITS.get(quantity, {})
        for key in sorted(self.model_fields_set):
            unit = re.fullmatch(r"(?:size|limit)_(\w+)|rate_(\w+)_per_s", key)
            if unit and (unit[1] or unit[2]) not in fitting:
                raise ValueError(
                    f"{key} does not fit {self.sensor}: its units are {_listed(fitting)}"
                )
        need = _NEEDS.get(self.kind)
        if need in ("fraction", "fraction_per_s") and getattr(self, need) is None:
            raise ValueError(f"{self.kind} needs {need}")
        if need in ("size", "rate") and self._in_si(need) is None:
            end = "_per_s" if need == "rate" else ""
            keys = " or ".join(f"{need}_{unit}{end}" for unit in _UNITS[quantity])
            raise ValueError(f"{self.kind} of {self.sensor} needs {keys}")
        return self

    def _in_si(self, what: str) -> float | None:
        end = "_per_s" if what == "rate" else ""
        for unit, factor in _UNITS.get(self.quantity, {}).items():
            value = getattr(self, f"{what}_{unit}{end}", None)
            if value is not None:
                return float(value) * factor
        return None

    def fault(self) -> Fault:
        """The fault model, in SI."""
        return Fault(
            sensor=self.sensor,
            kind=self.kind,
            start_s=self.start_s,
            end_s=self.end_s,
            size=self.fraction if self.fraction is not None else self._in_si("size") or 0.0,
            rate=self.fraction_per_s or self._in_si("rate") or 0.0,
            limit=self._in_si("limit") or float("inf"),
            period_s=self.period_s,
            drain_s=self.drain_s,
        )


class Start(Strict):
    """Where and how the flight begins."""

    speed_m_s: float = Field(0.0, ge=0.0, description="True airspeed; 0 is on the ground.")
    agl_m: float = Field(0.0, ge=0.0, description="Height above the field.")
    heading_deg: float = 0.0
    lat_deg: float = Field(52.0, gt=-80.0, lt=80.0)
    lon_deg: float = Field(4.4, ge=-180.0, le=180.0)
    field_m: float = Field(50.0, ge=-400.0, le=4000.0, description="Height of the field.")
    temperature_offset_k: float = 0.0
    boot_s: float = Field(20.0, ge=0.0, description="Vehicle time of the flight's first moment.")


class Messages(Strict):
    """Which messages the autopilot sends, and how often."""

    imu: Literal["raw", "highres"] = Field(
        "raw",
        description="RAW_IMU with SCALED_IMU2/3 in whole milli-g and mrad/s, or HIGHRES_IMU(id).",
    )
    airspeed: Literal["pressure", "airspeed"] = Field(
        "pressure", description="SCALED_PRESSURE only, or AIRSPEED(id) beside it."
    )
    attitude_hz: float = Field(25.0, gt=0.0, le=200.0, description="ATTITUDE.")
    quaternion_hz: float = Field(10.0, ge=0.0, le=200.0, description="ATTITUDE_QUATERNION.")
    position_hz: float = Field(10.0, gt=0.0, le=50.0, description="GLOBAL_POSITION_INT.")
    hud_hz: float = Field(4.0, ge=0.0, le=50.0, description="VFR_HUD.")
    servo_hz: float = Field(5.0, ge=0.0, le=50.0, description="SERVO_OUTPUT_RAW.")
    rpm_hz: float = Field(4.0, ge=0.0, le=50.0, description="RPM.")
    status_hz: float = Field(2.0, gt=0.0, le=10.0, description="SYS_STATUS, EXTENDED_SYS_STATE.")
    system_id: int = Field(1, ge=1, le=250)
    arm_s: float = Field(2.0, ge=0.0, description="When the motors are armed.")


class Scenario(Strict):
    """A flight that can be flown: see the module."""

    title: str
    aircraft: Literal["transport", "light-aircraft", "small-uav"]
    seed: int = Field(0, ge=0, description="Used unless the caller gives another.")
    truth_hz: float = Field(200.0, ge=50.0, le=1000.0, description="Grid of the truth.")
    start: Start = Start()
    leg: tuple[Leg, ...]
    wind: tuple[WindPart, ...] = ()
    imu: Imu = Imu()
    airspeed: Airspeed = Airspeed()
    aoa: Aoa = Aoa()
    baro: Baro = Baro()
    gps: Gps = Gps()
    autopilot: Autopilot = Autopilot()
    messages: Messages = Messages()
    fault: tuple[FaultEntry, ...] = ()

    @model_validator(mode="after")
    def _instruments_exist(self) -> Scenario:
        if not self.leg:
            raise ValueError("a flight needs at least one leg")
        if self.messages.imu == "raw" and self.imu.count > 3:
            raise ValueError("a fourth IMU needs messages.imu = 'highres'")
        for f in self.fault:
            base = f.sensor.split(".")[0]
            count = getattr(self, base[:-1]).count
            if int(base[-1]) >= count:
                raise ValueError(
                    f"fault on {f.sensor}, but the aircraft has {count} {base[:-1]} sensor(s)"
                )
        follows = self.autopilot.attitude_follows_imu
        if follows is not None and follows >= self.imu.count:
            raise ValueError(f"attitude_follows_imu = {follows}, but imu.count = {self.imu.count}")
        end_s = self.plan().time_s
        for f in self.fault:
            if f.start_s >= end_s:
                raise ValueError(
                    f"fault on {f.sensor} begins at {f.start_s:g} s, but the flight of this "
                    f"{self.aircraft} ends at {end_s:.0f} s"
                )
        return self

    def plan(self) -> FlightPlan:
        """The manoeuvres as profiles."""
        s = self.start
        plan = FlightPlan(
            AIRFRAMES[self.aircraft], s.speed_m_s, s.field_m + s.agl_m, radians(s.heading_deg)
        )
        for leg in self.leg:
            leg.fly(plan)
        return plan

    @property
    def duration_s(self) -> float:
        """Length of the flight."""
        return self.plan().time_s

    def faults(self) -> list[Fault]:
        """The faults, in SI."""
        return [f.fault() for f in self.fault]

    def fly(self, seed: int | None = None) -> Flight:
        """Truth and all readings; the same seed gives the same bits."""
        seed = self.seed if seed is None else seed
        s = self.start
        truth = fly(
            self.plan(),
            Wind([w.component() for w in self.wind]),
            seed=seed,
            rate_hz=self.truth_hz,
            lat_rad=radians(s.lat_deg),
            lon_rad=radians(s.lon_deg),
            field_m=s.field_m,
            temperature_offset_k=s.temperature_offset_k,
        )
        faults = self.faults()
        readings: dict[str, Series] = {}
        for kind in ("imu", "airspeed", "aoa", "baro", "gps"):
            instrument = getattr(self, kind)
            for i in range(instrument.count):
                readings[f"{kind}{i}"] = instrument.sample(truth, i, faults, seed)
        follows = self.autopilot.attitude_follows_imu
        source = None if follows is None else readings[f"imu{follows}"]
        rate = max(self.messages.attitude_hz, self.messages.quaternion_hz)
        navigation = self.autopilot.estimate(truth, source, seed, rate)
        return Flight(self, seed, truth, faults, readings, navigation)


@dataclass(frozen=True, slots=True)
class Flight:
    """A scenario flown with one seed: truth, readings per sensor, the autopilot's solution."""

    scenario: Scenario
    seed: int
    truth: Truth
    faults: list[Fault]
    readings: dict[str, Series]
    navigation: Navigation


def _listed(units: dict[str, float]) -> str:
    return ", ".join(units) or "none"


def bundled() -> list[str]:
    """Names of the scenarios that come along."""
    folder = resources.files("sim_feeds") / BUNDLE
    return sorted(
        p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")
    )


def load(
    name_or_path: str | Path, override: Callable[[dict[str, Any]], None] | None = None
) -> Scenario:
    """Read and validate a scenario.

    Parameters
    ----------
    name_or_path
        Name of a bundled scenario, or a TOML file.
    override
        Changes the parsed table in place before validation.

    Raises
    ------
    ScenarioError
        When there is none of that name, the file is no TOML, or a value does not fit.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml" or path.is_file():
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise ScenarioError(f"cannot read {path}: {error.strerror}") from error
    else:
        text = _bundled_text(str(name_or_path))
    return parse(text, str(name_or_path), override)


def _bundled_text(name: str) -> str:
    names = bundled()
    if name not in names:
        near = difflib.get_close_matches(name, names, 1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(names)}"
        raise ScenarioError(f"no bundled scenario is called {name!r}{hint}")
    return (resources.files("sim_feeds") / BUNDLE / f"{name}.toml").read_text(encoding="utf-8")


def parse(
    text: str, where: str = "scenario", override: Callable[[dict[str, Any]], None] | None = None
) -> Scenario:
    """Validate the text of a scenario; errors begin with ``where``."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{where} is no TOML: {error}") from error
    if override:
        override(table)
    try:
        return Scenario.model_validate(table)
    except ValidationError as error:
        lines = [f"{where}: {_explain(e)}" for e in error.errors()]
        raise ScenarioError("\n".join(lines)) from error


def _explain(error: Any) -> str:
    """One problem in one line; an unknown key names the nearest known one."""
    place = ".".join(str(p) for p in error["loc"]) or "the scenario"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        key = str(error["loc"][-1])
        near = difflib.get_close_matches(key, _known_keys(error["loc"]), 1)
        return f"{place}: unknown key" + (f"; did you mean {near[0]!r}?" if near else "")
    return f"{place}: {message}"


def _known_keys(loc: tuple[Any, ...]) -> list[str]:
    """Keys of the section that a location points into."""
    from typing import get_args

    sections: list[type[Strict]] = [Scenario]
    for part in loc[:-1]:
        if isinstance(part, int):
            continue
        found: list[type[Strict]] = []
        for section in sections:
            field = section.model_fields.get(str(part))
            if field is None:
                # The tag of a discriminated union narrows the choice.
                tags = [get_args(f.annotation) for f in section.model_fields.values()]
                found += [section] if any(part in t for t in tags) else []
            else:
                found += _sections_in(field.annotation)
        sections = found or sections
    return [key for section in sections for key in section.model_fields]


def _sections_in(annotation: Any) -> list[type[Strict]]:
    from typing import get_args

    if isinstance(annotation, type) and issubclass(annotation, Strict):
        return [annotation]
    return [s for arg in get_args(annotation) for s in _sections_in(arg)]
