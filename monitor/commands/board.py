"""The screen of ``mavsentry run``: what a pilot reads at a glance, in whatever room there is.

From top to bottom: one line that says how things stand, then the sensors, gravest first, each with
its state in a word, a mark and a colour; the newest changes; the link. What does not fit is left
out from the bottom of this list: changes first, then healthy sensors share a line, then evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Final

from links.vocabulary import GYRO_ACC_AXES, Kind, State
from monitor.announce import size_phrase
from monitor.commands.showing import STYLES, duration, true_value
from monitor.pages.palette import LOOKS
from monitor.verdict import Verdict

if TYPE_CHECKING:
    import numpy as np
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.text import Text

    from monitor.daemon import Status

__all__ = ["Board", "Rates", "View"]

GRAVEST: Final = (
    State.FAULTY,
    State.STOPPED,
    State.SUSPECT,
    State.STALE,
    State.UNMONITORED,
    State.OK,
    State.ABSENT,
)
"""States in the order in which a pilot wants to know of them."""

TOLD_ALONE: Final = frozenset(GRAVEST[:3])
"""States of which every axis is told by itself."""

LISTED: Final = frozenset({State.UNMONITORED, State.ABSENT})
"""States whose sensors share a line with all others of the same reason."""

ASCII_MARKS: Final = dict(zip(GRAVEST, "XX?~-+ ", strict=True))
"""Marks for a terminal that has no others."""

WIDE: Final = 90
"""Columns from which on evidence stands below what it explains, not below the sensor's name."""

EVIDENCE_LINES: Final = 3
CHANGES_WHOLE: Final = 22
"""Lines of a sensor's evidence; lines of changes on the last, unbounded picture."""


@dataclass(frozen=True, slots=True)
class Rates:
    """What comes in and goes out per second; NaN before it is known."""

    datagrams_s: float = float("nan")
    rows_s: float = float("nan")
    sent_s: float = float("nan")


@dataclass(frozen=True, slots=True)
class View:
    """Everything that is shown.

    Attributes
    ----------
    title
        The link that is listened to.
    states
        Sensor -> its standing verdict.
    newest
        Name of an estimate -> its newest row (dtypes in :mod:`monitor.verdict`).
    changes
        Newest changes of state as lines, oldest first.
    status, rates
        How the loop does.
    beside
        Further facts for the last line: the recording, the address of the live page.
    """

    title: str
    states: Mapping[str, Verdict]
    status: Status
    newest: Mapping[str, np.void] = field(default_factory=dict)
    changes: Sequence[str] = ()
    rates: Rates = Rates()
    beside: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class _Entry:
    """One line of the table: a sensor, or several that are told together."""

    name: str
    verdict: Verdict
    sensors: tuple[str, ...]


def _entries(states: Mapping[str, Verdict]) -> list[_Entry]:
    """Sensors gravest first; axes of one IMU in one state for one reason are one entry."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for sensor, verdict in sorted(states.items()):
        imu, _, axis = sensor.partition(".")
        together = axis in GYRO_ACC_AXES and verdict.state not in TOLD_ALONE
        key = (imu, str(verdict.state), str(verdict.reason)) if together else (sensor,)
        groups.setdefault(key, []).append(sensor)
    out = []
    for sensors in groups.values():
        newest = max((states[s] for s in sensors), key=lambda v: v.t_us)
        first, _, axis = sensors[0].partition(".")
        name = sensors[0] if len(sensors) == 1 else f"{first} {len(sensors)} axes"
        out.append(_Entry(name, newest, tuple(sensors)))
    return sorted(out, key=lambda e: (GRAVEST.index(e.verdict.state), e.name))


class Board:
    """A :class:`View` drawn into the room that a console has.

    Parameters
    ----------
    view
        What to show.
    whole
        Draw all of it however many lines that takes: for the last time, when nothing is drawn over.
    """

    def __init__(self, view: View, whole: bool = False) -> None:
        self._view = view
        self._whole = whole

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Lines for this width and height."""
        pen = _Pen(self._view, console, options.max_width, options.ascii_only)
        height = None if self._whole else (options.height or console.size.height)
        yield from pen.lines(height)


class _Pen:
    """Draws one view at one width."""

    def __init__(self, view: View, console: Console, width: int, ascii_only: bool) -> None:
        self._view = view
        self._console = console
        self._width = max(20, width)
        self._ascii = ascii_only
        self._dots = "..." if ascii_only else "…"
        self._t_us = view.status.t_us or 0
        self._entries = _entries(view.states)
        self._name_width = max((len(e.name) for e in self._entries), default=0)

    def lines(self, height: int | None) -> list[Text]:
        """All lines, at most ``height`` of them."""
        head, foot = [*self._head(), self._blank()], self._foot()
        if height is None:
            body = [*self._sensors(2, False), *self._changes(CHANGES_WHOLE)]
            return [*head, *body, self._blank(), *foot]
        foot = foot[: max(1, height // 8)]
        room = height - len(head) - len(foot) - 1
        for detail, folded in ((2, False), (2, True), (1, True), (0, True)):
            body = self._sensors(detail, folded)
            if len(body) <= room:
                body += self._changes(room - len(body))
                break
        else:
            body = [*body[: max(0, room - 1)], self._more(len(body) - max(0, room - 1))]
        return [*head, *body, self._blank(), *foot][:height]

    def _more(self, count: int) -> Text:
        from rich.text import Text

        return Text(f"  and {count} lines more that do not fit", style="dim")

    # -- the head -----------------------------------------------------------------------------

    def _head(self) -> list[Text]:
        from rich.text import Text

        status = self._view.status
        left = Text.assemble(("mavsentry", "bold"), " ", (self._view.title, "dim"))
        if status.t_us is not None:
            right = f"vehicle time {duration(status.t_us / 1e6)}"
            self._cut(left, max(9, self._width - len(right) - 2))
            left.append(" " * max(1, self._width - left.cell_len - len(right)))
            left.append(right, "dim")
        self._cut(left)
        return [left, self._banner()]

    def _banner(self) -> Text:
        """How things stand, in one line that a glance takes in."""
        from rich.text import Text

        said, style = self._summary()
        line = Text(f" {said}", style=style, no_wrap=True)
        self._cut(line)
        line.pad_right(self._width - line.cell_len)
        return line

    def _summary(self) -> tuple[str, str]:
        status, states = self._view.status, self._view.states
        if status.t_us is None:
            return "nothing heard of a vehicle yet", "bold reverse magenta"
        if status.silent:
            lasts = "" if status.silent_s is None else f" for {duration(status.silent_s)}"
            return f"LINK SILENT{lasts}: states are the last known", "bold reverse magenta"
        counts: dict[State, list[str]] = {state: [] for state in GRAVEST}
        for entry in self._entries:
            counts[entry.verdict.state].append(entry.name)
        grave = [
            f"{len(counts[state])} {state.upper()}: {', '.join(counts[state])}"
            for state in (State.FAULTY, State.STOPPED)
            if counts[state]
        ]
        if grave:
            return "; ".join(grave), "bold reverse red"
        doubtful = [
            f"{state}: {', '.join(counts[state])}"
            for state in (State.SUSPECT, State.STALE)
            if counts[state]
        ]
        if doubtful:
            return "; ".join(doubtful), "bold reverse yellow"
        fine = sum(v.state is State.OK for v in states.values())
        rest = sum(v.state is State.UNMONITORED for v in states.values())
        if fine:
            return f"all {fine} judged sensors ok" + (f", {rest} not judged" if rest else ""), (
                "bold green"
            )
        return "no sensor is judged now", "bold"

    # -- the sensors --------------------------------------------------------------------------

    def _sensors(self, detail: int, folded: bool) -> list[Text]:
        """Lines of the table.

        Parameters
        ----------
        detail
            Of what is wrong: 2 all of it, 1 one line each, 0 nothing beside the state.
        folded
            Sensors in any calm state share a line, not only those of :data:`LISTED`.
        """
        out: list[Text] = []
        shared: dict[tuple[State, str], list[str]] = {}
        for entry in self._entries:
            state = entry.verdict.state
            if state in LISTED or (folded and state not in TOLD_ALONE):
                words = shared.setdefault((state, str(entry.verdict.reason or "")), [])
                words.append(entry.name.replace(" 6 axes", ""))
            else:
                out += self._entry(entry, detail)
        for (state, reason), words in shared.items():
            line = self._state(state)
            line.append((f"{reason}: " if reason else "") + ", ".join(words))
            self._cut(line)
            out.append(line)
        return out

    def _state(self, state: State) -> Text:
        from rich.text import Text

        mark = ASCII_MARKS[state] if self._ascii else LOOKS[state].mark
        word = state.upper() if state in (State.FAULTY, State.STOPPED) else str(state)
        return Text.assemble((f"{mark} {word:<11}  ", STYLES[state]))

    def _entry(self, entry: _Entry, detail: int) -> list[Text]:
        """Lines of one sensor: state, name, for how long, and what is wrong."""
        from rich.text import Text

        verdict = entry.verdict
        since_us = verdict.t_us if verdict.onset_t_us is None else verdict.onset_t_us
        line = self._state(verdict.state)
        line.append(f"{entry.name:<{self._name_width}}", "bold")
        line.append(f" {duration((self._t_us - since_us) / 1e6):>7}")
        indent = line.cell_len + 2 if self._width >= WIDE else 4
        said, evidence = self._said(verdict)
        if line.cell_len + 2 + len(said) <= self._width:
            line.append(f"  {said}")
        else:
            evidence = f"{said}. {evidence}" if evidence else said
        line.rstrip()
        self._cut(line)
        if not evidence or not detail:
            return [line]
        room = self._width - indent
        wrapped = Text(evidence, style="dim").wrap(self._console, room)
        kept = list(wrapped)[: 1 if detail == 1 else EVIDENCE_LINES]
        if len(wrapped) > len(kept):
            kept[-1].rstrip()
            kept[-1].append(self._dots)
            self._cut(kept[-1], room)
        return [line, *(Text(" " * indent).append_text(text) for text in kept)]

    def _said(self, verdict: Verdict) -> tuple[str, str]:
        """What is wrong in a phrase, and the evidence for it."""
        if verdict.state is State.FAULTY:
            size = size_phrase(verdict)
            kind = "" if verdict.kind is Kind.UNKNOWN or str(verdict.kind) == size else verdict.kind
            newest = {} if self._view.status.silent else self._view.newest
            true = true_value(verdict.sensor, newest, self._t_us)
            parts = (size, str(kind), f"true {true}" if true else "")
            return ", ".join(filter(None, parts)), verdict.evidence
        evidence = verdict.evidence if verdict.state in TOLD_ALONE else ""
        return str(verdict.reason or ""), evidence

    # -- the rest -----------------------------------------------------------------------------

    def _changes(self, most: int) -> list[Text]:
        """The newest changes under a rule, in at most this many lines."""
        from rich.text import Text

        newest = self._view.changes[-(most - 2) :] if most >= 3 else ()
        if not newest:
            return []
        out = [self._blank(), Text("newest changes (vehicle time)", style="dim")]
        for change in newest:
            line = Text(change, no_wrap=True)
            self._cut(line)
            out.append(line)
        return out

    def _foot(self) -> list[Text]:
        """The link and what stands beside it, as many facts on a line as fit."""
        from rich.text import Text

        rates, latency = self._view.rates, self._view.status.latency
        facts = []
        if isfinite(rates.rows_s):
            facts.append(f"in {rates.datagrams_s:.0f} datagrams/s, {rates.rows_s:.0f} samples/s")
            facts.append(f"out {rates.sent_s:.0f}/s")
        if latency.count:
            facts.append(f"answers {latency.median_ms:.0f} ms (99 %: {latency.p99_ms:.0f} ms)")
        facts += self._view.beside
        between = " | " if self._ascii else " · "
        lines: list[str] = []
        for fact in facts:
            if lines and len(lines[-1]) + len(between) + len(fact) <= self._width:
                lines[-1] += between + fact
            else:
                lines.append(fact)
        out = [Text(text, style="dim", no_wrap=True) for text in lines]
        for text in out:
            self._cut(text)
        return out

    def _cut(self, text: Text, room: int | None = None) -> None:
        """Shorten to this many columns, the whole width without it, and say so by dots."""
        room = self._width if room is None else room
        if text.cell_len > room:
            text.truncate(room - len(self._dots))
            text.rstrip()
            text.append(self._dots)

    def _blank(self) -> Text:
        from rich.text import Text

        return Text("")
