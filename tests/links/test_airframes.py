"""Airframe files: the bundled one reads, and what is wrong with another is named."""

import pytest

from links.airframes import BUNDLED, AirframeError, load_airframe


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_airframes_are_tables_of_numbers(name):
    numbers = load_airframe(name)
    assert numbers["mass_kg"] > 0.0
    assert all(isinstance(value, float) for value in numbers.values())


def test_aerosonde_is_the_distributed_table():
    """The older, heavier one must not slip in."""
    numbers = load_airframe("aerosonde")
    assert (numbers["mass_kg"], numbers["CLalpha"], numbers["Clda"]) == (11.0, 5.61, 0.17)


def test_missing_file_is_named_with_what_is_bundled(tmp_path):
    with pytest.raises(AirframeError, match=r"cannot read .*none\.toml.*bundled: aerosonde"):
        load_airframe(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[a]\nx = 'y'", r"a\.x is no number"),
        ("[a]\nx = true", r"a\.x is no number"),
        ("[a]\nx = 1\n[b]\nx = 2", "x stands twice"),
        ("[a", "airframe"),
    ],
)
def test_wrong_content_is_named(tmp_path, text, words):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(AirframeError, match=words):
        load_airframe(file)


def test_what_is_no_text_is_named(tmp_path):
    file = tmp_path / "bad.toml"
    file.write_bytes(b"\xff\xfe[a]")
    with pytest.raises(AirframeError, match="is no text"):
        load_airframe(file)


def test_sections_merge(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("name = 'mine'\n[a]\nx = 1\n[b]\ny = 2.5")
    assert load_airframe(file) == {"x": 1.0, "y": 2.5}
