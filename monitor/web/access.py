"""Who may ask: which Host, which Origin, which token. Answers only; the server refuses.

A page on the loopback has two kinds of stranger: another site's script in the user's own browser,
which sends an ``Origin`` of its own, and one whose name was rebound to 127.0.0.1, which sends a
``Host`` that is not ours. On any other address everybody on the network may ask: the token decides.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import socket
from collections.abc import Iterable
from typing import Final
from urllib.parse import urlsplit

__all__ = ["COOKIE_S", "Access"]

COOKIE_S: Final = 30 * 86_400
"""Life of the cookie [s]."""


class Access:
    """Decides on requests.

    Parameters
    ----------
    token
        What must be presented; None when everybody who can connect may see the page.
    hosts
        Further names of this computer.
    port
        Of the page: browsers keep cookies of all ports of a host together.
    """

    def __init__(self, token: str | None, hosts: Iterable[str], port: int) -> None:
        own = socket.gethostname().lower()
        names = {"localhost", own, own.partition(".")[0], *(h.lower() for h in hosts)}
        self._hosts = names | {f"{name}.local" for name in names if "." not in name}
        self._token = None if token is None else token.encode()
        self.cookie_name = f"mavsentry-{port}"

    @property
    def guarded(self) -> bool:
        """Whether a token is asked for."""
        return self._token is not None

    @property
    def cookie(self) -> str:
        """What stands for the token in a cookie: made of it, and of no use to find it."""
        return hmac.new(self._token or b"", b"mavsentry live page", hashlib.sha256).hexdigest()

    def knows_host(self, host: str | None) -> bool:
        """Whether a ``Host`` is a name of ours, or an address: an address cannot be rebound."""
        name = _hostname(host)
        if name is None:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name in self._hosts
        return True

    def same_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether a page of ours asks; who is no browser sends no ``Origin``."""
        if origin is None:
            return True
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.netloc.lower() == (host or "").lower()

    def is_token(self, given: str) -> bool:
        """Whether this is the token, in a time that does not tell how much of it is right."""
        return self._token is not None and hmac.compare_digest(given.encode(), self._token)

    def admits(self, cookie: str | None, authorization: str | None) -> bool:
        """Whether a request with this cookie and ``Authorization`` may be answered."""
        if self._token is None:
            return True
        if authorization is not None:
            scheme, _, given = authorization.partition(" ")
            if scheme.lower() == "bearer" and self.is_token(given.strip()):
                return True
        return cookie is not None and hmac.compare_digest(cookie.encode(), self.cookie.encode())


def _hostname(host: str | None) -> str | None:
    """The name of a ``Host`` without its port, None of what is no host."""
    try:
        return urlsplit(f"//{host or ''}").hostname
    except ValueError:
        return None
