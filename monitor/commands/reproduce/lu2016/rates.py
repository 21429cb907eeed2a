"""Satellite receivers of 100, 5 and 1 Hz, used as they come or interpolated, and late ones.

The paper interpolates a ground speed of 1 Hz to the rate of the IMU, which needs the next sample
before the present one can be used. A monitor in flight has to take each sample when it comes: it
predicts in between with zero gain, see :mod:`estimators.two_stage_ekf`.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.kinematics import GS
from estimators.two_stage_ekf import DelayedFilter, Settings, TwoStageFilter
from monitor.commands.reproduce.lu2016.lines import Curve, panels
from monitor.commands.reproduce.lu2016.methods import PRINTED, observer, scores, two_stage
from monitor.commands.reproduce.lu2016.published import AXES, TRIAL_LATENCY_M_S2
from monitor.commands.reproduce.lu2016.simulated import graded
from monitor.commands.reproduce.study import Claim, Figure, Job, Result, Results, Scope, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from sim_feeds.papers.lu2016 import ImuExperiment

__all__ = ["WAYS", "blocks", "by_rate", "claims", "jobs", "mean_error", "work"]

Floats = NDArray[np.float64]

WAYS: Final = {
    "used": "as they come, ATSEKF",
    "used-iotsekf": "as they come, IOTSEKF",
    "interpolated": "interpolated, ATSEKF",
    "interpolated-smo": "interpolated, SMO low-passed",
}
"""How the receiver's samples are used, and by whom."""

EVERY: Final = 4
LATE_US: Final = 150_000
LATE_HZ: Final = (5, 20)
"""Rates of velocity and attitude in the study of latency."""


def jobs(scope: Scope) -> list[Job]:
    """One a wind, rate and draw, and one a draw for the latency."""
    from sim_feeds.papers.lu2016_runs import runs

    section = runs().rates
    seeds = [scope.drawn(seed) for seed in section.chosen(scope.quick)]
    out = [Job("lu2016", f"rates/late/{seed}", {"late": True}, seed) for seed in seeds]
    for wind in section.winds:
        for hz in section.gps_hz:
            out += [
                Job(
                    "lu2016",
                    f"rates/{wind}/{hz}/{seed}",
                    {"wind": wind, "hz": hz, "drawn": seed == seeds[0]},
                    seed,
                )
                for seed in seeds
            ]
    return out


def work(job: Job) -> Result:
    """Errors of every way to use a receiver, or the cost of its latency."""
    from sim_feeds.papers.lu2016 import lu2016_experiment

    if job.what.get("late"):
        return _late(lu2016_experiment("turbulence", job.seed, faults=[]))
    flight = lu2016_experiment(job.what["wind"], job.seed)
    sparse = held_back(flight.y_ground, round(100 / job.what["hz"]))
    found = by_rate(flight, sparse, interpolated(flight.t_s, sparse))
    out: Result = dict(scores(found, flight))
    if job.what["drawn"]:
        late = slice(1, None, EVERY)
        out["lines"] = {"t_s": flight.t_s[late], "f": flight.f[late]}
        out["lines"] |= {way: found[way][::EVERY] for way in ("used", "interpolated")}
    return out


def held_back(y: Floats, every: int) -> Floats:
    """Measurements whose velocity comes once in ``every`` samples, else NaN."""
    out = y.copy()
    out[np.arange(len(y)) % every != 0, :3] = np.nan
    return out


def interpolated(t_s: Floats, sparse: Floats) -> Floats:
    """The velocity at all samples, linear between those that came: the paper's way."""
    out = sparse.copy()
    came = np.isfinite(sparse[:, 0])
    for k in range(3):
        out[:, k] = np.interp(t_s, t_s[came], sparse[came, k])
    return out


def by_rate(
    flight: ImuExperiment, sparse: Floats, filled: Floats, **changes: Any
) -> dict[str, Floats]:
    """The faults by every way in :data:`WAYS`, each (n, 6) float64 [m/s^2, rad/s].

    Parameters
    ----------
    sparse, filled : (n + 1, 6) float64
        Measurements as they come and interpolated.
    changes
        The noise that the filters are told.
    """
    return {
        "used": two_stage(flight, GS, sparse, **changes)["f"],
        "used-iotsekf": two_stage(flight, GS, sparse, **changes, adapt=False)["f"],
        "interpolated": two_stage(flight, GS, filled, **changes, **PRINTED)["f"],
        "interpolated-smo": observer(flight, GS, filled)["f_low"],
    }


def _late(flight: ImuExperiment) -> Result:
    """Quiet standard deviations of f_Az with a late receiver, with and without knowing it."""
    t = np.round(flight.t_s * 1e6).astype(np.int64)
    stamps, rows = [], []
    for part, hz in ((slice(0, 3), LATE_HZ[0]), (slice(3, 6), LATE_HZ[1])):
        every = slice(None, None, 100 // hz)
        y = np.full((len(t[every]), 6), np.nan)
        y[:, part] = flight.y_ground[every, part]
        stamps.append(t[every])
        rows.append(y)
    valid, y = np.concatenate(stamps), np.concatenate(rows)
    velocity = np.isfinite(y[:, 0])
    found = {}
    for name, at in (
        ("compensated", valid),
        ("uncompensated", valid + np.where(velocity, LATE_US, 0)),
    ):
        delayed = DelayedFilter(TwoStageFilter(Settings()), delay_s=2e-6 * LATE_US)
        used, track = delayed.feed(t, flight.u_m, at, y, *flight.env[0])
        found[name] = float(np.std(track["f"][used > 5_000_000, 2]))
    return found


def _of(results: Results, wind: str, hz: int, way: str, score: str) -> Floats:
    """Median over the draws, (6,) [m/s^2, rad/s]."""
    own = [r for n, r in results.items() if n.startswith(f"rates/{wind}/{hz}/")]
    return np.asarray(np.median([r[way][score] for r in own], axis=0))


def _cases(results: Results) -> list[tuple[str, int]]:
    """Winds and rates, in the order of the jobs."""
    found = [n.split("/")[1:3] for n in results if n.count("/") == 3]
    return list(dict.fromkeys((wind, int(hz)) for wind, hz in found))


def blocks(results: Results, scope: Scope) -> list[Table | Figure]:
    """Rates, the lines of the slowest receiver, latency."""
    return [_rates_table(results), _figure(results), _late_table(results)]


def _rates_table(results: Results) -> Table:
    rows: list[list[Any]] = []
    for wind, hz in _cases(results):
        for way, label in WAYS.items():
            if hz == 100 and way.startswith("interpolated"):
                continue
            rmse, quiet = (_of(results, wind, hz, way, s) for s in ("rmse", "quiet"))
            gyro = float(np.degrees(rmse[3:].max()))
            rows.append([wind, hz, label, *(float(v) for v in rmse[:3]), float(quiet[2]), gyro])
    columns = ["wind", "GPS [Hz]", "samples", *(f"RMSE {axis} [m/s²]" for axis in AXES[:3])]
    columns += ["quiet std f_Az [m/s²]", "largest gyro RMSE [deg/s]"]
    caption = (
        "Ground speed at 100, 5 and 1 Hz, attitude at 100 Hz, Table 2's faults, ground-speed model."
        " Interpolated samples are the paper's way and not available in flight: they tell the"
        " filter half an interval of the future. A fault of 4 s period cannot be followed from"
        " samples 1 s apart by an estimate that is held between them."
    )
    return Table("lu2016-rates", caption, columns, rows)


def _figure(results: Results) -> Figure:
    slowest = min(hz for _, hz in _cases(results))
    name = next(n for n in sorted(results) if f"/{slowest}/" in n and "lines" in results[n])
    caption = (
        f"Accelerometer faults from a ground speed of {slowest} Hz, ground-speed model, ATSEKF."
    )
    draw = partial(_draw, lines=results[name]["lines"])
    return Figure("lu2016-rates-slowest", caption, draw, (8.0, 2.6))


def _draw(canvas: Canvas, lines: dict[str, Any]) -> None:
    curves = [
        Curve("as they come", "C1", lines["used"], 1.0),
        Curve("interpolated", "C0", lines["interpolated"], 1.0),
        Curve("true", "black", lines["f"], 1.0, dashed=True),
    ]
    panels(canvas, lines["t_s"], curves, axes=(0, 1, 2))


def _late_of(results: Results) -> dict[str, float]:
    own = [r for n, r in results.items() if n.startswith("rates/late/")]
    return {k: float(np.median([r[k] for r in own])) for k in TRIAL_LATENCY_M_S2}


def _late_table(results: Results) -> Table:
    ours = _late_of(results)
    words = {
        "compensated": "used at the time they were valid, 0.3 s behind",
        "uncompensated": "used when they arrive",
    }
    why = "Latency acts as a fault of latency times the rate of the acceleration; the gusts differ."
    rows: list[list[Any]] = [
        [words[k], ours[k], trial, why] for k, trial in TRIAL_LATENCY_M_S2.items()
    ]
    caption = (
        "Ground speed at 5 Hz that comes 150 ms late, attitude at 20 Hz, healthy flight in"
        " turbulence: standard deviation of f_Az. The paper does not treat latency."
    )
    columns = ["samples", "ours [m/s²]", "independent trial [m/s²]", "why they differ"]
    return Table("lu2016-latency", caption, columns, rows)


def mean_error(results: Results, hz: int, way: str = "used") -> float:
    """RMSE of the accelerometers' faults, mean of three axes, median of the winds [m/s^2]."""
    winds = dict.fromkeys(wind for wind, _ in _cases(results))
    return float(np.median([_of(results, w, hz, way, "rmse")[:3].mean() for w in winds]))


def claims(results: Results, scope: Scope) -> list[Claim]:
    """Section 5.4: ground speed with a high update rate."""
    rates = sorted({hz for _, hz in _cases(results)}, reverse=True)
    winds = list(dict.fromkeys(wind for wind, _ in _cases(results)))
    ways = ("used", "interpolated")
    error = {way: [mean_error(results, hz, way) for hz in rates] for way in ways}
    gyro = [
        float(np.median([_of(results, w, hz, "used", "rmse")[3:].max() for w in winds]))
        for hz in rates
    ]
    told = ", ".join(f"{hz} Hz" for hz in rates)
    listed = {way: ", ".join(f"{v:.2f}" for v in error[way]) for way in ways}
    return [
        Claim(
            "Section 5.4: ground speed with a high update rate gives a better performance.",
            graded([bool(np.all(np.diff(error[way]) > 0.0)) for way in ways]),
            f"Mean accelerometer RMSE at {told}: {listed['used']} m/s² with samples used as they"
            f" come, {listed['interpolated']} m/s² interpolated. The gyros keep theirs"
            f" ({np.degrees(min(gyro)):.2f} to {np.degrees(max(gyro)):.2f} deg/s): they are found"
            " from the attitude.",
        )
    ]
