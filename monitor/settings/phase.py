"""Settings of the flight phase: when an aircraft flies and may be judged."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["PhaseSettings"]


class PhaseSettings(Section):
    """When the aircraft counts as flying. All from the speed class of the aircraft, none fitted."""

    flying_speed_m_s: float = Field(
        9.0, gt=0, description="Ground speed above which it may be flying (half the cruise speed)."
    )
    standstill_speed_m_s: float = Field(
        1.5, gt=0, description="Ground speed below which it stands; sets the ground's height."
    )
    takeoff_height_m: float = Field(
        15.0, gt=0, description="Height above the ground it stood on from which it is judged."
    )
    landing_height_m: float = Field(
        12.0,
        ge=0,
        description="Height above that ground below which a sinking aircraft is judged no more.",
    )
    confirm_s: float = Field(2.0, ge=0, description="How long speed must hold to count.")
    join_s: float = Field(
        0.5, ge=0, description="The same for a stream that never showed the aircraft standing."
    )
    boot_settle_s: float = Field(
        5.0,
        ge=0,
        description="An autopilot that restarts in the air is judged again after this at the "
        "soonest: its sensors start up, its attitude converges.",
    )
    boot_decide_s: float = Field(
        30.0,
        gt=0,
        description="A vehicle that booted in flight, and of which nothing is known for so long, "
        "counts as standing on the ground.",
    )
    receiver_timeout_s: float = Field(
        2.0, gt=0, description="Silence after which GPS and autopilot stand in for each other."
    )
