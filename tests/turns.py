"""Who may work at a time: tests that measure time have the machine for themselves.

pytest-xdist runs tests in several processes. A test marked ``alone`` must not share the processors
with them: it waits until the others have finished theirs, and they wait for it.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def turn(place: Path, *, alone: bool) -> Iterator[None]:
    """Hold the machine, together with all who want it together or ``alone``.

    A lock that many can share serves those who need not be alone. Who does waits for it in the
    ``door``, through which all must pass: else the others, of whom one always works, would never
    let it in. A process that ends, however, gives back both; and what a test left running, with a
    copy of its descriptors, holds neither.

    Parameters
    ----------
    place
        Beginning of the names of two files, which are made.
    """
    with locked(f"{place}.machine") as machine:
        with locked(f"{place}.door") as door:
            fcntl.flock(door, fcntl.LOCK_EX)
            fcntl.flock(machine, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield


@contextmanager
def locked(name: str) -> Iterator[int]:
    """A file to lock, which is unlocked in the end."""
    descriptor = os.open(name, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        yield descriptor
    finally:
        fcntl.flock(descriptor, fcntl.LOCK_UN)
        os.close(descriptor)
