"""``mavsentry warmup``: compile the kernels once, so that ``run`` starts at once."""

from __future__ import annotations

import os
import time

__all__ = ["warmup"]


def warmup() -> None:
    """Compile every kernel of the daemon, on all processors, and keep the machine code."""
    from estimators.jit import cache_root, is_cold
    from monitor.commands.processes import each
    from monitor.settings import PROFILES, load
    from monitor.warmup import PARTS, compile_part, warm_up

    began_s = time.monotonic()
    jobs = min(os.cpu_count() or 1, len(PARTS)) if is_cold() else 1
    if jobs > 1:
        for _ in each(compile_part, PARTS, jobs, lambda: None):
            pass
    for profile in PROFILES:
        warm_up(load(profile))
    print(f"kernels are ready in {cache_root()} ({time.monotonic() - began_s:.1f} s)")
