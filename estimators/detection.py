"""From a test statistic to a latched verdict: threshold, physical size, confirmation, clearing.

===========  =====================================================  ========
symbol       meaning                                                unit
===========  =====================================================  ========
z            test statistic, estimate over its standard deviation   sigma
f            estimated fault                                        SI
size         physical size below which nothing is called a fault    SI
confirm      the test must hold this long before a fault is called  us
clear        agreement must last this long before re-admission      us
===========  =====================================================  ========

A fault is called when the test holds, without a break longer than ``grace``, for ``confirm``. Once
called it stays: only agreement with the reconstruction (a statistic below ``release`` times the
threshold *or* an estimate below ``release`` times the size) that lasts ``clear`` re-admits the
sensor, so that a fault which hovers about its threshold is one fault and not twenty-four.

The rules hold no clock and no buffer: times are those of the samples, so any split of a stream into
batches gives the same verdicts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

__all__ = ["Latch", "LatchRule", "LatchState", "significant"]


class LatchState(IntEnum):
    """What the latch says now."""

    OK = 0
    SUSPECT = 1
    FAULTY = 2


def significant(z: float, f: float, threshold: float, size: float) -> bool:
    """Whether an estimate is both beyond its threshold in sigmas and physically large.

    Not-a-number in either gives False: what cannot be computed is no evidence.
    """
    return abs(z) > threshold and abs(f) > size


@dataclass(frozen=True, slots=True)
class LatchRule:
    """Times and ratios of one latch.

    Attributes
    ----------
    confirm_us
        The test must hold this long [us].
    clear_us
        Agreement must last this long before re-admission [us].
    grace_us
        A break of the test no longer than this does not restart the confirmation [us].
    """

    confirm_us: int
    clear_us: int
    grace_us: int = 0


@dataclass(slots=True)
class Latch:
    """Confirmation, latching and clearing of one fault hypothesis.

    Attributes
    ----------
    rule
        Its times.
    state
        What it says after the last :meth:`step`.
    since_us
        When the test that led to the present suspicion or fault began to hold; None when ok.
    """

    rule: LatchRule
    state: LatchState = LatchState.OK
    since_us: int | None = None
    _held_us: int = field(default=0, repr=False)
    _agrees_since_us: int | None = field(default=None, repr=False)

    def step(self, t_us: int, alarm: bool, agrees: bool) -> LatchState:
        """Use one decision of the test, taken at ``t_us`` (never decreasing).

        Parameters
        ----------
        alarm
            The test holds: beyond the threshold and larger than the physical size.
        agrees
            The sensor agrees with its reconstruction, with the margin of the hysteresis. Between
            ``alarm`` and ``agrees`` lies the band in which nothing changes.
        """
        if self.state is LatchState.FAULTY:
            self._clear(t_us, agrees and not alarm)
        elif alarm:
            if self.since_us is None:
                self.since_us = t_us
            self._held_us = t_us
            held = t_us - self.since_us >= self.rule.confirm_us
            self.state = LatchState.FAULTY if held else LatchState.SUSPECT
        elif self.since_us is not None and t_us - self._held_us > self.rule.grace_us:
            self.reset()
        return self.state

    def _clear(self, t_us: int, agrees: bool) -> None:
        if not agrees:
            self._agrees_since_us = None
        elif self._agrees_since_us is None:
            self._agrees_since_us = t_us
        if self._agrees_since_us is not None and (
            t_us - self._agrees_since_us >= self.rule.clear_us
        ):
            self.reset()

    def force(self, t_us: int, since_us: int) -> None:
        """Call the fault now: other evidence than this latch's own test decided."""
        self.state = LatchState.FAULTY
        self.since_us = since_us
        self._held_us = t_us
        self._agrees_since_us = None

    def reset(self) -> None:
        """Back to ok, with no memory."""
        self.state = LatchState.OK
        self.since_us = None
        self._agrees_since_us = None
