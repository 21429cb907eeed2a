"""How much of the raw links the recorder keeps, and how soon it is safe on the disk."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["RecorderSettings"]


class RecorderSettings(Section):
    """Where ``run`` records, and the bounds."""

    folder: str = Field(
        "",
        description="Recordings go into this folder, which is made if it is not there; empty "
        "records nothing. `--record DIR` goes before it.",
    )
    file_max_mb: float = Field(
        256.0, gt=0, description="A new file is begun when one has this size, megabytes."
    )
    file_max_minutes: float = Field(
        0.0, ge=0, description="A new file is begun when one is this old, minutes; 0: never."
    )
    total_max_mb: float = Field(
        2048.0,
        gt=0,
        description="Oldest recordings in the folder are deleted beyond this sum, megabytes.",
    )
    max_age_days: float = Field(
        0.0,
        ge=0,
        description="Recordings that were last written to longer ago are deleted, days; 0: none "
        "is. It trusts the host's clock.",
    )
    free_min_mb: float = Field(
        100.0,
        ge=0,
        description="Nothing is recorded while less than this is free on the disk, megabytes: "
        "the system beside us needs it.",
    )
    sync_s: float = Field(
        5.0,
        gt=0,
        description="What was recorded is forced onto the disk (fsync) this often, seconds, and "
        "whenever a file is closed. A power cut loses no more than that; the end of the program, "
        "even by kill -9, no more than a second.",
    )
    queue_mb: float = Field(
        8.0,
        gt=0,
        description="So much waits in memory for a slow disk, megabytes; beyond it the oldest is "
        "dropped and counted.",
    )
    retry_s: float = Field(
        30.0,
        gt=0,
        description="After a failure of the disk recording is tried again this often, seconds, "
        "into a new file.",
    )
