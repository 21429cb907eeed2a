"""``run --web``: what cannot be served is refused before anything else, in one sentence."""

import socket
import sys

import pytest

from monitor.cli import invoke
from monitor.web.address import VARIABLE

LINK = ("run", "--in", "udpin:127.0.0.1:0")


def refused(capsys, *arguments):
    assert invoke([*LINK, *arguments]) == 2
    out, said = capsys.readouterr()
    assert not out
    (line,) = said.strip().splitlines()
    return line


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("8080", "not of the form HOST:PORT"),
        ("192.0.2.1:8080", "this computer has no such address"),
        ("nowhere.invalid:80", "there is no host called nowhere.invalid"),
    ],
)
def test_an_address_that_cannot_be_listened_on(capsys, address, said):
    assert said in refused(capsys, "--web", address)


def test_a_port_that_is_taken(capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        said = refused(capsys, "--web", f"127.0.0.1:{taken.getsockname()[1]}")
    assert "the port is already in use" in said


@pytest.mark.parametrize("missing", ["tornado", "prometheus_client", "bokeh", "jinja2"])
def test_without_the_extra_it_is_said_what_it_adds(capsys, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    said = refused(capsys, "--web", "127.0.0.1:0")
    assert "a live page and metrics, which needs the extra web: pip install" in said


def test_a_token_that_is_too_short(capsys, monkeypatch):
    monkeypatch.setenv(VARIABLE, "hunter2")
    said = refused(capsys, "--web", "0.0.0.0:0")
    assert "must be 16 characters or more" in said
    assert "hunter2" not in said


def test_a_token_file_that_others_can_read(capsys, tmp_path):
    token = tmp_path / "token"
    token.write_text("0123456789abcdefXYZ")
    token.chmod(0o644)
    config = tmp_path / "sentry.toml"
    config.write_text(f'[web]\ntoken_file = "{token}"\n')
    said = refused(capsys, "--web", "127.0.0.1:0", "--config", str(config))
    assert f"{token} can be read by others than its owner; chmod 600 {token}" in said
