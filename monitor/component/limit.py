"""A rate limit: so many at once after a quiet time, so many a second for good."""

from __future__ import annotations

__all__ = ["Limit"]


class Limit:
    """A bucket that holds a second's worth and fills at its rate.

    Attributes
    ----------
    dropped
        Questions that were answered with no.
    """

    def __init__(self, per_s: float, burst: float | None = None) -> None:
        self._per_us = per_s / 1e6
        self._burst = max(1.0, per_s if burst is None else burst)
        self._tokens = self._burst
        self._asked_us: int | None = None
        self.dropped = 0

    def allows(self, now_us: int) -> bool:
        """Whether one more may pass now (host monotonic [us])."""
        if self._asked_us is not None:
            gained = max(0, now_us - self._asked_us) * self._per_us
            self._tokens = min(self._burst, self._tokens + gained)
        self._asked_us = now_us
        if self._tokens < 1.0:
            self.dropped += 1
            return False
        self._tokens -= 1.0
        return True
