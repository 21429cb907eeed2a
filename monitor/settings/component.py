"""How the daemon behaves as a component among others."""

from pydantic import Field

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
