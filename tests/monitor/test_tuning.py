"""Settings in force: file, what was set over MAVLink, what is read again."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any

import pytest

from monitor.component.parameter_file import ParameterFile, parameter_path, read_parameters
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.retune import with_values
from monitor.settings import Settings, load
from monitor.tuning import Tuning

SIGMA = "imu.single_sigma"


def at_work(base: Settings, own: dict[str, Any] | None = None) -> Tuning:
    tuning = Tuning(base, own=own)
    settings = tuning.settings
    tuning.add(Pipeline(settings).retune, Publisher(settings.publish).retune)
    return tuning


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_read_again_is_taken_key_by_key_and_said_in_one_sentence(tmp_path: Path) -> None:
    file = written(tmp_path / "sentry.toml", "[imu]\nsingle_sigma = 5.0\n")
    tuning = at_work(load(None, file))
    written(
        file,
        "[imu]\nsingle_sigma = 7.0\nwindow_s = [2.0]\n[publish]\nmask_rate_hz = 4.0\n"
        "[web]\nrate_hz = 2.0\n",
    )
    done = tuning.reload(lambda: load(None, file), "sentry.toml")
    assert set(done.retuned.taken) == {SIGMA, "publish.mask_rate_hz"}
    assert set(done.retuned.waiting) == {"imu.window_s", "web.rate_hz"}
    assert done.sentence == (
        "sentry.toml read again; taken: imu.single_sigma, publish.mask_rate_hz; "
        "wait for a restart: imu.window_s, web.rate_hz"
    )
    assert tuning.get(SIGMA) == 7.0
    assert tuning.get("web.rate_hz") == Settings().web.rate_hz
    again = tuning.reload(lambda: load(None, file), "sentry.toml")
    assert again.retuned.taken == ()
    assert set(again.retuned.waiting) == {"imu.window_s", "web.rate_hz"}  # still waits, still said
    written(file, "[imu]\nsingle_sigma = 7.0\n[publish]\nmask_rate_hz = 4.0\n")
    assert tuning.reload(lambda: load(None, file), "f").sentence == "f read again; nothing changed"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[imu]\nsingle_sigma = -1\n", "imu.single_sigma = -1"),
        ("[imu]\nsigle_sigma = 7\n", "did you mean single_sigma?"),
        ("[imu\n", "not valid TOML"),
        (None, "cannot read"),
    ],
)
def test_a_broken_file_changes_nothing_and_says_what_is_wrong(
    tmp_path: Path, text: str | None, said: str
) -> None:
    file = written(tmp_path / "sentry.toml", "[imu]\nsingle_sigma = 5.0\n")
    tuning = at_work(load(None, file), {"air.margin_one": 9.0})
    before = tuning.settings
    if text is None:
        file.unlink()
    else:
        written(file, text)
    done = tuning.reload(lambda: load(None, file))
    assert done.failed
    assert said in done.sentence
    assert done.sentence.endswith("nothing was changed")
    assert "\n" not in done.sentence
    assert tuning.settings is before


def test_what_was_set_over_mavlink_stays_over_the_file() -> None:
    base = Settings()
    tuning = at_work(base)
    tuning.put({SIGMA: 9.0})
    newer = with_values(base, {SIGMA: 4.0, "air.margin_one": 9.5})
    done = tuning.reload(lambda: newer, "f")
    assert tuning.get(SIGMA) == 9.0
    assert done.sentence == (
        "f read again; taken: air.margin_one; set over MAVLink and kept: imu.single_sigma"
    )
    assert tuning.reset().taken == (SIGMA,)
    assert tuning.get(SIGMA) == 4.0
    tuning.put({SIGMA: 4.0})  # the file's own value is nothing set
    assert tuning.own == {}


def test_what_is_kept_is_in_force_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "made" / "parameters.json"
    assert read_parameters(path, Settings()) == ({}, None)
    keeper = ParameterFile(path)
    for sigma in range(3, 30):
        keeper.offer({SIGMA: float(sigma), "mute.air": 3, "publish.text": False})
    keeper.close(10.0)
    assert keeper.failure is None
    assert [p.name for p in path.parent.iterdir()] == ["parameters.json"]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    own, note = read_parameters(path, Settings())
    assert note is None
    assert own == {SIGMA: 29.0, "mute.air": 3, "publish.text": False}
    assert [type(own[key]) for key in (SIGMA, "mute.air", "publish.text")] == [float, int, bool]
    tuning = at_work(Settings(), own)
    assert tuning.get("publish.text") is False
    assert tuning.settings.mute.sensors == {"airspeed0", "airspeed1"}


@pytest.mark.parametrize(
    ("text", "kept", "said"),
    [
        ("", {}, "holds no parameters of ours"),
        ("{", {}, "holds no parameters of ours"),
        ("[" * 5000, {}, "holds no parameters of ours"),
        ("[]", {}, "holds no parameters of ours"),
        ('{"schema": "other/1", "values": {}}', {}, "holds no parameters of ours"),
        ('{"schema": "mavsentry/parameters/1", "values": 3}', {}, "holds no parameters of ours"),
        ("\xff" * 100_000, {}, "holds no parameters of ours"),
        (
            '{"schema": "mavsentry/parameters/1", "values": {"imu.single_sigma": 7,'
            ' "imu.confirm_s": NaN, "imu.clear_s": 1e999, "air.margin_one": "9",'
            ' "mute.air": 8, "web.viewers": 2, "links.system_id": 3, "": 1}}',
            {SIGMA: 7.0},
            "not used: , air.margin_one, imu.clear_s and 4 more",
        ),
    ],
)
def test_a_damaged_file_is_said_and_never_stops_the_start(
    tmp_path: Path, text: str, kept: dict[str, float], said: str
) -> None:
    path = written(tmp_path / "parameters.json", text)
    own, note = read_parameters(path, Settings())
    assert own == kept
    assert note is not None
    assert said in note


def test_a_folder_that_takes_nothing_is_said(tmp_path: Path) -> None:
    blocked = written(tmp_path / "file", "")
    keeper = ParameterFile(blocked / "parameters.json")
    keeper.offer({SIGMA: 7.0})
    keeper.close(10.0)
    assert keeper.failure is not None
    assert keeper.failure.startswith("parameters are not kept in")
    (tmp_path / "folder").mkdir()
    _, note = read_parameters(tmp_path / "folder", Settings())
    assert note is not None
    assert "cannot be read" in note


def test_a_write_that_fails_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "parameters.json"
    first = ParameterFile(path)
    first.offer({SIGMA: 7.0})
    first.close(10.0)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    second = ParameterFile(path)
    second.offer({SIGMA: 8.0})
    second.close(10.0)
    assert second.failure is not None
    assert second.failure.endswith("No space left on device")
    assert read_parameters(path, Settings()) == ({SIGMA: 7.0}, None)
    assert [p.name for p in tmp_path.iterdir()] == ["parameters.json"]


def test_where_they_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    assert parameter_path(Settings()) == tmp_path / "parameters.json"
    there = Settings.model_validate({"component": {"parameter_file": "/elsewhere/p.json"}})
    assert parameter_path(there) == Path("/elsewhere/p.json")
