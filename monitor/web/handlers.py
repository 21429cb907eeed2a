"""The four addresses that are answered: ``/``, ``/live``, ``/metrics`` and ``/healthz``.

Nothing is looked up by what a peer sends: there is no folder of files behind the page.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Final

from tornado.iostream import StreamClosedError
from tornado.log import app_log
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from monitor.web.access import COOKIE_S, Access
from monitor.web.store import Store
from monitor.web.viewers import Viewer, Viewers

__all__ = ["Shared", "application"]

HEALTHY_S: Final = 5.0
"""The daemon is well if its newest frame is not older."""

MESSAGE_MAX: Final = 1 << 10
"""Bytes that a viewer may send at once; it has nothing to say."""

PING_S: Final = 20.0
"""A viewer that leaves a ping unanswered for this long is gone."""

GOING_AWAY, NOT_ALLOWED, TRY_LATER = 1001, 1008, 1013

SAID: Final = {
    401: "A token is needed. Open this page once with ?token= and the token at its end, or send "
    "it as Authorization: Bearer. `mavsentry run` says where the token is kept.",
    403: "The page of another site asked for this.",
    404: "There is nothing here; the live page is at /.",
    405: "This can only be read.",
    421: "This computer is not known by that name; [web] hosts lists further names.",
    503: "The daemon has sent nothing lately.",
}

_FRAMED_BY_NONE: Final = "frame-ancestors 'none'"

_HEADERS: Final = {
    "Server": "mavsentry",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": f"default-src 'none'; {_FRAMED_BY_NONE}",
}

_ENTERED: Final = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" '
    'content="0; url=./"><title>mavsentry</title><p><a href="./">The live page</a></html>'
)


@dataclass(slots=True)
class Shared:
    """What all requests share.

    Attributes
    ----------
    store, viewers, access
        What is known, who watches, who may.
    html, html_gzip, policy
        The page, the same compressed, and its content security policy.
    heard_s
        When the newest frame came (monotonic) [s]; None before the first.
    """

    store: Store
    viewers: Viewers
    access: Access
    html: bytes
    html_gzip: bytes
    policy: str
    heard_s: float | None = None
    sockets: set[_Live] = field(default_factory=set)

    def say_goodbye(self) -> None:
        """Close all viewers: the daemon stops."""
        for handler in list(self.sockets):
            handler.close(GOING_AWAY, "the daemon has stopped")


def application(shared: Shared) -> Application:
    """The four addresses, and refusals of all others."""
    own = {"shared": shared}
    return Application(
        [
            ("/", _Page, own),
            ("/live", _Live, own),
            ("/metrics", _Metrics, own),
            ("/healthz", _Health, own),
        ],
        default_handler_class=_Nothing,
        default_handler_args=own,
        websocket_max_message_size=MESSAGE_MAX,
        websocket_ping_interval=PING_S,
    )


class _Guarded(RequestHandler):
    """Refuses strangers, in one sentence and without a trace."""

    shared: Shared

    def initialize(self, shared: Shared) -> None:
        self.shared = shared

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        if not self.shared.access.knows_host(self.request.headers.get("Host")):
            raise HTTPError(421)
        if not self.admitted():
            raise HTTPError(401)

    def admitted(self) -> bool:
        """Whether the token was presented, if one is asked for."""
        access = self.shared.access
        authorization = self.request.headers.get("Authorization")
        return access.admits(self.get_cookie(access.cookie_name), authorization)

    def write_error(self, status_code: int, **_: Any) -> None:
        if status_code == 401:
            self.set_header("WWW-Authenticate", 'Bearer realm="mavsentry"')
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(SAID.get(status_code, "This cannot be answered.") + "\n")

    def log_exception(self, kind: Any, value: Any, trace: Any) -> None:
        """A fault of ours; the request's address, which may hold the token, is not shown."""
        if not isinstance(value, HTTPError):
            app_log.error("live page: %s failed", self.request.path, exc_info=(kind, value, trace))


class _Page(_Guarded):
    """The page; with ``?token=`` the cookie first, and then the page under its plain address."""

    _entering = False

    def admitted(self) -> bool:
        given = self.get_query_arguments("token")
        self._entering = bool(given) and self.shared.access.is_token(given[-1])
        return self._entering or super().admitted()

    def get(self) -> None:
        self.set_header("Content-Type", "text/html; charset=utf-8")
        if self._entering:
            self._enter()
            return
        self.set_header("Content-Security-Policy", f"{self.shared.policy}; {_FRAMED_BY_NONE}")
        self.set_header("Vary", "Accept-Encoding")
        if "gzip" in self.request.headers.get("Accept-Encoding", ""):
            self.set_header("Content-Encoding", "gzip")
            self.finish(self.shared.html_gzip)
        else:
            self.finish(self.shared.html)

    def _enter(self) -> None:
        # A page that goes on by itself and no redirect: a strict cookie is not sent along when a
        # link in a message led here, and a redirect still counts as that link.
        self.set_cookie(
            self.shared.access.cookie_name,
            self.shared.access.cookie,
            max_age=COOKIE_S,
            httponly=True,
            secure=self.request.headers.get("X-Forwarded-Proto") == "https",
            samesite="Strict",
        )
        self.finish(_ENTERED)


class _Live(_Guarded, WebSocketHandler):
    """A viewer."""

    _viewer: Viewer | None = None
    _task: asyncio.Task[None] | None = None

    def check_origin(self, origin: str) -> bool:
        return self.shared.access.same_origin(origin, self.request.headers.get("Host"))

    def open(self) -> None:
        viewers = self.shared.viewers
        self._viewer = viewers.join(self._send)
        if self._viewer is None:
            said = f"{viewers.limit} pages are open, as many as [web] viewers allows"
            self.close(TRY_LATER, said)
            return
        self.shared.sockets.add(self)
        store = self.shared.store
        first = chain((store.hello(),), store.history()) if store.now else ()
        self._task = asyncio.create_task(self._run(self._viewer, first))

    async def _run(self, viewer: Viewer, first: Iterable[bytes]) -> None:
        try:
            await viewer.run(first)
        except (WebSocketClosedError, StreamClosedError):
            self.close()

    async def _send(self, message: bytes) -> None:
        await self.write_message(message)

    def on_message(self, message: str | bytes) -> None:
        self.close(NOT_ALLOWED, "a viewer only listens")

    def on_close(self) -> None:
        self.shared.sockets.discard(self)
        if self._viewer is not None:
            self.shared.viewers.leave(self._viewer)
        if self._task is not None:
            self._task.cancel()


class _Metrics(_Guarded):
    """Prometheus text."""

    def get(self) -> None:
        from monitor.web.metrics import exposition

        text, kind = exposition(self.shared.store, self.shared.viewers)
        self.set_header("Content-Type", kind)
        self.finish(text)


class _Health(_Guarded):
    """Whether the daemon's snapshots still come."""

    def get(self) -> None:
        heard_s = self.shared.heard_s
        if heard_s is None or time.monotonic() - heard_s > HEALTHY_S:
            raise HTTPError(503)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish("ok\n")


class _Nothing(_Guarded):
    """Every other address."""

    def prepare(self) -> None:
        super().prepare()
        raise HTTPError(404)
