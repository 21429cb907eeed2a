"""Base of every settings section: strict, and helpful about a key that does not exist."""

from pydantic import BaseModel, ConfigDict

__all__ = ["Section"]


class Section(BaseModel):
    """A section of the configuration: unknown keys are errors, values are fixed once validated.

    Every field carries its unit in its name and a sentence in its description; the description of a
    threshold says what it was fitted on.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
