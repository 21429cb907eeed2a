"""lu2016 section 5 on synthetic recordings: level, parabolic, turbulent; faults written in after.

The receiver gives the ground speed at 1 Hz; as in the paper it is interpolated linearly. What
that alone costs is shown beside it, with receivers of 5 and 100 Hz and with samples used as they
come.
"""

from __future__ import annotations

from functools import partial
from math import degrees, radians
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.kinematics import AS, GS
from monitor.commands.reproduce.lu2016.lines import Curve, bars, panels
from monitor.commands.reproduce.lu2016.methods import (
    LABELS,
    METHODS,
    PRINTED,
    Noise,
    all_estimates,
    scores,
    two_stage,
)
from monitor.commands.reproduce.lu2016.published import (
    AXES,
    LEVEL_RATIO,
    PARABOLIC_GYRO_RAD_S,
    UNITS,
    shown,
)
from monitor.commands.reproduce.lu2016.simulated import graded
from monitor.commands.reproduce.study import Claim, Figure, Job, Result, Results, Scope, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from sim_feeds.papers.lu2016_flights import Recording
    from sim_feeds.papers.lu2016_runs import Recorder

__all__ = ["blocks", "claims", "jobs", "work"]

Floats = NDArray[np.float64]

EVERY: Final = 4
FASTER_HZ: Final = (5.0, 100.0)
"""Receivers beside the recorder's own of 1 Hz."""
FOLLOWED_S: Final = 0.5
"""After an onset or end of faults in which no filter can know yet."""
MODELS: Final = ("AS", "GS")


def jobs(scope: Scope) -> list[Job]:
    """One a flight and draw."""
    from sim_feeds.papers.lu2016_runs import runs

    seeds = [scope.seed + s for s in runs().open_loop.chosen(scope.quick)]
    return [
        Job(
            "lu2016",
            f"open_loop/{flight.name}/{seed}",
            {"flight": flight.name, "drawn": seed == seeds[0]},
            seed,
        )
        for flight in runs().flight
        for seed in seeds
    ]


def work(job: Job) -> Result:
    """Errors with both models, with other receivers, and the lines of the first draw."""
    from sim_feeds.papers.lu2016_flights import record
    from sim_feeds.papers.lu2016_runs import runs

    name, recorder = job.what["flight"], runs().recorder
    recording = record(name, job.seed)
    flight, noise = recording.flight, _noise(recorder)
    estimates = {
        f"{name}/{method}": f
        for name, model, y in (("GS", GS, flight.y_ground), ("AS", AS, flight.y_air))
        for method, f in all_estimates(flight, model, y, noise).items()
    }
    estimates["as they come"] = two_stage(flight, GS, recording.y_sparse, noise)["f"]
    found: dict[str, Any] = dict(scores(estimates, flight))
    ours = found["GS/atsekf"]
    ours["followed"] = _largest_once_followed(estimates["GS/atsekf"], flight.f[1:], flight.t_s[1:])
    for hz in FASTER_HZ:
        faster = record(name, job.seed, recorder=recorder.model_copy(update={"gps_hz": hz})).flight
        track = two_stage(faster, GS, faster.y_ground, noise, **PRINTED)
        found[f"GS at {hz:g} Hz"] = scores({"": track["f"]}, faster)[""]
    if job.what["drawn"]:
        state = two_stage(flight, GS, flight.y_ground, noise, **PRINTED)["x"]
        found["lines"] = _lines(recording, estimates, state)
    return found


def _noise(r: Recorder) -> Noise:
    """What the filters are told: the white noise of the recorder's data sheet, no bias, no vane."""
    return Noise(
        acc=r.acc_std_m_s2,
        gyro=radians(r.gyro_std_deg_s),
        velocity=r.gps_std_m_s,
        angles=radians(r.attitude_std_deg),
        tas=r.tas_std_m_s,
        vane=radians(r.vane_std_deg),
    )


def _largest_once_followed(estimate: Floats, f: Floats, t_s: Floats) -> Floats:
    """Largest errors without the half second after each jump of a fault, (6,)."""
    jumps = t_s[1:][np.any(np.abs(np.diff(f, axis=0)) > np.array([0.2] * 3 + [0.01] * 3), axis=1)]
    fresh = np.zeros(len(t_s), dtype=bool)
    for jump in jumps:
        fresh |= (t_s >= jump) & (t_s < jump + FOLLOWED_S)
    return np.asarray(np.abs(estimate - f)[~fresh].max(axis=0))


def _lines(recording: Recording, estimates: dict[str, Floats], state: Floats) -> dict[str, Any]:
    flight, truth = recording.flight, recording.truth
    late = slice(1, None, EVERY)
    flown = np.column_stack(
        [
            truth.height_m,
            truth.tas_m_s,
            np.degrees(truth.aoa_rad),
            truth.specific_force_m_s2[:, 2],
        ]
    )
    return {
        "t_s": flight.t_s[late],
        "f": flight.f[late],
        "flown": flown[late],
        "measured": flight.y_ground[late],
        "state": state[::EVERY],
        **{model: estimates[f"{model}/atsekf"][::EVERY] for model in MODELS},
    }


def _flights(results: Results) -> list[str]:
    """Names in the order of the jobs."""
    from sim_feeds.papers.lu2016_runs import runs

    there = {n.split("/")[1] for n in results}
    return [f.name for f in runs().flight if f.name in there]


def _of(results: Results, flight: str, what: str, score: str = "rmse") -> Floats:
    """Median over the draws, (6,) [m/s^2, rad/s]."""
    own = [r for n, r in results.items() if n.startswith(f"open_loop/{flight}/")]
    return np.asarray(np.median([r[what][score] for r in own], axis=0))


def _both(results: Results, flight: str) -> dict[str, Floats]:
    """RMSE of the ATSEKF by model."""
    return {m: _of(results, flight, f"{m}/atsekf") for m in MODELS}


def _drawn(results: Results, flight: str) -> dict[str, Any]:
    own = (r for n, r in sorted(results.items()) if n.startswith(f"open_loop/{flight}/"))
    return next(r["lines"] for r in own if "lines" in r)


def blocks(results: Results, scope: Scope) -> list[Table | Figure]:
    """Fig. 7, Fig. 8, Figs. 9 to 11, Fig. 12, and the tables."""
    flights = _flights(results)
    drawn = {name: _drawn(results, name) for name in flights}
    out: list[Table | Figure] = [
        Figure(
            "lu2016-fig7",
            "Fig. 7: the three flights. The paper's are recordings of a Cessna Citation II, ours"
            " are flown at a steady 130 m/s and recorded with biases, slow attitude errors and a"
            " vane that reads 3 % and 0.1 degrees wrong.",
            partial(_draw_flights, drawn=drawn),
            (8.0, 5.0),
        ),
        _errors_table(results),
        Figure(
            "lu2016-fig8",
            "Fig. 8: above measured states (dashed) and estimated ones in level flight with faults"
            " from 10 to 30 s, below their difference; ATSEKF on the ground-speed model.",
            partial(_draw_states, lines=drawn[flights[0]]),
            (8.0, 4.4),
        ),
    ]
    for k, name in enumerate(flights):
        number, panel = 9 + k, partial(_draw_faults, lines=drawn[name])
        out += [
            Figure(
                f"lu2016-fig{number}ab",
                f"Fig. {number}(a), (b): true and estimated faults, {name} flight, ATSEKF.",
                panel,
                (8.0, 5.0),
            ),
            Figure(
                f"lu2016-fig{number}cd",
                f"Fig. {number}(c), (d): errors of the estimates, {name} flight.",
                partial(panel, error=True),
                (8.0, 5.0),
            ),
            Figure(
                f"lu2016-fig{number}ef",
                f"Fig. {number}(e), (f): root mean square errors, {name} flight.",
                partial(_draw_errors, rmse=_both(results, name)),
                (6.0, 2.4),
            ),
        ]
    each = [_both(results, name) for name in flights]
    f_ax = {m: np.array([rmse[m][0] for rmse in each]) for m in MODELS}
    out.append(
        Figure(
            "lu2016-fig12",
            "Fig. 12: root mean square error of f_Ax in the three flights.",
            partial(_draw_f_ax, flights=flights, rmse=f_ax),
            (5.0, 2.6),
        )
    )
    out.append(_receivers_table(results))
    return out


def _draw_flights(canvas: Canvas, drawn: dict[str, dict[str, Any]]) -> None:
    names = ("height [m]", "airspeed [m/s]", "angle of attack [deg]", "A_z [m/s²]")
    grid = canvas.subplots(4, len(drawn), sharex="col", squeeze=False)
    for column, (name, lines) in enumerate(drawn.items()):
        for row, label in enumerate(names):
            ax = grid[row, column]
            ax.plot(lines["t_s"], lines["flown"][:, row], linewidth=0.9)
            ax.ticklabel_format(useOffset=False)
            if row == 0:
                ax.set_title(name)
            if column == 0:
                ax.set_ylabel(label, fontsize=7)
        grid[-1, column].set_xlabel("time [s]")


def _draw_states(canvas: Canvas, lines: dict[str, Any]) -> None:
    measured, state = lines["measured"].copy(), lines["state"].copy()
    state[:, 3:] += 2.0 * np.pi * np.round((measured - state)[:, 3:] / (2.0 * np.pi))
    columns = (
        ("ground speed [m/s]", ("U_N", "U_E", "U_D"), 1.0),
        ("attitude [deg]", ("roll", "pitch", "yaw"), degrees(1.0)),
    )
    grid = canvas.subplots(2, 2, sharex=True)
    for c, (label, names, unit) in enumerate(columns):
        above, below = grid[:, c]
        for k, name in enumerate(names):
            m, x = measured[:, 3 * c + k] * unit, state[:, 3 * c + k] * unit
            above.plot(lines["t_s"], x, linewidth=0.9, label=name)
            above.plot(lines["t_s"], m, "--", linewidth=0.7, color="0.3")
            below.plot(lines["t_s"], m - x, linewidth=0.8)
        above.set_ylabel(label)
        above.legend(ncols=3)
        below.set_ylabel("difference")
        below.set_xlabel("time [s]")


def _draw_faults(canvas: Canvas, lines: dict[str, Any], error: bool = False) -> None:
    known = lines["f"] if error else 0.0
    curves = [
        Curve(LABELS[model], colour, lines[model] - known, 0.9)
        for model, colour in (("AS", "C1"), ("GS", "C0"))
    ]
    if not error:
        curves.append(Curve("true", "black", lines["f"], 1.0, dashed=True))
    panels(canvas, lines["t_s"], curves, zero=error)


def _draw_errors(canvas: Canvas, rmse: dict[str, Floats]) -> None:
    series = [(LABELS[m], c, shown(rmse[m])) for m, c in (("AS", "C1"), ("GS", "C0"))]
    bars(canvas, AXES, series, (UNITS[0], UNITS[3]))


def _draw_f_ax(canvas: Canvas, flights: list[str], rmse: dict[str, Floats]) -> None:
    series = [(LABELS[m], c, rmse[m]) for m, c in (("AS", "C1"), ("GS", "C0"))]
    bars(canvas, flights, series, (UNITS[0],))


def _errors_table(results: Results) -> Table:
    rows: list[list[Any]] = []
    for name in _flights(results):
        for model in MODELS:
            for method in METHODS:
                values = shown(_of(results, name, f"{model}/{method}"))
                labels = [name, LABELS[model], LABELS[method]]
                rows.append([*labels, *(float(v) for v in values)])
    columns = ["flight", "model", "estimator"]
    columns += [f"{axis} [{unit}]" for axis, unit in zip(AXES, UNITS, strict=True)]
    caption = (
        "Root mean square errors, median of the draws; Figs. 9 to 12 are of the ATSEKF. The paper"
        " draws its own as bars without numbers. The recording's own biases count as errors, as"
        " they would in a real one."
    )
    return Table("lu2016-open-loop", caption, columns, rows)


def _receivers_table(results: Results) -> Table:
    kinds = {
        "GS/atsekf": "1 Hz, interpolated",
        "as they come": "1 Hz, as they come",
        **{f"GS at {hz:g} Hz": f"{hz:g} Hz, interpolated" for hz in FASTER_HZ[:1]},
        **{f"GS at {hz:g} Hz": f"{hz:g} Hz" for hz in FASTER_HZ[1:]},
        "AS/atsekf": "none: airspeed model",
    }
    rows: list[list[Any]] = []
    for name in _flights(results):
        for what, label in kinds.items():
            rmse, quiet = _of(results, name, what), _of(results, name, what, "quiet")
            rows.append([name, label, *(float(v) for v in rmse[:3]), float(quiet[2])])
    columns = ["flight", "ground speed", *(f"RMSE {axis} [m/s²]" for axis in AXES[:3])]
    columns.append("quiet std f_Az [m/s²]")
    caption = "What the receiver costs: ATSEKF on the flights of Figs. 9 to 11."
    return Table("lu2016-receivers", caption, columns, rows)


def claims(results: Results, scope: Scope) -> list[Claim]:
    """What section 5 says of the three flights."""
    level, parabolic, turbulent = (
        _both(results, name) for name in ("level", "parabolic", "turbulent")
    )
    return [
        _level(level),
        _parabola(results, parabolic),
        _gyros(results),
        _turbulence(turbulent),
        _f_ax(level, parabolic, turbulent),
        _observer(results),
    ]


def _ratios(rmse: dict[str, Floats]) -> Floats:
    """Airspeed over ground-speed model."""
    return np.asarray(rmse["AS"] / rmse["GS"])


def _level(rmse: dict[str, Floats]) -> Claim:
    ratio = _ratios(rmse)
    others = np.delete(ratio, 2)
    twice = 0.75 * LEVEL_RATIO < ratio[2] < 1.25 * LEVEL_RATIO
    return Claim(
        "Section 5.1, level flight: both models do alike, but the airspeed model's RMSE of f_Az is"
        " almost twice the other's.",
        graded([bool(np.all(np.abs(others - 1.0) < 0.25)), twice]),
        f"Airspeed over ground-speed model: f_Az {ratio[2]:.2f} (paper: almost"
        f" {LEVEL_RATIO:g}), f_Ax {ratio[0]:.2f}, f_Ay {ratio[1]:.2f}, gyros"
        f" {ratio[3:].min():.2f} to {ratio[3:].max():.2f}; f_Ay suffers from the noise of the"
        " sideslip vane times the airspeed.",
    )


def _parabola(results: Results, rmse: dict[str, Floats]) -> Claim:
    ratio = _ratios(rmse)[:3]
    fast = _of(results, "parabolic", f"GS at {FASTER_HZ[-1]:g} Hz")[:3]
    better = [bool(v > 1.0) for v in ratio]
    words = ", ".join(
        f"{axis} {a:.2f} against {g:.2f}"
        for axis, a, g in zip(AXES[:3], rmse["AS"], rmse["GS"], strict=False)
    )
    return Claim(
        "Section 5.2, parabolic flight: both degrade, the ground-speed model is better.",
        graded(better),
        f"RMSE airspeed against ground-speed model: {words} m/s². Without the interpolation over"
        f" 1 s, from a receiver of {FASTER_HZ[-1]:g} Hz, the latter's are"
        f" {', '.join(f'{v:.2f}' for v in fast)}.",
    )


def _gyros(results: Results) -> Claim:
    largest = _of(results, "parabolic", "GS/atsekf", "largest")[3:].max()
    followed = _of(results, "parabolic", "GS/atsekf", "followed")[3:].max()
    return Claim(
        f"Section 5.2: the largest gyro error is below {PARABOLIC_GYRO_RAD_S:g} rad/s even when the"
        " faults are injected.",
        graded([bool(followed < PARABOLIC_GYRO_RAD_S), bool(largest < PARABOLIC_GYRO_RAD_S)]),
        f"{largest:.4f} rad/s ({degrees(largest):.2f} deg/s) at the sample at which f_r jumps to 3"
        f" deg/s = 0.0524 rad/s, which no filter can know yet; {followed:.4f} rad/s from"
        f" {FOLLOWED_S:g} s after each jump on.",
    )


def _turbulence(rmse: dict[str, Floats]) -> Claim:
    ratio = _ratios(rmse)
    return Claim(
        "Section 5.3, turbulence: the accelerometers' RMSEs of the ground-speed model are"
        " prominently smaller, the gyros' comparable.",
        graded([bool(ratio[:3].min() > 3.0), bool(np.all(np.abs(ratio[3:] - 1.0) < 0.25))]),
        f"Airspeed over ground-speed model: accelerometers {ratio[:3].min():.1f} to"
        f" {ratio[:3].max():.1f}, gyros {ratio[3:].min():.2f} to {ratio[3:].max():.2f}.",
    )


def _f_ax(*flights: dict[str, Floats]) -> Claim:
    air, ground = (np.array([rmse[m][0] for rmse in flights]) for m in MODELS)
    steady = bool(ground.max() < 1.5 * ground.min())
    return Claim(
        "Section 5.4, Fig. 12: over the three flights f_Ax of the ground-speed model does not"
        " change significantly, the airspeed model is worst in turbulence.",
        graded([steady, int(np.argmax(air)) == 2]),
        f"Level, parabolic, turbulent: {', '.join(f'{v:.2f}' for v in ground)} m/s² against"
        f" {', '.join(f'{v:.2f}' for v in air)} m/s².",
    )


def _observer(results: Results) -> Claim:
    flights = _flights(results)
    ours, low, raw = (
        np.median([_of(results, name, f"GS/{m}") for name in flights], axis=0)
        for m in ("atsekf", "smo-low", "smo")
    )

    def told(rmse: Floats) -> str:
        acc, gyro = rmse[:3], np.degrees(rmse[3:])
        return (
            f"{acc.min():.2f} to {acc.max():.2f} m/s², {gyro.min():.2f} to {gyro.max():.2f} deg/s"
        )

    return Claim(
        "Section 3.5: the observer's standard deviations are larger, therefore only the ATSEKF is"
        " used on the recorded flights.",
        graded([bool(np.all(low[part] > ours[part])) for part in (slice(0, 3), slice(3, 6))]),
        f"RMSE on the ground-speed model, median of the flights: ATSEKF {told(ours)}; observer"
        f" {told(raw)} raw, {told(low)} low-passed. A ground speed interpolated over 1 s has no"
        " noise from sample to sample that an observer could magnify.",
    )
