"""Turns the loop until it is told to stop, and does what is asked for between two turns."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from monitor.commands.live.assembly import Running
    from monitor.commands.screen import Show
    from monitor.service import Notifier
    from monitor.verdict import StepResult

__all__ = ["Asks", "turn_until_stopped"]


class Asks(Protocol):
    """What is asked of the loop; see :class:`monitor.commands.live.signals.Signals`."""

    @property
    def stop(self) -> bool:
        """Whether to stop."""
        ...

    def listen(self) -> None:
        """The loop begins to look."""
        ...

    def take_reload(self) -> bool:
        """Whether to read the configuration anew."""
        ...

    def take_status(self) -> bool:
        """Whether to tell how the loop is doing."""
        ...


def turn_until_stopped(
    running: Running,
    asks: Asks,
    notifier: Notifier,
    show: Show,
    tell_status: Callable[[], None],
    reload: Callable[[], None],
) -> None:
    """Turn until asked to stop, or until the end of a log that is read.

    The service manager's watchdog is fed here and nowhere else: after a turn, all of it, worked.
    """
    daemon, now_us = running.daemon, running.now_us

    def use(result: StepResult) -> None:
        for look in running.looks:
            look(result)
        show(result, running.pipeline.states(), partial(daemon.status, recent=True))

    asks.listen()
    first = True
    while not asks.stop and not running.links.hub.ended:
        use(daemon.turn())
        running.checkpoints.turn(now_us())
        if asks.take_status():
            tell_status()
        if asks.take_reload():
            notifier.reloading()
            reload()
            notifier.ready()
        if first:
            first = False
            notifier.ready()
        notifier.turned(now_us())
    notifier.stopping()
    running.checkpoints.close()
    use(daemon.finish())
