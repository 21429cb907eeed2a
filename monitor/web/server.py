"""The web process: ``python -m monitor.web.server LISTENING PIPE`` (two open file descriptors).

The daemon starts it, tells it how to serve and hands it snapshots; its end of the pipe closing is
the end of this process too, however the daemon ended. It runs at a low priority: a page waits, the
estimators do not.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import json
import logging
import os
import signal
import socket
import sys
import time
from math import ceil
from typing import TYPE_CHECKING, Any, Final
from weakref import WeakSet

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream

from monitor.web.access import Access
from monitor.web.handlers import Shared, application
from monitor.web.pipe import BEGIN, FRAME, SETUP, Incoming
from monitor.web.store import Store
from monitor.web.viewers import Viewers

if TYPE_CHECKING:
    from monitor.web.page import Page

__all__ = ["Server", "main"]

NICE: Final = 10

HEADERS_MAX, BODY_MAX, BUFFER_MAX = 1 << 14, 1 << 10, 1 << 20
"""Bytes of a request's head and body, and of what is read of one connection at a time."""

IDLE_S, BODY_S = 60.0, 5.0
"""An idle connection is closed after this; a request's body must have come within this."""

CONNECTIONS_BESIDE: Final = 64
"""Connections beside the viewers' own: what exceeds it is closed at once."""

FAREWELL_S: Final = 0.3
"""Time that viewers have to take our last word."""


class Server:
    """Serves what comes over the pipe.

    Parameters
    ----------
    listening
        The socket that connections wait at.
    pipe
        Our end of the pair.
    page
        Makes the page, once.
    """

    def __init__(self, listening: socket.socket, pipe: socket.socket, page: Any) -> None:
        self._listening, self._pipe = listening, pipe
        self._page = page
        self._incoming = Incoming(pipe)
        self._shared: Shared | None = None
        self._ended = asyncio.Event()
        self._fault: Exception | None = None

    async def run(self) -> None:
        """Serve until the daemon's end of the pipe closes.

        What fails meanwhile is raised: the daemon then starts a process anew.
        """
        loop = asyncio.get_running_loop()
        self._pipe.setblocking(False)
        loop.add_reader(self._pipe, self._read)
        await self._ended.wait()
        loop.remove_reader(self._pipe)
        if self._shared is not None:
            self._shared.say_goodbye()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(FAREWELL_S):
                    while len(self._shared.viewers):
                        await asyncio.sleep(0.01)
        if self._fault is not None:
            raise self._fault

    def _read(self) -> None:
        try:
            self._hear()
        except Exception as fault:
            self._fault = fault
            self._ended.set()

    def _hear(self) -> None:
        alive = self._incoming.receive()
        for kind, body in self._incoming.messages():
            if kind == SETUP:
                self._open(json.loads(body))
            elif self._shared is not None:
                self._take(self._shared, kind, body)
        if not alive:
            self._ended.set()

    def _open(self, how: dict[str, Any]) -> None:
        """Begin to answer."""
        page: Page = self._page()
        self._shared = Shared(
            store=Store.of(how["history_s"], how["rate_hz"]),
            viewers=Viewers(how["viewers"], ceil(how["behind_s"] * how["rate_hz"])),
            access=Access(how["token"], how["hosts"], how["port"]),
            html=page.html,
            html_gzip=gzip.compress(page.html, mtime=0),
            policy=page.policy,
        )
        server = _HttpServer(
            application(self._shared),
            max_header_size=HEADERS_MAX,
            max_body_size=BODY_MAX,
            max_buffer_size=BUFFER_MAX,
            idle_connection_timeout=IDLE_S,
            body_timeout=BODY_S,
        )
        server.most = how["viewers"] + CONNECTIONS_BESIDE
        server.add_socket(self._listening)

    def _take(self, shared: Shared, kind: bytes, body: bytes) -> None:
        if kind == BEGIN:
            shared.store.begin(body)
            shared.viewers.tell(shared.store.hello())
        elif kind == FRAME:
            shared.store.add(body)
            shared.viewers.tell(body)
            shared.heard_s = time.monotonic()


class _HttpServer(HTTPServer):
    """Closes what exceeds a number of connections, so that none takes all file descriptors."""

    most = 256

    def initialize(self, *args: Any, **kwargs: Any) -> None:
        super().initialize(*args, **kwargs)
        self._streams: WeakSet[IOStream] = WeakSet()

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        if sum(not known.closed() for known in self._streams) >= self.most:
            stream.close()
            return
        self._streams.add(stream)
        super().handle_stream(stream, address)


def main(arguments: list[str]) -> None:
    """Serve on the inherited descriptors until the daemon is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal; the daemon's end is ours
    with contextlib.suppress(OSError, AttributeError):
        os.nice(NICE)
    # A peer's malformed request is no news for the pilot's terminal, and an address may hold the
    # token: of Tornado's own records only those of our own faults are shown, without the address.
    logging.getLogger("tornado.access").disabled = True
    logging.getLogger("tornado.general").disabled = True
    from monitor.web.page import rendered

    listening, pipe = (socket.socket(fileno=int(number)) for number in arguments)
    asyncio.run(Server(listening, pipe, rendered).run())


if __name__ == "__main__":
    main(sys.argv[1:])
