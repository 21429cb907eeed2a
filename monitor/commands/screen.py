"""How ``mavsentry run`` shows what it sees: a live table, lines, or JSON lines."""

from __future__ import annotations

import json
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING

from monitor.commands.common import note
from monitor.commands.showing import as_json, finite, lines, state_table
from monitor.daemon import Status
from monitor.verdict import Verdict

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

__all__ = ["Show", "output", "tell_status"]

Show = Callable[[list[Verdict], Mapping[str, Verdict], Callable[[], Status]], None]
"""Shows the changes of one turn; the states and the loop's status are asked for when drawn."""

REDRAW_S = 0.25
CHANGES_KEPT = 8


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


def tell_status(status: Status, json_lines: bool, stopped: bool = False) -> None:
    """Say how the loop is doing: a sentence on standard error, or a line of JSON among the rest."""
    if json_lines:
        values = {key: finite(value) for key, value in asdict(status).items() if key != "latency"}
        values["latency"] = {k: finite(v) for k, v in asdict(status.latency).items()}
        print(json.dumps({"status": values}), flush=True)
    else:
        note(f"mavsentry: {'stopped; ' if stopped else ''}{status_line(status)}")


@contextmanager
def output(json_lines: bool, title: str) -> Iterator[Show]:
    """What fits: JSON lines if asked for, a live table on a terminal, else a line per change."""
    if json_lines:
        yield _show_json
    elif sys.stdout.isatty():
        with _Screen(title) as screen:
            yield screen.show
    else:
        yield _show_lines


def _show_json(
    verdicts: list[Verdict], states: Mapping[str, Verdict], status: Callable[[], Status]
) -> None:
    for verdict in verdicts:
        print(json.dumps(as_json(verdict)), flush=True)


def _show_lines(
    verdicts: list[Verdict], states: Mapping[str, Verdict], status: Callable[[], Status]
) -> None:
    for text in lines(verdicts):
        print(text, flush=True)


class _Screen:
    """A table of all states above the newest changes, redrawn a few times a second."""

    def __init__(self, title: str) -> None:
        from rich.live import Live

        self._title = title
        self._changes: deque[str] = deque(maxlen=CHANGES_KEPT)
        self._drawn_s = 0.0
        self._live: Live = Live(auto_refresh=False, vertical_overflow="crop")

    def __enter__(self) -> _Screen:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(
        self,
        verdicts: list[Verdict],
        states: Mapping[str, Verdict],
        status: Callable[[], Status],
    ) -> None:
        self._changes.extend(lines(verdicts))
        now_s = time.monotonic()
        if not verdicts and now_s - self._drawn_s < REDRAW_S:
            return
        self._drawn_s = now_s
        self._live.update(self._picture(states, status()), refresh=True)

    def _picture(self, states: Mapping[str, Verdict], status: Status) -> RenderableType:
        from rich.console import Group
        from rich.text import Text

        head = Text(status_line(status), style="bold magenta" if status.silent else "dim")
        newest = [Text(change, no_wrap=True, overflow="ellipsis") for change in self._changes]
        return Group(state_table(states, f"mavsentry on {self._title}"), *newest, head)
