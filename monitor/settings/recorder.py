"""How much of the raw link the recorder keeps."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["RecorderSettings"]


class RecorderSettings(Section):
    """Bounds of ``run --record DIR``."""

    file_max_mb: float = Field(
        256.0, gt=0, description="A new file is begun when one has this size, megabytes."
    )
    total_max_mb: float = Field(
        2048.0,
        gt=0,
        description="Oldest recordings in the folder are deleted beyond this sum, megabytes.",
    )
