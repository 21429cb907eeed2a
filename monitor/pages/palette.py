"""Every colour of the pages once, for light and for dark, and what a state looks like.

The hues are those of Okabe and Ito (2008), which people with each kind of colour-blindness tell
apart; no state is told by its colour alone: each has a mark, a hatch, a height and a word.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Final, NamedTuple

from links.vocabulary import State

__all__ = [
    "AXES",
    "BAND",
    "INK",
    "LINE",
    "LINKS",
    "LOOKS",
    "MEASURED",
    "MORE",
    "PAPER",
    "RECONSTRUCTED",
    "REFERENCE",
    "SOFT",
    "THRESHOLD",
    "WASH",
    "Look",
    "Tone",
    "dark_by_light",
    "tokens",
]


class Tone(NamedTuple):
    """One colour, as it is on light and on dark paper."""

    light: str
    dark: str


class Look(NamedTuple):
    """What a state looks like.

    Attributes
    ----------
    tone
        Its colour.
    mark
        One character, beside its word.
    hatch
        Bokeh's name of a hatch pattern, or ``""``.
    height
        Of its bar in a timeline, where 1 fills the row: what matters more is taller.
    word
        As people read it.
    """

    tone: Tone
    mark: str
    hatch: str
    height: float
    word: str


INK: Final = Tone("#1a1c1e", "#e6e8ea")
SOFT: Final = Tone("#575c63", "#a9aeb5")
LINE: Final = Tone("#d6dade", "#3a3f45")
PAPER: Final = Tone("#ffffff", "#16181b")
WASH: Final = Tone("#f3f5f7", "#202428")
LINKS: Final = Tone("#0b5cad", "#85bdf2")

MEASURED: Final = Tone("#0072b2", "#56b4e9")
"""What the sensor said."""
RECONSTRUCTED: Final = Tone("#222426", "#f0f1f2")
"""What it should have said."""
BAND: Final = Tone("#6b7178", "#8d949c")
"""Two standard deviations about it; drawn at :data:`monitor.pages.charts.BAND_ALPHA`."""
REFERENCE: Final = Tone("#009e73", "#2fc49a")
"""Another sensor that agrees or not."""
THRESHOLD: Final = Tone("#b34700", "#f2a35e")
"""What a test statistic is held to; warnings."""
MORE: Final = (
    MEASURED,
    Tone("#d55e00", "#ff8b3d"),
    REFERENCE,
    Tone("#b0578d", "#e29cc4"),
    Tone("#9a6a00", "#e6b422"),
)
"""Lines of equal rank, such as the axes or the instances of a sensor."""
AXES: Final = MORE[:3]
"""x, y, z; north, east, down."""

LOOKS: Final = MappingProxyType(
    {
        State.OK: Look(Tone("#5fb49c", "#3c8f77"), "✓", "", 0.30, "ok"),
        State.SUSPECT: Look(
            Tone("#e69f00", "#e8a80c"), "?", "right_diagonal_line", 0.70, "suspect"
        ),
        State.FAULTY: Look(Tone("#cf3f00", "#ff6a2b"), "✕", "", 1.00, "faulty"),
        State.STOPPED: Look(Tone("#7a3f78", "#d48bd1"), "■", "cross", 1.00, "stopped"),
        State.STALE: Look(Tone("#8563ab", "#b9a0dc"), "…", "horizontal_line", 0.55, "stale"),
        State.UNMONITORED: Look(
            Tone("#b3b9c0", "#5c636b"), "○", "left_diagonal_line", 0.30, "unmonitored"
        ),
        State.ABSENT: Look(Tone("#c9ced3", "#4a5057"), "–", "", 0.08, "absent"),
    }
)
"""Every state's look."""

_PAGE: Final = MappingProxyType(
    {
        "ink": INK,
        "soft": SOFT,
        "line": LINE,
        "paper": PAPER,
        "wash": WASH,
        "link": LINKS,
        "bar": MEASURED,
        "warn": THRESHOLD,
    }
)


def dark_by_light() -> dict[str, str]:
    """Each colour for light paper -> the same for dark paper.

    Charts are made with the light colours; the page's script exchanges them by this table.
    """
    tones = {*_PAGE.values(), *MORE, RECONSTRUCTED, BAND, *(look.tone for look in LOOKS.values())}
    return {tone.light: tone.dark for tone in sorted(tones)}


def tokens() -> str:
    """The colours as custom properties of CSS: ``--ink`` ..., ``--faulty`` ..."""
    named = {
        **_PAGE,
        **{str(state): look.tone for state, look in LOOKS.items()},
        "measured": MEASURED,
        "reconstructed": RECONSTRUCTED,
        "band": BAND,
        "reference": REFERENCE,
        "threshold": THRESHOLD,
    }
    rules = "".join(f"--{n}:light-dark({t.light},{t.dark});" for n, t in named.items())
    return f":root{{{rules}}}\n"
