"""Draws the pictures of the documentation from the bundled scenarios.

``python docs/pictures.py`` flies them, judges their telemetry with the pipeline and writes
``docs/pictures/*.png``; with names it draws those only, with ``--to DIR`` somewhere else. Needs
matplotlib (extra ``reproduce``). ``report.png`` and ``live.png`` are photographs of pages.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from drawing import air, imu, readme, verdict

PICTURES: Final = Path(__file__).parent / "pictures"

DRAWN: Final[Mapping[str, Callable[[Path], None]]] = {
    "pitot-runaway.png": readme.caught,
    "verdict-flight.png": verdict.flight,
    "verdict-evidence.png": verdict.evidence,
    "verdict-ratio.png": verdict.ratio,
    "air-turn.png": air.turn,
    "air-bounds.png": air.bounds,
    "air-drift.png": air.drift,
    "air-vane.png": air.vane,
    "imu-two.png": imu.two,
}
"""File -> what draws it."""


def main() -> None:
    """Draw what is asked for."""
    parser = argparse.ArgumentParser(description="Draws the pictures of the documentation.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(DRAWN))
    parser.add_argument("--to", type=Path, default=PICTURES, metavar="DIR")
    asked = parser.parse_args()
    unknown = set(asked.names) - set(DRAWN)
    if unknown:
        parser.error(f"nothing draws {', '.join(sorted(unknown))}")
    asked.to.mkdir(parents=True, exist_ok=True)
    with np.errstate(all="raise", under="ignore"):
        for name in asked.names or DRAWN:
            DRAWN[name](asked.to / name)


if __name__ == "__main__":
    main()
