"""The folder that a fleet's results go to, on this computer or wherever fsspec reaches.

A file appears whole or not at all on this computer, and object stores do the same.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from monitor.fleet.sources import is_url

__all__ = ["Place", "report_folder"]


def report_folder(sha256: str) -> str:
    """Where the files of a log with these bytes are, below the results' folder."""
    return f"reports/{sha256[:2]}/{sha256[:16]}"


class Place:
    """Reads and writes files by their names below one folder.

    Parameters
    ----------
    folder
        Path or fsspec URL.

    Raises
    ------
    OSError, ImportError, ValueError
        The URL's file system cannot be reached.
    """

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self._system: Any = None
        self._root = folder
        if is_url(folder):
            import fsspec

            self._system, self._root = fsspec.url_to_fs(folder)

    @property
    def local(self) -> Path | None:
        """The folder, if it is of this computer."""
        return Path(self._root) if self._system is None else None

    def read(self, name: str) -> bytes | None:
        """A file's bytes; None if there is no such file."""
        try:
            if self._system is None:
                return Path(self._root, name).read_bytes()
            data: bytes = self._system.cat_file(self._path(name))
        except (FileNotFoundError, NotADirectoryError):
            return None
        return data

    def write(self, name: str, data: bytes) -> None:
        """Write a file and the folders above it.

        Raises
        ------
        OSError
            It cannot be written.
        """
        if self._system is not None:
            self._system.makedirs(str(PurePosixPath(self._path(name)).parent), exist_ok=True)
            self._system.pipe_file(self._path(name), data)
            return
        path = Path(self._root, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
        try:
            part.write_bytes(data)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)

    @contextmanager
    def staged(self, name: str) -> Iterator[Path]:
        """A folder to write files into; those of a URL are sent there at the end."""
        if self._system is None:
            yield Path(self._root, name)
            return
        with tempfile.TemporaryDirectory(prefix="mavsentry-") as near:
            yield Path(near)
            for file in sorted(p for p in Path(near).rglob("*") if p.is_file()):
                far = self._path(f"{name}/{file.relative_to(near).as_posix()}")
                self._system.makedirs(str(PurePosixPath(far).parent), exist_ok=True)
                self._system.put_file(str(file), far)

    def clear(self, name: str) -> None:
        """Remove a folder with all files under it, if it is there."""
        if self._system is None:
            if Path(self._root, name).is_dir():
                shutil.rmtree(Path(self._root, name))
        elif self._system.exists(self._path(name)):
            self._system.rm(self._path(name), recursive=True)

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        if self._system is None:
            Path(self._root, name).unlink(missing_ok=True)
        elif self._system.exists(self._path(name)):
            self._system.rm_file(self._path(name))

    def list(self, name: str, suffix: str) -> list[str]:
        """Names of the files under a folder that end so, in order."""
        if self._system is None:
            root = Path(self._root)
            found = (
                path.relative_to(root).as_posix() for path in (root / name).rglob(f"*{suffix}")
            )
        else:
            root_ = self._system._strip_protocol(self._root)
            paths = self._system.find(self._path(name))
            found = (str(PurePosixPath(p).relative_to(root_)) for p in paths if p.endswith(suffix))
        return sorted(n for n in found if not PurePosixPath(n).name.startswith("."))

    def _path(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{name}"
