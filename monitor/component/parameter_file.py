"""Keeps what was set over MAVLink: read at the start, written by a thread whenever it changed.

The file holds settings keys, not parameter names, so that it outlives a renaming. It is replaced
at once as a whole, and what stands in it is checked like anything that comes from outside.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from monitor.component.tunables import TUNABLES, RefusedValue
from monitor.places import state_folder
from monitor.settings import Settings

__all__ = ["ParameterFile", "parameter_path", "read_parameters"]

SCHEMA = "mavsentry/parameters/1"
LARGEST = 1 << 16
"""A larger file is none of ours [bytes]."""

_BY_KEY = {tunable.key: tunable for tunable in TUNABLES}


def parameter_path(settings: Settings) -> Path:
    """Where parameters are kept."""
    given = settings.component.parameter_file
    return Path(given) if given else state_folder() / "parameters.json"


def read_parameters(path: Path, settings: Settings) -> tuple[dict[str, Any], str | None]:
    """What is kept, by dotted key, and a sentence on what of it could not be used.

    Never raises for the file's sake: a monitor flies with its configuration rather than not at all.

    Parameters
    ----------
    path
        The file; one that is not there holds nothing.
    settings
        Tell the type of each value.
    """
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST + 1)
    except FileNotFoundError:
        return {}, None
    except OSError as error:
        return {}, f"parameters kept in {path} cannot be read: {error.strerror}"
    try:
        found = json.loads(text) if len(text) <= LARGEST else {}
    except (ValueError, RecursionError):
        found = {}
    ours = isinstance(found, dict) and found.get("schema") == SCHEMA
    values = found.get("values") if ours else None
    if not isinstance(values, dict):
        return {}, f"{path} holds no parameters of ours; they are those of the configuration"
    good: dict[str, Any] = {}
    for key, value in values.items():
        tunable = _BY_KEY.get(key)
        if tunable is None or not isinstance(value, int | float):
            continue
        try:
            good[key] = tunable.checked(float(value), settings)
        except (RefusedValue, OverflowError):
            continue
    bad = sorted(str(key) for key in values.keys() - good.keys())
    if not bad:
        return good, None
    more = f" and {len(bad) - 3} more" if len(bad) > 3 else ""
    return good, f"{path}: not used: {', '.join(bad[:3])}{more}"


class ParameterFile:
    """Writes what was set, in a thread of its own; only the newest values are kept waiting.

    Attributes
    ----------
    failure
        Why the newest values could not be written; None while all is well.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._waiting: dict[str, Any] | None = None
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._ended = False
        self.failure: str | None = None

    def offer(self, values: Mapping[str, Any]) -> None:
        """Have these written soon; never waits for a disk."""
        with self._changed:
            if self._ended:
                return
            self._waiting = dict(values)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="parameters", daemon=True)
                self._thread.start()
            self._changed.notify()

    def close(self, timeout_s: float = 0.5) -> None:
        """Let what waits be written, for so long at most."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _work(self) -> None:
        while True:
            with self._changed:
                while self._waiting is None and not self._ended:
                    self._changed.wait()
                values, self._waiting = self._waiting, None
            if values is None:
                return
            try:
                _replace(self._path, values)
                self.failure = None
            except OSError as error:
                said = error.strerror or str(error)
                self.failure = f"parameters are not kept in {self._path}: {said}"


def _replace(path: Path, values: Mapping[str, Any]) -> None:
    """Write anew beside it, to the disk, and put that in its place."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    text = json.dumps({"schema": SCHEMA, "values": dict(sorted(values.items()))}, indent=2)
    try:
        handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text + "\n")
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
