"""What a monitor said in flight, read back from the log, beside what the log's replay says.

A ``mavsentry`` that ran in flight published its masks and texts, and they stand in the flight's
log. A :class:`ReadBack` gathers them while the log is read, in memory that does not grow with it,
as *episodes*: a sensor was said to be faulty from here to there. As in the replay's own account an
episode ends when the sensor is judged sound again, not when it merely cannot be judged.

Who is a monitor: a component of the vehicle that sends ``FLT_`` and ``MON_`` masks as
:mod:`monitor.masks` has them; of our own component id one of them, or a text, is enough. What
other components send under other names, or values that are no masks, is passed over.

The time of a word is when it stood in the log. A fault is said after it was judged, by the
pipeline's horizon, so live is ordinarily later than replay by about that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import inf
from typing import Any, Final

import numpy as np

from links.samples import Rows
from links.vocabulary import State
from monitor.overheard import NAMES, Episode, Overheard

__all__ = ["Agreement", "ReadBack"]

TOGETHER_US: Final = 5_000_000
"""Live and replay this far apart are of one fault; so are two episodes of one sensor [us]."""

MONITORS: Final = 8
"""Monitors that are told apart."""

_ID: Final = 0xFF
"""Bits of a system id and of a component id."""


class Agreement(StrEnum):
    """How live and replay stand to each other."""

    BOTH = "both"
    LIVE_ONLY = "live only"
    REPLAY_ONLY = "replay only"
    NOT_HEARD = "not heard"
    """Replay only, and no word of the monitor stood in the log at that time."""


class ReadBack:
    """Gathers what monitors of a log said in flight.

    Parameters
    ----------
    own_component
        Our component id: whose words are believed by less, and taken as the sender where a log
        does not tell one.
    """

    def __init__(self, own_component: int) -> None:
        self._own = own_component
        self._monitors: dict[tuple[int, int], Overheard] = {}

    def add(self, words: Rows) -> None:
        """Take words as a log's batches give them: (n,) of :data:`links.samples.WORD`."""
        if not len(words):
            return
        possible = (words["system"] | words["component"]) & ~_ID == 0
        words = words[possible & np.isin(words["name"], NAMES)]
        component = np.where(words["component"] == 0, self._own, words["component"])
        sender = words["system"].astype(np.int64) << 8 | component
        for key in np.unique(sender).tolist():
            theirs = words[sender == key]
            who = key >> 8, key & _ID
            if who not in self._monitors:
                if len(self._monitors) == MONITORS:
                    continue
                first_us = int(theirs["t_us"][0])
                self._monitors[who] = Overheard(first_us, first_us)
            self._monitors[who].hear(theirs)

    def summary(
        self, system_id: int, first_us: int, replayed: Iterable[Mapping[str, Any]]
    ) -> dict[str, Any] | None:
        """``live`` of ``summary.json``; None where no monitor spoke.

        Parameters
        ----------
        system_id
            The vehicle's, 0 where the log does not tell it: monitors of others are left out.
        first_us
            Vehicle time from which the summary's seconds count [us].
        replayed
            The summary's faults and events.
        """
        replayed = list(replayed)
        found = {
            who: monitor
            for who, monitor in self._monitors.items()
            if monitor.believed(ours=who[1] == self._own)
            and (who[0] in (0, system_id) or not system_id)
        }
        if not found:
            return None

        def seconds(t_us: int) -> float:
            return round((t_us - first_us) / 1e6, 3)

        monitors = [
            {
                "component_id": who[1],
                "from_s": seconds(monitor.first_us),
                "to_s": seconds(monitor.last_us),
                "words": monitor.words,
                "silent": [{"from_s": seconds(a), "to_s": seconds(b)} for a, b in monitor.silences],
                "left_out": monitor.left_out,
            }
            for who, monitor in found.items()
        ]
        faults = [
            {"component_id": who[1], **line}
            for who, monitor in found.items()
            for line in _compare(monitor, replayed, first_us)
        ]
        return {"monitors": monitors, "faults": faults}


@dataclass(frozen=True, slots=True)
class _Span:
    """Live or in replay a fault stood from here to there [us]."""

    sensor: str
    state: str
    from_us: float
    to_us: float
    live: Episode | None = None


def _compare(
    monitor: Overheard, replayed: Iterable[Mapping[str, Any]], first_us: int
) -> list[dict[str, Any]]:
    """A line per fault, live and replayed spans of one sensor joined where they meet."""

    def us(t_s: float | None) -> float:
        return inf if t_s is None else first_us + t_s * 1e6

    def seconds(t_us: float) -> float | None:
        return None if t_us == inf else round((t_us - first_us) / 1e6, 3)

    spans = [
        _Span(e.sensor, e.state, e.from_us, inf if e.to_us is None else e.to_us, e)
        for e in monitor.finish()
    ]
    for entry in replayed:
        if "what" in entry:
            end = us(entry["ended_s"])
            spans.append(_Span(entry["what"], entry["state"], us(entry["detected_s"]), end))
        else:
            end = us(entry["cleared_s"])
            spans.append(_Span(entry["sensor"], State.FAULTY, us(entry["isolated_s"]), end))
    lines = []
    for group in _meeting(spans):
        live = [span for span in group if span.live is not None]
        again = [span for span in group if span.live is None]
        episode = live[0].live if live else None
        standing = episode is not None and episode.standing
        if live and again:
            agreement = Agreement.BOTH
        elif live:
            agreement = Agreement.LIVE_ONLY
        elif monitor.heard(int(again[0].from_us)):
            agreement = Agreement.REPLAY_ONLY
        else:
            agreement = Agreement.NOT_HEARD
        delay_us = live[0].from_us - again[0].from_us if live and again and not standing else inf
        lines.append(
            {
                "sensor": group[0].sensor,
                "state": str(group[0].state),
                "agreement": str(agreement),
                "live_s": seconds(live[0].from_us) if live else None,
                "live_cleared_s": seconds(max(s.to_us for s in live)) if live else None,
                "replay_s": seconds(again[0].from_us) if again else None,
                "replay_cleared_s": seconds(max(s.to_us for s in again)) if again else None,
                "delay_s": None if delay_us == inf else round(delay_us / 1e6, 3),
                "standing": standing,
                "said": None if episode is None or not episode.said else episode.said,
            }
        )
    return lines


def _meeting(spans: Iterable[_Span]) -> list[list[_Span]]:
    """Spans of one sensor and state that overlap, or nearly so, in groups; by their begin."""
    groups: dict[tuple[str, str], list[list[_Span]]] = {}
    ends: dict[tuple[str, str], float] = {}
    for span in sorted(spans, key=lambda s: s.from_us):
        key = span.sensor, str(span.state)
        if span.from_us <= ends.get(key, -inf) + TOGETHER_US:
            groups[key][-1].append(span)
            ends[key] = max(ends[key], span.to_us)
        else:
            groups.setdefault(key, []).append([span])
            ends[key] = span.to_us
    every = (group for of_sensor in groups.values() for group in of_sensor)
    return sorted(every, key=lambda group: group[0].from_us)
