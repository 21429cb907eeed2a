"""``mavsentry warmup``: compile the kernels once, so that ``run`` starts at once."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from monitor.commands.common import Refused, note, progress

__all__ = ["compile_jobs", "warmup"]

PART_MB = 1000.0
"""Memory that one process takes to compile the kernels of a watch, with some to spare [MB]."""


def warmup() -> None:
    """Compile every kernel of the daemon, on all processors, and keep the machine code.

    It is kept in the user's cache folder, or where MAVSENTRY_CACHE_DIR says, and is good for this
    version, this Python and this type of processor. Where it is there already this takes seconds.
    """
    from estimators.jit import cache_root, is_cold, unkept
    from monitor.commands.processes import each
    from monitor.settings import PROFILES, load
    from monitor.warmup import PARTS, compile_part, warm_up

    began_s = time.monotonic()
    if is_cold():
        _have_place(cache_root())
        jobs = compile_jobs(len(PARTS))
        note(f"mavsentry: compiling kernels into {cache_root()}, {jobs} at once: takes minutes")
        with progress("compiling") as bar:
            for done, (part, _) in enumerate(
                each(compile_part, PARTS, jobs, lambda: None), start=1
            ):
                took_s = time.monotonic() - began_s
                with bar.hidden():
                    note(f"  {PARTS[part]}: ready ({done} of {len(PARTS)}, {took_s:.0f} s)")
                bar(done / (len(PARTS) + 1))
    for profile in PROFILES:
        warm_up(load(profile))
    if why := unkept():
        raise Refused(f"not all kernels could be kept in {cache_root()}: {why}")
    print(f"kernels are ready in {cache_root()} ({time.monotonic() - began_s:.1f} s)")


def _have_place(folder: Path) -> None:
    """Refuse to compile for minutes what cannot be kept then."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise Refused(
            f"kernels cannot be kept in {folder}: {error.strerror}; MAVSENTRY_CACHE_DIR names "
            "another folder, for `warmup` and for what runs afterwards"
        ) from None


def compile_jobs(parts: int) -> int:
    """Processes to compile in: as many as there are processors and memory is free for."""
    return int(max(1, min(os.cpu_count() or 1, parts, _free_mb() // PART_MB)))


def _free_mb() -> float:
    """Memory that is free, or can be freed [MB]; infinite where the system does not say."""
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) / 1e3
    except (OSError, ValueError, IndexError):
        pass
    return float("inf")
