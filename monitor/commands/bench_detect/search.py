"""The smallest size that is found: bisection over a ladder of sizes, twenty trials a rung.

A rung *passes* for a window when at least 95 % of its trials were found within the window. Rungs
are bisected for the longest window first; a shorter one cannot do with less, so it starts from
there. The same trials (flight, moment, sense) are made on every rung, so that sizes are compared on
equal terms. A rung is given up once it can pass for no window any more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import floor, inf

__all__ = ["SHARE", "Outcome", "Rung", "Search", "misses_allowed", "search"]

SHARE = 0.95
"""Of the trials that must be found."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one trial.

    Attributes
    ----------
    named_s
        From the onset to the verdict on the sensor that was broken (or on its pair, where the
        configuration takes the pair for an answer); infinite when there was none.
    announced_s
        The same to the moment that the verdict gives as detection, which is earlier where two IMUs
        were first said to disagree.
    as_pair
        The pair was named and the broken axis itself was not.
    wrong_sensor, wrong_axis
        Others that were called faulty: another instrument, or another axis of the same one.
    misled
        One of those was named first, or alone.
    """

    named_s: float = inf
    announced_s: float = inf
    as_pair: bool = False
    wrong_sensor: tuple[str, ...] = ()
    wrong_axis: tuple[str, ...] = ()
    misled: bool = False


@dataclass(frozen=True, slots=True)
class Rung:
    """All trials made with one size."""

    size: float
    outcomes: tuple[Outcome, ...]

    def found(self, window_s: float) -> int:
        """How many were named within the window."""
        return sum(o.named_s <= window_s for o in self.outcomes)

    def passes(self, window_s: float, trials: int) -> bool:
        """Whether enough of ``trials`` were found; one given up does not pass."""
        return trials - self.found(window_s) <= misses_allowed(trials)


@dataclass(slots=True)
class Search:
    """Result of :func:`search`.

    Attributes
    ----------
    smallest
        Window [s] -> smallest size that passes; None when the largest does not.
    rungs
        Those that were tried, by size.
    """

    smallest: dict[float, float | None] = field(default_factory=dict)
    rungs: list[Rung] = field(default_factory=list)

    @property
    def outcomes(self) -> list[Outcome]:
        """Of all trials of all rungs."""
        return [outcome for rung in self.rungs for outcome in rung.outcomes]


def misses_allowed(trials: int) -> int:
    """How many of the trials need not be found: 1 of 20, none of fewer."""
    return floor(trials * (1.0 - SHARE) + 1e-9)


def search(
    sizes: Sequence[float],
    windows_s: Sequence[float],
    trials: int,
    judge: Callable[[float, int], Outcome],
) -> Search:
    """Find the smallest size per window.

    Parameters
    ----------
    sizes
        Ladder, ascending.
    windows_s
        Times within which a fault should be found.
    trials
        Per rung.
    judge
        Makes the trial of this number with a fault of this size.
    """
    rungs: dict[int, Rung] = {}
    longest_s = max(windows_s)

    def rung(i: int) -> Rung:
        if i not in rungs:
            rungs[i] = Rung(sizes[i], _trials(sizes[i], longest_s, trials, judge))
        return rungs[i]

    out = Search()
    low, first = 0, True
    for window_s in sorted(windows_s, reverse=True):
        high = len(sizes)
        probe, stride = low, 1
        while not first and probe < high:  # not far above what the longer window takes
            if rung(probe).passes(window_s, trials):
                high = probe
            else:
                low, probe, stride = probe + 1, probe + stride, 2 * stride
        first = False
        while low < high:
            middle = (low + high) // 2
            if rung(middle).passes(window_s, trials):
                high = middle
            else:
                low = middle + 1
        out.smallest[window_s] = sizes[low] if low < len(sizes) else None
    out.rungs = [rungs[i] for i in sorted(rungs)]
    return out


def _trials(
    size: float, longest_s: float, trials: int, judge: Callable[[float, int], Outcome]
) -> tuple[Outcome, ...]:
    outcomes: list[Outcome] = []
    missed = 0
    for trial in range(trials):
        outcomes.append(judge(size, trial))
        missed += outcomes[-1].named_s > longest_s
        if missed > misses_allowed(trials):
            break
    return tuple(outcomes)
