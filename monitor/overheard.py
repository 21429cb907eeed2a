"""One monitor's words of a log, heard again: when it said of which sensor that it is faulty.

Masks come twice a second for hours, so they are compared as arrays, and only those that tell
something new are looked at one by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from links.samples import WORD, Rows
from links.vocabulary import State
from monitor.announce import understood
from monitor.masks import ENGINES, FAULT, MONITORED, SENSORS

__all__ = ["NAMES", "SILENT_US", "Episode", "Overheard"]

Ints = NDArray[np.int64]

SILENT_US: Final = 10_000_000
"""No word for this long: the monitor, or its link to the log, was silent [us]."""

LISTED: Final = 2_000
"""Episodes and silences of one monitor that are kept."""

_SAID_US = 5_000_000  # a text so long before its mask is of the same fault

_FLAGS: Final[Mapping[bytes, str]] = {
    **{(FAULT + mask).encode(): mask for mask in SENSORS},
    ENGINES.encode(): ENGINES,
}
_JUDGED: Final = {(MONITORED + mask).encode(): mask for mask in SENSORS}
_BITS: Final = {**SENSORS, ENGINES: {i: f"engine{i}" for i in range(24)}}
_MASK_OF: Final = {sensor: mask for mask, bits in _BITS.items() for sensor in bits.values()}
NAMES: Final = np.array([b"", *_FLAGS, *_JUDGED], WORD["name"])
"""Names of a monitor's masks, and the empty one of a text."""


@dataclass(slots=True)
class Episode:
    """A sensor was said to be faulty, or an engine to have stopped.

    Attributes
    ----------
    from_us, to_us
        First word that says so, and first that takes it back; None while it stands [us].
    standing
        It stood already when the monitor was first heard, or heard again: it began earlier.
    said
        The text that was sent of it.
    """

    sensor: str
    state: State
    from_us: int
    to_us: int | None = None
    standing: bool = False
    said: str = ""


@dataclass(slots=True)
class Overheard:
    """One sender's words so far.

    Attributes
    ----------
    masks
        Name of a mask -> when it was heard last [us], and its bits.
    awaited
        Groups whose flags changed and of which no ``MON_`` mask was heard since.
    open
        Sensor -> its episode that has not ended.
    withdrawn
        Sensor -> when its flag was taken back [us], until the sensor is judged; None once it was
        said not to be judged.
    texts
        Sensor -> when it was said to be faulty in a text, and the text.
    """

    first_us: int
    last_us: int
    words: int = 0
    understood: bool = False
    left_out: int = 0
    silences: list[tuple[int, int]] = field(default_factory=list)
    masks: dict[bytes, tuple[int, int]] = field(default_factory=dict)
    awaited: set[str] = field(default_factory=set)
    episodes: list[Episode] = field(default_factory=list)
    open: dict[str, Episode] = field(default_factory=dict)
    withdrawn: dict[str, int | None] = field(default_factory=dict)
    texts: dict[str, tuple[int, str]] = field(default_factory=dict)

    # ------------------------------------------------------------------ words

    def hear(self, words: Rows) -> None:
        """Take words in the order of their arrival, masks and texts."""
        t_us = words["t_us"]
        steps = np.diff(t_us, prepend=self.last_us)
        for k in np.flatnonzero(steps > SILENT_US).tolist():
            self._keep(self.silences, (int(t_us[k] - steps[k]), int(t_us[k])))
        self.words += len(words)
        self.last_us = max(self.last_us, int(t_us.max()))
        index, late = self._telling(words)
        for word, first in zip(words[index], late.tolist(), strict=True):
            name, at_us = bytes(word["name"]), int(word["t_us"])
            if name in _FLAGS:
                self._hear_flags(_FLAGS[name], int(word["value"]), at_us, first)
            elif name in _JUDGED:
                self._hear_judged(_JUDGED[name], int(word["value"]), at_us)
            else:
                self._hear_text(bytes(word["text"]).decode("utf-8", "replace"), at_us)

    def _telling(self, words: Rows) -> tuple[Ints, NDArray[np.bool_]]:
        """Words that tell something new, and whether each is the first of its name for long.

        All texts, each mask that changed or was not heard for long, and the first ``MON_`` after
        flags that did. Masks come twice a second for hours: the others are not looked at singly.
        """
        texts = np.flatnonzero(words["name"] == b"")
        parts, lates = [texts], [np.zeros(len(texts), np.bool_)]
        for mask, sensors in _BITS.items():
            changed = np.empty(0, np.int64)
            for name in (FAULT + mask, MONITORED + mask) if mask in SENSORS else (mask,):
                index = _masks(words, name.encode(), sensors)
                if not len(index):
                    continue
                tell, late = self._changes(words, index, name.encode())
                if name.startswith(MONITORED):
                    if mask in self.awaited:
                        self.awaited.discard(mask)
                        tell[0] = True
                    after = np.searchsorted(index, changed)
                    tell[after[after < len(index)]] = True
                    changed = changed[after == len(index)]
                else:
                    changed = index[tell]
                parts.append(index[tell])
                lates.append(late[tell])
            if len(changed):
                self.awaited.add(mask)
        index, late = np.concatenate(parts), np.concatenate(lates)
        order = np.argsort(index)
        return index[order], late[order]

    def _changes(
        self, words: Rows, index: Ints, name: bytes
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Of the words ``index``, all of one mask: which tell something, which come after long."""
        t_us, bits = words["t_us"][index], words["value"][index].astype(np.int64)
        before_us, before = self.masks.get(name, (int(t_us[0]) - 2 * SILENT_US, 0))
        late: NDArray[np.bool_] = np.diff(t_us, prepend=before_us) > SILENT_US
        tell: NDArray[np.bool_] = late | (np.diff(bits, prepend=before) != 0)
        self.masks[name] = int(t_us[-1]), int(bits[-1])
        return tell, late

    def _hear_flags(self, mask: str, bits: int, t_us: int, late: bool) -> None:
        for bit, sensor in _BITS[mask].items():
            if bits >> bit & 1:
                self.withdrawn.pop(sensor, None)
                if sensor not in self.open:
                    state = State.STOPPED if mask == ENGINES else State.FAULTY
                    self._begin(sensor, state, t_us, standing=late)
            elif sensor in self.open:
                if mask == ENGINES:  # no mask tells whether an engine is judged
                    self._end(sensor, t_us)
                else:
                    self.withdrawn.setdefault(sensor, t_us)

    def _hear_judged(self, mask: str, bits: int, t_us: int) -> None:
        """A flag that was taken back is cleared if the sensor is judged, and stands until it is."""
        for bit, sensor in SENSORS[mask].items():
            if sensor not in self.withdrawn:
                continue
            if bits >> bit & 1:
                taken_back_us = self.withdrawn[sensor]
                self._end(sensor, t_us if taken_back_us is None else taken_back_us)
            else:
                self.withdrawn[sensor] = None

    def _hear_text(self, text: str, t_us: int) -> None:
        """Texts tell the cause; where no mask speaks of the sensor they tell all."""
        for sensor, state in understood(text).items():
            self.understood = True
            alarm = state in (State.FAULTY, State.STOPPED)
            masked = self._flags_of(_MASK_OF[sensor]) is not None
            if alarm and not masked and sensor not in self.open:
                self._begin(sensor, state, t_us)
            elif state is State.OK and not masked and sensor in self.open:
                self._end(sensor, t_us)
            if not alarm:
                continue
            episode = self.open.get(sensor)
            if episode is None:
                self.texts[sensor] = (t_us, text)
            elif not episode.said:
                episode.said = text

    def _flags_of(self, mask: str) -> tuple[int, int] | None:
        name = mask if mask == ENGINES else FAULT + mask
        return self.masks.get(name.encode())

    # ------------------------------------------------------------------ episodes

    def _begin(self, sensor: str, state: State, t_us: int, *, standing: bool = False) -> None:
        said_us, said = self.texts.pop(sensor, (t_us, ""))
        episode = Episode(sensor, state, t_us, standing=standing)
        episode.said = said if t_us - said_us <= _SAID_US else ""
        self.open[sensor] = episode
        self._keep(self.episodes, episode)

    def _end(self, sensor: str, t_us: int) -> None:
        self.withdrawn.pop(sensor, None)
        self.open.pop(sensor).to_us = t_us

    def _keep(self, kept: list[Any], what: Any) -> None:
        if len(kept) < LISTED:
            kept.append(what)
        else:
            self.left_out += 1

    # ------------------------------------------------------------------ what it was

    def believed(self, *, ours: bool) -> bool:
        """Whether this is a monitor, and no one who uses a name of ours by chance."""
        both = any(
            MONITORED.encode() + mask.encode() in self.masks and self._flags_of(mask) is not None
            for mask in SENSORS
        )
        return both or (ours and (self.understood or bool(self.masks)))

    def finish(self) -> list[Episode]:
        """All episodes; of a flag taken back last nothing more was said: it is cleared."""
        for sensor, t_us in list(self.withdrawn.items()):
            if t_us is not None:
                self._end(sensor, t_us)
        return self.episodes

    def heard(self, t_us: int) -> bool:
        """Whether a word stood in the log at that time or within :data:`SILENT_US` of it."""
        if not self.first_us - SILENT_US <= t_us <= self.last_us:
            return False
        return not any(a <= t_us and t_us + SILENT_US <= b for a, b in self.silences)


def _masks(words: Rows, name: bytes, sensors: Mapping[int, str]) -> Ints:
    """Indices of the words of this name whose value is a mask of these sensors."""
    index = np.flatnonzero(words["name"] == name)
    value = words["value"][index]
    every = sum(1 << bit for bit in sensors)
    whole = (value >= 0) & (value <= every) & (np.floor(value) == value)
    index, value = index[whole], value[whole]
    known: NDArray[np.bool_] = (value.astype(np.int64) & ~every) == 0
    return np.asarray(index[known])
