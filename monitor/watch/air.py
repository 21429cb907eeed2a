"""Air-data watch: chooses between the filter bank and the triplex logic by what the aircraft has.

The choice falls once, at the row at which the aircraft first flies: with three pitots, or with two
vanes, there is a majority to ask (``air_triplex``); with fewer, wind and GPS are the witnesses
(``air_bank``), and a vane beside them is held against their angle of attack (``air_vane``). All see
the rows up to then; afterwards only the chosen ones work.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from links.samples import Rows, quantity_of
from monitor.retune import Retuned
from monitor.settings import Settings
from monitor.settings.air import AirSettings
from monitor.settings.triplex import TriplexSettings
from monitor.settings.vane import VaneSettings
from monitor.verdict import StepResult, Verdict
from monitor.watch.air_bank import AirBankWatch
from monitor.watch.air_triplex import AirTriplexWatch
from monitor.watch.air_vane import AirVaneWatch

__all__ = ["AirWatch"]


class AirWatch:
    """Judges pitots and vanes with the estimator that suits their number."""

    name = "air"

    def __init__(
        self, air: AirSettings, triplex: TriplexSettings, vane: VaneSettings | None = None
    ) -> None:
        self._bank = AirBankWatch(air)
        self._triplex = AirTriplexWatch(triplex)
        self._vane = AirVaneWatch(vane or VaneSettings())
        self.quantities = self._bank.quantities | self._triplex.quantities
        self._method: Literal["auto", "bank", "triplex"] = air.method
        self._chosen: AirBankWatch | AirTriplexWatch | None = None
        self._chosen_us = 0
        self._first_us: dict[str, int] = {}

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings (see :class:`monitor.verdict.Watch`); the choice stands."""
        watches = (self._bank, self._triplex, self._vane)
        return sum((watch.retune(settings) for watch in watches), Retuned())

    def step(self, rows: Mapping[str, Rows], until_us: int) -> StepResult:
        """Use the newly released rows (see :class:`monitor.verdict.Watch`)."""
        if self._chosen is self._triplex:
            return self._chosen.step(rows, until_us)
        chosen_before = self._chosen is self._bank
        if not chosen_before:
            self._choose(rows)
        bank = self._bank.step(rows, until_us)
        vanes = self._vane.step(rows, bank.estimates.get("air"), bank.verdicts)
        if len(self._vane.tests):
            bank.estimates |= self._bank.tests_beside(self._vane.tests)
        if chosen_before:
            return StepResult(_in_order(bank.verdicts, vanes), bank.estimates)
        triplex = self._triplex.step(rows, until_us)
        chosen, beside = (triplex, []) if self._chosen is self._triplex else (bank, vanes)
        verdicts = (
            [v for v in bank.verdicts if quantity_of(v.sensor) != "aoa" and self._before(v)]
            + [v for v in triplex.verdicts if quantity_of(v.sensor) == "aoa" and self._before(v)]
            + [v for v in _in_order(chosen.verdicts, beside) if not self._before(v)]
        )
        return StepResult(verdicts, {} if self._chosen is None else self._after(chosen.estimates))

    def peaks(self) -> dict[str, float]:
        """What the chosen estimator's test quantities reached, by settings key."""
        return {} if self._chosen is None else self._chosen.peaks()

    def _before(self, verdict: Verdict) -> bool:
        return self._chosen is None or verdict.t_us < self._chosen_us

    def _after(self, estimates: Mapping[str, Rows]) -> dict[str, Rows]:
        return {name: e[e["t_us"] >= self._chosen_us] for name, e in estimates.items()}

    def _choose(self, rows: Mapping[str, Rows]) -> None:
        for sensor, new in rows.items():
            if len(new) and sensor[:3] in ("air", "aoa"):
                self._first_us.setdefault(sensor, int(new["t_us"][0]))
        phase = rows.get("phase")
        if phase is None or not phase["flying"].any():
            return
        self._chosen_us = int(phase["t_us"][phase["flying"]][0])
        seen = [s for s, t_us in self._first_us.items() if t_us <= self._chosen_us]
        pitots = sum(s.startswith("airspeed") for s in seen)
        many = pitots >= 3 or len(seen) - pitots >= 2
        use_triplex = self._method == "triplex" or (self._method == "auto" and many)
        self._chosen = self._triplex if use_triplex else self._bank


def _in_order(verdicts: list[Verdict], more: list[Verdict]) -> list[Verdict]:
    """Both in order of time."""
    return sorted(verdicts + more, key=lambda v: v.t_us) if more else verdicts
