"""What is wrong with a configuration, as a person would say it: where, what, and what to do."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

__all__ = ["problems"]

_WORDS = {
    "float_parsing": "is text, and takes a number: leave the quotes away",
    "float_type": "takes a number",
    "int_parsing": "is text, and takes a whole number: leave the quotes away",
    "int_type": "takes a whole number",
    "int_from_float": "takes a whole number",
    "bool_type": "takes true or false",
    "bool_parsing": "takes true or false",
    "string_type": "takes text in quotes",
    "tuple_type": 'takes a list in brackets: ["..."]',
    "dict_type": "takes a table",
    "model_type": "is a section: its keys stand below its name in brackets",
    "missing": "must be given",
}
"""Kind of pydantic's error -> what it means here."""


def problems(error: ValidationError, model: type[BaseModel], file: Path | None) -> list[str]:
    """A sentence for each thing that is wrong, with the line of the file where it stands."""
    lines = _lines(file)
    said: dict[str, int] = {}
    for one in error.errors():
        path = [str(part) for part in one["loc"]]
        line = _line(path, lines)
        where = "" if file is None else f"{file}, line {line}: " if line else f"{file}: "
        said.setdefault(where + _sentence(path, dict(one), model), line)
    return sorted(said, key=said.__getitem__)


def _sentence(path: list[str], one: Mapping[str, Any], model: type[BaseModel]) -> str:
    key = ".".join(path)
    if one["type"] == "extra_forbidden":
        return _unknown(path, one["input"], model)
    given = one["input"]
    shown = "" if isinstance(given, Mapping | BaseModel) else f" = {given!r}"
    if (words := _WORDS.get(one["type"])) is not None:
        return f"{key}{'' if one['type'] == 'missing' else shown} {words}"
    said = one["msg"].removeprefix("Value error, ").replace("Input should be", "should be")
    return f"{key}{shown}: {said}"


def _unknown(path: list[str], given: Any, model: type[BaseModel]) -> str:
    """A key that is not there: the nearest of its section, else where a key of that name stands."""
    key, last = ".".join(path), path[-1]
    known = _known_keys(model, path[:-1])
    what = "section" if isinstance(given, Mapping) else "key"
    near = difflib.get_close_matches(last, known, n=1, cutoff=0.6)
    if near:
        return f"there is no {what} {key}; did you mean {near[0]}?"
    elsewhere = [name for name in _all_keys(model) if name.rpartition(".")[2] == last]
    if elsewhere:
        section, _, name = elsewhere[0].rpartition(".")
        return f"there is no {what} {key}; {name} stands in the section [{section}]"
    far = difflib.get_close_matches(last, known, n=1, cutoff=0.4)
    hint = f"did you mean {far[0]}?" if far else f"known are {', '.join(known)}"
    return f"there is no {what} {key}; {hint}"


def _known_keys(model: type[BaseModel], path: list[str]) -> list[str]:
    for part in path:
        annotation = model.model_fields[part].annotation if part in model.model_fields else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return list(model.model_fields)


def _all_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    found = []
    for name, field in model.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            found += _all_keys(inner, f"{prefix}{name}.")
        else:
            found.append(prefix + name)
    return found


def _lines(file: Path | None) -> list[str]:
    try:
        return [] if file is None else file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return []


def _line(path: list[str], lines: list[str]) -> int:
    """Number of the line that sets the key or opens its section; 0 where it is not found."""
    section: list[str] = []
    for number, text in enumerate(lines, 1):
        bare = text.partition("#")[0].strip()
        if header := re.fullmatch(r"\[+\s*([^\[\]]+?)\s*\]+", bare):
            section = [part.strip(" \"'") for part in header[1].split(".")]
            if section == path:
                return number
        elif "=" in bare:
            own = [part.strip(" \"'") for part in bare.partition("=")[0].split(".")]
            if section + own == path[: len(section) + len(own)]:
                return number
    return 0
