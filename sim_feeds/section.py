"""Base of every scenario section: unknown keys are errors that name the nearest known key."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

__all__ = ["Strict"]


class Strict(BaseModel):
    """A section of a scenario; values are fixed once validated, the unit stands in each key."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
