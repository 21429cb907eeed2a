"""lu2016 section 3.3, Fig. 3: what the comparison of the two loops shows, as blocks and claims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.lu2016.closed_loop_claims import claims
from monitor.commands.reproduce.lu2016.closed_loop_names import (
    AIR,
    ANGLE_RAD,
    EXACT,
    FAULTY,
    FLOWN,
    GROUND,
    TRUE,
    VELOCITY_M_S,
    change_of,
    deviations,
    draws_of,
    median_of,
    steered_on,
    winds_of,
)
from monitor.commands.reproduce.lu2016.published import AXES, COLUMNS, UNITS, shown
from monitor.commands.reproduce.study import Figure, Result, Scope, Table, Text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["blocks", "claims"]

Floats = NDArray[np.float64]


def blocks(results: Mapping[str, Result], scope: Scope) -> list[Table | Figure | Text]:
    """Fig. 3, its numbers in three winds, and the flights of three feedbacks."""
    winds = winds_of(results)
    if not winds:
        return []
    calm = draws_of(results, winds[0])
    drawn = next(r for r in calm if r["t_s"] is not None)
    return [
        Text("An aircraft that answers its autopilot", _words(results, winds)),
        Figure(
            "lu2016-fig3",
            "Fig. 3: closed loop less open loop, one draw in calm air. True states (a, b), "
            "estimated faults in both loops (c, d; true ones grey), and their differences (e, f).",
            lambda canvas: _draw_fig3(canvas, drawn),
            (8.0, 7.2),
        ),
        _states_table(results, winds),
        _errors_table(results, winds),
        Figure(
            "lu2016-steered",
            "Not in the paper: the same flight with the autopilot steering on true values, on the "
            "faulty readings and on the reconstructed ones; faults from 10 to 30 s, calm air.",
            lambda canvas: _draw_feedback(canvas, drawn),
            (8.0, 4.6),
        ),
        _feedback_table(results, winds),
    ]


def _words(results: Mapping[str, Result], winds: Sequence[str]) -> str:
    rows = draws_of(results, winds[0])
    draws = f"median of {len(rows)} draws" if len(rows) > 1 else "one draw"
    states = median_of(rows, GROUND, "state_max")
    share = np.max(
        median_of(rows, GROUND, "difference_rms") / median_of(rows, GROUND, "rmse_closed")
    )
    return (
        "The paper steers its simulator (not public) by the baseline controller on reconstructed "
        "values. Here a rigid aircraft with lift, drag, side force and the short-period, roll and "
        "yaw modes of a transport is flown by a PI autopilot on airspeed, load factor, pitch rate, "
        "roll rate and side force through a climb, a turn and a reversal; see "
        "`sim_feeds/closed_loop.py`. Every inner loop uses an axis of the IMU that fails. The "
        "same noise is drawn for both loops.\n\n"
        f"In calm air ({draws}) the true velocities of the two flights part by "
        f"at most {states[:3].max():.2f} m/s and the angles by at most "
        f"{1e3 * states[3:].max():.1f} mrad, and the estimates of the faults differ by "
        f"{100 * share:.1f} % of their own error. What is fed back changes the flight; it hardly "
        "changes the estimation, because the kinematic model is exact in any flight."
    )


def _states_table(results: Mapping[str, Result], winds: Sequence[str]) -> Table:
    rows: list[list[Any]] = []
    for wind in winds:
        for name in (GROUND, EXACT, AIR):
            most = median_of(draws_of(results, wind), name, "state_max")
            velocity, angle = float(most[:3].max()), float(most[3:].max())
            cells: list[Any] = [velocity, None, 1e3 * angle, None, None]
            if wind == "calm" and name == GROUND:
                cells[1], cells[3] = f"< {VELOCITY_M_S:g}", f"< {1e3 * ANGLE_RAD:g}"
                cells[4] = _why_states(velocity, angle)
            rows.append([wind, name, *cells])
    return Table(
        "lu2016-fig3-states",
        "Fig. 3(a, b): largest difference of the true states of the two flights; median of the "
        "draws. The paper has calm air and the ground-speed model only.",
        (
            "wind",
            "filter",
            "velocities [m/s]",
            "paper [m/s]",
            "angles [mrad]",
            "paper [mrad]",
            "why they differ",
        ),
        rows,
        digits=2,
    )


def _why_states(velocity: float, angle: float) -> str:
    if velocity < VELOCITY_M_S and angle < ANGLE_RAD:
        return "No difference."
    return (
        "Another aircraft and autopilot: ours holds no heading, and heading integrates the "
        "estimates' lag at onset and end and the small bias that (31) has from linearising at xbar "
        "(next row)."
    )


def _errors_table(results: Mapping[str, Result], winds: Sequence[str]) -> Table:
    rows: list[list[Any]] = []
    for wind in winds:
        found = draws_of(results, wind)
        for name in (GROUND, EXACT, AIR):
            for loop in ("open", "closed"):
                errors = shown(median_of(found, name, f"rmse_{loop}"))
                change = 100.0 * change_of(found, name) if loop == "closed" else None
                rows.append([wind, name, loop, *map(float, errors), change])
        errors = shown(np.median([r["rmse_faulty"] for r in found], axis=0))
        rows.append([wind, GROUND, "faulty", *map(float, errors), None])
    return Table(
        "lu2016-loops",
        "RMSE of the fault estimates in both loops over 40 s, median of the draws, and the largest "
        "change of any axis that closing the loop makes; the paper prints no numbers. “Faulty”: "
        "the autopilot steers on the faulty readings, and the filter only watches.",
        (
            "wind",
            "filter",
            "loop",
            *COLUMNS,
            "change [%]",
        ),
        rows,
    )


def _feedback_table(results: Mapping[str, Result], winds: Sequence[str]) -> Table:
    rows: list[list[Any]] = []
    for wind in winds:
        found = draws_of(results, wind)
        for fed in (FAULTY, steered_on(GROUND), steered_on(AIR)):
            most = deviations(found, fed)
            lost = sum(r["lost_s"][fed] is not None for r in found)
            rows.append([wind, fed, *map(float, most), lost])
    return Table(
        "lu2016-feedback",
        "Not in the paper: largest deviation from the flight that steers on true values, median of "
        "the draws, and how many flights lost control.",
        ("wind", "the autopilot steers on", *FLOWN, "lost"),
        rows,
        digits=2,
    )


# ----------------------------------------------------------------------------- figures


def _draw_fig3(canvas: Canvas, r: Result) -> None:
    axes = canvas.subplots(3, 2, sharex=True)
    t = r["t_s"]
    moved, opened, closed = r["x_difference"], shown(r["f_open"]), shown(r["f_closed"])
    true = shown(r["f"])
    for k, name in enumerate(("$U_N$", "$U_E$", "$U_D$")):
        axes[0, 0].plot(t, moved[:, k], label=name)
    for k, name in enumerate((r"$\phi$", r"$\theta$", r"$\psi$")):
        axes[0, 1].plot(t, 1e3 * moved[:, 3 + k], label=name)
    _entitle(axes[0, 0], "(a) true velocities, closed less open [m/s]")
    _entitle(axes[0, 1], "(b) true angles, closed less open [mrad]")
    for side in range(2):
        for k in range(3):
            column = 3 * side + k
            axes[1, side].plot(t, true[:, column], color="0.6", lw=2.2)
            axes[1, side].plot(t, closed[:, column], color=f"C{k}", label=AXES[column])
            axes[1, side].plot(t, opened[:, column], color="black", lw=0.7, ls=":")
            difference = closed[:, column] - opened[:, column]
            axes[2, side].plot(t, difference, color=f"C{k}", label=AXES[column])
        unit = UNITS[3 * side]
        _entitle(axes[1, side], f"({'cd'[side]}) estimates, open loop dotted [{unit}]")
        _entitle(axes[2, side], f"({'ef'[side]}) estimates, closed less open [{unit}]")
        axes[2, side].set_xlabel("time [s]")


def _draw_feedback(canvas: Canvas, r: Result) -> None:
    axes = canvas.subplots(2, 3, sharex=True)
    shades = {FAULTY: "C1", steered_on(GROUND): "C0", TRUE: "black"}
    for k, (axis, title) in enumerate(zip(axes.flat, FLOWN, strict=True)):
        for name, colour in shades.items():
            style = ":" if name == TRUE else "-"
            axis.plot(r["t_s"], r["flown"][name][:, k], color=colour, ls=style, label=name)
        axis.set_title(title)
        axis.axvspan(10.0, 30.0, color="0.95", lw=0)
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    canvas.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def _entitle(axis: Axes, title: str) -> None:
    axis.set_title(title)
    axis.legend(loc="upper left", handlelength=1.0)
    axis.grid(True)
