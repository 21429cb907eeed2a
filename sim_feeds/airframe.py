"""What the synthetic vehicle needs to know of an aircraft: speeds, lift curve, gust response.

The numbers are round ones of each class, not of a particular type; where two of them fix a third
(lift slope and time constant of the heave response) the third is derived.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

from sim_feeds.earth import STANDARD_GRAVITY_M_S2

__all__ = ["AIRFRAMES", "Airframe"]


@dataclass(frozen=True, slots=True)
class Airframe:
    """One aircraft class.

    Attributes
    ----------
    name
        The class, as scenarios call it.
    cruise_m_s, approach_m_s
        Equivalent airspeeds; the angle of attack at cruise is ``cruise_aoa_rad`` in 1 g flight.
    zero_lift_aoa_rad, cruise_aoa_rad
        Two points of the linear lift curve.
    ground_pitch_rad
        Pitch angle of the aircraft on its wheels.
    gust_length_m
        Length over which wing and tail average the gusts.
    surge_s, heave_hold_rad_s
        Time constant with which the ground velocity follows the horizontal wind, and bandwidth of
        the height hold.
    short_period_rad_s, short_period_damping
        Pitch motion into a vertical gust.
    weathercock_rad_s, weathercock_damping, dihedral
        Yaw motion into a side gust, and roll per sideslip.
    takeoff_acc_m_s2, cruise_acc_m_s2
        Along the path.
    bank_rate_rad_s
        For the entry into a turn.
    load_step_g_s
        How fast the load factor is built up.
    """

    name: str
    cruise_m_s: float
    approach_m_s: float
    zero_lift_aoa_rad: float
    cruise_aoa_rad: float
    ground_pitch_rad: float
    gust_length_m: float
    surge_s: float
    heave_hold_rad_s: float
    short_period_rad_s: float
    short_period_damping: float
    weathercock_rad_s: float
    weathercock_damping: float
    dihedral: float
    takeoff_acc_m_s2: float
    cruise_acc_m_s2: float
    bank_rate_rad_s: float
    load_step_g_s: float
    idle_rpm: float
    full_rpm: float

    @property
    def lift_constant(self) -> float:
        """Angle above zero lift times equivalent airspeed squared in 1 g flight [rad m^2/s^2]."""
        return (self.cruise_aoa_rad - self.zero_lift_aoa_rad) * self.cruise_m_s**2

    @property
    def heave_s(self) -> float:
        """Time constant with which the vertical velocity follows the air at constant pitch [s].

        A change of angle of attack by ``a`` adds ``a * V^2 / lift_constant`` to the load factor.
        """
        return self.lift_constant / (STANDARD_GRAVITY_M_S2 * self.cruise_m_s)


AIRFRAMES: Final = {
    a.name: a
    for a in (
        Airframe(
            name="transport",
            cruise_m_s=120.0,
            approach_m_s=80.0,
            zero_lift_aoa_rad=radians(-3.0),
            cruise_aoa_rad=radians(3.0),
            ground_pitch_rad=radians(0.5),
            gust_length_m=12.0,
            surge_s=8.0,
            heave_hold_rad_s=0.25,
            short_period_rad_s=1.8,
            short_period_damping=0.7,
            weathercock_rad_s=1.2,
            weathercock_damping=0.6,
            dihedral=0.3,
            takeoff_acc_m_s2=5.0,
            cruise_acc_m_s2=1.0,
            bank_rate_rad_s=radians(8.0),
            load_step_g_s=0.5,
            idle_rpm=2000.0,
            full_rpm=5000.0,
        ),
        Airframe(
            name="light-aircraft",
            cruise_m_s=52.0,
            approach_m_s=34.0,
            zero_lift_aoa_rad=radians(-3.0),
            cruise_aoa_rad=radians(2.0),
            ground_pitch_rad=radians(2.0),
            gust_length_m=4.0,
            surge_s=5.0,
            heave_hold_rad_s=0.4,
            short_period_rad_s=4.0,
            short_period_damping=0.7,
            weathercock_rad_s=2.2,
            weathercock_damping=0.5,
            dihedral=0.4,
            takeoff_acc_m_s2=3.0,
            cruise_acc_m_s2=0.8,
            bank_rate_rad_s=radians(12.0),
            load_step_g_s=0.8,
            idle_rpm=800.0,
            full_rpm=2600.0,
        ),
        Airframe(
            name="small-uav",
            cruise_m_s=20.0,
            approach_m_s=15.0,
            zero_lift_aoa_rad=radians(-3.5),
            cruise_aoa_rad=radians(2.5),
            ground_pitch_rad=radians(3.0),
            gust_length_m=1.0,
            surge_s=3.0,
            heave_hold_rad_s=0.7,
            short_period_rad_s=8.0,
            short_period_damping=0.7,
            weathercock_rad_s=4.0,
            weathercock_damping=0.5,
            dihedral=0.5,
            takeoff_acc_m_s2=4.0,
            cruise_acc_m_s2=1.0,
            bank_rate_rad_s=radians(35.0),
            load_step_g_s=2.0,
            idle_rpm=1500.0,
            full_rpm=9000.0,
        ),
    )
}
