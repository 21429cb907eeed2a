"""Draws the pictures of the architecture: ``python docs/architecture.py`` writes them.

``docs/pictures/rooms.svg`` shows who imports whom, with the commands that are let into
``sim_feeds`` as ``pyproject.toml`` lists them; ``docs/pictures/flow.svg`` the way from bytes to
verdicts. Both are narrow enough for a telephone, and light in a dark page, too: an image does not
know the page's colours. A test compares :data:`ARROWS` with the imports that there are.
"""

from __future__ import annotations

import re
import tomllib
from html import escape
from pathlib import Path

DOCS = Path(__file__).parent
INK, QUIET, LINE, CARD = "#1b2733", "#4b5a69", "#51708f", "#f7f9fb"
FILL = {"links": "#dcecf9", "estimators": "#e2f2df", "sim_feeds": "#fbeed6", "monitor": "#ebe4f7"}
FREE, NARROW = "free", "narrow"

ARROWS = {
    ("monitor", "links"): FREE,
    ("monitor", "estimators"): FREE,
    ("monitor", "sim_feeds"): NARROW,
    ("sim_feeds", "links"): FREE,
    ("estimators", "links"): NARROW,
}
"""(importer, imported) -> whether all modules may, or only those that the contracts list."""


def commands_with_feeds() -> list[str]:
    """Names of ``monitor.commands`` that may import ``sim_feeds``, from the contracts."""
    rules = tomllib.loads((DOCS.parent / "pyproject.toml").read_text("utf-8"))
    contracts = rules["tool"]["importlinter"]["contracts"]
    listed = [line for c in contracts for line in c.get("ignore_imports", ())]
    found = [re.match(r"monitor\.commands\.(\w+)\S* -> sim_feeds", line) for line in listed]
    return [match[1] for match in found if match]


class Drawing:
    """An SVG under way; lengths are its own pixels."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self._parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" font-family="system-ui, sans-serif">',
            f"<title>{escape(title)}</title>",
            '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" '
            'markerHeight="8" orient="auto">'
            f'<path d="M0 0L8 4L0 8z" fill="{LINE}"/></marker></defs>',
            f'<rect width="{width}" height="{height}" rx="10" fill="{CARD}"/>',
        ]

    def box(
        self, at: tuple[int, int, int, int], head: str, *lines: str, room: str = "", top: int = 0
    ) -> None:
        """A box ``(x, y, width, height)`` with a bold head and lines below it.

        Centred, or with ``top`` that far below the box's top.
        """
        x, y, width, height = at
        self._parts.append(
            f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="7" '
            f'fill="{FILL.get(room, "#ffffff")}" stroke="{LINE}"/>'
        )
        first = y + (top or height // 2 - 9 * len(lines) + 5)
        self.words(x + width // 2, first, head, f'fill="{INK}" font-weight="600"')
        for i, line in enumerate(lines, 1):
            self.words(x + width // 2, first + 18 * i, line)

    def words(self, x: int, y: int, text: str, look: str = "", anchor: str = "middle") -> None:
        """A line of text, centred on x."""
        look = look or f'fill="{QUIET}" font-size="13"'
        self._parts.append(
            f'<text x="{x}" y="{y}" text-anchor="{anchor}" {look}>{escape(text)}</text>'
        )

    def arrow(self, *points: tuple[int, int], narrow: bool = False) -> None:
        """A line through the points that ends in a tip; dashed where only some may go."""
        path = " ".join(f"{x},{y}" for x, y in points)
        dash = ' stroke-dasharray="5 4"' if narrow else ""
        self._parts.append(
            f'<polyline points="{path}" fill="none" stroke="{LINE}" stroke-width="1.6"{dash} '
            'marker-end="url(#tip)"/>'
        )

    def text(self) -> str:
        """The file."""
        return "\n".join([*self._parts, "</svg>", ""])


def rooms() -> str:
    """The four packages and who imports whom."""
    picture = Drawing(520, 372, "The four packages: who imports whom")
    places = {
        "monitor": (20, 20, 480, 92),
        "sim_feeds": (20, 232, 150, 112),
        "links": (194, 232, 118, 112),
        "estimators": (358, 232, 142, 112),
    }
    says = {
        "monitor": ("pipeline and watches: rows to verdicts", "daemon, analysis, commands, pages"),
        "sim_feeds": ("a vehicle whose", "truth is known,", "and its faults"),
        "links": ("bytes to rows", "in SI units;", "sockets, files"),
        "estimators": ("arrays in, arrays", "out: no I/O,", "no clock, no log"),
    }
    ways = {
        ("monitor", "links"): ((260, 112), (260, 230)),
        ("monitor", "estimators"): ((425, 112), (425, 230)),
        ("monitor", "sim_feeds"): ((95, 112), (95, 230)),
        ("sim_feeds", "links"): ((170, 288), (192, 288)),
        ("estimators", "links"): ((358, 288), (314, 288)),
    }
    for name, place in places.items():
        picture.box(place, name, *says[name], room=name)
    for pair, kind in ARROWS.items():
        picture.arrow(*ways[pair], narrow=kind == NARROW)
    names = commands_with_feeds()
    lines = ["commands only:", *(", ".join(names[i : i + 2]) for i in range(0, len(names), 2))]
    for i, line in enumerate(lines):
        picture.words(104, 148 + 18 * i, line, anchor="start")
    picture.words(335, 278, "jit")
    return picture.text()


def flow() -> str:
    """From bytes to verdicts, live and from a log."""
    picture = Drawing(520, 640, "One pipeline, two drivers: from bytes to verdicts")
    left, right = (20, 20, 230, 66), (270, 20, 230, 66)
    picture.box(left, "in flight: run", "links.endpoints", "UDP, TCP, serial port", room="links")
    picture.box(right, "afterwards: analyze", "links.logs", ".tlog, .BIN, .ulg", room="links")
    picture.arrow((135, 86), (135, 114))
    picture.arrow((385, 86), (385, 114))
    picture.box((20, 116, 480, 64), "decoder and catalog", "frames checked, fields to SI units")
    picture.arrow((260, 180), (260, 212))
    picture.words(392, 201, "Batch: rows of each sensor")
    picture.box(
        (20, 214, 480, 254),
        "monitor.pipeline",
        "orders rows by vehicle time, finds the flight phase,",
        "notices streams that stop, hands rows to the watches",
        room="monitor",
        top=24,
    )
    watches = {
        "imu": "six axes each",
        "air": "pitots, vanes",
        "engine": "speeds",
        "wing": "lift, drag",
    }
    for x, (name, text) in zip(range(34, 520, 115), watches.items(), strict=False):
        picture.arrow((x + 53, 280), (x + 53, 300))
        picture.box((x, 302, 107, 52), name, text)
        picture.arrow((x + 53, 372), (x + 53, 356))
        picture.arrow((x + 53, 372), (x + 53, 386))
    picture.box(
        (34, 388, 452, 62),
        "estimators",
        "compiled filters and horizons: state, statistic, threshold",
        room="estimators",
    )
    picture.arrow((260, 468), (260, 500))
    picture.words(392, 489, "Verdicts and estimates")
    picture.box(
        (20, 502, 230, 118),
        "the daemon",
        "publishes over MAVLink,",
        "records, keeps what it",
        "learnt, serves a live page",
        room="monitor",
    )
    picture.box(
        (270, 502, 230, 118),
        "the analysis",
        "summary.json, Parquet,",
        "report.html; of many logs",
        "a fleet's dataset and page",
        room="monitor",
    )
    return picture.text()


PICTURES = {"rooms.svg": rooms, "flow.svg": flow}

if __name__ == "__main__":
    for file, draw in PICTURES.items():
        (DOCS / "pictures" / file).write_text(draw(), "utf-8")
