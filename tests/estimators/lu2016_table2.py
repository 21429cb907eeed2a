"""lu2016 section 3: the six faults of Table 2, reconstructed in calm air, shear and turbulence.

``python -m tests.estimators.lu2016_table2`` prints the root mean square errors of both models.
Estimates are compared with the faults present at the time of the estimate, over the whole 40 s,
so the error contains the detection of every onset and end.
"""

from __future__ import annotations

from typing import get_args

import numpy as np
from numpy.typing import NDArray

from estimators.two_stage_ekf import AS, GS, Settings, Status, TwoStageFilter
from sim_feeds.papers.lu2016 import Air, lu2016_experiment

WINDS: tuple[Air, ...] = get_args(Air)
SEEDS = range(100, 120)
"""Others than those on which :data:`DETUNING_S2` was chosen."""

DETUNING_S2 = 1e-3
"""Factor of (57) used here; chosen on seeds 0-5 between 1e-4 (the printed dt^2) and 1e-2.

Ten times the printed one: the estimates follow a fault faster and are 2.6 times noisier.
"""

AIR_START_VAR = (0.01, 0.04, 0.04, 3.05e-8, 3.05e-8, 3.05e-8)


def rmse(
    wind: Air, seeds: range = SEEDS, detuning_s2: float | None = DETUNING_S2
) -> dict[int, NDArray[np.float64]]:
    """Root mean square errors of the fault estimates, median over the seeds.

    Returns
    -------
    {GS: (6,), AS: (6,)} float64 [m/s^2, rad/s]
    """
    errors: dict[int, list[NDArray[np.float64]]] = {GS: [], AS: []}
    for seed in seeds:
        flight = lu2016_experiment(wind, seed)
        for model, x, y, x_var in (
            (GS, flight.x_ground, flight.y_ground, None),
            (AS, flight.x_air, flight.y_air, AIR_START_VAR),
        ):
            one = TwoStageFilter(Settings(model=model, detuning=detuning_s2), x[0], x_var)
            track = one.run(flight.u_m[:-1], y[1:], flight.env[:-1])
            if np.any(track["status"] != Status.OK):
                raise RuntimeError(f"{wind} {seed}: status {set(track['status'])}")
            errors[model].append(np.sqrt(np.mean((track["f"] - flight.f[1:]) ** 2, axis=0)))
    return {model: np.median(rows, axis=0) for model, rows in errors.items()}


def main() -> None:
    """Print the table, with the printed factor of (57) and with ours."""
    print("RMSE, median of 20 seeds         f_Ax    f_Ay    f_Az     f_p     f_q     f_r")
    for label, detuning in (("printed", None), ("tuned", DETUNING_S2)):
        for wind in WINDS:
            for model, row in rmse(wind, detuning_s2=detuning).items():
                name = {GS: "GS-KM", AS: "AS-KM"}[model]
                acc = "".join(f"{v:8.3f}" for v in row[:3])
                gyro = "".join(f"{v:8.4f}" for v in row[3:])
                print(f"{label:8} {name} {wind:11}{acc}{gyro}")


if __name__ == "__main__":
    main()
