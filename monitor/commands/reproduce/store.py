"""Results of jobs on disk, each in its file with what it came from.

A result is taken up again when its job and the code are the ones that made it. Files appear whole
or not at all, so that an interrupted run can be continued by typing it again.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from monitor.commands.reproduce.study import Job, Result

__all__ = ["Kept", "Store", "code_digest"]

ROOT: Final = Path(__file__).resolve().parents[3]
PACKAGES: Final = ("links", "estimators", "sim_feeds", "monitor")
SOURCES: Final = frozenset({".py", ".toml", ".csv", ".json", ".jsonl", ".xml"})
HEAD: Final = "__head__"
ARRAY: Final = "__array__"
DAMAGED: Final = (
    OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, zlib.error, zipfile.BadZipFile
)  # fmt: skip
"""What reading an archive raises when bytes of it have changed: such a file is no result."""


@cache
def code_digest() -> str:
    """Digest of everything in the four packages that can change a result."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*")):
            if path.suffix in SOURCES:
                digest.update(path.relative_to(ROOT).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Kept:
    """A result that was found on disk, what code made it and in how many seconds."""

    result: Result
    code: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Store:
    """A folder of results, one ``<paper>/<job's name>.npz`` each."""

    folder: Path

    def path(self, job: Job) -> Path:
        """Where this job's result is kept."""
        return self.folder / job.paper / f"{job.name}.npz"

    def take(self, job: Job, *, any_code: bool = False) -> Kept | None:
        """The result of exactly this job, or None.

        Parameters
        ----------
        any_code
            Also when other code made it.
        """
        try:
            with self.path(job).open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                head = json.loads(bytes(file[HEAD]).decode())
                if head["digest"] != job.digest():
                    return None
                if not any_code and head["code"] != code_digest():
                    return None
                arrays = {k: file[k] for k in file.files if k != HEAD}
            result = _filled(head["result"], arrays)
        except DAMAGED:
            return None
        return Kept(result, head["code"], head["seconds"])

    def keep(self, job: Job, result: Result, seconds: float) -> None:
        """Write a result; the file appears whole or not at all."""
        arrays: dict[str, np.ndarray] = {}
        head = {
            "digest": job.digest(),
            "code": code_digest(),
            "seconds": seconds,
            "result": _emptied(result, arrays),
        }
        arrays[HEAD] = np.frombuffer(json.dumps(head).encode(), np.uint8)
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
        path = self.path(job)
        path.parent.mkdir(parents=True, exist_ok=True)
        half = path.with_name(f".{path.name}.{os.getpid()}")
        half.write_bytes(buffer.getvalue())
        half.replace(path)


def _emptied(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """``value`` for JSON, its arrays moved to ``arrays``."""
    if isinstance(value, np.ndarray):
        key = f"a{len(arrays)}"
        arrays[key] = value
        return {ARRAY: key}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {str(k): _emptied(v, arrays) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_emptied(v, arrays) for v in value]
    return value


def _filled(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(value, dict):
        if set(value) == {ARRAY}:
            return arrays[value[ARRAY]]
        return {k: _filled(v, arrays) for k, v in value.items()}
    if isinstance(value, list):
        return [_filled(v, arrays) for v in value]
    return value
