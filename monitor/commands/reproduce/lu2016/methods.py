"""The estimators that lu2016 compares, each on a flight of six faults.

``iotsekf`` is the two-stage filter with Q^f as given, ``atsekf`` matches Q^f to the innovations,
``smo`` is the sliding-mode observer and ``smo-low`` the same after its low-pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.sliding_mode import SlidingModeObserver, SlidingModeSettings
from estimators.kinematics import AS, GS, output_jacobian, state_from_output
from estimators.two_stage_ekf import Settings, TwoStageFilter

if TYPE_CHECKING:
    from sim_feeds.papers.lu2016 import ImuExperiment

__all__ = [
    "LABELS",
    "METHODS",
    "MODELS",
    "TABLE_1",
    "Noise",
    "all_estimates",
    "scores",
    "two_stage",
]

Floats = NDArray[np.float64]
Rows = NDArray[np.void]

MODELS: Final = {"GS": GS, "AS": AS}
METHODS: Final = ("iotsekf", "atsekf", "smo", "smo-low")
LABELS: Final = {
    "GS": "GS-KM",
    "AS": "AS-KM",
    "iotsekf": "IOTSEKF",
    "atsekf": "ATSEKF",
    "smo": "SMO",
    "smo-low": "SMO, low-passed",
}

PRINTED: Final[dict[str, Any]] = {"mode": "paper", "divide_by_dt": True}
"""The filter as the paper prints it, but for the signs of (11) and of G."""

SETTLED_S: Final = 3.0
"""Of a flight that is not scored as quiet: the filters' initial errors are still there."""


@dataclass(frozen=True, slots=True)
class Noise:
    """What the filters are told, standard deviations.

    Attributes
    ----------
    acc, gyro
        Of one IMU sample [m/s^2, rad/s].
    velocity, angles
        Of the ground velocity and of the attitude [m/s, rad].
    tas, vane
        Of airspeed and flow angles [m/s, rad].
    """

    acc: float
    gyro: float
    velocity: float
    angles: float
    tas: float
    vane: float

    @property
    def inputs(self) -> tuple[float, ...]:
        """Of u, (6,)."""
        return (self.acc,) * 3 + (self.gyro,) * 3

    def outputs(self, model: int) -> tuple[float, ...]:
        """Of y, (6,)."""
        first = (self.velocity,) * 3 if model == GS else (self.tas, self.vane, self.vane)
        return first + (self.angles,) * 3


TABLE_1: Final = Noise(0.01, radians(0.01), 0.01, radians(0.01), 0.1, radians(0.1))


def two_stage(
    flight: ImuExperiment, model: int, y: Floats, noise: Noise = TABLE_1, **changes: Any
) -> Rows:
    """Run the two-stage filter over a flight, from its first measurement on.

    Parameters
    ----------
    model
        ``GS`` or ``AS``.
    y : (n + 1, 6) float64
        Measurements; the first must be whole.
    changes
        Of :class:`estimators.two_stage_ekf.Settings`.

    Returns
    -------
    (n,) rows of ``two_stage_memory.TRACK``
    """
    settings = Settings(
        model=model, input_std=noise.inputs, output_std=noise.outputs(model), **changes
    )
    x, H = _start(model, y[0])
    back = np.linalg.inv(H)
    P = back @ np.diag(np.square(noise.outputs(model))) @ back.T
    return TwoStageFilter(settings, x, P).run(flight.u_m[:-1], y[1:], flight.env[:-1])


def observer(flight: ImuExperiment, model: int, y: Floats, **changes: Any) -> Rows:
    """Run the sliding-mode observer over a flight.

    Returns
    -------
    (n,) rows of ``sliding_mode.OBSERVED``
    """
    settings = SlidingModeSettings(model=model, **changes)
    x, _ = _start(model, y[0])
    return SlidingModeObserver(settings, x).run(flight.u_m[:-1], y[1:], flight.env[:-1])


def all_estimates(
    flight: ImuExperiment, model: int, y: Floats, noise: Noise = TABLE_1
) -> dict[str, Floats]:
    """The faults by every method, each (n, 6) float64 [m/s^2, rad/s]."""
    slid = observer(flight, model, y)
    return {
        "iotsekf": two_stage(flight, model, y, noise, **PRINTED, adapt=False)["f"],
        "atsekf": two_stage(flight, model, y, noise, **PRINTED)["f"],
        "smo": slid["f"],
        "smo-low": slid["f_low"],
    }


def scores(estimates: dict[str, Floats], flight: ImuExperiment) -> dict[str, dict[str, Floats]]:
    """Errors of each method against the faults present at the time of the estimate.

    Returns
    -------
    per method
        ``rmse`` over the whole flight, ``bias`` the mean error from 5 s after the faults' onset to
        their end, ``largest`` the largest error; before the faults ``before`` is the root mean
        square error and ``quiet`` the standard deviation. Each (6,) float64 [m/s^2, rad/s].
    """
    t, f = flight.t_s[1:], flight.f[1:]
    on = np.flatnonzero(np.any(f != 0.0, axis=1))
    onset, end = (t[on[0]], t[on[-1]]) if len(on) else (t[-1], t[-1])
    late, quiet = (t > onset + 5.0) & (t < end), (t > SETTLED_S) & (t < onset)
    out = {}
    for name, estimate in estimates.items():
        error = estimate - f
        out[name] = {
            "rmse": np.sqrt(np.mean(error**2, axis=0)),
            "bias": np.mean(error[late], axis=0) if late.any() else np.zeros(6),
            "largest": np.abs(error).max(axis=0),
            "before": np.sqrt(np.mean(error[quiet] ** 2, axis=0)),
            "quiet": np.std(estimate[quiet], axis=0),
        }
    return out


def _start(model: int, y: Floats) -> tuple[Floats, Floats]:
    """State that has these outputs, and the outputs' Jacobian there."""
    x, H = np.empty(6), np.empty((6, 6))
    state_from_output(model, np.ascontiguousarray(y), x)
    output_jacobian(model, x, H)
    return x, H
