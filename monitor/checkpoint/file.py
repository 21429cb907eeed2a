"""The file of a checkpoint: whole or not there, of its owner alone, and checked before it is used.

``MAGIC``, the length of what follows as eight bytes, zlib-compressed JSON and arrays, and last the
SHA-256 of all of that. It is written beside its place, forced to the disk, and renamed; a process
that is killed at any moment leaves the file from before, or this one.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from monitor.checkpoint.graph import Flat

__all__ = ["BYTES_MAX", "Unusable", "pack", "read", "replace", "unpack"]

MAGIC = b"mavsentry checkpoint 1\n"
BYTES_MAX = 1 << 26
"""Of a file, and of what it unfolds to; a hundred times what is usual."""

_LENGTH = 8
_DIGEST = hashlib.sha256().digest_size


class Unusable(Exception):
    """A checkpoint that is not taken up, in words that go on from "checkpoint not used:"."""


def pack(about: dict[str, Any], flat: Flat) -> bytes:
    """The bytes of a file."""
    text = json.dumps([about, flat.tree, flat.shapes, flat.heads, [len(a) for a in flat.arrays]])
    head = text.encode()
    whole = b"".join((len(head).to_bytes(_LENGTH, "little"), head, *flat.arrays))
    body = zlib.compress(whole, 1)
    data = MAGIC + len(body).to_bytes(_LENGTH, "little") + body
    return data + hashlib.sha256(data).digest()


def unpack(data: bytes) -> tuple[dict[str, Any], Flat]:
    """What a file says of itself, and what it holds.

    Raises
    ------
    Unusable
        It is not whole, or no checkpoint.
    """
    if not data.startswith(MAGIC):
        raise Unusable("it is no checkpoint of this version")
    kept, digest = data[:-_DIGEST], data[-_DIGEST:]
    if hashlib.sha256(kept).digest() != digest:
        raise Unusable("it is damaged")
    unfold = zlib.decompressobj()
    try:
        whole = unfold.decompress(kept[len(MAGIC) + _LENGTH :], BYTES_MAX)
        end = _LENGTH + int.from_bytes(whole[:_LENGTH], "little")
        about, tree, shapes, heads, lengths = json.loads(whole[_LENGTH:end])
        edges = [end, *(end + np.cumsum(lengths, dtype=np.int64)).tolist()]
    except (ValueError, TypeError, RecursionError, zlib.error):
        raise Unusable("it is damaged") from None
    if unfold.unconsumed_tail or edges[-1] != len(whole) or min(lengths, default=0) < 0:
        raise Unusable("it is damaged")
    arrays = [whole[a:b] for a, b in pairwise(edges)]
    return about, Flat(tree, shapes, heads, arrays)


def read(path: Path) -> bytes:
    """The bytes of a file that nobody else can have written.

    Raises
    ------
    Unusable
        It is not its owner's alone, no file, or cannot be read.
    FileNotFoundError
        There is none.
    """
    try:
        with open(os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0)), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode) or found.st_size > BYTES_MAX:
                raise Unusable("it is no such file")
            if hasattr(os, "geteuid") and (
                found.st_uid != os.geteuid() or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
            ):
                raise Unusable("others can write to it")
            return file.read(BYTES_MAX)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise Unusable(f"it cannot be read: {error.strerror}") from None


def replace(path: Path, data: bytes) -> None:
    """Put a file in the place of what was there, at once and for good.

    Raises
    ------
    OSError
        What was there is as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    beside = path.with_name(f".{path.name}.new")
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0)
    try:
        with open(os.open(beside, flags, 0o600), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise
    if hasattr(os, "O_DIRECTORY"):
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
