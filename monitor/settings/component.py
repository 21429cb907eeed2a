"""How the daemon behaves as a component among others."""

from typing import Literal, Self

from pydantic import Field, NonNegativeFloat, model_validator

from monitor.needs import NEEDS
from monitor.settings.base import Section

__all__ = ["ComponentSettings"]


class ComponentSettings(Section):
    """Manners towards the autopilot and the ground stations. The id is [links] component_id."""

    other_ids: tuple[int, ...] = Field(
        (),
        description="Component ids to take instead, the first free one, when another sender of the "
        "vehicle's system uses [links] component_id before anything was sent. Empty: the id stays "
        "and the clash is said.",
    )
    listen_s: float = Field(
        1.5,
        ge=0,
        le=60,
        description="Time to listen for others with our component id before anything is sent. A "
        "heartbeat comes once a second.",
    )
    obey_systems: tuple[int, ...] = Field(
        (),
        description="System ids of other vehicles whose commands and parameter changes are obeyed "
        "all the same. Ground stations and the watched vehicle always are, as far as [security] "
        "lets them through.",
    )
    request_streams: bool = Field(
        True,
        description="Ask the autopilot for streams that come too slowly (SET_MESSAGE_INTERVAL), "
        "and put them back at the end. Never while a telemetry radio is on the link.",
    )
    stream_hz: dict[str, NonNegativeFloat] = Field(
        default_factory=dict,
        description="Rate to ask for instead of the built-in one, by stream (imu0, attitude, gps0 "
        "...) [1/s]; 0 asks for nothing.",
    )
    timesync_s: float = Field(
        5.0,
        ge=0,
        le=600,
        description="Time between TIMESYNC requests to the autopilot, which tell the offset of its "
        "clock and the round trip; 0 sends none.",
    )
    answers_per_s: float = Field(
        20.0,
        gt=0,
        le=1000,
        description="Most commands, pings and TIMESYNC answered in a second; what exceeds it is "
        "dropped.",
    )

    parameters: Literal["write", "read", "off"] = Field(
        "write",
        description="Parameters over MAVLink: whether a ground station may change them, read them, "
        "or finds none. Who is heard at all is settled by [security].",
    )
    parameter_encoding: Literal["auto", "c-cast", "bytewise"] = Field(
        "auto",
        description="How PARAM_VALUE and PARAM_SET carry whole numbers: cast to a float as "
        "ArduPilot does, or their bytes as PX4 does. auto: as the vehicle's autopilot does, since "
        "ground stations go by that.",
    )
    parameter_hz: float = Field(
        50.0, gt=0, le=1000, description="Most PARAM_VALUE sent in a second, over all links."
    )
    parameter_file: str = Field(
        "",
        description="File that keeps parameters which were set over MAVLink; empty: "
        "parameters.json in the state folder.",
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        strange = set(self.stream_hz) - set(NEEDS)
        if strange:
            known = ", ".join(NEEDS)
            raise ValueError(f"{min(strange)} is no stream that is asked for; choose of {known}")
        for number in (*self.other_ids, *self.obey_systems):
            if not 1 <= number <= 255:
                raise ValueError(f"{number} is no MAVLink id; they are 1 to 255")
        return self
