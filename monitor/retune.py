"""New settings for what is already at work: what can be taken now, and what waits for a restart.

Whoever works by a section of the settings has a ``retune(settings)``: it takes the new values and
keeps its state. A key that its arrays were made with, or that it put into its state when that was
made, is *fixed* and waits. Keys that a validator holds against each other are fixed together, so
that a mixture of old and new values is as valid as the settings that it came from, and nothing is
taken by half.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from monitor.settings.base import Section

__all__ = ["Retuned", "Taker", "blend", "differing", "value_of", "with_values"]

S = TypeVar("S", bound=Section)


@dataclass(frozen=True, slots=True)
class Retuned:
    """What came of new settings.

    Attributes
    ----------
    taken
        Dotted keys whose new values are in force.
    waiting
        Dotted keys whose new values need a restart; the old ones stay in force.
    """

    taken: tuple[str, ...] = ()
    waiting: tuple[str, ...] = ()

    def __add__(self, other: Retuned) -> Retuned:
        return Retuned(self.taken + other.taken, self.waiting + other.waiting)

    def under(self, section: str) -> Retuned:
        """The same with the keys of a section as keys of all settings."""
        return Retuned(
            tuple(f"{section}.{key}" for key in self.taken),
            tuple(f"{section}.{key}" for key in self.waiting),
        )


Taker = Callable[[Any], Retuned]
"""``retune`` of one who works by the settings: all of them in, dotted keys out."""


def differing(old: Section, new: Section) -> tuple[str, ...]:
    """Dotted keys in which two sections of a kind differ; a table of free names is one key."""
    return tuple(_differing(old, new, ""))


def _differing(old: Section, new: Section, prefix: str) -> Iterator[str]:
    for key in type(old).model_fields:
        was, now = getattr(old, key), getattr(new, key)
        if isinstance(was, Section) and type(was) is type(now):
            yield from _differing(was, now, f"{prefix}{key}.")
        elif was != now:
            yield prefix + key


def blend(old: S, new: S, fixed: Collection[str] = ()) -> tuple[S, Retuned]:
    """The old section with those new values that can be taken.

    Parameters
    ----------
    old, new
        Sections of a kind.
    fixed
        Keys that wait; one that names a subsection means all of it.
    """
    taken: list[str] = []
    waiting: list[str] = []
    for key in differing(old, new):
        waits = any(key == name or key.startswith(f"{name}.") for name in fixed)
        (waiting if waits else taken).append(key)
    mixed = with_values(old, {key: value_of(new, key) for key in taken})
    return mixed, Retuned(tuple(taken), tuple(waiting))


def value_of(section: Section, key: str) -> Any:
    """Value of a dotted key."""
    value: Any = section
    for part in key.split("."):
        value = getattr(value, part)
    return value


def with_values(section: S, values: Mapping[str, Any]) -> S:
    """A copy with other values at dotted keys; they must be valid, nothing is checked again."""
    update: dict[str, Any] = {}
    for name, below in _grouped(values.items()).items():
        if "" in below:
            update[name] = below[""]
        else:
            update[name] = with_values(getattr(section, name), below)
    return section.model_copy(update=update) if update else section


def _grouped(items: Iterable[tuple[str, Any]]) -> dict[str, dict[str, Any]]:
    """First part of the keys -> rest of the key ("" where there is none) -> value."""
    out: dict[str, dict[str, Any]] = {}
    for key, value in items:
        first, _, rest = key.partition(".")
        out.setdefault(first, {})[rest] = value
    return out
