"""The throttle as a servo output drives it, from 0 to 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.engine_ticks import FUNCTION_THROTTLE
from links.samples import Rows
from monitor.settings.engine import EngineSettings

__all__ = ["Throttle"]

OUTPUTS: Final = 16
USUAL: Final = 2
"""Output that is taken where neither settings nor parameters tell: the third."""


class Throttle:
    """Reads the throttle out of servo pulses, by the parameters that the log shows.

    Parameters
    ----------
    settings
        The output, where it is configured; pulses at idle and at full throttle until a parameter
        tells them.
    """

    def __init__(self, settings: EngineSettings) -> None:
        given = settings.throttle_channels
        self._given = given[0] - 1 if given and given[0] > 0 else None
        self._found = USUAL
        self._least = np.full(OUTPUTS, settings.throttle_idle_us)
        self._most = np.full(OUTPUTS, settings.throttle_full_us)
        self._reversed = np.zeros(OUTPUTS, np.bool_)

    def step(
        self, rows: Mapping[str, Rows]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
        """Times (n,) [us] and throttle (1, n) of released servo rows; None if there are none."""
        servo, changes = rows.get("servo"), _changes(rows.get("param"))
        if servo is None or not len(servo):
            for _, change in changes:
                self._use(*change)
            return None
        out = np.empty((1, len(servo)))
        begin = 0
        for (t_us, seq), change in changes:
            later = (servo["t_us"] > t_us) | ((servo["t_us"] == t_us) & (servo["seq"] > seq))
            end = len(servo) - int(later.sum())
            out[0, begin:end] = self._of(servo["pwm_us"][begin:end])
            begin = end
            self._use(*change)
        out[0, begin:] = self._of(servo["pwm_us"][begin:])
        return servo["t_us"], out

    def _of(self, pwm_us: NDArray[np.float64]) -> NDArray[np.float64]:
        output = self._found if self._given is None else self._given
        pulse, least, most = pwm_us[:, output], self._least[output], self._most[output]
        if least == most:
            return np.full(len(pulse), np.nan)
        share = np.clip((pulse - least) / (most - least), 0.0, 1.0)
        if self._reversed[output]:
            share = 1.0 - share
        return np.where(pulse > 0.0, share, np.nan)

    def _use(self, output: int, what: bytes, value: float) -> None:
        match what:
            case b"FUNCTION" if value == FUNCTION_THROTTLE:
                self._found = output
            case b"MIN":
                self._least[output] = value
            case b"MAX":
                self._most[output] = value
            case b"REVERSED":
                self._reversed[output] = value > 0.5


def _changes(params: Rows | None) -> list[tuple[tuple[int, int], tuple[int, bytes, float]]]:
    """When (time, arrival) which output's parameter got which value, in order."""
    out = []
    if params is None:
        return []
    for row in params[np.char.startswith(params["name"], b"SERVO")]:
        number, _, what = bytes(row["name"]).removeprefix(b"SERVO").partition(b"_")
        if number.isdigit() and 1 <= int(number) <= OUTPUTS:
            when = (int(row["t_us"]), int(row["seq"]))
            out.append((when, (int(number) - 1, what, float(row["value"]))))
    return out
