"""How every kernel of these packages is compiled, and where the machine code is kept.

``kernel`` is ``numba.njit`` with the project's options: cached, numpy error model (a division by
zero gives an infinity, not an exception), no fast-math (the result must not depend on how a stream
is split). Numba's own cache looks at the file of the kernel alone and would go on serving machine
code compiled against a callee that has changed since; the cache folder is therefore named after a
digest of the module *and* of every module of ``links`` and ``estimators`` it imports.

``MAVSENTRY_CACHE_DIR`` moves the cache; its default is the user's cache folder. Several processes
may compile at once: each saves under a lock, or two signatures of one kernel could end up with one
name for two pieces of machine code. What is there is used where nothing can be written, too: a
cache that was made with the image of a read-only system. A cache that cannot be written or read
costs the time to compile, never the program; :func:`unkept` says why.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import platformdirs
from numba.core import caching, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.types.common import Buffer
from numba.extending import intrinsic
from numba.np import arrayobj

__all__ = ["borrowed", "cache_root", "inlined", "is_cold", "kernel", "unkept"]

F = TypeVar("F", bound=Callable[..., Any])
State = TypeVar("State")

make_view: Any = arrayobj.make_array
_folders: set[Path] = set()
_unkept: list[str] = []
_locators: Any = vars(caching)
_OwnFolder: Any = (
    _locators.get("UserProvidedCacheLocator") or _locators["_UserProvidedCacheLocator"]
)
_OURS = r"((?:estimators|links)(?:\.\w+)*)"
_IMPORT = re.compile(rf"^from {_OURS} import (\([^)]*\)|.*)|^import {_OURS}", re.M)
_THIS = {__name__, "estimators.jit"}


def cache_root() -> Path:
    """Folder under which compiled kernels are kept."""
    chosen = os.environ.get("MAVSENTRY_CACHE_DIR")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("mavsentry")) / "kernels"


@cache
def _digest(module: str) -> str:
    """Digest of a module's source and of the modules with kernels it imports, transitively.

    Packages themselves hold no kernels: of them, only the modules that are imported count.
    """
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return module
    text = Path(file).read_text(encoding="utf-8")
    found = set()
    for source, names, alone in _IMPORT.findall(text):
        if hasattr(sys.modules.get(source), "__path__"):
            found |= {f"{source}.{name}" for name in re.findall(r"\w+", names)} & set(sys.modules)
        else:
            found.add(source or alone)
    found -= {module} | _THIS
    parts = [numba.__version__, text, *(_digest(name) for name in sorted(found))]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def kernel(function: F) -> F:
    """Compile ``function`` to machine code on its first call (or load it from the cache)."""
    return _compiled(function)


def inlined(function: F) -> F:
    """A small kernel that is always merged into the kernels that call it."""
    return _compiled(function, forceinline=True)


def _compiled(function: F, **options: Any) -> F:
    folder = cache_root() / _digest(function.__module__)
    _folders.add(folder)
    config: Any = numba.config
    config.CACHE_DIR = str(folder)
    compiled: Any = numba.njit(error_model="numpy", fastmath=False, **options)(function)
    if hasattr(compiled, "py_func"):  # not where NUMBA_DISABLE_JIT leaves functions as they are
        compiled._cache = _Cache(function)  # type: ignore[no-untyped-call]
    return cast(F, compiled)


class _Place(_OwnFolder):  # type: ignore[misc]
    """Our folder, also where it cannot be written: numba would take another one, or none at all."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """The place of a kernel's machine code; nothing is made or tried out here."""
        return cls(py_func, py_file)


class _Impl(CompileResultCacheImpl):
    """Numba's way to write machine code down, in our folder and nowhere else."""

    _locator_classes = [_Place]  # noqa: RUF012


class _Cache(FunctionCache):
    """Numba's cache of a kernel, of which one process at a time changes the files."""

    _impl_class = _Impl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code of a signature; None, so that it is compiled, if it cannot be read."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except OSError as error:
            _tell(error)
        except Exception:  # cut off by a power cut: what unpickling it raises may be anything
            folder = Path(self.cache_path)
            with suppress(OSError), _locked(folder):
                self.flush()  # type: ignore[no-untyped-call]
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code of a signature, if that is possible."""
        folder = Path(self.cache_path)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with _locked(folder):
                super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except OSError as error:
            _tell(error)


def _tell(error: OSError) -> None:
    if not _unkept:
        _unkept.append(error.strerror or str(error))


def unkept() -> str | None:
    """Why machine code could not be kept or read in this process; None if it could."""
    return _unkept[0] if _unkept else None


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold a folder against other processes, where the system has such locks."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with open(folder / ".lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def borrowed(state: State) -> State:
    """An array, bytes, or a tuple of them, of which no references are counted within a kernel.

    A kernel counts a reference of every array that it hands to another, twice and atomically: with
    thirty arrays, or for every message of a stream, that is longer than most of what is called.
    Within a kernel, ``b = borrowed(b)`` gives the same memory without its owner. Whoever called the
    kernel keeps it alive; it must not outlive the call. Elements that are no arrays stay as they
    are.
    """
    return state


@intrinsic
def _borrowed(typing: Any, state: Any) -> Any:
    """:func:`borrowed`, in machine code: null pointers for owner and counter of every array."""

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        def without_owner(of: Any, value: Any) -> Any:
            array = make_view(of)(context, builder, value)
            array.meminfo = array.meminfo.type(None)
            array.parent = array.parent.type(None)
            return array._getvalue()

        (of,), (out,) = signature.args, args
        if isinstance(of, Buffer):
            return without_owner(of, out)
        for i, element in enumerate(of.types):
            if isinstance(element, Buffer):
                value = without_owner(element, builder.extract_value(out, i))
                out = builder.insert_value(out, value, i)
        return out

    return state(state), lower


@numba.extending.overload(borrowed, strict=False)
def _overload_borrowed(state: Any) -> Any:
    if isinstance(state, types.BaseTuple | Buffer):
        return lambda state: _borrowed(state)  # type: ignore[call-arg]
    return None


def is_cold() -> bool:
    """Whether most of the modules imported so far have no machine code in the cache yet.

    Their first calls will then take some minutes. (Most, because a module's kernels may be of no
    use to this program and never be compiled.)
    """
    compiled = sum(any(folder.rglob("*.nbi")) for folder in _folders)
    return 2 * compiled < len(_folders)
