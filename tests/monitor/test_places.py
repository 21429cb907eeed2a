"""Where state is kept: the service manager's folder before the user's."""

from pathlib import Path

from platformdirs import user_state_path

from monitor.places import state_folder


def test_the_service_managers_folder_is_taken_first():
    assert state_folder({"STATE_DIRECTORY": "/var/lib/mavsentry"}) == Path("/var/lib/mavsentry")
    assert state_folder({"STATE_DIRECTORY": "/var/lib/a:/var/lib/b"}) == Path("/var/lib/a")


def test_without_it_state_is_the_users():
    expected = user_state_path("mavsentry", appauthor=False)
    assert state_folder({}) == expected
    assert state_folder({"STATE_DIRECTORY": ""}) == expected
