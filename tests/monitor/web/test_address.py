"""Where the page listens, and the token that guards it: each refusal is one sentence."""

import os
import socket
import stat
import subprocess
import sys

import pytest

from monitor.web.address import VARIABLE, Token, WebError, find_token, listen

GOOD = "0123456789abcdefXYZ-_"


@pytest.mark.parametrize(
    "address",
    ["8080", "127.0.0.1", "127.0.0.1:http", "127.0.0.1:70000", "http://127.0.0.1:8080", "::1:8080"],
)
def test_what_is_no_address_is_refused(address):
    with pytest.raises(WebError, match="not of the form HOST:PORT"):
        listen(address)


def test_a_host_that_is_not_there_is_refused():
    with pytest.raises(WebError, match=r"there is no host called nowhere\.invalid"):
        listen("nowhere.invalid:8080")


def test_a_port_that_is_taken_is_refused():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(WebError, match="the port is already in use"):
            listen(f"127.0.0.1:{port}")


def test_another_computers_address_is_refused():
    with pytest.raises(WebError, match="this computer has no such address"):
        listen("192.0.2.1:8080")


def test_a_port_that_needs_permission_is_refused(monkeypatch):
    def refuse(self, where):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    with pytest.raises(WebError, match=r"cannot open the live page at .*: permission denied"):
        listen("127.0.0.1:80")


@pytest.mark.parametrize(
    ("address", "loopback"),
    [("127.0.0.1:0", True), ("localhost:0", True), ("0.0.0.0:0", False), ("127.8.8.8:0", True)],
)
def test_who_can_reach_it_is_known(address, loopback):
    listening = listen(address)
    with listening.socket:
        assert listening.loopback is loopback
        assert listening.port > 0


def test_the_address_for_a_browser():
    for address, shown in (("127.0.0.1:0", "127.0.0.1"), ("0.0.0.0:0", socket.gethostname())):
        listening = listen(address)
        with listening.socket:
            assert listening.url == f"http://{shown}:{listening.port}/"


def test_the_port_is_free_at_once_after_it_was_used():
    first = listen("127.0.0.1:0")
    with first.socket, socket.create_connection(("127.0.0.1", first.port)):
        first.socket.setblocking(True)
        first.socket.accept()[0].close()  # closed by us: it lingers in TIME_WAIT
    listen(f"127.0.0.1:{first.port}").socket.close()


def test_on_the_loopback_no_token_is_needed(tmp_path):
    assert find_token("", {}, True, tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_a_token_that_is_given_holds_on_the_loopback_too(tmp_path):
    assert find_token("", {VARIABLE: GOOD}, True, tmp_path) == Token(GOOD, VARIABLE)


def test_elsewhere_a_token_is_made_once_and_kept_from_others(tmp_path):
    folder = tmp_path / "state"
    made = find_token("", {}, False, folder)
    (file,) = folder.iterdir()
    assert made == find_token("", {}, False, folder)
    assert made.where == str(file)
    assert len(made.value) >= 32
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert made.value != find_token("", {}, False, tmp_path / "other").value


def test_the_token_shows_nowhere(tmp_path):
    made = find_token("", {}, False, tmp_path)
    assert made.value not in f"{made} {made!r}"


def token_file(tmp_path, text=GOOD + "\n", mode=0o600):
    file = tmp_path / "token"
    file.write_text(text)
    file.chmod(mode)
    return str(file)


def test_a_token_file_is_read(tmp_path):
    file = token_file(tmp_path)
    assert find_token(file, {}, False) == Token(GOOD, file)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666, 0o610])
def test_a_token_file_that_others_can_read_is_refused(tmp_path, mode):
    with pytest.raises(WebError, match=r"can be read by others than its owner; chmod 600"):
        find_token(token_file(tmp_path, mode=mode), {}, False)


def test_a_kept_token_that_others_can_read_is_refused(tmp_path):
    find_token("", {}, False, tmp_path)
    (tmp_path / "web-token").chmod(0o644)
    with pytest.raises(WebError, match="can be read by others"):
        find_token("", {}, False, tmp_path)


@pytest.mark.parametrize(
    "text", ["", "short", "a token of several words", "tokén" * 5, "x\x00" * 20]
)
def test_a_token_that_is_none_is_refused_and_not_shown(tmp_path, text):
    with pytest.raises(WebError, match="must be 16 characters or more") as refused:
        find_token(token_file(tmp_path, text), {}, False)
    assert not text or text not in str(refused.value)


def test_a_token_file_that_is_missing_is_refused_with_how_to_make_one(tmp_path):
    missing = tmp_path / "none"
    with pytest.raises(WebError, match=r"there is no .*; make it with: ") as refused:
        find_token(str(missing), {}, False)
    command = str(refused.value).partition("make it with: ")[2]
    subprocess.run(["sh", "-c", command], check=True)
    assert find_token(str(missing), {}, False).where == str(missing)


@pytest.mark.skipif(os.name != "posix" or sys.platform == "darwin", reason="needs /proc")
def test_a_token_that_cannot_be_kept_is_refused():
    from pathlib import Path

    with pytest.raises(WebError, match=f"give one in {VARIABLE}"):
        find_token("", {}, False, Path("/proc/none"))
