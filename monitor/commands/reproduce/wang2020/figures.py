"""Figures of the wang2020 chapter: the paper's 3 to 9 with our estimators, and the spread."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from monitor.commands.reproduce.study import Figure
from monitor.commands.reproduce.wang2020.found import Found
from monitor.commands.reproduce.wang2020.methods import DEPLOYED_MEMORY_S
from monitor.commands.reproduce.wang2020.printed import TABLE3
from monitor.commands.reproduce.wang2020.scores import SHARES, chi_square_2
from monitor.commands.reproduce.wang2020.tables import NAMES, PRINTED_AS
from sim_feeds.papers.wang2020 import NOISE_LAWS, wang2020_scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

__all__ = ["figures"]

Array = NDArray[np.float64]

OURS: Final = f"memory {DEPLOYED_MEMORY_S:g} s"
SPEEDS: Final = ("LPC speed [%]", "HPC speed [%]")
ERRORS: Final = ("LPC error [%]", "HPC error [%]")
DOTS: Final = 500
"""Points drawn of a scatter."""


def figures(found: Found) -> dict[str, Figure]:
    """All figures by name."""
    shown = found.shown
    which = f"Run of seed {shown['seed']}."
    made = (
        Figure("wang2020-fig3", f"Fig. 3: the engine's inputs. {which}", partial(_inputs, found)),
        Figure(
            "wang2020-fig4",
            "Fig. 4: outputs with noise and faults; from 5 s on (dashed) LPC and HPC speed sensor "
            f"never work. {which}",
            partial(_outputs, found),
            (8.0, 4.6),
        ),
        Figure(
            "wang2020-fig5",
            "Fig. 5: true speeds, estimates of the proposed method as printed and with j = 0 and "
            f"health memory, and the expected standard deviation (20). {which}",
            partial(_estimates, found),
            (8.0, 5.0),
        ),
        Figure(
            "wang2020-health",
            f"Health of each channel with a memory of {DEPLOYED_MEMORY_S:g} s; the paper's lambda "
            f"has none. {which}",
            partial(_health, found),
            (8.0, 2.4),
        ),
        Figure(
            "wang2020-fig6",
            "Fig. 6: errors of the proposed method as printed, with the 68 and 95 % ellipses of "
            f"their mean and covariance. {which}",
            partial(_histogram, found),
            (5.0, 3.6),
        ),
        Figure(
            "wang2020-fig7",
            f"Fig. 7: errors of the methods and their 95 % ellipses. {which}",
            partial(_scatter, found, "errors", NAMES),
            (8.0, 4.2),
        ),
        Figure(
            "wang2020-fig8",
            "Fig. 8: errors of the proposed method as printed under three laws of noise. " + which,
            partial(_scatter, found, "by_noise", {law: law for law in NOISE_LAWS}),
            (8.0, 4.2),
        ),
        Figure(
            "wang2020-fig9",
            f"Fig. 9: the bleed-inferred HPC speed under three laws of noise. {which}",
            partial(_bleed, found),
            (8.0, 4.2),
        ),
        Figure(
            "wang2020-spread",
            f"Area of the 95 % ellipse in {found.runs} runs (bar: 10 to 90 %, dot: median) and the "
            "paper's one run (cross).",
            partial(_spread, found),
            (8.0, 4.0),
        ),
    )
    return {figure.name.removeprefix("wang2020-"): figure for figure in made}


def _panels(canvas: Canvas, rows: int) -> Any:
    axes = canvas.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    axes[-1].set_xlabel("time [s]")
    for ax in axes:
        ax.axvline(wang2020_scenario().permanent_from_s, color="0.5", ls="--", lw=0.8)
    return axes


def _inputs(found: Found, canvas: Canvas) -> None:
    (ax,) = _panels(canvas, 1)
    shown = found.shown
    ax.plot(shown["t_s"], shown["u"], label=["fuel flow", "nozzle area"])
    ax.set_ylabel("share of limit")
    ax.legend()


def _outputs(found: Found, canvas: Canvas) -> None:
    shown = found.shown
    names = wang2020_scenario().outputs
    for i, ax in enumerate(_panels(canvas, len(names))):
        ax.plot(shown["t_s"], 100.0 * shown["y"][:, i], lw=0.6)
        ax.set_title(f"{names[i]} [%]")
        ax.set_ylim(-5.0, 105.0)


def _estimates(found: Found, canvas: Canvas) -> None:
    shown = found.shown
    *speeds, last = _panels(canvas, 3)
    for i, ax in enumerate(speeds):
        ax.plot(shown["t_s"], 100.0 * shown["x"][:, i], color="k", label="true")
        for name, colour, label in (("proposed", "C1", "as printed"), ("deployed", "C0", OURS)):
            estimate = 100.0 * shown["estimates"][name][:, i]
            ax.plot(shown["t_s"], estimate, color=colour, lw=0.8, label=label)
        ax.set_ylabel(SPEEDS[i])
    speeds[0].legend(ncols=3)
    for name, colour in (("proposed", "C1"), ("deployed", "C0")):
        last.plot(shown["t_s"], shown["delta"][name], color=colour, lw=0.8)
    last.set_ylabel("expected std [%]")


def _health(found: Found, canvas: Canvas) -> None:
    (ax,) = _panels(canvas, 1)
    shown = found.shown
    for i, name in enumerate(wang2020_scenario().outputs):
        ax.plot(shown["t_s"], shown["health"][:, i], lw=0.8, label=name)
    ax.set_ylabel("health")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _ellipse(ax: Axes, errors: Array, share: float, **style: Any) -> None:
    """The ellipse that holds this share of a Gaussian with the errors' mean and covariance."""
    turn = np.linspace(0.0, 2.0 * math.pi, 121)
    values, vectors = np.linalg.eigh(np.cov(errors.T))
    axes = vectors * np.sqrt(chi_square_2(share) * np.maximum(values, 0.0))
    line = errors.mean(axis=0) + np.column_stack([np.cos(turn), np.sin(turn)]) @ axes.T
    ax.plot(line[:, 0], line[:, 1], **style)


def _histogram(found: Found, canvas: Canvas) -> None:
    errors = np.asarray(found.shown["errors"]["proposed"])
    ax = canvas.subplots()
    edges = [np.linspace(-reach, reach, 61) for reach in _reach(errors)]
    counts, *_ = np.histogram2d(errors[:, 0], errors[:, 1], bins=edges)
    image = ax.pcolormesh(
        *edges, np.log10(np.maximum(counts.T, 0.5)), cmap="Blues", rasterized=True
    )
    canvas.colorbar(image, label="log10 of samples")
    for share, colour in zip(SHARES, ("C2", "C4"), strict=True):
        _ellipse(ax, errors, share, color=colour, label=f"{share:.0%}")
    ax.set_xlabel(ERRORS[0])
    ax.set_ylabel(ERRORS[1])
    ax.legend()


def _reach(errors: Array) -> tuple[float, float]:
    """Half-width of the drawn region: the 95 % ellipse with some room."""
    x, y = 1.3 * math.sqrt(chi_square_2(0.95)) * errors.std(axis=0)
    return float(x), float(y)


def _scatter(found: Found, key: str, names: dict[str, str], canvas: Canvas) -> None:
    ax = canvas.subplots()
    sets = found.shown[key]
    order = {"deployed": 0, "proposed": 1, "gaussian": 0, "laplace": 1, "cauchy": 2}
    widest = np.zeros(2)
    for i, name in enumerate(sorted(sets, key=lambda name: order.get(name, 9))):
        errors = np.asarray(sets[name])
        step = max(len(errors) // DOTS, 1)
        x, y = errors[::step].T
        ax.scatter(x, y, s=4, color=f"C{i}", alpha=0.4, lw=0, rasterized=True)
        _ellipse(ax, errors, 0.95, color=f"C{i}", ls="--", label=names[name])
        widest = np.maximum(widest, np.abs(errors.mean(axis=0)) + _reach(errors))
    ax.set_xlim(-widest[0], widest[0])
    ax.set_ylim(-widest[1], widest[1])
    ax.set_xlabel(ERRORS[0])
    ax.set_ylabel(ERRORS[1])
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _bleed(found: Found, canvas: Canvas) -> None:
    shown = found.shown
    for law, ax in zip(NOISE_LAWS, _panels(canvas, len(NOISE_LAWS)), strict=True):
        ax.plot(shown["t_s"], 100.0 * shown["bleed"][law], lw=0.6)
        ax.set_title(f"{law}: bleed-inferred HPC speed [%]")
        ax.set_ylim(-50.0, 150.0)


def _spread(found: Found, canvas: Canvas) -> None:
    ax = canvas.subplots()
    order = list(reversed(NAMES))
    for i, method in enumerate(order):
        area = found.spread(method, "a95")
        colour = "C0" if method == "deployed" else "0.4"
        ax.plot([area.low, area.high], [i, i], color=colour, lw=3, solid_capstyle="butt")
        ax.plot(area.median, i, "o", color=colour, mec="white")
        if method in PRINTED_AS:
            ax.plot(TABLE3[PRINTED_AS[method]].a95, i, "x", color="C1")
    ax.set_yticks(range(len(order)), [NAMES[method] for method in order])
    ax.set_xscale("log")
    ax.set_xlabel("area of the 95 % ellipse [%²]")
    ax.grid(axis="x", which="both")
