"""The configuration as text: every key with meaning, unit, limits, and where its value came from.

``config init``, ``config show`` and the page docs/configuration.md all read the settings' own
definitions here, so that none of them can say something else.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from monitor.settings import PROFILES, Settings, load, origins
from monitor.toml import toml_value

__all__ = ["Key", "Layer", "commented", "keys_of", "layers_of", "near_keys", "sections_of"]

WRITTEN_BY_LEARN = "learnt"
"""Section that `mavsentry learn` writes, and nobody by hand."""

HEAD = """\
# mavsentry settings. Every key is shown with the value that the profile gives it; take the # from
# a key (and from nothing else) to set it. `mavsentry config check FILE` says what is wrong with a
# file, `mavsentry config show KEY --config FILE` explains one key.

profile = "{profile}"
"""

_COMPARED = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


class Key(NamedTuple):
    """One key of the configuration.

    Attributes
    ----------
    name
        Dotted: ``air.confirm_s``.
    meaning
        The description of the field.
    limits
        What values are taken: ``0.2 to 10``, ``above 0``; empty where any is.
    default
        Value of the class, before any profile.
    """

    name: str
    meaning: str
    limits: str
    default: Any

    @property
    def section(self) -> str:
        """Dotted name of its table; empty at the top."""
        return self.name.rpartition(".")[0]


class Layer(NamedTuple):
    """One place that may give a key its value.

    Attributes
    ----------
    origin
        ``default``, ``profile NAME``, the file, ``parameter``.
    value
        What it says; None where it says nothing.
    wins
        It is the one in force.
    """

    origin: str
    value: Any
    wins: bool


def keys_of(model: type[BaseModel] = Settings, prefix: str = "") -> Iterator[tuple[Key, str]]:
    """Every key with the first sentence about its section, a section's keys before those below."""
    below = []
    about = " ".join((model.__doc__ or "").split("\n\n")[0].split())
    for name, field in model.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            below.append((inner, f"{prefix}{name}."))
            continue
        default = field.get_default(call_default_factory=True)
        key = Key(prefix + name, field.description or "", _limits(field.metadata), default)
        yield key, about
    for inner, path in below:
        yield from keys_of(inner, path)


def _limits(metadata: list[Any]) -> str:
    """What pydantic's constraints allow, in words."""
    bounds: dict[str, Any] = {}
    for item in metadata:
        for name in _COMPARED:
            if (value := getattr(item, name, None)) is not None:
                bounds[name] = value
    if "ge" in bounds and "le" in bounds:
        return f"{bounds['ge']:g} to {bounds['le']:g}"
    return ", ".join(f"{_COMPARED[name]} {value:g}" for name, value in bounds.items())


def sections_of() -> dict[str, list[str]]:
    """Section -> its keys, dotted; the top-level keys stand under their own names."""
    found: dict[str, list[str]] = {}
    for key, _ in keys_of():
        found.setdefault(key.section or key.name, []).append(key.name)
    return found


def value_at(values: Any, dotted: str) -> Any:
    """Value of a key; None where there is none."""
    for part in dotted.split("."):
        if isinstance(values, BaseModel):
            values = getattr(values, part, None)
        elif isinstance(values, Mapping):
            values = values.get(part)
        else:
            return None
    return values


def layers_of(key: Key, profile: str | None, file: Path | None) -> list[Layer]:
    """What each layer says of a key, the last that says something wins.

    Raises
    ------
    SettingsError
        As of :func:`monitor.settings.load`.
    """
    settings = load(profile, file)
    origin = origins(profile, file)
    came_from = origin.get(key.name) or next(
        (o for k, o in origin.items() if k.startswith(f"{key.name}.")), "default"
    )
    base = value_at(load(settings.profile), key.name)
    layers = [Layer("default", key.default, came_from == "default")]
    by_profile = f"profile {settings.profile}"
    if base != key.default or came_from == by_profile:
        layers.append(Layer(by_profile, base, came_from == by_profile))
    if came_from not in ("default", by_profile):
        layers.append(Layer(came_from, value_at(settings, key.name), True))
    return layers


def near_keys(typed: str) -> list[str]:
    """Keys that somebody may have meant, best first."""
    import difflib

    names = [key.name for key, _ in keys_of()]
    last = typed.rpartition(".")[2]
    same = [name for name in names if name.rpartition(".")[2] == last]
    return same or difflib.get_close_matches(typed, [*names, *sections_of()], n=1, cutoff=0.5)


def commented(settings: Settings) -> str:
    """A file with every key, its meaning and its value, all commented out but the profile."""
    lines = [HEAD.format(profile=settings.profile)]
    section = ""
    for key, about in keys_of():
        if key.section.partition(".")[0] == WRITTEN_BY_LEARN or key.name == "profile":
            continue
        if key.section != section:
            section = key.section
            lines.append(f"\n[{section}]  # {about}\n")
        lines += [
            f"# {text}\n"
            for text in textwrap.wrap(_told(key, settings), 92, break_on_hyphens=False)
        ]
        value = value_at(settings, key.name)
        value = value.model_dump() if isinstance(value, BaseModel) else value
        lines.append(f"# {key.name.rpartition('.')[2]} = {toml_value(value)}\n")
    return "".join(lines)


def _told(key: Key, settings: Settings) -> str:
    """Meaning, limits, and the default where the profile has another value."""
    facts = [key.limits] if key.limits else []
    if value_at(settings, key.name) != key.default:
        facts.append(f"without the profile {toml_value(key.default)}")
    return f"{key.meaning} ({'; '.join(facts)})" if facts else key.meaning


def profiles_of(key: Key) -> dict[str, Any]:
    """Profile -> its value of this key, of profiles that have another than the default."""
    found = {name: value_at(load(name), key.name) for name in PROFILES}
    return {name: value for name, value in found.items() if value != key.default}
