"""The MAVLink parameter protocol: a ground station reads and changes our tunables in flight.

A PARAM_SET is checked at once, takes effect with the next :meth:`Parameters.due` (several together,
a few times a second), and is echoed with the value that is then in force: the old one where it was
refused. Values leave at a limited rate. What waits to be sent is a set of names and a place in the
list per link, so that no number of requests makes it grow.

Source: mavlink.io/en/services/parameter.html.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

from links.mavlink.heard import Heard
from monitor.component.about import CAPABILITY
from monitor.component.identity import Identity
from monitor.component.parameter_file import ParameterFile
from monitor.component.tunables import RESET, TUNABLES, Refusal, RefusedValue, Tunable
from monitor.publish import Message
from monitor.settings.component import ComponentSettings
from monitor.tuning import Tuning

__all__ = ["Parameters"]

APPLY_US = 100_000
"""Least time between two changes of the settings: a storm of PARAM_SET costs ten a second."""

AT_ONCE = 10
"""Values that may leave together."""

LINKS_KEPT = 64
"""Links that lists are sent to at a time."""

_ARDUPILOT = 3
_WARNING, _NOTICE = 4, 5
_PARAMETERS: Final = (*TUNABLES, RESET)
_INDEX: Final = {tunable.name: i for i, tunable in enumerate(_PARAMETERS)}
_BY_KEY: Final = {tunable.key: tunable for tunable in TUNABLES}


class Parameters:
    """Answers PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET of our own component.

    Parameters
    ----------
    settings
        Of the component section.
    identity
        Who we are; the autopilot tells the encoding.
    tuning
        Holds the settings in force and changes them.
    flying
        Whether the aircraft flies: some parameters are then locked.
    keep
        Keeps what was set; None forgets it at the end.

    Attributes
    ----------
    refused
        Why -> PARAM_SET that were refused, count.
    """

    def __init__(
        self,
        settings: ComponentSettings,
        identity: Identity,
        tuning: Tuning,
        flying: Callable[[], bool] = lambda: False,
        keep: ParameterFile | None = None,
    ) -> None:
        self._settings = settings
        self._identity = identity
        self._tuning = tuning
        self._flying = flying
        self._keep = keep
        self._wanted: dict[str, Any] = {}
        self._reset = False
        self._echoes: dict[tuple[str, int | None], None] = {}
        self._lists: dict[int, tuple[int, int]] = {}
        self._listed = True
        self._allowed = float(AT_ONCE)
        self._paced_us: int | None = None
        self._applied_us: int | None = None
        self._told: dict[str, None] = {}
        self.refused: Counter[Refusal] = Counter()
        off = settings.parameters == "off"
        names = () if off else ("PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET")
        self.wants: frozenset[str] = frozenset(names)

    # ------------------------------------------------------------------ what holds

    @property
    def bytewise(self) -> bool:
        """Whether whole numbers travel as their bytes: with every autopilot but ArduPilot."""
        if self._settings.parameter_encoding != "auto":
            return self._settings.parameter_encoding == "bytewise"
        autopilot = self._identity.autopilot
        return autopilot is None or autopilot.kind != _ARDUPILOT

    @property
    def capabilities(self) -> int:
        """MAV_PROTOCOL_CAPABILITY bit of the encoding; none where there are no parameters."""
        if not self.wants:
            return 0
        return CAPABILITY["PARAM_ENCODE_BYTEWISE" if self.bytewise else "PARAM_ENCODE_C_CAST"]

    @property
    def notes(self) -> tuple[str, ...]:
        """What is muted, what was set over MAVLink, and that it could not be kept."""
        out = []
        muted = sorted(self._tuning.settings.mute.sensors)
        if muted:
            out.append(f"muted by the operator: {', '.join(muted)}")
        own = [_BY_KEY[key].name for key in self._tuning.own if key in _BY_KEY]
        own = sorted(name for name in own if not name.startswith("MUTE_"))
        if own:
            out.append(f"set over MAVLink: {', '.join(own)}")
        if self._keep is not None and self._keep.failure is not None:
            out.append(self._keep.failure)
        return tuple(out)

    # ------------------------------------------------------------------ service

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Take note of a request; what answers it leaves with :meth:`due`."""
        system = int(heard.fields["target_system"])
        component = int(heard.fields["target_component"])
        if not self._identity.addressed(system, component):
            return []
        if heard.name == "PARAM_REQUEST_LIST":
            self._list(heard.link)
        elif heard.name == "PARAM_REQUEST_READ":
            self._read(heard.fields, heard.link, to_all=component == 0)
        elif component != 0:  # a name of another component's may be one of ours
            self._set(heard.fields)
        return []

    def due(self, now_us: int) -> list[Message]:
        """Put into force what was set, and send what is owed, as fast as the rate allows."""
        self._apply(now_us)
        if self._paced_us is not None:
            gained = (now_us - self._paced_us) * 1e-6 * self._settings.parameter_hz
            self._allowed = min(self._allowed + max(gained, 0.0), float(AT_ONCE))
        self._paced_us = now_us
        out = [Message("STATUSTEXT", {"severity": _NOTICE, "text": text}) for text in self._told]
        if self._identity.address is None:
            return []
        self._told.clear()
        while self._allowed >= 1.0 and (self._echoes or self._lists):
            out.append(self._next())
            self._allowed -= 1.0
        return out

    def close(self, now_us: int) -> list[Message]:
        """Put into force and keep what was set last."""
        self._applied_us = None
        self._apply(now_us)
        if self._keep is not None:
            self._keep.close()
        return []

    # ------------------------------------------------------------------ requests

    def _list(self, link: int) -> None:
        """All of them, once from here on: a lap that is under way is prolonged, not begun anew."""
        begun = self._lists.get(link)
        if begun is None and len(self._lists) >= LINKS_KEPT:
            return
        self._lists[link] = (begun[0] if begun is not None else 0), len(_PARAMETERS)

    def _read(self, fields: Mapping[str, Any], link: int, *, to_all: bool) -> None:
        """One of them: by its index where one is given, which is ours alone; else by name."""
        index = int(fields["param_index"])
        if index >= 0:
            if index < len(_PARAMETERS) and not to_all:
                self._echoes[_PARAMETERS[index].name, link] = None
            return
        name = _name(fields["param_id"])
        if name in _INDEX:
            self._echoes[name, link] = None

    def _set(self, fields: Mapping[str, Any]) -> None:
        name = _name(fields["param_id"])
        try:
            tunable, value = self._judged(name, fields)
        except RefusedValue as error:
            self.refused[error.why] += 1
            if len(self._told) < AT_ONCE:
                shown = "".join(c if c.isprintable() and c.isascii() else "?" for c in name)
                self._told[f"MAVSENTRY: {shown}: {error.why}"] = None
            if name in _INDEX and _PARAMETERS[_INDEX[name]].key not in self._wanted:
                self._echoes[name, None] = None  # a change that waits is echoed when it is made
            return
        if tunable is RESET:
            self._reset = self._reset or bool(value)
            self._echoes[name, None] = None
        else:
            self._wanted[tunable.key] = value

    def _judged(self, name: str, fields: Mapping[str, Any]) -> tuple[Tunable, Any]:
        """A parameter and the value that it is to have."""
        if name not in _INDEX:
            raise RefusedValue(Refusal.UNKNOWN)
        if self._settings.parameters != "write":
            raise RefusedValue(Refusal.READ_ONLY)
        tunable = _PARAMETERS[_INDEX[name]]
        sent, kind = float(fields["param_value"]), int(fields["param_type"])
        settings = self._tuning.settings
        value = tunable.decode(sent, kind, bytewise=self.bytewise, settings=settings)
        if self._flying() and (tunable.on_ground or (tunable is RESET and self._locks_reset())):
            raise RefusedValue(Refusal.LOCKED)
        return tunable, value

    def _locks_reset(self) -> bool:
        """Whether to reset would change what is locked."""
        return any(tunable.on_ground and tunable.key in self._tuning.own for tunable in TUNABLES)

    # ------------------------------------------------------------------ answers

    def _apply(self, now_us: int) -> None:
        """Put into force what was asked for since the last time."""
        if not (self._wanted or self._reset):
            return
        if self._applied_us is not None and 0 <= now_us - self._applied_us < APPLY_US:
            return
        self._applied_us = now_us
        before = dict(self._tuning.own)
        if self._reset:
            self._tuning.reset()
            touched = [_BY_KEY[key].name for key in before if key in _BY_KEY]
            self._echoes.update(((name, None), None) for name in (RESET.name, *touched))
        if self._wanted:
            self._tuning.put(self._wanted)
            self._echoes.update(((_BY_KEY[key].name, None), None) for key in self._wanted)
        self._wanted, self._reset = {}, False
        if self._keep is not None and dict(self._tuning.own) != before:
            self._keep.offer(self._tuning.own)

    def _next(self) -> Message:
        """The next value owed: single ones and the lists by turns, of the lists each in turn."""
        self._listed = not self._listed
        if self._echoes and not (self._lists and self._listed):
            name, link = next(iter(self._echoes))
            del self._echoes[name, link]
            return self._value(_INDEX[name], link)
        link = next(iter(self._lists))
        at, left = self._lists.pop(link)
        if left > 1:
            self._lists[link] = (at + 1) % len(_PARAMETERS), left - 1
        return self._value(at, link)

    def _value(self, index: int, link: int | None) -> Message:
        """PARAM_VALUE of what is in force."""
        tunable = _PARAMETERS[index]
        value = self._tuning.get(tunable.key) if tunable is not RESET else 0
        fields = {
            "param_id": tunable.name,
            "param_value": tunable.encode(value, bytewise=self.bytewise),
            "param_type": int(tunable.type),
            "param_count": len(_PARAMETERS),
            "param_index": index,
        }
        return Message("PARAM_VALUE", fields, link)


def _name(text: Any) -> str:
    """``param_id`` as text: up to its end or 16 characters, whichever comes first."""
    if isinstance(text, bytes):
        text = text.decode("ascii", "replace")
    return str(text).partition("\0")[0][:16]
