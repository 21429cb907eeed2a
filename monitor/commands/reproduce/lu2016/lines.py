"""Drawings that several studies of lu2016 share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.lu2016.published import AXES, UNITS, shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["Curve", "bars", "panels"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Curve:
    """Six lines of one kind.

    Attributes
    ----------
    label, colour
    values : (n, 6) float64
        Faults or errors [m/s^2, rad/s].
    width, alpha
        Of the line; noisy ones are drawn thin.
    """

    label: str
    colour: str
    values: Floats
    width: float = 1.2
    alpha: float = 1.0
    dashed: bool = False


def panels(
    canvas: Canvas,
    t_s: Floats,
    curves: Sequence[Curve],
    *,
    axes: Sequence[int] = range(6),
    zero: bool = False,
) -> None:
    """A panel per axis of the IMU: accelerometers to the left, gyros to the right.

    Parameters
    ----------
    t_s : (n,) float64
    curves
        The first lies undermost.
    axes
        Which of the six; three of a kind stand in one row.
    zero
        Draw a line at zero, for errors.
    """
    both = len(axes) > 3
    shape = (3, 2) if both else (1, len(axes))
    grid = np.atleast_2d(canvas.subplots(*shape, sharex=True))
    flat = [grid[k % 3, k // 3] for k in range(6)] if both else list(grid[0])
    for ax, k in zip(flat, axes, strict=True):
        if zero:
            ax.axhline(0.0, color="0.6", linewidth=0.6)
        for c in curves:
            ax.plot(
                t_s,
                shown(c.values)[:, k],
                color=c.colour,
                linewidth=c.width,
                alpha=c.alpha,
                linestyle="--" if c.dashed else "-",
                label=c.label,
            )
        ax.set_title(f"{AXES[k]} [{UNITS[k]}]")
    for ax in grid[-1]:
        ax.set_xlabel("time [s]")
    handles, labels = flat[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside upper center", ncols=len(labels))


def bars(
    canvas: Canvas,
    groups: Sequence[str],
    series: Sequence[tuple[str, str, Floats]],
    units: Sequence[str],
    *,
    log: bool = False,
) -> None:
    """Bars of several kinds side by side, one panel per unit.

    Parameters
    ----------
    groups
        Names under the bars, `len(units)` blocks of equal length.
    series
        Label, colour and (len(groups),) values of each kind.
    units
        One panel each; its share of the groups in order.
    """
    per = len(groups) // len(units)
    grid = np.atleast_1d(canvas.subplots(1, len(units)))
    width = 0.8 / len(series)
    for block, (ax, unit) in enumerate(zip(grid, units, strict=True)):
        part = slice(block * per, (block + 1) * per)
        at = np.arange(per)
        for i, (label, colour, values) in enumerate(series):
            ax.bar(
                at + (i - (len(series) - 1) / 2) * width,
                values[part],
                width,
                label=label,
                color=colour,
            )
        ax.set_xticks(at, list(groups[part]))
        ax.set_ylabel(f"RMSE [{unit}]")
        if log:
            ax.set_yscale("log")
    handles, labels = grid[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside upper center", ncols=len(labels))
