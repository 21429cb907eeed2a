"""The fleet page: one HTML file that loads nothing and can run no script but its own.

Texts from logs and file names are escaped, and a content security policy holds what would slip
through: it admits the one style sheet and the one script of this folder by their digests.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from monitor.fleet.dataset import Tables
from monitor.fleet.doubts import WHY
from monitor.fleet.figures import CLEAN_FLIGHTS, Group, doubts_of, figures
from monitor.fleet.places import Place
from monitor.fleet.task import code_version
from monitor.pages import html
from monitor.pages.units import quantity

__all__ = ["PAGE", "write_page"]

PAGE: Final = "index.html"
SCALES: Final = (1, 2, 5, 10, 20, 50)
"""Ends of a bar's scale [%]; 100 where none of them is enough."""
STEPS: Final = (0.0, 0.05, 0.1, 0.2, 0.4)
"""Share of flights from which a cell of the matrix is darker."""

_HERE = Path(__file__).parent
_TEMPLATE, _STYLE, _SCRIPT = "page.html.jinja", "page.css", "page.js"


def write_page(place: Place, tables: Tables, key: str) -> None:
    """Write ``index.html``.

    Parameters
    ----------
    place
        The folder of the results.
    tables
        The whole dataset.
    key
        Of the settings and code in force; logs judged with others are counted.

    Raises
    ------
    OSError
        The page cannot be written.
    """
    place.write(PAGE, rendered(figures(tables, key)).encode(errors="replace"))


def rendered(shown: Mapping[str, Any]) -> str:
    """The page as HTML, from what :func:`monitor.fleet.figures.figures` gives."""
    environment = html.environment(_HERE)
    environment.filters |= {
        "hours": _hours,
        "percent": _percent,
        "size": _size,
        "seconds": html.clock,
        "doubts": doubts_of,
        "full_scale": _full_scale,
        "step": lambda share: sum(share > least for least in STEPS),
        "address": quote,
    }
    style = html.base_style(_HERE / _STYLE)
    script = _HERE.joinpath(_SCRIPT).read_text("utf-8")
    return environment.get_template(_TEMPLATE).render(
        shown,
        written=datetime.now(UTC),
        version=code_version(),
        why=WHY,
        clean_flights=CLEAN_FLIGHTS,
        style=style,
        script=script,
        policy=html.content_security_policy([style], [script]),
    )


def _full_scale(groups: Iterable[Group]) -> int:
    """End of the scale that a table's bars share [%]."""
    most = 100.0 * max((group.share for group in groups), default=0.0)
    return next((end for end in SCALES if end >= most), 100)


def _hours(hours: float) -> str:
    digits = 0 if hours >= 100.0 else 1 if hours >= 10.0 else 2
    return f"{hours:,.{digits}f}"


def _percent(share: float) -> str:
    """A share in percent; what is not nothing never looks like nothing."""
    percent = 100.0 * share
    digits = 0 if percent >= 10.0 or percent == 0.0 else 1 if percent >= 0.1 else 2
    return f"{percent:.{digits}f}"


def _size(fault: Mapping[str, Any]) -> str:
    """How large a fault is; angles in degrees."""
    return quantity(fault["magnitude"], fault["unit"], sign=True)
