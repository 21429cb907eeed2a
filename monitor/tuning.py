"""The settings in force, where each came from, and who is told when they change.

Three sources, later ones win key by key: profile and file (:mod:`monitor.settings`), and what was
set in flight over MAVLink. Every change takes the one way: all settings are put together anew and
handed to those who work by them, each of whom says what it took and what waits for a restart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from monitor.retune import Retuned, Taker, differing, value_of, with_values
from monitor.settings import Settings, SettingsError

__all__ = ["Reloaded", "Tuning"]

_SILENT = ("profile", "learnt")
"""What says where values came from and is none itself."""

_NAMED = 6
"""Keys that are named in a sentence; the others are counted."""


@dataclass(frozen=True, slots=True)
class Reloaded:
    """What came of reading the configuration again.

    Attributes
    ----------
    retuned
        Keys taken and waiting; none of either where the file could not be used.
    sentence
        The same for an operator, in one sentence.
    failed
        The file could not be used, and nothing was changed.
    """

    retuned: Retuned
    sentence: str
    failed: bool = False


class Tuning:
    """Keeps the settings and changes them in flight.

    Parameters
    ----------
    base
        Settings of profile and file.
    takers
        ``retune`` of all who work by the settings; they were made with :attr:`settings`.
    own
        Dotted key -> value that was set over MAVLink before and kept. They must be valid.
    """

    def __init__(
        self, base: Settings, takers: Sequence[Taker] = (), own: Mapping[str, Any] | None = None
    ) -> None:
        self._base = base
        self._own = dict(own or {})
        self._settings = with_values(base, self._own)
        self._takers = list(takers)

    @property
    def settings(self) -> Settings:
        """The settings in force; of keys that wait for a restart the old values."""
        return self._settings

    @property
    def own(self) -> Mapping[str, Any]:
        """Dotted key -> value that was set over MAVLink and is in force over the file's."""
        return self._own

    def add(self, *takers: Taker) -> None:
        """Tell these of changes as well; they were made with :attr:`settings`."""
        self._takers += takers

    def get(self, key: str) -> Any:
        """Value of a dotted key that is in force."""
        return value_of(self._settings, key)

    def put(self, values: Mapping[str, Any]) -> Retuned:
        """Set dotted keys over the file's values; they must be valid.

        A value that is the file's own is nothing set: the key follows the file again.
        """
        for key, value in values.items():
            if value == value_of(self._base, key):
                self._own.pop(key, None)
            else:
                self._own[key] = value
        return self._tell()

    def reset(self) -> Retuned:
        """Go back to the file's values."""
        self._own.clear()
        return self._tell()

    def reload(self, read: Callable[[], Settings], source: str = "configuration") -> Reloaded:
        """Take a configuration that was changed; what was set over MAVLink stays over it.

        Parameters
        ----------
        read
            Gives the new settings of profile and file; a SettingsError leaves all as it is.
        source
            What was read, for the sentence.
        """
        try:
            base = read()
        except SettingsError as error:
            return Reloaded(Retuned(), f"{error}; nothing was changed", failed=True)
        self._base = base
        done = self._tell()
        return Reloaded(done, _sentence(source, done, self._hidden()))

    def _tell(self) -> Retuned:
        """Hand the settings to everybody; what nobody takes waits."""
        wanted = with_values(self._base, self._own)
        changed = [
            key for key in differing(self._settings, wanted) if key.partition(".")[0] not in _SILENT
        ]
        for key in _SILENT:
            self._settings = with_values(self._settings, {key: getattr(wanted, key)})
        if not changed:
            return Retuned()
        told = sum((take(wanted) for take in self._takers), Retuned())
        waiting = set(told.waiting)
        taken = tuple(k for k in changed if k in told.taken and k not in waiting)
        self._settings = with_values(self._settings, {key: value_of(wanted, key) for key in taken})
        return Retuned(taken, tuple(k for k in changed if k not in taken))

    def _hidden(self) -> tuple[str, ...]:
        """Keys whose value in the file does not count."""
        return tuple(sorted(self._own))


def _sentence(source: str, done: Retuned, hidden: tuple[str, ...]) -> str:
    parts = []
    if done.taken:
        parts.append(f"taken: {_some(done.taken)}")
    if done.waiting:
        verb = "waits" if len(done.waiting) == 1 else "wait"
        parts.append(f"{verb} for a restart: {_some(done.waiting)}")
    if not parts:
        parts.append("nothing changed")
    if hidden:
        parts.append(f"set over MAVLink and kept: {_some(hidden)}")
    return f"{source} read again; " + "; ".join(parts)


def _some(keys: Iterable[str]) -> str:
    named = list(keys)
    more = len(named) - _NAMED
    return ", ".join(named[:_NAMED]) + (f" and {more} more" if more > 0 else "")
