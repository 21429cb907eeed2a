"""Who may ask: names, origins, tokens."""

import socket

import pytest

from monitor.web.access import Access

TOKEN = "0123456789abcdefXYZ-_"
OPEN = Access(None, ["127.0.0.1", "Sentry.Example"], 8080)
GUARDED = Access(TOKEN, [], 8080)


@pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1:8080",
        "localhost:8080",
        "LOCALHOST",
        "localhost:9000",  # forwarded by ssh
        "[::1]:8080",
        "192.168.1.7:8080",
        "sentry.example:8080",
        socket.gethostname(),
    ],
)
def test_our_own_names_and_addresses_are_known(host):
    assert OPEN.knows_host(host)


@pytest.mark.parametrize(
    "host",
    [
        None,
        "",
        "evil.example",
        "localhost.evil.example:8080",
        "127.0.0.1.evil.example",
        "[::1",
        "@",
    ],
)
def test_a_name_that_was_rebound_to_us_is_not_known(host):
    assert not OPEN.knows_host(host)


@pytest.mark.parametrize(
    ("origin", "same"),
    [
        (None, True),
        ("http://localhost:8080", True),
        ("https://LOCALHOST:8080", True),
        ("http://localhost:8081", False),
        ("http://evil.example", False),
        ("http://localhost:8080.evil.example", False),
        ("null", False),
        ("", False),
        ("file://localhost:8080", False),
    ],
)
def test_only_a_page_of_ours_may_connect(origin, same):
    assert OPEN.same_origin(origin, "localhost:8080") is same


def test_without_a_token_everybody_is_admitted():
    assert not OPEN.guarded
    assert OPEN.admits(None, None)
    assert not OPEN.is_token("")


def test_the_token_admits_as_bearer_and_its_cookie_as_cookie():
    assert GUARDED.admits(None, f"Bearer {TOKEN}")
    assert GUARDED.admits(None, f"bearer  {TOKEN} ")
    assert GUARDED.admits(GUARDED.cookie, None)
    assert GUARDED.admits(GUARDED.cookie, "Basic abc")


@pytest.mark.parametrize(
    ("cookie", "authorization"),
    [
        (None, None),
        ("", ""),
        (None, "Bearer"),
        (None, f"Bearer {TOKEN[:-1]}"),
        (None, f"Bearer {TOKEN}x"),
        (None, f"Basic {TOKEN}"),
        (TOKEN, None),
        (GUARDED.cookie[:-1], None),
        ("é" * 64, "Bearer é"),
        (None, f"Bearer {GUARDED.cookie}"),
    ],
)
def test_nothing_else_is_admitted(cookie, authorization):
    assert not GUARDED.admits(cookie, authorization)


def test_a_cookie_is_good_after_a_restart_and_for_one_token_only():
    assert Access(TOKEN, [], 8080).cookie == GUARDED.cookie
    assert Access(TOKEN + "x", [], 8080).cookie != GUARDED.cookie
    assert TOKEN not in GUARDED.cookie
