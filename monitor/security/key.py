"""Where the signing key comes from: a file of ours alone, the environment, systemd's credentials.

It is never taken from the command line, which every user of a computer can read.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
from collections.abc import MutableMapping
from pathlib import Path
from typing import Final

from links.mavlink.signing import KEY_BYTES, SigningKey

__all__ = ["CREDENTIAL", "VARIABLE", "KeyFileError", "find_key", "new_key_file", "read_key"]

VARIABLE: Final = "MAVSENTRY_SIGNING_KEY"
CREDENTIAL: Final = "mavlink-key"
"""Name of the key among the credentials that systemd hands to a service."""

_LONGEST: Final = 4096
_HEX: Final = re.compile(r"[0-9A-Fa-f]{64}")
_LETTERS: Final = "abcdefghijkmnpqrstuvwxyz23456789"  # none that reads like another
_GROUPS, _GROUP = 6, 5


class KeyFileError(ValueError):
    """A signing key that cannot be used; the message is one plain sentence without any of it."""


def find_key(key_file: str, environ: MutableMapping[str, str]) -> SigningKey | None:
    """The signing key in force; None when there is none.

    Parameters
    ----------
    key_file
        ``[security] key_file``; empty for none.
    environ
        The environment. A key in it is taken out, so that programs we start do not get it.

    Raises
    ------
    KeyFileError
        The file is missing, unreadable, not ours or open to others, or holds no key.
    """
    if given := environ.pop(VARIABLE, ""):
        return _key(given.encode("utf-8", "surrogateescape"), VARIABLE)
    if key_file:
        return read_key(Path(key_file).expanduser())
    folder = environ.get("CREDENTIALS_DIRECTORY", "")
    if folder and (path := Path(folder) / CREDENTIAL).exists():
        return read_key(path, private=False)  # systemd keeps them for this service alone
    return None


def read_key(path: Path, *, private: bool = True) -> SigningKey:
    """The key that a file holds.

    Parameters
    ----------
    private
        Demand that the file is ours and closed to others.

    Raises
    ------
    KeyFileError
        As of :func:`find_key`.
    """
    try:
        # who may read it is asked of the open file, not of its name; a pipe must not block us
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise KeyFileError(f"{path} is not a file: a key stands in one of its own")
            if private and status.st_uid != os.geteuid():
                raise KeyFileError(
                    f"{path} belongs to another user; a signing key must be ours: "
                    f"sudo chown $USER {path}"
                )
            if private and stat.S_IMODE(status.st_mode) & 0o077:
                raise KeyFileError(f"{path} is open to others than its owner; chmod 600 {path}")
            return _key(file.read(_LONGEST + 1), str(path))
    except FileNotFoundError:
        raise KeyFileError(f"there is no {path}; mavsentry key new {path} makes one") from None
    except OSError as error:
        raise KeyFileError(f"cannot read {path}: {error.strerror}") from None


def new_key_file(path: Path) -> None:
    """Write a new random passphrase into a new file that is ours alone.

    150 bits of letters that can be typed into a ground station.

    Raises
    ------
    KeyFileError
        The file is there already or cannot be written.
    """
    groups = ("".join(secrets.choice(_LETTERS) for _ in range(_GROUP)) for _ in range(_GROUPS))
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    try:
        with open(os.open(path, flags, 0o600), "w", encoding="ascii") as file:
            file.write("-".join(groups) + "\n")
    except FileExistsError:
        raise KeyFileError(
            f"{path} is there already; a key is not overwritten: choose another name"
        ) from None
    except OSError as error:
        raise KeyFileError(f"cannot write {path}: {error.strerror}") from None


def _key(content: bytes, where: str) -> SigningKey:
    """The key of what a file or a variable holds.

    64 hexadecimal digits are the key itself, and so are 32 bytes that are no text; any other text
    is a passphrase.
    """
    if len(content) > _LONGEST:
        raise KeyFileError(f"{where} is too long for a signing key: is it the right file?")
    try:
        text = content.decode("utf-8").rstrip("\r\n")
    except UnicodeDecodeError:
        text = ""
    try:
        if _HEX.fullmatch(text):
            return SigningKey(bytes.fromhex(text))
        if text and text.isprintable():
            return SigningKey.of_passphrase(text)
        if len(content) == KEY_BYTES:
            return SigningKey(content)
    except ValueError as error:
        raise KeyFileError(f"{where}: {error}") from None
    raise KeyFileError(
        f"{where} holds no signing key: a passphrase, 64 hexadecimal digits or {KEY_BYTES} bytes"
    )
