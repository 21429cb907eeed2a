"""Changes of state as short texts for a pilot's screen: worded, rate-limited, folded.

A STATUSTEXT has fifty characters and a ground station shows (and speaks) every one, so a change
that a pilot cannot use is not announced (suspicion of one sensor, learning), and changes that come
faster than the rate allows are folded: one text names several sensors, and of one sensor only the
newest state. A sensor that goes back and forth is said a few times a minute at most, then with how
often it changed: ``airspeed0 FAULTY: 3.1 m/s low (x7)``.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import degrees, isfinite
from typing import ClassVar

from links.vocabulary import GYRO_ACC_AXES, Kind, Reason, State
from monitor.masks import mask_bit
from monitor.verdict import Verdict

__all__ = ["TEXT_MAX", "Announcer", "Text", "size_phrase", "understood", "wording"]

TEXT_MAX = 50
"""Characters of a STATUSTEXT that every ground station shows."""

TOGGLES, TOGGLES_US = 4, 60_000_000
"""Texts on one sensor within this host time after which its changes are held back and counted."""

_SEVERITY = {
    State.FAULTY: 2,
    State.STOPPED: 2,
    State.SUSPECT: 4,
    State.STALE: 4,
    State.UNMONITORED: 5,
    State.ABSENT: 5,
    State.OK: 5,
}
"""MAV_SEVERITY of a change to this state: critical, warning, notice."""

_FOLDED_HEAD = {
    State.FAULTY: "FAULTY",
    State.STOPPED: "STOPPED",
    State.STALE: "STALE",
    State.UNMONITORED: "not judged",
}

_ALARMS = frozenset({State.FAULTY, State.STOPPED, State.STALE})

_SHOWN_UNIT = {"rad": (degrees(1.0), "deg"), "rad/s": (degrees(1.0), "deg/s")}
"""SI unit -> (factor, unit) of a pilot's text; other units are shown as they are."""


@dataclass(frozen=True, slots=True)
class Text:
    """A STATUSTEXT to send: MAV_SEVERITY and at most :data:`TEXT_MAX` ASCII characters."""

    severity: int
    text: str


_ENGINE = re.compile(r"engine\d+")
_TIMES = re.compile(r" \(x\d+\)$")

_BY_KIND = frozenset({Kind.STUCK, Kind.NOISE, Kind.OSCILLATION, Kind.DROPOUT})
"""Kinds of which the size at one moment says little."""


def size_phrase(verdict: Verdict) -> str:
    """``"3.1 m/s low"``, or the fault's kind when that says more or the size is not known."""
    if verdict.kind in _BY_KIND or not isfinite(verdict.magnitude):
        return str(verdict.kind)
    factor, unit = _SHOWN_UNIT.get(verdict.unit, (1.0, verdict.unit))
    size = abs(verdict.magnitude) * factor
    return (
        f"{size:.{1 if size < 99.95 else 0}f} {unit} {'low' if verdict.magnitude < 0 else 'high'}"
    )


def wording(verdict: Verdict, t_us: int) -> str:
    """One sensor's change as a text of at most :data:`TEXT_MAX` characters.

    Parameters
    ----------
    verdict
        The new state.
    t_us
        Vehicle time now [us]: the age of a fault is counted from its onset to here.
    """
    sensor = verdict.sensor
    match verdict.state:
        case State.FAULTY:
            text = f"{sensor} FAULTY: {size_phrase(verdict)}"
            aged = f"{text}{_age(verdict, t_us)}"
            text = aged if len(aged) <= TEXT_MAX else text
        case State.STOPPED:
            text = f"{sensor} STOPPED: no power{_age(verdict, t_us)}"
        case State.STALE:
            text = f"{sensor} STALE: its data stopped"
        case State.OK:
            text = f"{sensor} ok"
        case State.UNMONITORED:
            text = f"{sensor} not judged: {verdict.reason}"
        case _:
            text = f"{sensor} {verdict.state}"
    return text[:TEXT_MAX]


def _age(verdict: Verdict, t_us: int) -> str:
    """``" since 12 s"``, from the onset to now; empty where no onset is known."""
    if verdict.onset_t_us is None:
        return ""
    return f" since {max(0, t_us - verdict.onset_t_us) // 1_000_000} s"


def _words(sensors: list[str]) -> list[str]:
    """Sensors as short as they can be told: an IMU by its name when all six axes are meant."""
    axes = {s: s.partition(".")[0] for s in sensors if s.partition(".")[2] in GYRO_ACC_AXES}
    counts = Counter(axes.values())
    words: list[str] = []
    for sensor in sorted(sensors):
        imu = axes.get(sensor)
        word = imu if imu is not None and counts[imu] == len(GYRO_ACC_AXES) else sensor
        if word not in words:
            words.append(word)
    return words


def _folded(state: State, sensors: list[str]) -> str:
    """Several sensors that took the same state in one text; what does not fit is counted."""
    text = _FOLDED_HEAD.get(state, str(state)) + ":"
    words = _words(sensors)
    last = ""
    for i, sensor in enumerate(words):
        group, _, axis = sensor.partition(".")
        word = f" .{axis}" if axis and group == last else f" {sensor}"
        left = len(words) - i - 1
        room = TEXT_MAX - (len(f" +{left}") if left else 0)
        if len(text) + len(word) > room:
            return f"{text} +{left + 1}"
        text += word
        last = group
    return text


_HEADS = {_FOLDED_HEAD.get(state, str(state)): state for state in State}


def understood(text: str) -> dict[str, State]:
    """Sensor -> state that a text says, as :func:`wording` and the folded texts put it.

    Of a text that is none of ours nothing is understood; words that name no sensor are passed over.
    """
    head, colon, rest = _TIMES.sub("", text).partition(":")
    if colon and head in _HEADS:
        return dict.fromkeys(_sensors(rest.split()), _HEADS[head])
    word, _, said = head.partition(" ")
    state = next((s for start, s in _HEADS.items() if said == start), None)
    return {} if state is None else dict.fromkeys(_sensors([word]), state)


def _sensors(words: Iterable[str]) -> Iterator[str]:
    """Sensors that words of a text mean: undoes :func:`_words` and the folding of axes."""
    group = ""
    for word in words:
        name = group + word if word.startswith(".") else word
        group = name.partition(".")[0]
        axes = [f"{name}.{axis}" for axis in GYRO_ACC_AXES]
        if mask_bit(name) is not None or _ENGINE.fullmatch(name):
            yield name
        elif mask_bit(axes[0]) is not None:
            yield from axes


def _disagreement(sensors: list[str]) -> str:
    """``"imu0/imu1 gyro_x disagree"``: sensors that contradict each other, none told wrong yet."""
    groups = dict.fromkeys(s.partition(".")[0] for s in sorted(sensors))
    axes = dict.fromkeys(s.partition(".")[2] for s in sorted(sensors))
    text = "/".join(groups)
    verb = "disagree" if len(groups) > 1 else "disagrees"  # the other one was said too often
    named = " ".join((text, *filter(None, axes))) + f" {verb}"
    return named if len(named) <= TEXT_MAX else f"{text} {verb} on {len(axes)} axes"[:TEXT_MAX]


class Announcer:
    """Chooses which changes are said, and when.

    Parameters
    ----------
    burst
        Texts that may go out at once after a quiet time.
    interval_s
        Least mean time between texts [s].
    """

    fleeting: ClassVar = ("_refilled_us", "_said_us", "_held")
    """Moments of the host's clock: see :mod:`monitor.checkpoint.graph`."""

    def __init__(self, burst: int, interval_s: float) -> None:
        self._burst = float(burst)
        self._interval_us = interval_s * 1e6
        self._tokens = float(burst)
        self._refilled_us: int | None = None
        self._waiting: dict[str, Verdict] = {}
        self._said: dict[str, State] = {}
        self._said_us: dict[str, deque[int]] = {}
        self._held: Counter[str] = Counter()

    def retune(self, burst: int, interval_s: float) -> None:
        """Take another pace; what was said and what waits is remembered."""
        self._burst, self._interval_us = float(burst), interval_s * 1e6
        self._tokens = min(self._tokens, self._burst)

    def note(self, verdict: Verdict) -> None:
        """Take a change of state; a newer one of the same sensor replaces one still waiting."""
        self._waiting.pop(verdict.sensor, None)
        if verdict.sensor in self._held:
            self._held[verdict.sensor] += verdict.state in _ALARMS or verdict.state is State.OK
        if self._worth_saying(verdict):
            self._waiting[verdict.sensor] = verdict

    def due(self, now_us: int, t_us: int) -> list[Text]:
        """Texts that may go out now; host time ``now_us`` paces, vehicle time ``t_us`` dates."""
        if self._refilled_us is not None:
            gained = (now_us - self._refilled_us) / self._interval_us
            self._tokens = min(self._burst, self._tokens + max(0.0, gained))
        self._refilled_us = now_us
        texts = []
        while self._tokens >= 1.0 and (ready := self._ready(now_us)):
            texts.append(self._next(ready, now_us, t_us))
            self._tokens -= 1.0
        return texts

    def _ready(self, now_us: int) -> dict[str, Verdict]:
        """What waits but for sensors that were said too often of late; those are held back."""
        ready = {}
        for sensor, verdict in self._waiting.items():
            said_us = self._said_us.get(sensor)
            often = said_us is not None and len(said_us) == TOGGLES
            if said_us is not None and often and now_us - said_us[0] < TOGGLES_US:
                if sensor not in self._held:
                    self._held[sensor] = 1
            else:
                ready[sensor] = verdict
        return ready

    def _worth_saying(self, verdict: Verdict) -> bool:
        """An alarm, its end, and the first time that a sensor is being watched."""
        said = self._said.get(verdict.sensor)
        if verdict.state in _ALARMS:
            return verdict.state != said
        if verdict.state is State.SUSPECT:
            return verdict.reason is Reason.SENSORS_DISAGREE and verdict.state != said
        if verdict.state is State.OK:
            return said is None or said is not State.OK
        return said in _ALARMS

    def _next(self, ready: dict[str, Verdict], now_us: int, t_us: int) -> Text:
        """Text on the gravest state that is ready: a fault alone in full, equal states folded."""
        gravest = min(ready.values(), key=lambda v: _SEVERITY.get(v.state, 6))
        state = gravest.state
        same = [s for s, v in ready.items() if v.state is state]
        # While the tokens suffice each fault is said in full: its size is worth a text.
        if state is State.FAULTY and len(ready) <= self._tokens:
            same = [gravest.sensor]
        if state is State.SUSPECT:
            text = _disagreement(same)
        elif len(same) == 1:
            text = wording(ready[same[0]], t_us)
        else:
            text = _folded(state, sorted(same))
        times = max(self._held.pop(sensor, 1) for sensor in same)
        for sensor in same:
            del self._waiting[sensor]
            self._said[sensor] = state
            self._said_us.setdefault(sensor, deque(maxlen=TOGGLES)).append(now_us)
        return Text(_SEVERITY.get(state, 6), _with_times(text, times))


def _with_times(text: str, times: int) -> str:
    """The text with how often its sensor changed since it was last said, if it did so often."""
    if times == 1:
        return text
    end = f" (x{times})"
    return text[: TEXT_MAX - len(end)].rstrip() + end
