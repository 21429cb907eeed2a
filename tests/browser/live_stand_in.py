"""A daemon's web side whose every message a test decides: the page's own server stands still.

with StandIn() as daemon:
    daemon.say(*messages())        # to each viewer, now and when one comes again
    daemon.stop(); daemon.start()  # on the same port
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable
from typing import Any

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from monitor.web.page import rendered


class StandIn:
    """Serves the live page on a port of its own, and what it is told to say over ``/live``.

    Attributes
    ----------
    opened
        How many viewers have come so far.
    """

    def __init__(self) -> None:
        self.opened = 0
        self.port = 0
        self._said: list[str] = []
        self._viewers: set[Any] = set()
        self._server: tornado.httpserver.HTTPServer | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> StandIn:
        self._thread.start()
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def start(self) -> None:
        """Listen, on the port of before if there was one."""
        self._do(self._start)

    def stop(self, code: int = 1001) -> None:
        """Close every viewer and the port."""
        self._do(lambda: self._stop(code))

    def say(self, *messages: Any) -> None:
        """Say these to all viewers, and again to each one who comes later."""
        texts = [json.dumps(message, allow_nan=False) for message in messages]
        self._do(lambda: self._say(texts))

    def forget(self) -> None:
        """Who comes from now on hears nothing of what was said."""
        self._do(self._said.clear)

    def _do(self, what: Callable[[], None]) -> None:
        done: Any = asyncio.run_coroutine_threadsafe(_called(what), self._loop)
        done.result(timeout=10.0)

    def _start(self) -> None:
        stand_in = self

        class Root(tornado.web.RequestHandler):
            def get(self) -> None:
                page = rendered()
                self.set_header("Content-Type", "text/html; charset=utf-8")
                self.set_header("Content-Security-Policy", page.policy)
                self.finish(page.html)

        class Live(tornado.websocket.WebSocketHandler):
            def open(self, *_: str) -> None:
                stand_in.opened += 1
                stand_in._viewers.add(self)
                for text in stand_in._said:
                    self.write_message(text)

            def on_close(self) -> None:
                stand_in._viewers.discard(self)

        sockets = tornado.netutil.bind_sockets(self.port, "127.0.0.1")
        self.port = sockets[0].getsockname()[1]
        routes = [("/", Root), ("/live", Live)]
        self._server = tornado.httpserver.HTTPServer(tornado.web.Application(routes))
        self._server.add_sockets(sockets)

    def _stop(self, code: int) -> None:
        for viewer in list(self._viewers):
            viewer.close(code)
        self._viewers.clear()
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _say(self, texts: list[str]) -> None:
        self._said += texts
        for viewer in self._viewers:
            for text in texts:
                viewer.write_message(text)


async def _called(what: Callable[[], None]) -> None:
    what()
