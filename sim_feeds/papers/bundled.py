"""The scenario files of this package."""

from __future__ import annotations

from importlib.resources import files
from typing import TypeVar

from sim_feeds.section import Strict, parse_table

__all__ = ["scenario_of", "text_of"]

File = TypeVar("File", bound=Strict)


def text_of(name: str) -> str:
    """A bundled file's text."""
    return files("sim_feeds.papers").joinpath(name).read_text(encoding="utf-8")


def scenario_of(name: str, model: type[File]) -> File:
    """A bundled TOML file, validated.

    Raises
    ------
    sim_feeds.section.ScenarioError
        It does not fit the model.
    """
    return parse_table(text_of(name), model, name)
