"""How much of the raw link the recorder keeps."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["RecorderSettings"]


class RecorderSettings(Section):
    """Where ``run`` records, and the bounds."""

    folder: str = Field(
        "",
        description="Record what is received and published as .tlog in this folder (run --record); "
        "empty records nothing.",
    )

    file_max_mb: float = Field(
        256.0, gt=0, description="A new file is begun when one has this size, megabytes."
    )
    total_max_mb: float = Field(
        2048.0,
        gt=0,
        description="Oldest recordings in the folder are deleted beyond this sum, megabytes.",
    )
