"""A flight as a file: aircraft, manoeuvres, wind, instruments, faults; validated, bit-reproducible.

The kinematic classes (transport, light-aircraft, small-uav) fly ``leg`` after ``leg``. Any other
aircraft is one of six degrees of freedom ("aerosonde", or a name that JSBSim knows): it flies a
``circuit`` in the air, its servo outputs and engine speeds are real, its wings and engines break.

``load("demo")`` finds a bundled scenario, ``load("my/flight.toml")`` a file. A scenario with a seed
determines every bit of the flight, of the sensor readings and of the frames.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from math import radians
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, ValidationError, model_validator

from sim_feeds.airframe import AIRFRAMES, Airframe
from sim_feeds.autopilot import Autopilot, Navigation
from sim_feeds.fault_table import FaultEntry
from sim_feeds.faults import Fault
from sim_feeds.flightplan import FlightPlan
from sim_feeds.legs import Leg, WindPart
from sim_feeds.section import ScenarioError, Strict, parse_table
from sim_feeds.sensors import Airspeed, Aoa, Baro, Gps, Imu, Series
from sim_feeds.sixdof.as_truth import as_truth
from sim_feeds.sixdof.engine import AircraftMissing, EngineMissing
from sim_feeds.sixdof.vehicle import CRUISE, Cruise, VehicleFlight, fly_circuit
from sim_feeds.tachometer import MAX_CHANNELS, Tachometer
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Wind

__all__ = [
    "Circuit",
    "FaultEntry",
    "Flight",
    "Scenario",
    "ScenarioError",
    "bundled",
    "load",
    "with_aircraft",
]

BUNDLE: Final = "scenarios"
SIX_DOF_FAULTS: Final = ("spool", "wing", "engine")
"""Quantities that only exist where forces act and engines turn."""


class Start(Strict):
    """Where and how the flight begins."""

    speed_m_s: float = Field(
        0.0,
        ge=0.0,
        description="True airspeed; 0 is on the ground, with six degrees of freedom at cruise.",
    )
    agl_m: float = Field(0.0, ge=0.0, description="Height above the field.")
    heading_deg: float = Field(0.0, description="A circuit has its own.")
    lat_deg: float = Field(52.0, gt=-80.0, lt=80.0)
    lon_deg: float = Field(4.4, ge=-180.0, le=180.0)
    field_m: float = Field(50.0, ge=-400.0, le=4000.0, description="Height of the field.")
    temperature_offset_k: float = 0.0
    boot_s: float = Field(20.0, ge=0.0, description="Vehicle time of the flight's first moment.")


class Circuit(Strict):
    """What an aircraft with six degrees of freedom flies, at the airspeed and height of its start.

    The flight begins on the last leg and goes round until its time is over.
    """

    duration_s: float = Field(300.0, ge=5.0, le=7200.0)
    waypoints_m: tuple[tuple[float, float], ...] = Field(
        (), description="North and east of the start; none: a circuit that fits the airspeed."
    )

    @model_validator(mode="after")
    def _closed(self) -> Circuit:
        if 0 < len(self.waypoints_m) < 3:
            raise ValueError("a circuit needs three waypoints, or none to have one that fits")
        return self


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
    rpm_hz: float = Field(
        4.0,
        ge=0.0,
        le=50.0,
        description="RPM of a kinematic aircraft; with six degrees of freedom see rpm.rate_hz.",
    )
    status_hz: float = Field(2.0, gt=0.0, le=10.0, description="SYS_STATUS, EXTENDED_SYS_STATE.")
    system_id: int = Field(1, ge=1, le=250)
    arm_s: float = Field(2.0, ge=0.0, description="When the motors are armed.")


class Scenario(Strict):
    """A flight that can be flown: see the module."""

    title: str
    aircraft: str = Field(
        description="transport, light-aircraft, small-uav; or aerosonde, c172p, A320 ..."
    )
    seed: int = Field(0, ge=0, description="Used unless the caller gives another.")
    truth_hz: float = Field(
        200.0, ge=50.0, le=1000.0, description="Grid of the truth; with six degrees of freedom 200."
    )
    start: Start = Start()
    leg: tuple[Leg, ...] = ()
    circuit: Circuit = Circuit()
    wind: tuple[WindPart, ...] = ()
    imu: Imu = Imu()
    airspeed: Airspeed = Airspeed()
    aoa: Aoa = Aoa()
    baro: Baro = Baro()
    gps: Gps = Gps()
    rpm: Tachometer = Tachometer()
    autopilot: Autopilot = Autopilot()
    messages: Messages = Messages()
    fault: tuple[FaultEntry, ...] = ()

    @model_validator(mode="after")
    def _can_be_flown(self) -> Scenario:
        """Each aircraft has what it flies; what only the other kind understands is refused."""
        self.cruise()
        strange = self.model_fields_set & ({"leg"} if self.six_dof else {"circuit", "rpm"})
        if strange:
            raise ValueError(
                f"{self.aircraft} does not fly {', '.join(sorted(strange))}: the kinematic "
                f"{', '.join(AIRFRAMES)} fly legs, aircraft with six degrees of freedom a circuit"
            )
        if not self.six_dof and not self.leg:
            raise ValueError("a flight needs at least one leg")
        if self.six_dof and self.start.temperature_offset_k:
            raise ValueError(f"{self.aircraft} flies in the standard atmosphere")
        return self

    @model_validator(mode="after")
    def _instruments_exist(self) -> Scenario:
        if self.messages.imu == "raw" and self.imu.count > 3:
            raise ValueError("a fourth IMU needs messages.imu = 'highres'")
        for f in self.fault:
            base = f.sensor.split(".")[0]
            if f.quantity == "attitude" or base == "attitude":
                raise ValueError(f"{f.sensor} is computed here, not sensed: it has no fault")
            if f.quantity in SIX_DOF_FAULTS:
                if not self.six_dof:
                    raise ValueError(
                        f"{f.sensor} breaks on an aircraft with six degrees of freedom only"
                    )
                continue
            count = getattr(self, base[:-1]).count
            if int(base[-1]) >= count:
                raise ValueError(
                    f"fault on {f.sensor}, but the aircraft has {count} {base[:-1]} sensor(s)"
                )
        follows = self.autopilot.attitude_follows_imu
        if follows is not None and follows >= self.imu.count:
            raise ValueError(f"attitude_follows_imu = {follows}, but imu.count = {self.imu.count}")
        end_s = self.duration_s
        for f in self.fault:
            if f.start_s >= end_s:
                raise ValueError(
                    f"fault on {f.sensor} begins at {f.start_s:g} s, but the flight of this "
                    f"{self.aircraft} ends at {end_s:.0f} s"
                )
        return self

    @property
    def six_dof(self) -> bool:
        """Whether JSBSim flies it."""
        return self.aircraft not in AIRFRAMES

    def cruise(self) -> Cruise:
        """Airspeed and height: those of the start, or the aircraft's own.

        Raises
        ------
        ValueError
            Neither is known.
        """
        s = self.start
        own = CRUISE.get(self.aircraft, AIRFRAMES.get(self.aircraft))
        if isinstance(own, Airframe):
            return Cruise(own.cruise_m_s, s.agl_m)
        if own is None and not (s.speed_m_s and s.agl_m):
            raise ValueError(
                f"no aircraft {self.aircraft!r} is known: {', '.join([*AIRFRAMES, *CRUISE])}; any "
                "other that JSBSim ships needs start.speed_m_s and start.agl_m"
            )
        return Cruise(
            s.speed_m_s or (own.tas_m_s if own else 0.0), s.agl_m or (own.agl_m if own else 0.0)
        )

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
        return self.circuit.duration_s if self.six_dof else self.plan().time_s

    def faults(self) -> list[Fault]:
        """The faults, in SI."""
        return [f.fault() for f in self.fault]

    def fly(self, seed: int | None = None) -> Flight:
        """Truth and all readings; the same seed gives the same bits."""
        seed = self.seed if seed is None else seed
        controls = None
        if self.six_dof:
            controls = self._six_dof(seed)
            truth = as_truth(controls, field_m=self.start.field_m)
        else:
            truth = self._kinematic(seed)
        faults = self.faults()
        readings: dict[str, Series] = {}
        for kind in ("imu", "airspeed", "aoa", "baro", "gps"):
            instrument = getattr(self, kind)
            for i in range(instrument.count):
                readings[f"{kind}{i}"] = instrument.sample(truth, i, faults, seed)
        if controls is not None:
            readings["rpm"] = self.rpm.read(controls.t_s, controls.shaft_rpm, faults, seed)
        follows = self.autopilot.attitude_follows_imu
        source = None if follows is None else readings[f"imu{follows}"]
        rate = max(self.messages.attitude_hz, self.messages.quaternion_hz)
        navigation = self.autopilot.estimate(truth, source, seed, rate)
        return Flight(self, seed, truth, faults, readings, navigation, controls)

    def _kinematic(self, seed: int) -> Truth:
        s = self.start
        return fly(
            self.plan(),
            Wind([w.component() for w in self.wind]),
            seed=seed,
            rate_hz=self.truth_hz,
            lat_rad=radians(s.lat_deg),
            lon_rad=radians(s.lon_deg),
            field_m=s.field_m,
            temperature_offset_k=s.temperature_offset_k,
        )

    def _six_dof(self, seed: int) -> VehicleFlight:
        """Raises ScenarioError where JSBSim, the aircraft, or what should break is missing."""
        s, cruise = self.start, self.cruise()
        try:
            flown = fly_circuit(
                self.aircraft,
                tas_m_s=cruise.tas_m_s,
                height_m=s.field_m + cruise.agl_m,
                duration_s=self.circuit.duration_s,
                seed=seed,
                lat_rad=radians(s.lat_deg),
                lon_rad=radians(s.lon_deg),
                field_m=s.field_m,
                waypoints_m=self.circuit.waypoints_m,
                wind=[w.component() for w in self.wind],
                faults=self.faults(),
            )
        except (EngineMissing, AircraftMissing, ValueError) as error:
            raise ScenarioError(str(error)) from error
        channels = len(self.rpm.channels(flown.shaft_rpm.shape[1]))
        if channels > MAX_CHANNELS:
            raise ScenarioError(f"rpm.count: {channels} channels, but there are {MAX_CHANNELS}")
        for f in self.fault:
            if f.quantity == "spool" and int(f.sensor.removeprefix("spool")) >= channels:
                raise ScenarioError(
                    f"fault on {f.sensor}, but {self.aircraft} has {channels} engine speed(s)"
                )
        return flown


@dataclass(frozen=True, slots=True)
class Flight:
    """A scenario flown with one seed: truth, readings per sensor, the autopilot's solution.

    ``controls`` is what an aircraft with six degrees of freedom really did; a kinematic one has
    none.
    """

    scenario: Scenario
    seed: int
    truth: Truth
    faults: list[Fault]
    readings: dict[str, Series]
    navigation: Navigation
    controls: VehicleFlight | None = None


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


def with_aircraft(table: dict[str, Any], aircraft: str) -> None:
    """Put another aircraft into the parsed table of a scenario, in place.

    One with six degrees of freedom flies its own circuit at its own cruise, for as long as the
    legs or the circuit of the scenario; everything else stays.
    """
    was = table.get("aircraft")
    table["aircraft"] = aircraft
    if aircraft in AIRFRAMES or was == aircraft:
        return
    legs = table.pop("leg", None)
    if legs is not None and was in AIRFRAMES:
        start = {k: v for k, v in table.items() if k in ("title", "start")}
        try:
            flown = Scenario.model_validate({**start, "aircraft": was, "leg": legs})
        except ValidationError:  # told when the table itself is validated
            table |= {"aircraft": was, "leg": legs}
            return
        table["circuit"] = {"duration_s": round(flown.duration_s, 1)}
    for section, keys in (("start", ("speed_m_s", "agl_m")), ("circuit", ("waypoints_m",))):
        if isinstance(table.get(section), dict):
            table[section] = {k: v for k, v in table[section].items() if k not in keys}


def parse(
    text: str, where: str = "scenario", override: Callable[[dict[str, Any]], None] | None = None
) -> Scenario:
    """Validate the text of a scenario; errors begin with ``where``."""
    return parse_table(text, Scenario, where, override)
