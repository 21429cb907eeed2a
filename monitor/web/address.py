"""Where the live page listens: the address, the socket, and the token that guards it.

All of it happens in the daemon, before anything else runs, so that what cannot work is said in one
sentence at once. The web process is given the open socket.
"""

from __future__ import annotations

import ipaddress
import os
import re
import secrets
import socket
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from links.endpoints.base import LinkError, plain, resolve
from monitor.places import state_folder

__all__ = ["VARIABLE", "Listening", "Token", "WebError", "find_token", "listen"]

VARIABLE: Final = "MAVSENTRY_WEB_TOKEN"
"""Variable of the environment that may hold the token."""

SHORTEST: Final = 16
"""Characters that a token must have at least."""

_HOST_PORT = re.compile(r"(?:\[([0-9A-Fa-f:.%\w]+)\]|([^:\[\]\s/]+)):(\d{1,5})")
_BACKLOG = 64
_SEND_BUFFER = 1 << 17
_MADE_BYTES = 24


class WebError(ValueError):
    """A live page that cannot be served; the message is one plain sentence."""


@dataclass(frozen=True, slots=True)
class Listening:
    """An open socket that connections wait at.

    Attributes
    ----------
    socket
        Bound and listening, non-blocking.
    host, port
        As asked for; the port is the true one where 0 was asked for.
    loopback
        Whether only this computer can reach it.
    """

    socket: socket.socket
    host: str
    port: int
    loopback: bool

    @property
    def url(self) -> str:
        """Address for a browser: by this computer's name where it listens on all addresses."""
        bound = ipaddress.ip_address(self.socket.getsockname()[0].partition("%")[0])
        host = socket.gethostname() if bound.is_unspecified else self.host
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/"


def listen(address: str) -> Listening:
    """Bind ``HOST:PORT`` (``[::1]:8080`` for IPv6) and listen.

    The port is free again at once when the program has ended, however it ended.

    Raises
    ------
    WebError
        The address is none, is not this computer's, is in use or not allowed.
    """
    name = f"the live page at {address}"
    parts = _HOST_PORT.fullmatch(address)
    if parts is None or int(parts[3]) > 65535:
        raise WebError(f"{address!r} is not of the form HOST:PORT, such as 127.0.0.1:8080")
    host, port = parts[1] or parts[2], int(parts[3])
    try:
        family, where = resolve(name, host, port, socket.SOCK_STREAM)
        sock = socket.socket(family, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # elsewhere it would let two programs have one port
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            # Of every connection (it is handed down): a slow viewer is to fall behind here, where
            # frames are dropped, and not in a buffer of megabytes full of old ones.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            sock.bind(where)
            sock.listen(_BACKLOG)
            sock.setblocking(False)
        except OSError:
            sock.close()
            raise
    except LinkError as error:
        raise WebError(str(error)) from None
    except OSError as error:
        raise WebError(str(plain(name, error))) from None
    bound, port = sock.getsockname()[:2]
    return Listening(sock, host, port, ipaddress.ip_address(bound.partition("%")[0]).is_loopback)


@dataclass(frozen=True, slots=True)
class Token:
    """What a viewer must present.

    Attributes
    ----------
    value
        The secret; it shows in no message and no representation.
    where
        Where it stands, in words.
    """

    value: str
    where: str

    def __repr__(self) -> str:
        return f"Token(of {self.where})"


def find_token(
    token_file: str, environ: Mapping[str, str], loopback: bool, state_folder: Path | None = None
) -> Token | None:
    """The token in force: of the environment, the file of the settings, or one that is made.

    Parameters
    ----------
    token_file
        ``[web] token_file``; empty for none.
    environ
        The environment.
    loopback
        Only this computer can reach the page: without a token given, none is needed.
    state_folder
        Where a made token is kept; None takes :func:`monitor.places.state_folder`.

    Raises
    ------
    WebError
        The token is too short, or its file missing, unreadable or readable by others.
    """
    if given := environ.get(VARIABLE, ""):
        return _checked(given, VARIABLE)
    if token_file:
        path = Path(token_file).expanduser()
        try:
            return _checked(_read(path), str(path))
        except FileNotFoundError:
            raise WebError(
                f"there is no {path}; make it with: (umask 077; head -c 24 /dev/urandom | base64 "
                f"> {path})"
            ) from None
        except OSError as error:
            raise WebError(f"cannot read {path}: {error.strerror}") from None
    return None if loopback else _kept(state_folder)


def _kept(folder: Path | None) -> Token:
    """The token of the user's state folder, made if there is none yet."""
    folder = folder or state_folder()
    path = folder / "web-token"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            return _checked(_read(path), str(path))
        with os.fdopen(handle, "w", encoding="ascii") as file:
            file.write(secrets.token_urlsafe(_MADE_BYTES) + "\n")
        return _checked(_read(path), str(path))
    except OSError as error:
        raise WebError(
            f"cannot keep a token in {path}: {error.strerror}; give one in {VARIABLE} or "
            "[web] token_file"
        ) from None


def _read(path: Path) -> str:
    """A secret file's text; who may read it is asked of the open file, not of its name."""
    with path.open("rb") as file:
        mode = os.fstat(file.fileno()).st_mode
        if os.name == "posix" and stat.S_IMODE(mode) & 0o077:
            raise WebError(f"{path} can be read by others than its owner; chmod 600 {path}")
        return file.read(4096).decode("utf-8", errors="replace")


def _checked(text: str, where: str) -> Token:
    value = text.strip()
    if len(value) < SHORTEST or not value.isascii() or not value.isprintable() or " " in value:
        raise WebError(
            f"the token of {where} must be {SHORTEST} characters or more, of ASCII without spaces"
        )
    return Token(value, where)
