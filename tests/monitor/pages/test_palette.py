"""Colours that everybody can tell apart from their ground, and states told by more than colour."""

from __future__ import annotations

import itertools

import pytest

from links.vocabulary import State
from monitor.pages import palette
from monitor.pages.palette import LOOKS, Tone, dark_by_light, tokens

TEXT = {"ink": palette.INK, "soft": palette.SOFT, "links": palette.LINKS, "warn": palette.THRESHOLD}
DRAWN = {"measured": palette.MEASURED, "reconstructed": palette.RECONSTRUCTED} | {
    f"line {k}": tone for k, tone in enumerate(palette.MORE)
}


def luminance(colour: str) -> float:
    """Relative luminance, WCAG 2.2."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(a: str, b: str) -> float:
    light, dark = sorted((luminance(a), luminance(b)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("tone", TEXT.values(), ids=TEXT)
@pytest.mark.parametrize("ground", [palette.PAPER, palette.WASH], ids=["paper", "wash"])
def test_text_is_read_on_paper_and_wash(tone: Tone, ground: Tone) -> None:
    assert contrast(tone.light, ground.light) >= 4.5
    assert contrast(tone.dark, ground.dark) >= 4.5


@pytest.mark.parametrize("tone", DRAWN.values(), ids=DRAWN)
def test_lines_stand_out_from_the_paper(tone: Tone) -> None:
    assert contrast(tone.light, palette.PAPER.light) >= 3.0
    assert contrast(tone.dark, palette.PAPER.dark) >= 3.0


def test_every_state_has_a_look_of_its_own_without_its_colour() -> None:
    assert set(LOOKS) == set(State)
    for what in ("mark", "word"):
        values = [getattr(look, what) for look in LOOKS.values()]
        assert len(set(values)) == len(values)
    for a, b in itertools.combinations(LOOKS.values(), 2):
        assert (a.hatch, a.height) != (b.hatch, b.height), f"{a.word} is drawn like {b.word}"


def test_what_is_wrong_is_drawn_taller_than_what_is_fine() -> None:
    fine = max(LOOKS[s].height for s in (State.OK, State.UNMONITORED, State.ABSENT))
    assert LOOKS[State.FAULTY].height > LOOKS[State.SUSPECT].height > fine


def test_colours_go_to_the_dark_and_back() -> None:
    table = dark_by_light()
    assert len(set(table.values())) == len(table), "two light colours have one dark one"
    assert not set(table) & set(table.values()), "a dark colour is also a light one"
    assert table[palette.MEASURED.light] == palette.MEASURED.dark
    assert all(LOOKS[state].tone.light in table for state in State)


def test_tokens_are_custom_properties_for_both() -> None:
    assert "--faulty:light-dark(#cf3f00,#ff6a2b);" in tokens()
    assert tokens().count("--ink:") == 1
