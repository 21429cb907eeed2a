"""One look for all pictures: colours that differ in print, too, a size that a phone can show."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

MEASURED: Final = "#b3261e"
TRUE: Final = "#000000"
RECONSTRUCTED: Final = "#1f5fa8"
FAULT: Final = "#f6d6d3"
OTHER: Final = "#2e7d4f"
GREY: Final = "#8a8f98"

STATES: Final = {
    "ok": "#7fb98f",
    "suspect": "#f2c14e",
    "faulty": "#b3261e",
    "stale": "#7b5ea7",
    "absent": "#ffffff",
    "unmonitored": "#d5d8dd",
}

WIDTH_IN: Final = 6.0
DPI: Final = 150

plt.rcParams.update(
    {
        "font.size": 10.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 10.5,
        "axes.titlelocation": "left",
        "legend.frameon": False,
        "legend.fontsize": 9.5,
        "lines.linewidth": 1.4,
        "figure.facecolor": "white",
    }
)


def canvas(height_in: float, rows: int = 1, **how: Any) -> tuple[Figure, list[Axes]]:
    """A figure and its panels from top to bottom, with one time axis unless told otherwise."""
    figure, axes = plt.subplots(
        rows, figsize=(WIDTH_IN, height_in), layout="constrained", squeeze=False, **how
    )
    return figure, list(axes[:, 0])


def save(figure: Figure, path: Path) -> None:
    """Write the picture, without the date and version that would make it differ every time."""
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
    plt.close(figure)
