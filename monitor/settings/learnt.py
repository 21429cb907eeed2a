"""Where learnt thresholds come from: the section that ``mavsentry learn`` writes."""

from __future__ import annotations

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["LearntLog", "LearntSettings"]


class LearntLog(Section):
    """One healthy flight that was learnt from."""

    name: str = Field(description="File name of the log.")
    sha256: str = Field(description="Digest of its bytes.", pattern="^[0-9a-f]{64}$")
    seconds: float = Field(ge=0, description="Its duration [s].")


class LearntSettings(Section):
    """Provenance of learnt keys, written by `mavsentry learn`; nothing in it changes a verdict."""

    airframe: str = Field("", description="Whose thresholds these are.")
    vehicle: str = Field("", description="System id, autopilot and type in the logs.")
    hours: float = Field(0.0, ge=0, description="Judged flight that they rest on [h].")
    keys: tuple[str, ...] = Field((), description="Keys of this file whose values were learnt.")
    logs: tuple[LearntLog, ...] = Field((), description="The healthy flights.")

    @property
    def origin(self) -> str:
        """How much was learnt from, in a few words; empty where nothing was learnt."""
        if not self.logs:
            return ""
        return f"learnt from {len(self.logs)} flights, {self.hours:.2f} h"
