"""lu2016 sections 3.2 and 3.3: the reconstruction inside an autopilot's loop, and outside it.

Two flights of the same draw are compared. *Closed loop*: the faults of Table 2 act in flight, the
filter reconstructs, the autopilot steers on what it returns. *Open loop*: the autopilot steers on
the filter's estimates of a healthy IMU; the faults are written into the recording afterwards and
estimated off line. Beside them the same flight steered on true values, and on the faulty ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.kinematics import output_jacobian, state_from_output
from estimators.two_stage_ekf import AS, GS, Settings, TwoStageFilter
from monitor.commands.reproduce.lu2016.closed_loop_names import (
    AIR,
    EXACT,
    FAULTY,
    GROUND,
    TRUE,
    steered_on,
)
from monitor.commands.reproduce.lu2016.closed_loop_shown import blocks, claims
from monitor.commands.reproduce.lu2016.methods import PRINTED
from monitor.commands.reproduce.study import Job, Result, Scope
from sim_feeds.closed_loop import (
    ClosedFlight,
    Moment,
    Order,
    Steering,
    Task,
    fly_closed,
    on_sensors,
    on_truth,
)
from sim_feeds.faults import lu2016_table2
from sim_feeds.papers.lu2016 import Air, lu2016_wind
from sim_feeds.papers.lu2016_validation import ClosedLoopSection, validation

__all__ = ["Reconstruction", "blocks", "claims", "jobs", "task", "work"]

Floats = NDArray[np.float64]

FILTERS: Final = {
    GROUND: Settings(model=GS, **PRINTED),
    EXACT: Settings(model=GS, **{**PRINTED, "mode": "exact"}),
    AIR: Settings(model=AS, **PRINTED),
}
"""The adaptive two-stage filter as printed, linearised at x instead, on the airspeed model."""

POINTS: Final = 1000
"""Of a line in a figure."""

FAULT_S: Final = (10.0, 30.0)
EDGE_S: Final = 2.0
"""Beginning and end of a fault, where estimates catch up."""


def jobs(scope: Scope) -> list[Job]:
    """One for each wind and draw."""
    section = validation().closed_loop
    return [
        Job(
            "lu2016",
            f"closed_loop/{wind}/{seed}",
            {"wind": wind, "lines": seed == section.seeds[0]},
            scope.drawn(seed),
        )
        for wind, seed in section.chosen(scope.quick)
    ]


def task(section: ClosedLoopSection, wind: Air) -> Task:
    """What is flown in this wind."""
    flight = section.flight
    orders = [Order(o.start_s, radians(o.bank_deg), o.climb_m_s) for o in flight.order]
    return Task(
        orders=orders,
        wind=lu2016_wind(wind),
        duration_s=flight.duration_s,
        rate_hz=flight.rate_hz,
        speed_m_s=flight.speed_m_s,
        height_m=flight.height_m,
        heading_rad=flight.heading_rad,
    )


class Reconstruction:
    """The two-stage filter between the sensors and the autopilot: (59), (60), Fig. 2(a).

    Steers on the estimated state and on the IMU less its estimated faults. On the airspeed model
    the ground velocity, which it does not estimate, is the measured one.

    Attributes
    ----------
    faults
        Estimate at each sample.
    states
        State estimate at each sample.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._filter: TwoStageFilter | None = None
        self._held: tuple[Floats, Floats] | None = None
        self.faults: list[Floats] = []
        self.states: list[Floats] = []

    def __call__(self, moment: Moment) -> Steering:
        ground = self._settings.model == GS
        y = moment.y_ground if ground else moment.y_air
        if self._filter is None or self._held is None:
            self._filter = started(self._settings, y)
        else:
            u_m, env = self._held
            self._filter.predict(u_m, env[0], env[1], self._settings.dt_s)
            self._filter.update(y)
        self._held = moment.u_m.copy(), moment.env.copy()
        fault, state = self._filter.fault, self._filter.state
        self.faults.append(fault)
        self.states.append(state)
        x = state if ground else np.concatenate([moment.y_ground[:3], state[3:]])
        return Steering(x.tolist(), (moment.u_m - fault).tolist(), float(moment.y_air[0]))


def started(settings: Settings, y: Floats) -> TwoStageFilter:
    """A filter that begins with a measurement."""
    x, H = np.empty(6), np.empty((6, 6))
    state_from_output(settings.model, y, x)
    output_jacobian(settings.model, x, H)
    back = np.linalg.inv(H)
    return TwoStageFilter(settings, x, back @ np.diag(settings.tuning()["R"][0]) @ back.T)


@dataclass(frozen=True, slots=True)
class _Loop:
    """A flight, and what was estimated of it."""

    flight: ClosedFlight
    f: Floats
    x: Floats


def _closed(task: Task, settings: Settings, seed: int) -> _Loop:
    """Faults in flight, estimates fed back."""
    reconstruct = Reconstruction(settings)
    flight = fly_closed(task, reconstruct, faults=lu2016_table2(), seed=seed)
    return _Loop(flight, *_filled(reconstruct, len(flight.t_s)))


def _filled(reconstruct: Reconstruction, n: int) -> tuple[Floats, Floats]:
    """Estimates at all samples; after control was lost, not a number."""
    out = np.full((2, n, 6), np.nan)
    out[0, : len(reconstruct.faults)] = reconstruct.faults
    out[1, : len(reconstruct.states)] = reconstruct.states
    return out[0], out[1]


def _open(task: Task, settings: Settings, f: Floats, seed: int) -> _Loop:
    """A healthy flight steered on the filter's estimates; faults written in and estimated after."""
    flight = fly_closed(task, Reconstruction(settings), seed=seed)
    return _estimated(flight, settings, f)


def _estimated(flight: ClosedFlight, settings: Settings, added: Floats | float) -> _Loop:
    """Off-line estimates of a recording whose IMU gets further faults."""
    y = flight.y_ground if settings.model == GS else flight.y_air
    one = started(settings, y[0])
    track = one.run((flight.u_m + added)[:-1], y[1:], flight.env[:-1])
    start = np.zeros((1, 6))
    x0 = np.full((1, 6), np.nan)
    return _Loop(flight, np.vstack([start, track["f"]]), np.vstack([x0, track["x"]]))


def work(job: Job) -> Result:
    """All flights of one wind and one draw."""
    one = task(validation().closed_loop, job.what["wind"])
    truth = fly_closed(one, on_truth, seed=job.seed)
    faulty = fly_closed(one, on_sensors, faults=lu2016_table2(), seed=job.seed)
    f = faulty.f
    watched = _estimated(faulty, FILTERS[GROUND], 0.0)
    out: Result = {
        "t_s": None,
        "filters": {},
        "deviation": {FAULTY: deviation(faulty, truth)},
        "lost_s": {FAULTY: faulty.lost_s},
        "rmse_faulty": rmse(watched.f, f),
    }
    lines = {TRUE: _flown(truth), FAULTY: _flown(faulty)}
    for name, settings in FILTERS.items():
        opened = _open(one, settings, f, job.seed)
        closed = _closed(one, settings, job.seed)
        out["filters"][name] = _compared(opened, closed, f)
        steered = steered_on(name)
        out["deviation"][steered] = deviation(closed.flight, truth)
        out["lost_s"][steered] = closed.flight.lost_s
        lines[steered] = _flown(closed.flight)
        if job.what["lines"] and name == GROUND:
            step = _step(len(f))
            out["t_s"] = truth.t_s[::step]
            out["f"] = f[::step]
            out["f_open"], out["f_closed"] = opened.f[::step], closed.f[::step]
            out["x_difference"] = _state_difference(closed, opened)[::step]
    if job.what["lines"]:
        out["flown"] = {name: line[:: _step(len(f))] for name, line in lines.items()}
    return out


def _step(n: int) -> int:
    return max(1, n // POINTS)


def rmse(estimate: Floats, truth: Floats) -> list[float]:
    """Root mean square error of each column over the samples that have an estimate."""
    return [float(v) for v in np.sqrt(np.nanmean((estimate - truth) ** 2, axis=0))]


def _state_difference(a: _Loop, b: _Loop) -> Floats:
    """True states of two flights, angles wrapped."""
    difference = a.flight.x_ground - b.flight.x_ground
    difference[:, 3:] = (difference[:, 3:] + np.pi) % (2.0 * np.pi) - np.pi
    return difference


def _compared(opened: _Loop, closed: _Loop, f: Floats) -> dict[str, Any]:
    """Open against closed loop, of one filter."""
    t = opened.flight.t_s
    during = (t > FAULT_S[0] + EDGE_S) & (t < FAULT_S[1])
    after = t > FAULT_S[1] + EDGE_S
    edges = (t >= FAULT_S[0]) & (t < FAULT_S[0] + EDGE_S)
    edges |= (t >= FAULT_S[1]) & (t < FAULT_S[1] + EDGE_S)
    difference = closed.f - opened.f
    squares = np.nansum(difference**2, axis=0)
    at_edges = np.nansum(difference[edges] ** 2, axis=0)
    return {
        "rmse_open": rmse(opened.f, f),
        "rmse_closed": rmse(closed.f, f),
        "bias_open": _means(opened.f - f, during),
        "bias_closed": _means(closed.f - f, during),
        "quiet_mean_open": _means(opened.f, after),
        "quiet_mean_closed": _means(closed.f, after),
        "quiet_std_closed": np.nanstd(closed.f[after], axis=0).tolist(),
        "difference_rms": np.sqrt(np.nanmean(difference**2, axis=0)).tolist(),
        "difference_max": np.nanmax(np.abs(difference), axis=0).tolist(),
        "edge_share": (at_edges / np.maximum(squares, 1e-300)).tolist(),
        "edge_time_share": float(edges.mean()),
        "state_max": np.abs(_state_difference(closed, opened)).max(axis=0).tolist(),
    }


def _means(values: Floats, where: NDArray[np.bool_]) -> list[float]:
    return [float(v) for v in np.nanmean(values[where], axis=0)]


def _flown(flight: ClosedFlight) -> Floats:
    """[height m, airspeed m/s, bank deg, sideslip deg, heading deg, load factor] of a flight."""
    return np.column_stack(
        [
            flight.env[:, 1],
            flight.flow[:, 0],
            np.degrees(flight.x_ground[:, 3]),
            np.degrees(flight.flow[:, 2]),
            np.degrees(np.unwrap(flight.x_ground[:, 5])),
            -flight.u[:, 2] / 9.80665,
        ]
    )


def deviation(flight: ClosedFlight, reference: ClosedFlight) -> list[float]:
    """Largest differences of two flights, in the columns of a line that is flown."""
    return [float(v) for v in np.abs(_flown(flight) - _flown(reference)).max(axis=0)]
