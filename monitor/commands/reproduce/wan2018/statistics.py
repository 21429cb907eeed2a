"""The metrics of wan2018 VI-B over the judged runs, and what the paper printed for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.study import Results

__all__ = [
    "CHANNELS",
    "PAPER",
    "PAPER_ERRORS",
    "SOON_S",
    "Channel",
    "Paper",
    "channel_of",
    "errors_of",
    "judged_runs",
    "memory_of",
    "remembered_s",
    "sensors_of",
]

Floats = NDArray[np.float64]
Judged = dict[str, Any]

CHANNELS: Final = ("AOA", "VCAS")
SOON_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Paper:
    """A row of wan2018 Table IV."""

    far: float
    mdr: float
    fir: float
    max_s: float
    mean_s: float


PAPER: Final = (Paper(0.0, 0.0, 0.92, 19.16, 0.75), Paper(0.0, 0.0, 0.0, 4.64, 0.80))
PAPER_ERRORS: Final = {
    ("healthy", "alpha"): (2.44, 0.02),
    ("faulty", "alpha"): (16.39, 0.24),
    ("healthy", "cas"): (8.22, 0.02),
    ("faulty", "cas"): (8.22, 0.02),
}
"""wan2018 Table III: largest and mean absolute error, deg and kt."""


@dataclass(frozen=True)
class Channel:
    """One channel by one scheme; rates in percent of the runs, as the paper counts them.

    Attributes
    ----------
    far, fir
        Healthy runs with a flag; faulty runs with a healthy sensor flagged.
    mdr, mdr_all
        Faulty runs in which a sensor whose fault can be seen, or any broken one, is never found.
    released
        Faulty runs in which a found sensor is let go while its fault lasts.
    delays_s : (n,)
        From the onset until the last sensor whose fault can be seen is found, one a run.
    waits_s : (n,)
        The same, each sensor counted from the moment from which its fault can be seen.
    visible_s : (n,)
        From the onset until the fault of the sensor that is found last can be seen.
    runs : (n,) int
        Their numbers.
    """

    far: float
    mdr: float
    mdr_all: float
    fir: float
    released: float
    delays_s: Floats
    waits_s: Floats
    visible_s: Floats
    runs: NDArray[np.int64]

    @property
    def slowest(self) -> int:
        """Number of the run with the longest delay."""
        return int(self.runs[self.delays_s.argmax()]) if len(self.runs) else -1

    @property
    def max_s(self) -> float:
        """Longest delay."""
        return float(self.delays_s.max(initial=0.0))

    @property
    def mean_s(self) -> float:
        """Mean delay."""
        return float(self.delays_s.mean()) if len(self.delays_s) else 0.0

    @property
    def soon_s(self) -> Floats:
        """Delays of the faults that can be seen within :data:`SOON_S` of the onset."""
        return self.delays_s[self.visible_s <= SOON_S]

    @property
    def mean_soon_s(self) -> float:
        """Their mean."""
        return float(self.soon_s.mean()) if len(self.soon_s) else 0.0

    @property
    def max_wait_s(self) -> float:
        """Longest delay since the fault could be seen."""
        return float(self.waits_s.max(initial=0.0))


def judged_runs(results: Results, which: str = "main") -> list[Judged]:
    """All judged runs of "main", "small" or "fresh", by number."""
    found = [
        run
        for name, result in results.items()
        if name.startswith(f"parametric/{which}")
        for run in result["runs"]
    ]
    return sorted(found, key=lambda run: int(run["number"]))


def _percent(part: int, whole: int) -> float:
    return 100.0 * part / whole if whole else 0.0


def channel_of(runs: Sequence[Judged], scheme: str, ch: int) -> Channel:
    """Metrics of one channel (0 vanes, 1 pitots) by one scheme."""
    healthy = [r for r in runs if r["category"] == "healthy"]
    faulty = [r for r in runs if r["category"] != "healthy"]
    alarms = sum(bool(np.any(r["schemes"][scheme]["wrongly"][ch])) for r in healthy)
    missed = missed_all = wrong = released = 0
    delays, waits, since, numbers = [], [], [], []
    for r in faulty:
        s = r["schemes"][scheme]
        wrong += bool(np.any(s["wrongly"][ch]))
        released += bool(np.any(s["released"][ch]))
        found, visible = np.asarray(s["found_s"][ch]), np.asarray(r["visible_s"][ch])
        broken = _broken(r, ch)
        missed_all += bool((broken & ~np.isfinite(found)).any())
        seen = np.isfinite(visible)
        missed += bool((seen & ~np.isfinite(found)).any())
        both = seen & np.isfinite(found)
        if both.any():
            delays.append(float(found[both].max()))
            waits.append(float(np.maximum(found - visible, 0.0)[both].max()))
            since.append(float(visible[both][found[both].argmax()]))
            numbers.append(int(r["number"]))
    return Channel(
        far=_percent(alarms, len(healthy)),
        mdr=_percent(missed, len(faulty)),
        mdr_all=_percent(missed_all, len(faulty)),
        fir=_percent(wrong, len(faulty)),
        released=_percent(released, len(faulty)),
        delays_s=np.asarray(delays),
        waits_s=np.asarray(waits),
        visible_s=np.asarray(since),
        runs=np.asarray(numbers, dtype=np.int64),
    )


def _broken(run: Judged, ch: int) -> NDArray[np.bool_]:
    prefix = ("aoa", "airspeed")[ch]
    return np.array([f"{prefix}{i}" in run["kinds"] for i in range(3)])


def errors_of(runs: Sequence[Judged], scheme: str, name: str, healthy: bool) -> tuple[float, float]:
    """Largest absolute error, and the mean over runs of each run's mean; deg or kt."""
    chosen = [
        r["schemes"][scheme]["errors"][name]
        for r in runs
        if (r["category"] == "healthy") == healthy
    ]
    if not chosen:
        return np.nan, np.nan
    return max(e[0] for e in chosen), float(np.mean([e[1] for e in chosen]))


def memory_of(runs: Sequence[Judged], scheme: str) -> Floats:
    """Rows [samples, mean |error| kt, max |error| kt, share within 3 sigma] per age, (5, 4)."""
    each = np.array([r["schemes"][scheme]["memory"] for r in runs], dtype=float)
    n = each[:, :, 0].sum(axis=0)
    some = np.maximum(n, 1.0)
    mean, inside = each[:, :, 1].sum(axis=0) / some, each[:, :, 3].sum(axis=0) / some
    return np.column_stack([n, mean, each[:, :, 2].max(axis=0), inside])


def remembered_s(runs: Sequence[Judged], scheme: str) -> Floats:
    """How long each run without a pitot told the airspeed to within the threshold (1 sigma)."""
    times = [r["schemes"][scheme]["remembered_s"] for r in runs]
    return np.array([t for t in times if t is not None])


def sensors_of(
    runs: Sequence[Judged], scheme: str, ch: int
) -> dict[str, tuple[int, int, int, int]]:
    """Per kind: sensors broken, seen by a perfect observer, of these found, found of all."""
    out: dict[str, list[int]] = {}
    prefix = ("aoa", "airspeed")[ch]
    for r in runs:
        found = np.isfinite(np.asarray(r["schemes"][scheme]["found_s"][ch]))
        visible = np.isfinite(np.asarray(r["visible_s"][ch]))
        for i in range(3):
            kind = r["kinds"].get(f"{prefix}{i}")
            if kind is not None:
                row = out.setdefault(kind, [0, 0, 0, 0])
                row[0] += 1
                row[1] += bool(visible[i])
                row[2] += bool(visible[i] and found[i])
                row[3] += bool(found[i])
    return {kind: (a, b, c, d) for kind, (a, b, c, d) in sorted(out.items())}
