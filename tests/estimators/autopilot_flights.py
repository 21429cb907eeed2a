"""Events for the autopilots' checks: straight flight north at a constant speed, one pitot told."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.autopilot_events import (
    AIRSPEED,
    ATTITUDE,
    FLYING,
    GPS,
    NAV,
)

Events = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]
SPEED_M_S = 20.0


def straight(
    seconds: float,
    shown: Callable[[float], float | None],
    *,
    fix: Callable[[float], float] = lambda t: 3.0,
    pitots: int = 1,
) -> Events:
    """Ten looks a second at 20 m/s over ground; ``shown(t)`` is what pitot 0 shows, None nothing.

    Further pitots show 20 m/s. The last digit of every pitot moves, so that none is stuck.
    """
    rows: list[tuple[int, int, tuple[float, ...]]] = [(0, FLYING, (1.0, 0.0, 0.0, 0.0))]
    for i in range(round(10 * seconds)):
        t_us, t_s, flicker = 100_000 * i, 0.1 * i, 1e-4 * (i % 2)
        rows.append((t_us, ATTITUDE, (1.0, 0.0, 0.0, 0.0)))
        rows.append((t_us, NAV, (SPEED_M_S, 0.0, 0.0, 0.0)))
        rows.append((t_us, GPS, (SPEED_M_S, 0.0, fix(t_s), 0.0)))
        for k in range(pitots):
            cas = shown(t_s) if k == 0 else SPEED_M_S
            if cas is not None:
                rows.append((t_us, AIRSPEED + k, (cas + flicker, 0.0, 0.0, 0.0)))
    return (
        np.array([r[0] for r in rows]),
        np.array([r[1] for r in rows]),
        np.array([r[2] for r in rows]),
    )


def off_by(error_m_s: float, start_s: float, end_s: float = np.inf) -> Callable[[float], float]:
    """A pitot that is wrong by a constant between two times."""
    return lambda t: SPEED_M_S + (error_m_s if start_s <= t < end_s else 0.0)
