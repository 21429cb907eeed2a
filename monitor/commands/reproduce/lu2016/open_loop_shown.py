"""Figures 7 to 12 and the tables of :mod:`monitor.commands.reproduce.lu2016.open_loop`."""

from __future__ import annotations

from functools import partial
from math import degrees
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.lu2016.lines import Curve, bars, panels
from monitor.commands.reproduce.lu2016.methods import LABELS, METHODS
from monitor.commands.reproduce.lu2016.published import AXES, COLUMNS, UNITS, shown
from monitor.commands.reproduce.study import Figure, Results, Scope, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["FASTER_HZ", "SHOWN_MODELS", "blocks", "both", "flights_of", "of"]

Floats = NDArray[np.float64]

FASTER_HZ: Final = (5.0, 100.0)
"""Receivers beside the recorder's own of 1 Hz."""
SHOWN_MODELS: Final = ("AS", "GS")


def flights_of(results: Results) -> list[str]:
    """Names in the order of the jobs."""
    from sim_feeds.papers.lu2016_runs import runs

    there = {n.split("/")[1] for n in results}
    return [f.name for f in runs().flight if f.name in there]


def of(results: Results, flight: str, what: str, score: str = "rmse") -> Floats:
    """Median over the draws, (6,) [m/s^2, rad/s]."""
    own = [r for n, r in results.items() if n.startswith(f"open_loop/{flight}/")]
    return np.asarray(np.median([r[what][score] for r in own], axis=0))


def both(results: Results, flight: str) -> dict[str, Floats]:
    """RMSE of the ATSEKF by model."""
    return {m: of(results, flight, f"{m}/atsekf") for m in SHOWN_MODELS}


def _drawn(results: Results, flight: str) -> dict[str, Any]:
    own = (r for n, r in sorted(results.items()) if n.startswith(f"open_loop/{flight}/"))
    return next(r["lines"] for r in own if "lines" in r)


def blocks(results: Results, scope: Scope) -> list[Table | Figure]:
    """Fig. 7, Fig. 8, Figs. 9 to 11, Fig. 12, and the tables."""
    flights = flights_of(results)
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
                partial(_draw_errors, rmse=both(results, name)),
                (6.0, 2.4),
            ),
        ]
    each = [both(results, name) for name in flights]
    f_ax = {m: np.array([rmse[m][0] for rmse in each]) for m in SHOWN_MODELS}
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
    for name in flights_of(results):
        for model in SHOWN_MODELS:
            for method in METHODS:
                values = shown(of(results, name, f"{model}/{method}"))
                labels = [name, LABELS[model], LABELS[method]]
                rows.append([*labels, *(float(v) for v in values)])
    columns = ["flight", "model", "estimator"]
    columns += COLUMNS
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
    for name in flights_of(results):
        for what, label in kinds.items():
            rmse, quiet = of(results, name, what), of(results, name, what, "quiet")
            rows.append([name, label, *(float(v) for v in rmse[:3]), float(quiet[2])])
    columns = ["flight", "ground speed", *(f"RMSE {axis} [m/s²]" for axis in AXES[:3])]
    columns.append("quiet std f_Az [m/s²]")
    caption = "What the receiver costs: ATSEKF on the flights of Figs. 9 to 11."
    return Table("lu2016-receivers", caption, columns, rows)
