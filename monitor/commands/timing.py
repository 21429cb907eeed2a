"""Timing of interleaved work: ours and each peer in turn, so that a busy machine is fair to all."""

from __future__ import annotations

import gc
import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

__all__ = ["Timing", "interleaved", "machine"]


@dataclass(frozen=True, slots=True)
class Timing:
    """Median and 99th percentile of the time of one call [us], over ``rounds`` calls."""

    median_us: float
    p99_us: float
    rounds: int


def interleaved(
    contenders: Mapping[str, Callable[[], object]],
    budget_s: float,
    rounds_min: int = 5,
    rounds_max: int = 2000,
) -> dict[str, Timing]:
    """Call every contender once per round until the budget is used; the first round is not counted.

    Parameters
    ----------
    contenders
        Name -> work.
    budget_s
        Time for all of it [s]; ``rounds_min`` rounds are made whatever they take.
    rounds_min, rounds_max
        Bounds of the number of counted rounds.
    """
    taken: dict[str, list[int]] = {name: [] for name in contenders}
    for work in contenders.values():
        work()
    collecting = gc.isenabled()
    gc.disable()
    try:
        end_s = time.perf_counter() + budget_s
        for done in range(rounds_max):
            if done >= rounds_min and time.perf_counter() > end_s:
                break
            for name, work in contenders.items():
                began_ns = time.perf_counter_ns()
                work()
                taken[name].append(time.perf_counter_ns() - began_ns)
    finally:
        if collecting:
            gc.enable()
    return {name: _timing(np.asarray(ns) / 1e3) for name, ns in taken.items()}


def machine() -> dict[str, object]:
    """What the numbers were measured on."""
    import numba

    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "load_1min": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    }


def _timing(us: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Timing:
    median, p99 = np.quantile(us, (0.5, 0.99))
    return Timing(float(median), float(p99), len(us))


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [
                text.partition(":")[2].strip() for text in file if text.startswith("model name")
            ]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or "unknown"
