"""Base of every section of a scenario or fault file, and how such a file is read.

Unknown keys and words are errors that name the nearest known one.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Callable
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

__all__ = ["ScenarioError", "Strict", "parse_table"]


class ScenarioError(ValueError):
    """A file cannot be used; the message says where and why, in one line per problem."""


class Strict(BaseModel):
    """A section of a scenario; values are fixed once validated, the unit stands in each key."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


File = TypeVar("File", bound=Strict)


def parse_table(
    text: str,
    model: type[File],
    where: str,
    override: Callable[[dict[str, Any]], None] | None = None,
) -> File:
    """Validate TOML text; errors begin with ``where``.

    Raises
    ------
    ScenarioError
        It is no TOML, or a value does not fit.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{where} is no TOML: {error}") from error
    if override:
        override(table)
    try:
        return model.model_validate(table)
    except ValidationError as error:
        lines = [f"{where}: {_explain(e, model)}" for e in error.errors()]
        raise ScenarioError("\n".join(lines)) from error


def _explain(error: Any, model: type[Strict]) -> str:
    """One problem in one line; an unknown key or word names the nearest known one."""
    place = ".".join(str(p) for p in error["loc"]) or "the file"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        key = str(error["loc"][-1])
        near = difflib.get_close_matches(key, _known_keys(error["loc"], model), 1)
        return f"{place}: unknown key" + (f"; did you mean {near[0]!r}?" if near else "")
    if error["type"] == "enum":
        words = re.findall(r"'([^']+)'", error["ctx"]["expected"])
        near = difflib.get_close_matches(str(error["input"]), words, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(words)}"
        return f"{place}: {error['input']!r} is none; {hint}"
    return f"{place}: {message}"


def _known_keys(loc: tuple[Any, ...], model: type[Strict]) -> list[str]:
    """Keys of the section that a location points into."""
    sections: list[type[Strict]] = [model]
    for part in loc[:-1]:
        if isinstance(part, int):
            continue
        found: list[type[Strict]] = []
        for section in sections:
            field = section.model_fields.get(str(part))
            if field is None:
                # The tag of a discriminated union narrows the choice.
                tags = [get_args(f.annotation) for f in section.model_fields.values()]
                found += [section] if any(part in t for t in tags) else []
            else:
                found += _sections_in(field.annotation)
        sections = found or sections
    return [key for section in sections for key in section.model_fields]


def _sections_in(annotation: Any) -> list[type[Strict]]:
    if isinstance(annotation, type) and issubclass(annotation, Strict):
        return [annotation]
    return [s for arg in get_args(annotation) for s in _sections_in(arg)]
