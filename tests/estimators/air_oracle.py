"""The problems of the oracle file as arrays and as loaded estimators."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimators.air_data_2d import air_outside
from estimators.air_data_mhe import AirDataMHE, AirDataTuning

CASES = tuple(
    f"c{i:02d}" for i in (0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29, 32, 33, 36, 37)
)
CONSTRAINED = tuple(c for c in CASES if int(c[1:]) % 4 == 0)


@dataclass
class Problem:
    """One problem; attributes are the file's keys without the case's prefix."""

    fields: dict[str, Any]

    def __getattr__(self, key: str) -> Any:
        return self.fields[key]

    @property
    def tuning(self) -> np.ndarray:
        """Rows P, Q, R, xl, xu, ul, uu; infinite bounds when the problem has none."""
        inf = np.full(4, np.inf)
        free = [-inf, inf, -inf, inf]
        bounds = [self.xl, self.xu, self.ul, self.uu] if self.con else free
        return np.array([self.P, self.Q, self.R, *bounds])

    def window(self) -> tuple[Any, ...]:
        """Arguments P .. uu of the window solvers (constrained problems carry them)."""
        return (
            np.diag(self.P), self.Q, self.R, self.A, self.B, self.C, self.f,
            self.xprior - self.xlin[0], -self.ulin, self.ry,
            self.xl - self.xlin, self.xu - self.xlin, self.ul - self.ulin, self.uu - self.ulin,
        )  # fmt: skip

    def estimator(self, **settings: Any) -> AirDataMHE:
        """An estimator whose horizon is this problem."""
        tuning = AirDataTuning(model=int(self.model), N=int(self.N), t_s=float(self.ts), **settings)
        e = AirDataMHE(tuning, self.xprior, self.theta[0])
        e.table[:] = self.tuning
        e.x_prior[:], e.x[:], e.u[:] = self.xprior, self.xlin, self.ulin
        e.y[:], e.use[:], e.theta[:] = self.ym, self.mask, self.theta
        for altitude, air in zip(self.theta[:, 5], e.air, strict=True):
            air_outside(altitude, 0.0, air)
        return e


def load(oracle: Path, case: str) -> Problem:
    """Read one problem."""
    with np.load(oracle / "air_data_mhe.npz") as file:
        keys = [k for k in file.files if k.startswith(f"{case}_")]
        return Problem({k[4:]: file[k] for k in keys})
