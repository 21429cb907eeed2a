"""``run --web HOST:PORT``: puts the live page together, or says in a sentence why it cannot be."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from monitor.commands.common import Refused, note
from monitor.daemon import Host
from monitor.web.address import WebError, find_token, listen
from monitor.web.process import WebProcess

if TYPE_CHECKING:
    from links.mavlink import Counters
    from monitor.daemon import Daemon
    from monitor.pipeline import Pipeline
    from monitor.recorder import Recorder
    from monitor.settings import Settings
    from monitor.verdict import StepResult, Tap

__all__ = ["LivePage"]

_NEEDED: Final = ("tornado", "prometheus_client", "bokeh", "jinja2")


class LivePage:
    """Listens, and has the web process running; what it is to show comes with :meth:`begin`.

    Parameters
    ----------
    address
        ``HOST:PORT``.
    settings, source
        The daemon's settings and the link that it listens to.
    stack
        Closes it.

    Attributes
    ----------
    url
        Where a browser on this machine finds it.

    Raises
    ------
    Refused
        The extra is not installed, the address cannot be listened on, or the token not used.
    """

    def __init__(self, address: str, settings: Settings, source: str, stack: ExitStack) -> None:
        missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
        if missing:
            raise Refused(
                "--web serves a live page and metrics, which needs the extra web: "
                "pip install 'mavsentry[web]'"
            )
        self._settings, self._source = settings, source
        self._host = Host()
        here = settings.web
        try:
            listening = listen(address)
            stack.callback(listening.socket.close)
            token = find_token(here.token_file, os.environ, listening.loopback)
        except WebError as error:
            raise Refused(str(error)) from None
        self.url = listening.url
        setup = {
            "token": token.value if token else None,
            "hosts": [listening.host, *here.hosts],
            "port": listening.port,
            "viewers": here.viewers,
            "behind_s": here.behind_s,
            "history_s": here.history_s,
            "rate_hz": here.rate_hz,
        }
        self._process = WebProcess(listening, setup, lambda said: note(f"mavsentry: {said}"))
        stack.callback(self._process.close)
        self._process.ready(self._host.now_us())
        if token is None:
            note(f"mavsentry: live page on {listening.url}")
        else:
            note(f"mavsentry: live page on {listening.url}?token= and the token of {token.where}")
        from monitor.web.measured import Measured

        self._measured = Measured(settings.engine)

    @property
    def taps(self) -> Sequence[Tap]:
        """What the pipeline must show its rows to."""
        return (self._measured,)

    def begin(
        self,
        daemon: Daemon,
        pipeline: Pipeline,
        counters: Counters,
        recorder: Recorder | None,
    ) -> Callable[[StepResult], None]:
        """The stages stand; return what is to see the result of each turn."""
        from monitor.web.feed import WebFeed
        from monitor.web.snapshot import About, Snapshots

        here = self._settings.web
        about = About(
            self._source,
            self._settings.profile,
            version("mavsentry"),
            here.rate_hz,
            here.history_s,
        )
        snapshots = Snapshots(about, pipeline, counters, self._measured, recorder)
        status = partial(daemon.status, recent=True)
        feed = WebFeed(snapshots, self._process, status, here.rate_hz, self._host.now_us)
        return feed.turn
