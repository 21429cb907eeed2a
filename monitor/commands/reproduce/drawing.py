"""Figures of the report: one style, vector pictures, no display needed."""

from __future__ import annotations

import io
import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from monitor.commands.reproduce.study import Figure

__all__ = ["COLOURS", "svg", "thinned"]

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Colours of Okabe and Ito, told apart by the colour-blind; C0 is ours."""

_STYLE: Final[dict[str, Any]] = {
    "font.size": 9.0,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "svg.fonttype": "path",
    "svg.hashsalt": "mavsentry",
    "path.simplify": True,
    "figure.facecolor": "white",
}


def thinned(
    t: NDArray[np.float64], y: NDArray[np.float64], points: int = 2000
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A line of at most ``points`` points with every peak still there.

    Parameters
    ----------
    t, y : (n,) float64
        The line.
    points
        Even; each pair of points is the least and the largest value of one bin, in order of time.
    """
    n = len(t)
    if n <= points:
        return t, y
    edges = np.linspace(0, n, points // 2 + 1).astype(int)
    keep = []
    for a, b in pairwise(edges):
        part = np.where(np.isfinite(y[a:b]), y[a:b], 0.0)
        keep += sorted({a + int(part.argmin()), a + int(part.argmax())})
    return t[keep], y[keep]


def svg(figure: Figure) -> str:
    """The figure as an SVG document; the same figure gives the same text."""
    import matplotlib

    matplotlib.use("agg")
    from cycler import cycler
    from matplotlib.figure import Figure as Canvas

    style: Any = {**_STYLE, "axes.prop_cycle": cycler(color=COLOURS)}
    with matplotlib.rc_context(style):
        canvas = Canvas(figsize=figure.size_in, layout="constrained")
        figure.draw(canvas)
        out = io.StringIO()
        canvas.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return _PATH.sub(_rounded, out.getvalue())


_PATH: Final = re.compile(r'(?<= d=")[^"]+')
_LONG: Final = re.compile(r"-?\d+\.\d{3,}")


def _rounded(path: re.Match[str]) -> str:
    """A path with its points to a hundredth of a pixel: half the size, the same picture."""
    return _LONG.sub(lambda number: f"{float(number[0]):.2f}", path[0])
