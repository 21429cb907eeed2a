"""lu2016 section 3.3, Fig. 3: what the comparison of the two loops shows, as blocks and claims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

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
from monitor.commands.reproduce.lu2016.published import AXES, UNITS, shown
from monitor.commands.reproduce.study import Figure, Result, Scope, Table, Text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["blocks", "claims"]

Floats = NDArray[np.float64]

BLOWN: Final = 3.0
"""An estimator with so many times the other's error is carried away by the wind."""


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
            "lu2016-feedback",
            "Not in the paper: the same flight with the autopilot steering on true values, on the "
            "faulty readings and on the reconstructed ones; faults from 10 to 30 s, calm air.",
            lambda canvas: _draw_feedback(canvas, drawn),
            (8.0, 4.6),
        ),
        _feedback_table(results, winds),
    ]


def _words(results: Mapping[str, Result], winds: Sequence[str]) -> str:
    rows = draws_of(results, winds[0])
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
        f"In calm air (median of {len(rows)} draws) the true velocities of the two flights part by "
        f"at most {states[:3].max():.2f} m/s and the angles by at most "
        f"{1e3 * states[3:].max():.1f} mrad, and the estimates of the faults differ by "
        f"{100 * share:.1f} % of their own error. What is fed back changes the flight; it hardly "
        "changes the estimation, because the kinematic model is exact in any flight."
    )


def _states_table(results: Mapping[str, Result], winds: Sequence[str]) -> Table:
    rows = []
    for wind in winds:
        for name in (GROUND, EXACT, AIR):
            most = median_of(draws_of(results, wind), name, "state_max")
            printed = wind == winds[0] and name == GROUND
            for what, value, limit in (
                ("velocities [m/s]", float(most[:3].max()), VELOCITY_M_S),
                ("angles [rad]", float(most[3:].max()), ANGLE_RAD),
            ):
                told = f"< {limit:g}" if printed else None
                rows.append([wind, name, what, value, told, _why_states(value, told, limit)])
    return Table(
        "lu2016-fig3-states",
        "Fig. 3(a, b): largest difference of the true states of the two flights; median of the "
        "draws. The paper has calm air and the ground-speed model only.",
        ("wind", "filter", "of", "ours", "paper", "why they differ"),
        rows,
        digits=2,
    )


def _why_states(value: float, told: str | None, limit: float) -> str | None:
    if told is not None and value >= limit:
        return (
            "Another aircraft and autopilot: ours holds no heading, and heading integrates the "
            "estimates' lag at onset and end and the small bias that (31) has from linearising at "
            "xbar (next rows)."
        )
    return None


def _errors_table(results: Mapping[str, Result], winds: Sequence[str]) -> Table:
    rows: list[list[Any]] = []
    for wind in winds:
        found = draws_of(results, wind)
        for name in (GROUND, EXACT, AIR):
            for loop in ("open", "closed"):
                errors = shown(median_of(found, name, f"rmse_{loop}"))
                rows.append([wind, name, loop, *map(float, errors), *_same(found, name, loop)])
        errors = shown(np.median([r["rmse_faulty"] for r in found], axis=0))
        why = "The autopilot steers on the faults; the filter only watches."
        rows.append([wind, GROUND, "closed on faulty values", *map(float, errors), None, why])
    return Table(
        "lu2016-loops",
        "RMSE of the fault estimates in both loops over 40 s, median of the draws; the paper "
        "prints no numbers. The last of the numbers is the largest difference of any axis.",
        (
            "wind",
            "filter",
            "loop",
            *(f"{a} [{u}]" for a, u in zip(AXES, UNITS, strict=True)),
            "closed - open [%]",
            "remark",
        ),
        rows,
    )


def _same(rows: Sequence[Result], name: str, loop: str) -> tuple[float | None, str | None]:
    """Largest relative change of the RMSE that closing the loop makes, and a remark."""
    if loop == "open":
        return None, None
    change = change_of(rows, name)
    ground = median_of(rows, GROUND, "rmse_closed")[:3]
    ratio = float(np.max(median_of(rows, name, "rmse_closed")[:3] / ground))
    remark = None
    if name == AIR and ratio > BLOWN:
        remark = (
            f"Up to {ratio:.0f} times the ground-speed model's errors, in both loops alike: they "
            "are the wind's, not the faults'."
        )
    return 100.0 * change, remark


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
