"""Turns the loop until it is told to stop: signals, and what happens beside each turn."""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from monitor.commands.live.assembly import Running
    from monitor.commands.screen import Show

__all__ = ["STOP", "TELL", "turn_until_stopped"]

STOP = {signal.SIGINT, signal.SIGTERM}
TELL = {signal.SIGUSR1} if hasattr(signal, "SIGUSR1") else set()


def turn_until_stopped(running: Running, show: Show, tell: Callable[..., None]) -> None:
    """Turn until SIGINT, SIGTERM or the end of a file; SIGUSR1 tells how the loop is doing."""
    daemon, pipeline = running.daemon, running.pipeline
    recent = partial(daemon.status, recent=True)
    asked: set[int] = set()
    for number in (*STOP, *TELL):
        signal.signal(number, lambda received, frame: asked.add(received))
    while asked.isdisjoint(STOP) and not running.links.hub.ended:
        result = daemon.turn()
        for look in running.looks:
            look(result)
        show(result, pipeline.states(), recent)
        if not asked.isdisjoint(TELL):
            asked -= TELL
            tell(daemon.status())
    result = daemon.finish()
    for look in running.looks:
        look(result)
    show(result, pipeline.states(), recent)
