"""The smallest size that is found: bisection over a ladder of sizes, twenty trials a rung.

A rung *passes* for a window when at least 95 % of its trials were found within the window. Rungs
are bisected for the longest window first; a shorter one cannot do with less, so it starts from
there. The same trials (flight, moment, sense) are made on every rung, so that sizes are compared on
equal terms. A rung is given up at the miss that decides, and the trials that were hard on other
rungs come first: neither changes what passes.
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
    """Trials made with one size, in the order of their numbers; one given up has not all."""

    size: float
    outcomes: tuple[Outcome, ...]


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
    ladder = _Ladder(sizes, trials, judge)
    out = Search()
    low, first = 0, True
    for window_s in sorted(windows_s, reverse=True):
        high = len(sizes)
        probe, stride = low, 1
        while not first and probe < high:  # not far above what the longer window takes
            if ladder.passes(probe, window_s):
                high = probe
            else:
                low, probe, stride = probe + 1, probe + stride, 2 * stride
        first = False
        while low < high:
            middle = (low + high) // 2
            if ladder.passes(middle, window_s):
                high = middle
            else:
                low = middle + 1
        out.smallest[window_s] = sizes[low] if low < len(sizes) else None
    out.rungs = ladder.rungs()
    return out


class _Ladder:
    """Outcomes so far: rung -> trial -> outcome."""

    def __init__(
        self, sizes: Sequence[float], trials: int, judge: Callable[[float, int], Outcome]
    ) -> None:
        self._sizes, self._trials, self._judge = sizes, trials, judge
        self._made: dict[int, dict[int, Outcome]] = {}

    def passes(self, i: int, window_s: float) -> bool:
        """Whether enough trials of a rung are found within a window; makes those that decide."""
        made = self._made.setdefault(i, {})
        missed = sum(o.named_s > window_s for o in made.values())
        for trial in sorted(set(range(self._trials)) - set(made), key=self._ease):
            if missed > misses_allowed(self._trials):
                break
            made[trial] = self._judge(self._sizes[i], trial)
            missed += made[trial].named_s > window_s
        return missed <= misses_allowed(self._trials)

    def rungs(self) -> list[Rung]:
        """All rungs that were tried, by size."""
        return [
            Rung(self._sizes[i], tuple(made[trial] for trial in sorted(made)))
            for i, made in sorted(self._made.items())
        ]

    def _ease(self, trial: int) -> float:
        """Low for a trial that took long, or was not found, on other rungs."""
        delays = [made[trial].named_s for made in self._made.values() if trial in made]
        return -max(delays, default=0.0)
