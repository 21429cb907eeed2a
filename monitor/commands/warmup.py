"""``mavsentry warmup``: compile the kernels once, so that ``run`` starts at once."""

from __future__ import annotations

import time

__all__ = ["warmup"]


def warmup() -> None:
    """Compile every kernel of the daemon and keep the machine code."""
    from estimators.jit import cache_root
    from monitor.settings import PROFILES, load
    from monitor.warmup import warm_up

    began_s = time.monotonic()
    for profile in PROFILES:
        warm_up(load(profile))
    print(f"kernels are ready in {cache_root()} ({time.monotonic() - began_s:.1f} s)")
