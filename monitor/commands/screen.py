"""How ``mavsentry run`` shows what it sees: a live screen, lines, or JSON lines."""

from __future__ import annotations

import io
import json
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from monitor.commands.board import Board, Rates, View
from monitor.commands.common import note
from monitor.commands.showing import as_json, finite, lines
from monitor.daemon import Status
from monitor.verdict import StepResult, Verdict

if TYPE_CHECKING:
    import numpy as np
    from rich.console import Console

__all__ = ["Beside", "Screen", "Show", "output", "status_facts", "status_line", "tell_status"]

Show = Callable[[StepResult, Mapping[str, Verdict], Callable[[], Status]], None]
"""Shows what one turn gave; the states and the loop's status are asked for when drawn."""

Beside = Callable[[], Sequence[str]]
"""Gives further facts for the screen's last line, when it is drawn."""

REDRAW_S = 0.5
"""Longest that the screen stays as it is; a change of state is drawn at once."""

RATE_OVER_S = 2.0
"""Rates are counted over about this long."""

CHANGES_KEPT = 100


def status_line(status: Status) -> str:
    """How the loop is doing, in one line."""
    if status.t_us is None:
        return "nothing heard of a vehicle yet"
    latency = status.latency
    took = (
        f", latency median {latency.median_ms:.1f} ms, p99 {latency.p99_ms:.1f} ms"
        f" over {latency.count} answers"
        if latency.count
        else ""
    )
    silent = ", LINK SILENT" if status.silent else ""
    return (
        f"vehicle time {status.t_us / 1e6:.1f} s{silent}, {status.datagrams} datagrams, "
        f"{status.rows} samples, {status.sent} messages sent{took}"
    )


def status_facts(status: Status) -> dict[str, Any]:
    """How the loop is doing, as JSON values."""
    values = {key: finite(value) for key, value in asdict(status).items() if key != "latency"}
    values["latency"] = {k: finite(v) for k, v in asdict(status.latency).items()}
    return values


def tell_status(status: Status, json_lines: bool, stopped: bool = False) -> None:
    """Say how the loop is doing: a sentence on standard error, or a line of JSON among the rest."""
    if json_lines:
        print(json.dumps({"status": status_facts(status)}), flush=True)
    else:
        note(f"mavsentry: {'stopped; ' if stopped else ''}{status_line(status)}")


@contextmanager
def output(json_lines: bool, title: str, beside: Beside = tuple) -> Iterator[Show]:
    """What fits: JSON lines if asked for, a live screen on a terminal, else a line per change.

    Parameters
    ----------
    title
        The link that is listened to.
    beside
        Further facts for the screen: the recording, the address of the live page.
    """
    if json_lines:
        yield _show_json
        return
    from rich.console import Console

    console = Console(highlight=False)
    if console.is_terminal and not console.is_dumb_terminal:
        with Screen(console, title, beside) as screen:
            yield screen.show
    else:
        yield _show_lines


def _show_json(
    result: StepResult, states: Mapping[str, Verdict], status: Callable[[], Status]
) -> None:
    for verdict in result.verdicts:
        print(json.dumps(as_json(verdict)), flush=True)


def _show_lines(
    result: StepResult, states: Mapping[str, Verdict], status: Callable[[], Status]
) -> None:
    for text in lines(result.verdicts):
        print(text, flush=True)


class _Lines(io.TextIOBase):
    """A stream whose lines are handed on whole."""

    def __init__(self, take: Callable[[str], None]) -> None:
        super().__init__()
        self._take = take
        self._rest = ""

    def write(self, text: str) -> int:
        *whole, self._rest = (self._rest + text).split("\n")
        for line in whole:
            self._take(line)
        return len(text)


class Screen:
    """All states, the newest changes and the link, redrawn a few times a second.

    It is drawn on the terminal's other page, so that a window that changes its size leaves no
    scraps; at the end the last of it is printed where the command was given. What is said on
    standard error meanwhile would be drawn over: it is kept, and said at the end.

    Parameters
    ----------
    console
        A terminal.
    title
        The link that is listened to.
    beside
        Further facts for the last line.
    """

    def __init__(self, console: Console, title: str, beside: Beside = tuple) -> None:
        from rich.live import Live

        self._console = console
        self._live = Live(
            console=console,
            screen=True,
            auto_refresh=False,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._notes: deque[str] = deque(maxlen=CHANGES_KEPT)
        self._stderr = redirect_stderr(_Lines(self._take_note))
        self._title = title
        self._beside = beside
        self._changes: deque[str] = deque(maxlen=CHANGES_KEPT)
        self._newest: dict[str, np.void] = {}
        self._counts: deque[tuple[float, Status]] = deque()
        self._drawn_s = -REDRAW_S
        self._asked: tuple[Mapping[str, Verdict], Callable[[], Status]] | None = None

    def __enter__(self) -> Screen:
        self._live.start()
        self._stderr.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._stderr.__exit__(None, None, None)
        self._live.stop()
        if self._asked is not None:
            self._console.print(Board(self._look(*self._asked), whole=True))
        for text in self._notes:
            note(text)

    def _take_note(self, text: str) -> None:
        """A line for standard error: it stands among the changes, and is said again at the end."""
        self._changes.append(text)
        self._notes.append(text)

    def show(
        self,
        result: StepResult,
        states: Mapping[str, Verdict],
        status: Callable[[], Status],
    ) -> None:
        """Take what one turn gave; draw if something changed or it was long ago."""
        self._changes.extend(lines(result.verdicts))
        for name, rows in result.estimates.items():
            if len(rows):
                self._newest[name] = rows[-1]
        self._asked = states, status
        now_s = time.monotonic()
        if result.verdicts or now_s - self._drawn_s >= REDRAW_S:
            self._drawn_s = now_s
            self._live.update(Board(self._look(states, status)), refresh=True)

    def _look(self, states: Mapping[str, Verdict], status: Callable[[], Status]) -> View:
        """What there is to show now."""
        now = status()
        rates = self._rates(time.monotonic(), now)
        beside, changes = tuple(self._beside()), tuple(self._changes)
        return View(self._title, states, now, self._newest, changes, rates, beside)

    def _rates(self, now_s: float, now: Status) -> Rates:
        """Per second, since about :data:`RATE_OVER_S` ago."""
        counts = self._counts
        counts.append((now_s, now))
        while len(counts) > 2 and now_s - counts[1][0] >= RATE_OVER_S:
            counts.popleft()
        then_s, then = counts[0]
        took_s = now_s - then_s
        if took_s < 0.5 * REDRAW_S:
            return Rates()
        return Rates(
            (now.datagrams - then.datagrams) / took_s,
            (now.rows - then.rows) / took_s,
            (now.sent - then.sent) / took_s,
        )
