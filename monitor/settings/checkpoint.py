"""How often what was learnt is kept, and how old it may be when it is taken up again."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["CheckpointSettings"]


class CheckpointSettings(Section):
    """The checkpoint of ``mavsentry run``: what a restart comes back with."""

    interval_s: float = Field(
        5.0,
        ge=0.0,
        description="Vehicle data for this long, then the learned state is kept again, seconds; "
        "0 keeps none and takes none up. What was learnt since then is lost with the power.",
    )
    max_age_s: float = Field(
        120.0,
        ge=0.0,
        le=3600.0,
        description="An older checkpoint is not taken up, seconds. The service is back within "
        "three, a companion computer within about sixty; beyond two minutes the wind has moved by "
        "as much as the deviations it is remembered with, and learning anew takes no longer than "
        "that.",
    )
