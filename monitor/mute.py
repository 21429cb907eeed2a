"""What is said of sensors while an operator has muted some: the watches go on and are not heard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from links.vocabulary import Reason, State
from monitor.verdict import Verdict

__all__ = ["Muting"]

_UNHEARD = frozenset({State.ABSENT})
"""States that are said of a muted sensor all the same: it is not there to be muted."""


class Muting:
    """The last stage of the composition of states: from what is so to what is said.

    Attributes
    ----------
    said
        Sensor -> the verdict that stands, with muted sensors unmonitored.
    """

    def __init__(self, muted: frozenset[str] = frozenset()) -> None:
        self._muted = muted
        self._so: dict[str, Verdict] = {}
        self.said: dict[str, Verdict] = {}

    def hear(self, verdicts: list[Verdict]) -> list[Verdict]:
        """What of new verdicts is said."""
        out = []
        for verdict in verdicts:
            self._so[verdict.sensor] = verdict
            if self._hides(verdict):
                if self._is_muted(verdict.sensor):
                    continue
                verdict = _muted(verdict, verdict.t_us)
            self.said[verdict.sensor] = verdict
            out.append(verdict)
        return out

    def mute(self, muted: frozenset[str], t_us: int) -> list[Verdict]:
        """Mute these and no others; what changes by that is said as of ``t_us``."""
        self._muted = muted
        out = []
        for sensor, verdict in self._so.items():
            hidden = self._hides(verdict)
            if hidden != self._is_muted(sensor):
                said = _muted(verdict, t_us) if hidden else replace(verdict, t_us=t_us)
                self.said[sensor] = said
                out.append(said)
        return out

    def so(self) -> Mapping[str, Verdict]:
        """Sensor -> what would be said if nothing were muted."""
        return self._so

    def _hides(self, verdict: Verdict) -> bool:
        return verdict.sensor in self._muted and verdict.state not in _UNHEARD

    def _is_muted(self, sensor: str) -> bool:
        said = self.said.get(sensor)
        return said is not None and said.reason is Reason.MUTED


def _muted(verdict: Verdict, t_us: int) -> Verdict:
    return Verdict(t_us, verdict.sensor, State.UNMONITORED, Reason.MUTED)
