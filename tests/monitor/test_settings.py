"""Configuration: layers, origins, and errors that help."""

from pathlib import Path

import pytest

from monitor import settings


def write(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "sentry.toml"
    file.write_text(text)
    return file


@pytest.mark.parametrize("profile", settings.PROFILES)
def test_every_profile_loads_and_names_itself(profile: str) -> None:
    assert settings.load(profile).profile == profile


def test_a_file_overrides_single_keys_of_the_profile(tmp_path: Path) -> None:
    file = write(tmp_path, 'profile = "transport"\n[phase]\nconfirm_s = 4.0\n')
    loaded = settings.load(None, file)
    assert loaded.phase.confirm_s == 4.0
    assert loaded.phase.flying_speed_m_s == settings.load("transport").phase.flying_speed_m_s


def test_origins_say_where_each_value_came_from(tmp_path: Path) -> None:
    file = write(tmp_path, 'profile = "transport"\n[phase]\nconfirm_s = 4.0\n')
    origin = settings.origins(None, file)
    assert origin["phase.confirm_s"] == str(file)
    assert origin["phase.flying_speed_m_s"] == "profile transport"
    assert origin["phase.standstill_speed_m_s"] == "default"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[phase]\nflying_sped_m_s = 9", "did you mean flying_speed_m_s?"),
        ("[fase]\nconfirm_s = 1", "did you mean phase?"),
        ("[phase]\nconfirm_s = -1", "phase.confirm_s = -1"),
        ("[phase\n", "is not valid TOML"),
        ('profile = "glider"', "choose one of small-uav"),
    ],
)
def test_a_mistake_is_one_sentence_that_names_the_remedy(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(settings.SettingsError) as error:
        settings.load(None, write(tmp_path, text))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(settings.SettingsError, match="No such file"):
        settings.load(None, tmp_path / "none.toml")
