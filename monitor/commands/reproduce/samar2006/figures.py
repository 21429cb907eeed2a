"""Figures 2 to 7 of samar2006, with our flight and our estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from monitor.commands.reproduce.drawing import thinned
from monitor.commands.reproduce.samar2006.scheme import RIGHT
from monitor.commands.reproduce.samar2006.tables import NAMES, model_word
from monitor.commands.reproduce.study import Figure, Results
from sim_feeds.sixdof.aerosonde import WAYPOINTS_M

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["figures"]

ACCELERATIONS = (
    "ahead [m/s^2]", "right [m/s^2]", "down [m/s^2]",
    "roll [rad/s^2]", "pitch [rad/s^2]", "yaw [rad/s^2]",
)  # fmt: skip


def figures(results: Results) -> list[Figure]:
    """The paper's figures in their order."""
    shown = results["shown"]
    return [
        Figure("samar2006-fig2", "Fig. 2: states over the flight.", _states(shown), (8.0, 5.2)),
        Figure(
            "samar2006-fig3",
            "Fig. 3: trajectory and waypoints. The paper's waypoints are not printed.",
            _trajectory(shown),
            (5.0, 4.5),
        ),
        Figure(
            "samar2006-fig4",
            "Fig. 4: wind at the aircraft, gusts included (the velocity the air moves toward).",
            _wind(shown),
            (8.0, 3.6),
        ),
        Figure(
            "samar2006-fig5",
            "Fig. 5: residuals, body axes, after the 4 s filter; dotted: onsets of the faults.",
            _six(shown, shown["y"], ""),
            (8.0, 4.4),
        ),
        Figure(
            "samar2006-fig6",
            "Fig. 6: signature of right lift loss, residual per %, after the same filter.",
            _six(shown, shown["S"][:, :, 0], " per %"),
            (8.0, 4.4),
        ),
        Figure(
            "samar2006-fig7",
            "Fig. 7: faults (grey) and their estimates, with the aircraft's coefficients and with "
            "wrong ones (dashed).",
            _estimates(shown),
            (8.0, 4.8),
        ),
    ]


def _states(shown: dict[str, Any]) -> Any:
    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots(4, 2, sharex=True).T.ravel()
        t = shown["t_s"]
        rows = [
            ("north, east [m]", shown["ned_m"][:, :2]),
            ("height change [m]", -shown["ned_m"][:, 2:]),
            ("roll, pitch [deg]", shown["euler_deg"][:, :2]),
            ("yaw [deg]", shown["euler_deg"][:, 2:]),
            ("velocity N, E, D [m/s]", shown["vel_ned_m_s"]),
            ("airspeed [m/s]", shown["tas_m_s"][:, None]),
            ("rates [deg/s]", shown["rate_deg_s"]),
            ("propeller [rad/s]", shown["prop_rad_s"][:, None]),
        ]
        for ax, (label, columns) in zip(axes, rows, strict=True):
            for column in columns.T:
                ax.plot(*thinned(t, np.ascontiguousarray(column), 800), lw=0.8)
            ax.set_ylabel(label, fontsize=7)
        for ax in (axes[3], axes[7]):
            ax.set_xlabel("time [s]")

    return draw


def _trajectory(shown: dict[str, Any]) -> Any:
    def draw(canvas: Canvas) -> None:
        ax = canvas.subplots()
        ax.plot(shown["ned_m"][:, 1], shown["ned_m"][:, 0])
        north, east = zip(*WAYPOINTS_M, strict=True)
        ax.plot(east, north, "o", mfc="none", color="C1", label="waypoints")
        ax.set_xlabel("east [m]")
        ax.set_ylabel("north [m]")
        ax.set_aspect("equal")
        ax.legend()

    return draw


def _wind(shown: dict[str, Any]) -> Any:
    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots(3, 1, sharex=True)
        for ax, column, label in zip(
            axes, shown["wind_ned_m_s"].T, ("north", "east", "down"), strict=True
        ):
            ax.plot(*thinned(shown["t_s"], np.ascontiguousarray(column), 1000), lw=0.8)
            ax.set_ylabel(f"{label} [m/s]")
        axes[-1].set_xlabel("time [s]")

    return draw


def _onsets(shown: dict[str, Any]) -> list[float]:
    begun = shown["fault"] > 0.0
    return [float(shown["t_s"][int(b.argmax())]) for b in begun.T if b.any()]


def _six(shown: dict[str, Any], values: Any, unit: str) -> Any:
    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots(3, 2, sharex=True).T.ravel()
        for ax, column, label in zip(axes, values.T, ACCELERATIONS, strict=True):
            ax.plot(shown["rows_t_s"], column, lw=0.9)
            for onset in _onsets(shown):
                ax.axvline(onset, color="0.6", ls=":", lw=0.8)
            ax.set_ylabel(label.replace("]", unit + "]"), fontsize=7)
        for ax in (axes[2], axes[5]):
            ax.set_xlabel("time [s]")

    return draw


def _estimates(shown: dict[str, Any]) -> Any:
    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots(2, 2, sharex=True).ravel()
        for i, ax in enumerate(axes):
            ax.plot(shown["t_s"], shown["fault"][:, i], color="0.6", lw=2.5, label="true")
            for k, (model, f) in enumerate(shown["f"].items()):
                style = "-" if model == RIGHT else "--"
                ax.plot(shown["rows_t_s"], f[:, i], style, color=f"C{k}", label=model_word(model))
            ax.set_ylabel(f"{NAMES[i]} [%]")
            highest = max(float(f[:, i].max()) for f in shown["f"].values())
            ax.set_ylim(0.0, 1.1 * max(10.0, shown["fault"][:, i].max(), highest))
        axes[0].legend()
        for ax in axes[2:]:
            ax.set_xlabel("time [s]")

    return draw
