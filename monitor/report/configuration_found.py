"""With what settings a flight was judged: changed keys, thresholds in force, what was learnt."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

from pydantic import BaseModel

from monitor.columns import unit_of
from monitor.learn.rules import RULES
from monitor.report.wording import count
from monitor.settings import Settings, load

__all__ = ["Key", "changed_keys", "described", "learnt_from", "thresholds"]

_BRACKETS = re.compile(r"\s*\[([^\]]{1,24})\]")
_UNITS = {"1/min": "rpm", "1": "", "count": "", "logarithm": "ln", "m/s^2": "m/s²"}


@dataclass(frozen=True, slots=True)
class Key:
    """A key of the settings.

    Attributes
    ----------
    name
        Dotted, as in the configuration file.
    value, usual
        As they would be written in it: the value in force, and the profile's.
    unit
        Empty where it has none.
    meaning
        The setting's own description.
    learnt
        Whether the value was learnt from flights.
    """

    name: str
    value: str
    usual: str
    unit: str
    meaning: str
    learnt: bool = False

    @property
    def changed(self) -> bool:
        """Whether it differs from the profile."""
        return self.value != self.usual


def described(name: str) -> tuple[str, str]:
    """Unit and description of a dotted key; empty where it has none, or there is no such key.

    ``described("imu.acc_size_m_s2")[0] == "m/s^2"``. A channel's own table
    (``links.spools.spool0.source``) has the key of the table's kind.
    """
    model: Any = Settings
    parts = name.split(".")
    said = ""
    for part in parts:
        if not (isinstance(model, type) and issubclass(model, BaseModel)):
            inner = [a for a in get_args(model) if isinstance(a, type)]
            models = [a for a in inner if issubclass(a, BaseModel)]
            model = models[-1] if models else None
            continue  # the part is the table's own name, spool0
        field = model.model_fields.get(part)
        if field is None:
            return "", ""
        said, model = field.description or "", field.annotation
    # A unit in brackets stands in the description, others at the end of the name.
    if found := _BRACKETS.search(said):
        unit = found[1].split(", ")[-1]
        return _shown(unit), _BRACKETS.sub("", said, count=1)
    return _named_unit(parts[-1]), said


def _named_unit(key: str) -> str:
    for end, root in (("_sqrt_hz", "/√Hz"), ("_sqrt_s", "/√s")):
        if key.endswith(end):
            return _shown(unit_of(key.removesuffix(end))) + root
    for end, unit in (("_deg", "deg"), ("_sigma", "σ"), ("_sigmas", "σ"), ("_nats", "ln")):
        if key.endswith(end):
            return unit
    return _shown(unit_of(key))


def _shown(unit: str) -> str:
    return _UNITS.get(unit, unit)


def changed_keys(settings: Settings, changed: Mapping[str, Any]) -> list[Key]:
    """``made_by.changed`` of a summary, each key with what it means."""
    return [_key(name, value, settings) for name, value in changed.items()]


def thresholds(settings: Settings, quantities: Sequence[str]) -> list[Key]:
    """The thresholds in force, of the quantities in the log."""
    dump = settings.model_dump(mode="json")
    return [
        _key(rule.key, _at(dump, rule.key), settings)
        for rule in RULES
        if rule.quantity in quantities
    ]


def _key(name: str, value: Any, settings: Settings) -> Key:
    unit, meaning = described(name)
    usual = _at(_profile(settings.profile), name)
    learnt = name in settings.learnt.keys and bool(settings.learnt.logs)
    return Key(name, _written(value), _written(usual), unit, meaning, learnt)


@cache
def _profile(name: str) -> dict[str, Any]:
    return load(name).model_dump(mode="json")


def _at(values: Any, name: str) -> Any:
    for part in name.split("."):
        if not isinstance(values, Mapping) or part not in values:
            return None
        values = values[part]
    return values


def _written(value: Any) -> str:
    """A value as a configuration file has it; a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_written, value)) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k} = {_written(v)}" for k, v in value.items()) + "}"
    return str(value) or '""'


def learnt_from(settings: Settings, learnt: Mapping[str, Any] | None) -> list[str]:
    """What was learnt, from which flights, and what speaks against it; empty if nothing was."""
    own = settings.learnt
    if not own.logs:
        return []
    whose = f" of {own.airframe}" if own.airframe else ""
    names = ", ".join(log.name for log in own.logs[:6])
    more = f" and {len(own.logs) - 6} more" if len(own.logs) > 6 else ""
    lines = [
        f"{count(len(own.keys), 'value')} {'was' if len(own.keys) == 1 else 'were'} learnt from "
        f"{count(len(own.logs), 'healthy flight')}{whose}, {own.hours:.2f} h judged: {names}{more}."
    ]
    note = (learnt or {}).get("note")
    if note:
        lines.append(f"{note[0].upper()}{note[1:]}.")
    return lines
