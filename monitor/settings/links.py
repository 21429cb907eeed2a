"""What is read from a link, whatever carries it."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["LinkSettings"]


class LinkSettings(Section):
    """The vehicle, our own place in its network, and how the loop reads."""

    dialect: str = Field(
        "ardupilotmega",
        pattern=r"^[a-z0-9_]+$",
        description="MAVLink dialect by pymavlink's name: ardupilotmega, all, common ...",
    )
    system_id: int = Field(
        0,
        ge=0,
        le=255,
        description="MAVLink system id of the vehicle; 0 takes the first autopilot that is heard.",
    )
    component_id: int = Field(
        191,
        ge=1,
        le=255,
        description="Our own MAVLink component id: what carries it is sent by us and never read.",
    )
    airspeed_ratio: float = Field(
        2.0,
        gt=0,
        le=10,
        description="ARSPD_RATIO (pascal per (m/s)^2, inverse) used until the vehicle's parameter "
        "is heard: CAS = sqrt(ratio * differential pressure). 2.0 is ArduPilot's default.",
    )
    aoa_ssa_is_vane: bool = Field(
        False,
        description="AOA_SSA carries a real vane (ArduPilot computes it, so it is not read).",
    )
    silent_after_s: float = Field(
        3.0,
        gt=0,
        le=60,
        description="Time without any byte of the vehicle (host clock) after which the link is "
        "silent: the heartbeat says EMERGENCY.",
    )
    coalesce_ms: float = Field(
        20.0,
        ge=0,
        le=200,
        description="Datagrams are gathered for this time before they are worked on: less waking "
        "up against more latency.",
    )
