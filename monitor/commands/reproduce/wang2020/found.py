"""Numbers of the chapter out of the results of the jobs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.study import Result, Results

__all__ = ["Found", "Spread"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Spread:
    """A number over many runs: its values, median, and what 10 and 90 % of the runs stay below."""

    values: Array

    @property
    def median(self) -> float:
        """Half of the runs are below."""
        return float(np.nanmedian(self.values))

    @property
    def low(self) -> float:
        """10 % of the runs are below."""
        return float(np.nanquantile(self.values, 0.1))

    @property
    def high(self) -> float:
        """90 % of the runs are below."""
        return float(np.nanquantile(self.values, 0.9))

    def below(self, value: float) -> float:
        """Share of the runs at or below a value."""
        return float(np.mean(self.values <= value))

    def words(self, digits: int = 3) -> str:
        """Median and spread, as "39.3 (27 to 60)"."""
        low, high = (f"{v:.{digits - 1}g}" for v in (self.low, self.high))
        return f"{self.median:.{digits}g} ({low} to {high})"


@dataclass(frozen=True, slots=True)
class Found:
    """Everything that the jobs returned, by what it is asked for."""

    results: Results

    def _parts(self, law: str) -> list[Result]:
        prefix = f"runs/{law}/"
        return [self.results[name] for name in sorted(self.results) if name.startswith(prefix)]

    @property
    def runs(self) -> int:
        """How many runs a number rests on."""
        return len(self.spread("proposed", "a95").values)

    def methods(self, law: str = "gaussian") -> tuple[str, ...]:
        """Methods that were run in this noise."""
        return tuple(self._parts(law)[0]["scores"])

    def each(self, method: str, key: str, law: str = "gaussian") -> Array:
        """One score of a method, run by run."""
        parts = [np.asarray(part["scores"][method][key]) for part in self._parts(law)]
        joined: Array = np.concatenate(parts)
        return joined

    def spread(self, method: str, key: str, law: str = "gaussian") -> Spread:
        """The same as a spread; for scores that are one number."""
        return Spread(self.each(method, key, law))

    def ratio(self, method: str, to: str, law: str = "gaussian") -> Spread:
        """Area of a method's ellipse over that of another's in the same run."""
        return Spread(self.each(method, "a95", law) / self.each(to, "a95", law))

    def reduction(self, key: str, of: str) -> float:
        """By how many per cent the proposed method's median is below another's."""
        return 100.0 * (1.0 - self.spread("proposed", key).median / self.spread(of, key).median)

    def printed(self, key: str, law: str = "gaussian") -> int:
        """A count of the printed form over all runs."""
        return int(sum(np.sum(part["printed"][key]) for part in self._parts(law)))

    @property
    def classic_apart(self) -> float:
        """Worst relative difference of the proposed and the classic correction's estimates."""
        return float(max(np.max(part["classic_apart"]) for part in self._parts("gaussian")))

    @property
    def named_s(self) -> Array:
        """Times until a permanent fault is seen in the health, (runs, 2) [s]."""
        named: Array = np.concatenate([part["named_s"] for part in self._parts("gaussian")])
        return named

    @property
    def units(self) -> Result:
        """Of the job with physical units."""
        return self.results["units"]

    @property
    def settings(self) -> dict[str, Spread]:
        """Areas under other settings, on other runs."""
        return {name: Spread(np.asarray(v)) for name, v in self.results["settings"].items()}

    @property
    def shown(self) -> Result:
        """The run of the figures."""
        return self.results["shown"]
