"""The states of every sensor over a flight, as spans without gaps: what a timeline shows."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from links.vocabulary import State
from monitor.verdict import Verdict

__all__ = ["BEFORE", "LISTED", "NOT_LISTED", "Span", "spans_of"]

LISTED: Final = 2_000
"""Spans of one sensor that are told apart."""

BEFORE: Final = "not heard of yet"
NOT_LISTED: Final = "more changes of state than are listed"


class Span(NamedTuple):
    """A time in which one sensor's state did not change.

    Attributes
    ----------
    from_s, to_s
        Seconds from the log's first record.
    state
        What was said of the sensor.
    reason
        Why it could not be judged; None where it could.
    kind
        Shape of the fault, where it is faulty.
    evidence
        What was said with the verdict that began it, one sentence or nothing.
    """

    from_s: float
    to_s: float
    state: State
    reason: str | None
    kind: str | None
    evidence: str


def spans_of(
    verdicts: Iterable[Verdict], first_us: int, duration_s: float, left_out: int = 0
) -> dict[str, list[Span]]:
    """Spans of every sensor that a verdict speaks of, each from 0 to the end without a gap.

    Parameters
    ----------
    verdicts
        In time order.
    first_us
        Vehicle time of the log's first record [us].
    duration_s
        Where the last spans end; a later verdict begins none.
    left_out
        How many verdicts followed that were not kept: nothing is known after the last one then.

    Returns
    -------
    dict
        Sensor -> its spans, by the sensor's name. Before its first verdict a sensor is
        ``unmonitored``, with the reason :data:`BEFORE`; from the :data:`LISTED`-th span on, and
        where verdicts were left out, with the reason :data:`NOT_LISTED`.
    """
    tracks: dict[str, _Track] = {}
    last_s = 0.0
    for v in verdicts:
        last_s = min(max((v.t_us - first_us) / 1e6, last_s), duration_s)
        tracks.setdefault(v.sensor, _Track()).add(last_s, v)
    return {
        sensor: track.closed(duration_s, last_s if left_out else None)
        for sensor, track in sorted(tracks.items())
    }


class _Track:
    """One sensor's spans; the last one's end is not known yet."""

    def __init__(self) -> None:
        self._spans: list[Span] = []
        self._standing = Span(0.0, 0.0, State.UNMONITORED, BEFORE, None, "")

    def add(self, at_s: float, v: Verdict) -> None:
        """The sensor's state changes."""
        if len(self._spans) >= LISTED - 2:
            new = _unknown(at_s)
        else:
            kind = str(v.kind) if v.state is State.FAULTY else None
            reason = str(v.reason) if v.reason is not None else None
            new = Span(at_s, at_s, v.state, reason, kind, v.evidence)
        self._change(new)

    def closed(self, end_s: float, known_s: float | None) -> list[Span]:
        """All spans up to the end; what is known ends at ``known_s``, unless that is None."""
        if known_s is not None:
            self._change(_unknown(known_s))
        if self._standing.from_s < end_s or not self._spans:
            return [*self._spans, self._standing._replace(to_s=end_s)]
        return self._spans

    def _change(self, new: Span) -> None:
        standing = self._standing
        if (new.state, new.reason, new.kind) == (standing.state, standing.reason, standing.kind):
            return
        if new.from_s > standing.from_s:
            self._spans.append(standing._replace(to_s=new.from_s))
        self._standing = new


def _unknown(at_s: float) -> Span:
    return Span(at_s, at_s, State.UNMONITORED, NOT_LISTED, None, "")
