"""The log of what happened, for programs."""

from typing import Literal

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["LogSettings"]


class LogSettings(Section):
    """Events of ``run``, one a line as JSON or an entry of the journal each."""

    to: str = Field(
        "",
        description="Where events go: a file, journal (systemd's, with fields of its own), - "
        "(standard error), or nowhere when empty. A file that was moved away is begun anew.",
    )
    level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="The least grave events that are logged."
    )
