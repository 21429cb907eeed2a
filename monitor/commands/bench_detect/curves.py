"""Delay against size as a small picture: one row per group of flights, one column per quantity.

Written as SVG by hand, so that the command needs no plotting library.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from math import log10
from typing import Any, Final

from monitor.commands.bench_detect.configurations import LADDERS
from monitor.commands.bench_detect.table import curve

__all__ = ["picture"]

Json = dict[str, Any]

COLUMNS: Final = {
    "acc": "accelerometer step [m/s²]",
    "gyro": "gyro step [deg/s]",
    "airspeed": "pitot step [% of airspeed]",
    "aoa": "vane step [deg]",
}
COLOURS: Final = ("#1f5fa8", "#b3261e", "#2e7d32", "#8e5ba6", "#b8860b", "#00838f", "#555555")
WIDTH, HEIGHT, LEFT, TOP, GAP_X, GAP_Y = 215.0, 120.0, 92.0, 30.0, 34.0, 44.0
LEAST_S, MOST_S = 0.3, 60.0
MARKS_S: Final = (1.0, 3.0, 10.0, 30.0, 60.0)


def picture(document: Json) -> str:
    """The picture of a table's document."""
    groups = [g for g in document["groups"] if any(p["cells"] for p in g["configurations"])]
    names = list(dict.fromkeys(p["configuration"] for g in groups for p in g["configurations"]))
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)}
    columns = [q for q in COLUMNS if any(_lines(g, q, document["trials"]) for g in groups)]
    width = LEFT + len(columns) * (WIDTH + GAP_X)
    legend_y = TOP + len(groups) * (HEIGHT + GAP_Y) + 8.0
    height = legend_y + 16.0 * ((len(names) + 1) // 2) + 8.0
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" font-family="sans-serif" font-size="10.5">',
        f"<title>{escape('Time within which 95 % of the trials were named, against size')}</title>",
        '<rect width="100%" height="100%" fill="#ffffff"/>',
    ]
    for i, group in enumerate(groups):
        top = TOP + i * (HEIGHT + GAP_Y)
        parts.append(
            f'<text x="8" y="{top + HEIGHT / 2:.0f}" font-weight="bold">{escape(group["name"])}'
            f'</text><text x="8" y="{top + HEIGHT / 2 + 13:.0f}" fill="#555">'
            f"{'recorded' if group['recorded'] else 'synthetic'}</text>"
        )
        for j, quantity in enumerate(columns):
            left = LEFT + j * (WIDTH + GAP_X)
            if _lines(group, quantity, document["trials"]):
                parts += _panel(group, quantity, left, top, colours, document["trials"])
            if i == 0:
                parts.append(f'<text x="{left:.0f}" y="{top - 12:.0f}">{COLUMNS[quantity]}</text>')
    for k, name in enumerate(names):
        x, y = LEFT + (k % 2) * 330.0, legend_y + 16.0 * (k // 2)
        parts.append(
            f'<line x1="{x:.0f}" x2="{x + 22:.0f}" y1="{y:.0f}" y2="{y:.0f}" '
            f'stroke="{colours[name]}" stroke-width="2"/>'
            f'<text x="{x + 28:.0f}" y="{y + 4:.0f}">{escape(name)}</text>'
        )
    return "\n".join([*parts, "</svg>"]) + "\n"


def _lines(
    group: Json, quantity: str, trials: int
) -> list[tuple[str, str, list[tuple[float, float]]]]:
    """(configuration, axis, points) of the steps of one quantity."""
    found = []
    for part in group["configurations"]:
        for cell in part["cells"]:
            axis = cell["sensor"].partition(".")[2]
            own = axis.partition("_")[0] if axis else cell["sensor"].rstrip("0123456789")
            points = curve(cell, trials)
            if cell["shape"] == "step" and own == quantity and points:
                found.append((part["configuration"], axis[-1:], points))
    return found


def _panel(
    group: Json, quantity: str, left: float, top: float, colours: dict[str, str], trials: int
) -> Iterator[str]:
    least, most = LADDERS[quantity].steps[0], LADDERS[quantity].steps[-1]

    def x_of(size: float) -> float:
        return left + WIDTH * log10(size / least) / log10(most / least)

    def y_of(seconds: float) -> float:
        clipped = min(max(seconds, LEAST_S), MOST_S)
        return top + HEIGHT * (1.0 - log10(clipped / LEAST_S) / log10(MOST_S / LEAST_S))

    yield (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{WIDTH:.0f}" height="{HEIGHT:.0f}" '
        'fill="none" stroke="#999"/>'
    )
    for mark_s in MARKS_S:
        y = y_of(mark_s)
        yield (
            f'<line x1="{left:.1f}" x2="{left + WIDTH:.1f}" y1="{y:.1f}" y2="{y:.1f}" '
            'stroke="#e4e4e4"/>'
            f'<text x="{left - 4:.1f}" y="{y + 3.5:.1f}" text-anchor="end" fill="#555">'
            f"{mark_s:g}{' s' if mark_s == MARKS_S[-1] else ''}</text>"
        )
    for size in LADDERS[quantity].steps:
        if f"{size:.1e}"[:3] not in ("1.0", "2.0", "5.0"):
            continue
        x = x_of(size)
        yield (
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{top + HEIGHT:.1f}" '
            f'y2="{top + HEIGHT + 3:.1f}" stroke="#999"/>'
            f'<text x="{x:.1f}" y="{top + HEIGHT + 14:.1f}" text-anchor="middle" fill="#555">'
            f"{size:g}</text>"
        )
    for name, axis, points in _lines(group, quantity, trials):
        path = " ".join(f"{x_of(size):.1f},{y_of(seconds):.1f}" for size, seconds in points)
        yield (
            f'<polyline points="{path}" fill="none" stroke="{colours[name]}" '
            'stroke-width="1.4" stroke-opacity="0.85"/>'
        )
        for size, seconds in points:
            yield (
                f'<circle cx="{x_of(size):.1f}" cy="{y_of(seconds):.1f}" r="1.8" '
                f'fill="{colours[name]}"/>'
            )
        size, seconds = points[0]
        yield (
            f'<text x="{x_of(size) - 4:.1f}" y="{y_of(seconds) - 3:.1f}" text-anchor="end" '
            f'fill="{colours[name]}">{axis}</text>'
        )
