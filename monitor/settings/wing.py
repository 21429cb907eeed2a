"""Settings of the wing watch: the airframe, how servos move surfaces, and what a verdict takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import inf
from typing import Literal, Self

from pydantic import Field, model_validator

from estimators.wing_model import AERODYNAMIC, FAULTS, Airframe
from links.airframes import AirframeError, load_airframe
from monitor.settings.base import Section

__all__ = [
    "LEARNT_KEYS",
    "KnownAirframe",
    "SurfaceSettings",
    "WingSettings",
    "airframe_of",
    "surfaces_of",
]

SURFACES = ("elevator", "aileron", "rudder")
TRAVEL_US, TRAVEL_DEG = 400.0, 25.0
"""Where neither the settings nor the airframe's file say."""
MOST_TRAVEL_US, MOST_TRAVEL_DEG = 1000.0, 60.0


class SurfaceSettings(Section):
    """A control surface and the servo output that moves it."""

    channel: int = Field(ge=1, le=16, description="Servo output.")
    trim_us: float = Field(
        0.0,
        ge=0,
        le=2500,
        description="Pulse at which the surface is at zero [us]; 0: SERVOn_TRIM where that "
        "parameter was heard, else 1500.",
    )
    travel_us: float = Field(
        0.0,
        ge=0,
        le=MOST_TRAVEL_US,
        description="Pulse from trim to travel_deg [us]; 0: as the airframe's file says, else 400.",
    )
    travel_deg: float = Field(
        0.0,
        ge=0,
        le=MOST_TRAVEL_DEG,
        description="Deflection at trim plus travel [deg]; 0: as the airframe's file says, else "
        "25.",
    )
    reversed: bool = Field(
        False,
        description="A longer pulse moves the surface to the negative side. Positive are: elevator "
        "trailing edge down, aileron right wing down, rudder nose left.",
    )


class ElevatorSettings(SurfaceSettings):
    """The elevator's servo output."""

    channel: int = Field(2, ge=1, le=16, description="Servo output.")


class AileronSettings(SurfaceSettings):
    """The ailerons' servo output."""

    channel: int = Field(1, ge=1, le=16, description="Servo output.")


class RudderSettings(SurfaceSettings):
    """The rudder's servo output."""

    channel: int = Field(4, ge=1, le=16, description="Servo output.")


class WingSettings(Section):
    """What is known of the aircraft, and what is asked before a wing is called damaged.

    Without an airframe nothing can be said of its wings: they are unmonitored.
    """

    airframe: str = Field(
        "",
        description="Bundled name (aerosonde) or TOML file of coefficients; empty: none is known.",
    )
    elevator: ElevatorSettings = ElevatorSettings()
    aileron: AileronSettings = AileronSettings()
    rudder: RudderSettings = RudderSettings()
    throttle_channel: int = Field(3, ge=1, le=16, description="Servo output of the throttle.")
    thrust_from: Literal["rpm", "throttle", "auto"] = Field(
        "auto", description="Source of the propeller's speed; auto: rpm where it comes."
    )
    spool: int = Field(0, ge=0, le=15, description="Engine-speed channel that turns the propeller.")
    spool_ratio: float = Field(
        1.0, gt=0, description="Turns of the propeller for one turn that the channel shows."
    )
    prop_idle_rad_s: float = Field(
        0.0, ge=0, description="Without rpm: propeller's speed at throttle 0, standing [rad/s]."
    )
    prop_full_rad_s: float = Field(
        520.0, gt=0, description="Without rpm: propeller's speed at throttle 1, standing [rad/s]."
    )
    prop_advance_rad_m: float = Field(
        6.0, ge=0, description="Without rpm: what airspeed adds to it [rad/s per m/s]."
    )
    coefficient_share: float = Field(
        0.15,
        ge=0,
        le=1,
        description="Deviation of a coefficient as a share of it, where the airframe's file gives "
        "no deviation of its own. The better the table is known, the smaller the damage found.",
    )
    gust_m_s: float = Field(
        0.8,
        gt=0,
        description="Unknown wind per axis that the filtered residuals keep [m/s]. Fitted on "
        "flights of the bundled airframe in wind of 20 to 25 % of its airspeed.",
    )
    airspeed_std_m_s: float = Field(0.3, ge=0, description="Error of the airspeed [m/s].")
    tilt_std_deg: float = Field(
        0.1, ge=0, description="Error of roll and pitch, which gravity turns into force [deg]."
    )
    noise_share: float = Field(
        0.005,
        ge=0,
        description="Share of the residuals' variances that is added to them, lest combinations "
        "that no gust moves be trusted without bound.",
    )
    floor_m_s2: float = Field(
        0.03, gt=0, description="Scatter of each acceleration's residual in calm air [m/s^2]."
    )
    floor_rad_s2: float = Field(0.01, gt=0, description="Scatter of each angular one's [rad/s^2].")
    use_imu: bool = Field(
        True,
        description="Take accelerations from imu0 where it comes, not from the velocity alone.",
    )
    contradiction_m_s2: float = Field(
        0.4,
        gt=0,
        description="Difference between accelerometers and the slope of the velocity, low-passed, "
        "beyond which neither is believed [m/s^2].",
    )
    wind_time_s: float = Field(10.0, gt=0, description="tau_w: the wind is known so slowly [s].")
    filter_time_s: float = Field(3.0, gt=0, description="tau_a: residuals are low-passed so [s].")
    period_s: float = Field(0.5, ge=0.2, description="Time between two estimates [s].")
    window: int = Field(50, ge=5, le=400, description="Rows of the moving horizon, count.")
    growth_percent: float = Field(
        6.0, gt=0, description="lambda: mean growth of a fault from row to row [%]."
    )
    carried_std_percent: float = Field(
        1.0, gt=0, description="Deviation of a window's first point from the window before [%]."
    )
    tick_s: float = Field(0.05, ge=0.02, le=0.2, description="Step of the residuals [s].")
    late_s: float = Field(
        1.0,
        gt=0,
        le=3,
        description="Longer gaps of a stream are not bridged, and none is waited for longer [s].",
    )
    least_airspeed_m_s: float = Field(
        8.0, gt=0, description="Slower flight is not judged: wings near the stall [m/s]."
    )
    lift_percent: float = Field(
        3.0,
        gt=0,
        description="A wing that has lost so much more lift than the other is damaged [%]. Healthy "
        "flights with the right coefficients reach 1.4.",
    )
    drag_percent: float = Field(
        7.3,
        gt=0,
        description="A wing that has so much more drag than the other is damaged [%]. Healthy "
        "flights with the right coefficients reach 7.2, by the accelerometer's bias.",
    )
    lift_sigmas: float = Field(
        4.0,
        ge=0,
        description="And the difference in lift must exceed so many of its own deviations, those "
        "from wrong coefficients included. An airframe learnt from flights has instead of these "
        "2 % more than the largest excess of this wing that its healthy flights showed. Set on ten "
        "healthy flights with eight tables whose every coefficient was 15 % off.",
    )
    drag_sigmas: float = Field(3.0, ge=0, description="The same of drag.")
    confirm_s: float = Field(0.0, ge=0, description="For so long [s].")
    clear_share: float = Field(
        0.5, gt=0, lt=1, description="Below this share of the threshold a wing is whole again."
    )
    clear_s: float = Field(30.0, gt=0, description="If it stays there for so long [s].")

    misfit_limit: float = Field(
        3.0,
        gt=0,
        description="Variance of the residuals that no difference between the wings explains, "
        "against what is expected of a healthy aircraft, beyond which the airframe is not this "
        "aircraft's. Models 15 % off reach 2.1, another aircraft's begin at 11.",
    )
    misfit_after_s: float = Field(
        10.0, gt=0, description="Mean over so much flight at least; no wing is judged before [s]."
    )
    misfit_until_s: float = Field(
        120.0,
        gt=0,
        description="Later, and once a wing is damaged, the airframe is not asked again [s].",
    )

    @model_validator(mode="after")
    def _readable(self) -> Self:
        if self.airframe:
            airframe_of(self)
        return self


@dataclass(frozen=True, slots=True)
class KnownAirframe:
    """An airframe's file, read.

    Attributes
    ----------
    airframe
    std
        Deviation of each number: coefficients have one, mass and geometry are known.
    learnt_percent
        Largest excess of each wing over the other, in the order of the faults, in the healthy
        flights that it was learnt from; None where it was not.
    travel_us, travel_deg
        This far from trim a servo deflects its surface so much; None where the file does not say.
    """

    airframe: Airframe
    std: tuple[float, ...]
    learnt_percent: tuple[float | None, ...]
    travel_us: float | None
    travel_deg: float | None


LEARNT_KEYS = tuple(f"healthy_{fault.replace('.', '_')}_percent" for fault in FAULTS)


def airframe_of(settings: WingSettings) -> KnownAirframe:
    """Read the airframe's file.

    A key ``<coefficient>_std`` in it takes the place of the settings' share; ``mavsentry learn
    airframe`` writes these and :data:`LEARNT_KEYS`.

    Raises
    ------
    ValueError
        The file cannot be read, or a number is missing or cannot be: the message names it.
    """
    try:
        numbers = load_airframe(settings.airframe)
        own = {n: numbers.pop(f"{n}_std") for n in AERODYNAMIC if f"{n}_std" in numbers}
        learnt = tuple(numbers.pop(key, None) for key in LEARNT_KEYS)
        beside = {f"{n}_std": std for n, std in own.items()}
        beside |= {k: v for k, v in zip(LEARNT_KEYS, learnt, strict=True) if v is not None}
        for key, value in beside.items():
            if not 0.0 <= value < inf:
                raise ValueError(f"{key} = {value:g} is not 0 or more, and finite")
        airframe = Airframe.of(numbers)
        travel_us = _travel(numbers, "travel_us", MOST_TRAVEL_US)
        travel_deg = _travel(numbers, "travel_deg", MOST_TRAVEL_DEG)
    except AirframeError:
        raise
    except ValueError as error:
        raise ValueError(f"{settings.airframe}: {error}") from None
    std = []
    for name in (field.name for field in fields(Airframe)):
        share = settings.coefficient_share if name in AERODYNAMIC else 0.0
        std.append(abs(own.get(name, share * getattr(airframe, name))))
    return KnownAirframe(airframe, tuple(std), learnt, travel_us, travel_deg)


def _travel(numbers: Mapping[str, float], key: str, most: float) -> float | None:
    value = numbers.get(key)
    if value is not None and not 0.0 < value <= most:
        raise ValueError(f"{key} = {value:g} is not above 0 and at most {most:g}")
    return value


def surfaces_of(settings: WingSettings) -> tuple[SurfaceSettings, ...]:
    """Elevator, aileron and rudder with the travel that counts filled in.

    A key of the settings comes first, then the airframe's file.

    Raises
    ------
    ValueError
        As of :func:`airframe_of`.
    """
    known = airframe_of(settings) if settings.airframe else None
    travel_us = known.travel_us if known is not None else None
    travel_deg = known.travel_deg if known is not None else None
    out = []
    for name in SURFACES:
        surface: SurfaceSettings = getattr(settings, name)
        travel = {
            "travel_us": surface.travel_us or travel_us or TRAVEL_US,
            "travel_deg": surface.travel_deg or travel_deg or TRAVEL_DEG,
        }
        out.append(surface.model_copy(update=travel))
    return tuple(out)
