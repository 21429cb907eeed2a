"""Which logs: files, folders and patterns, on this computer or wherever fsspec reaches."""

from __future__ import annotations

import glob
import hashlib
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["LOG_SUFFIXES", "Source", "SourceError", "expand", "is_url", "opened", "printable"]

LOG_SUFFIXES = (".tlog", ".bin", ".ulg")
"""Files that are taken when a folder is named; a file that is named itself is always taken."""

_STAMPS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "modified", "created")
"""What the file systems of fsspec call the state of a file, the surest first."""


class SourceError(Exception):
    """Logs that cannot be listed, in one plain sentence."""


@dataclass(frozen=True, slots=True, order=True)
class Source:
    """One log.

    Attributes
    ----------
    log
        Absolute path or URL.
    bytes
        Its size.
    stamp
        Changes when the file does: size with time of change or tag; empty where nothing tells.
    """

    log: str
    bytes: int
    stamp: str

    @property
    def shown(self) -> str:
        """The log as any text can hold it: on this computer a file's name is bytes, not text."""
        return printable(self.log)

    @property
    def name(self) -> str:
        """The file's name."""
        return self.log.partition("::")[0].rpartition("/")[2]

    @property
    def folder(self) -> str:
        """Name of the folder that holds it."""
        return self.log.partition("::")[0].rpartition("/")[0].rpartition("/")[2]


def printable(text: str) -> str:
    """The text with what UTF-8 cannot say as a backslash and a number."""
    return text.encode(errors="backslashreplace").decode()


def is_url(text: str) -> bool:
    """Whether this is a URL of fsspec and no path."""
    return "://" in text or "::" in text


def expand(patterns: Iterable[str]) -> list[Source]:
    """The logs that the patterns name, each once, in order of their names.

    Parameters
    ----------
    patterns
        Files, folders (with all logs under them), patterns with ``*``, ``**`` and ``?``, or any of
        these as an fsspec URL: ``s3://bucket/2026/**/*.tlog``, ``sftp://host/logs``.

    Raises
    ------
    SourceError
        A pattern names nothing, or its file system cannot be reached.
    """
    found: dict[str, Source] = {}
    for pattern in patterns:
        try:
            sources = list(_remote(pattern) if is_url(pattern) else _local(pattern))
        except OSError as error:
            raise SourceError(f"cannot list {pattern}: {error.strerror or error}") from None
        if not sources:
            raise SourceError(f"there is no log at {pattern}")
        found |= {source.log: source for source in sources}
    return sorted(found.values())


@contextmanager
def opened(source: Source) -> Iterator[tuple[Path, str]]:
    """The log as a local file, with the SHA-256 of its bytes; a download is removed afterwards.

    Raises
    ------
    OSError
        It cannot be read, or not be fetched.
    """
    if not is_url(source.log):
        yield Path(source.log), _digest(Path(source.log))
        return
    import fsspec

    with tempfile.TemporaryDirectory(prefix="mavsentry-") as folder:
        path = Path(folder) / (source.name or "log")
        with fsspec.open(source.log, "rb") as far, open(path, "wb") as near:
            shutil.copyfileobj(far, near, 1 << 20)
        yield path, _digest(path)


def _digest(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _local(pattern: str) -> Iterator[Source]:
    path = Path(pattern)
    if path.is_file():
        paths: Iterable[Path] = (path,)
    elif path.is_dir():
        paths = (p for p in path.rglob("*") if p.suffix.lower() in LOG_SUFFIXES and p.is_file())
    else:
        found = (Path(p) for p in glob.iglob(pattern, recursive=True))
        paths = (p for p in found if p.is_file())
    for file in paths:
        try:
            state = file.stat()
        except FileNotFoundError:  # removed since it was listed
            continue
        yield Source(str(file.absolute()), state.st_size, f"{state.st_size}-{state.st_mtime_ns}")


def _remote(pattern: str) -> Iterator[Source]:
    first, _, rest = pattern.partition("::")
    scheme = first.partition("://")[0]
    try:
        import fsspec

        system, path = fsspec.url_to_fs(pattern)
        if system.isdir(path):
            listed = system.find(path, detail=True)
            files = {p: d for p, d in listed.items() if p.lower().endswith(LOG_SUFFIXES)}
        elif any(sign in path for sign in "*?["):
            listed = system.glob(path, detail=True)
            files = {p: d for p, d in listed.items() if d.get("type") != "directory"}
        else:
            files = {path: system.info(path)}
    except ImportError as error:
        raise SourceError(f"{scheme}:// needs one more package: {error}") from None
    except FileNotFoundError:
        return
    except Exception as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise SourceError(f"cannot list {pattern}: {said}") from None
    for name, detail in files.items():
        log = _with_rest(str(system.unstrip_protocol(name)), rest)
        yield Source(log, int(detail.get("size") or 0), _stamp(detail))


def _with_rest(url: str, rest: str) -> str:
    """The URL with what a chain such as ``zip://*.tlog::s3://bucket/logs.zip`` adds to it."""
    return f"{url}::{rest}" if rest else url


def _stamp(detail: Mapping[str, Any]) -> str:
    for key in _STAMPS:
        if detail.get(key):
            return f"{detail.get('size')}-{detail[key]}"
    return ""
