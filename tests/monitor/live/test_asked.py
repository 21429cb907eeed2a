"""Options of ``run`` over its configuration file."""

from pathlib import Path

import pytest

from monitor.commands.live.asked import Asked
from monitor.settings import Settings, SettingsError

FILE = """\
profile = "transport"
[links]
inputs = ["tcp:10.0.0.1:5760", "udpin:0.0.0.0:14550"]
outputs = ["udpout:127.0.0.1:14551"]
system_id = 4
[recorder]
folder = "/var/lib/mavsentry/recordings"
[web]
address = "127.0.0.1:8080"
[log]
to = "journal"
"""


@pytest.fixture
def config(tmp_path):
    file = tmp_path / "mavsentry.toml"
    file.write_text(FILE)
    return file


def test_the_file_alone_is_enough(config):
    settings = Asked(config=config).settings()
    assert settings.profile == "transport"
    assert settings.links.inputs == ("tcp:10.0.0.1:5760", "udpin:0.0.0.0:14550")
    assert settings.links.outputs == ("udpout:127.0.0.1:14551",)
    assert settings.recorder.folder == "/var/lib/mavsentry/recordings"
    assert settings.web.address == "127.0.0.1:8080"
    assert settings.log.to == "journal"


def test_what_is_typed_goes_before_the_file(config):
    asked = Asked(
        "small-uav", config, ("udpin:0.0.0.0:1",), (), 0, Path("here"), "127.0.0.1:0", "-"
    )
    settings = asked.settings()
    assert settings.profile == "small-uav"
    assert settings.links.inputs == ("udpin:0.0.0.0:1",)
    assert settings.links.outputs == ("udpout:127.0.0.1:14551",)
    assert settings.links.system_id == 0
    assert (settings.recorder.folder, settings.web.address, settings.log.to) == (
        "here",
        "127.0.0.1:0",
        "-",
    )


def test_without_anything_the_defaults_stand():
    assert Asked().settings() == Settings()
    assert Asked().settings().links.inputs == ("udpin:0.0.0.0:14550",)


def test_a_file_that_changed_is_read_again_under_the_same_options(config):
    asked = Asked(config=config, system_id=9)
    asked.settings()
    config.write_text("[links]\nsystem_id = 2\nsilent_after_s = 1.0\n")
    settings = asked.settings()
    assert (settings.links.system_id, settings.links.silent_after_s) == (9, 1.0)
    config.write_text("[links]\nsystem = 2\n")
    with pytest.raises(SettingsError, match="system_id"):
        asked.settings()
