"""The web process over real sockets: the page, who is refused, viewers fast and slow."""

import http.client
import os
import re
import signal
import socket
import time

import pytest

from monitor.web.handlers import SAID
from monitor.web.pipe import FRAME

from .checked import checked
from .serving import received, serving

TOKEN = "0123456789abcdefXYZ-_"


@pytest.fixture(scope="module")
def served():
    with serving() as served:
        served.tell(30)
        served.until_heard()
        yield served


@pytest.fixture(scope="module")
def guarded():
    with serving(token=TOKEN) as served:
        served.tell(3)
        yield served


@pytest.fixture
def raw():
    """Makes viewers, and closes them."""
    made = []

    def make(served, buffer=None, **headers):
        made.append(Raw(served.port, buffer, **headers))
        return made[-1]

    yield make
    for viewer in made:
        viewer.close()


def test_the_page_is_served_whole_and_is_kept_nowhere(served):
    status, headers, body = served.ask("/")
    assert status == 200
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    assert body.startswith(b"<!doctype html>")
    assert headers["Cache-Control"] == "no-store"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Server"] == "mavsentry"
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'")
    assert "frame-ancestors 'none'" in policy
    assert "unsafe-eval" not in policy


def test_the_page_is_sent_compressed_to_who_can_take_it(served):
    import gzip

    status, headers, body = served.ask("/", Accept_Encoding="gzip, br")
    assert (status, headers["Content-Encoding"]) == (200, "gzip")
    assert gzip.decompress(body) == served.ask("/")[2]


def test_a_viewer_hears_hello_then_history_then_frames(served):
    messages, _ = received(served.url, 2)
    hello, history = (checked(message) for message in messages)
    assert (hello["kind"], history["kind"], history["last"]) == ("hello", "history", True)
    assert [frame["number"] for frame in history["frames"]] == list(range(served.next))
    assert hello["number"] == served.next - 1
    assert hello["timeline"]["airspeed0"][0]["reason"] == "on ground"
    assert {"streams", "channels", "rejected"} <= set(hello)


def test_frames_reach_every_viewer_as_the_daemon_made_them(served, raw):
    sockets = [raw(served) for _ in range(2)]
    first = served.next
    served.tell(3)
    for viewer in sockets:
        heard = [viewer.message() for _ in range(2 + 3)]
        assert heard[2:] == served.frames[first : first + 3]


def test_more_viewers_than_allowed_are_refused_with_the_reason(served, raw):
    until(lambda: b"mavsentry_web_viewers 0.0" in served.ask("/metrics")[2])
    sockets = [raw(served) for _ in range(3)]
    for viewer in sockets:
        viewer.message()
    messages, closed = received(served.url, 1)
    assert messages == [None]
    assert closed == (1013, "3 pages are open, as many as [web] viewers allows")
    for viewer in sockets:
        viewer.close()
    until(lambda: b"mavsentry_web_viewers 0.0" in served.ask("/metrics")[2])
    assert received(served.url, 1)[0][0] is not None


def test_a_viewer_that_speaks_is_closed(served, raw):
    viewer = raw(served)
    viewer.message()
    viewer.send(b"give me more")
    assert viewer.closed() == (1008, "a viewer only listens")


def test_a_long_message_is_not_even_read(served, raw):
    viewer = raw(served)
    viewer.message()
    viewer.send(bytes(2000))
    assert viewer.closed()[0] == 1009


def test_well_while_frames_come(served):
    served.tell()
    served.until_heard()
    assert served.ask("/healthz")[0] == 200


@pytest.mark.parametrize(
    "path", ["/live.js", "/../page.py", "/%2e%2e/page.py", "/static/", "//", "/metrics/"]
)
def test_nothing_else_is_there(served, path):
    status, _, body = served.ask(path)
    assert (status, body.decode()) == (404, SAID[404] + "\n")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"])
@pytest.mark.parametrize("path", ["/", "/metrics", "/healthz", "/live", "/none"])
def test_it_can_only_be_read(served, method, path):
    assert served.ask(path, method)[0] in (404, 405)


@pytest.mark.parametrize("path", ["/", "/live", "/metrics", "/healthz", "/none"])
def test_a_name_that_is_not_ours_is_refused_everywhere(served, path):
    status, _, body = served.ask(path, Host="evil.example")
    assert (status, body.decode()) == (421, SAID[421] + "\n")


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_another_sites_page_cannot_watch(served, origin):
    assert Raw.handshake(served.port, Origin=origin)[0] == 403


def test_a_page_of_ours_can_watch(served):
    origin = f"http://127.0.0.1:{served.port}"
    assert Raw.handshake(served.port, Origin=origin)[0] == 101


@pytest.mark.parametrize("more", [{"Cookie": "x" * 40_000}, {"body": b"x" * 5000}])
def test_headers_and_bodies_have_a_bound(served, more):
    try:
        status = served.ask("/", **more)[0]
    except (http.client.HTTPException, OSError):  # closed in the middle of it
        status = 400
    assert status >= 400
    assert served.ask("/")[0] == 200


def test_connections_have_a_bound(served):
    held = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(90)]
    until(lambda: sum(ended(one) for one in held) >= 90 - 3 - 64)
    for one in held:
        one.close()
    until(lambda: status_of(served) == 200)


@pytest.mark.parametrize("path", ["/", "/live", "/metrics", "/healthz", "/none"])
def test_without_the_token_nothing_is_told(guarded, path):
    status, headers, body = guarded.ask(path)
    assert (status, body.decode()) == (401, SAID[401] + "\n")
    assert headers["WWW-Authenticate"].startswith("Bearer")


@pytest.mark.parametrize("path", ["/live", "/metrics", "/healthz", "/none"])
def test_the_token_in_an_address_opens_the_page_alone(guarded, path):
    assert guarded.ask(f"{path}?token={TOKEN}")[0] == 401


def test_the_token_in_the_address_becomes_a_cookie(guarded):
    status, headers, body = guarded.ask(f"/?token={TOKEN}")
    cookie = headers["Set-Cookie"]
    assert status == 200
    assert TOKEN not in cookie + body.decode()
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(cookie.split("; "))
    kept = cookie.partition(";")[0]
    assert guarded.ask("/", Cookie=kept)[2].startswith(b"<!doctype html>")
    assert guarded.ask("/", Cookie=kept)[0] == 200
    assert Raw.handshake(guarded.port, Cookie=kept)[0] == 101


@pytest.mark.parametrize(
    "query", ["?token=", "?token=wrong", f"?token={TOKEN}x", f"?Token={TOKEN}"]
)
def test_a_wrong_token_sets_no_cookie(guarded, query):
    status, headers, _ = guarded.ask("/" + query)
    assert status == 401
    assert "Set-Cookie" not in headers


def test_prometheus_presents_the_token_as_a_header(guarded):
    assert guarded.ask("/metrics", Authorization=f"Bearer {TOKEN}")[0] == 200
    assert guarded.ask("/metrics", Authorization=f"Bearer {TOKEN}x")[0] == 401


def test_a_viewer_that_never_reads_costs_bounded_memory_and_nobody_else_anything(raw):
    with serving(history_s=10.0) as served:
        slow, quick = raw(served, buffer=4096), raw(served)
        until(lambda: b"mavsentry_web_viewers 2.0" in served.ask("/metrics")[2])
        quick.message()
        quick.message()
        memory_mb = []
        for _ in range(3):
            for _ in range(300):
                served.tell()
                assert quick.message() == served.frames[(served.next - 1) % len(served.frames)]
            memory_mb.append(resident_mb(served.process.pid))
        text = served.ask("/metrics")[2].decode()
        dropped = float(re.search(r"^mavsentry_web_frames_dropped_total (.*)$", text, re.M)[1])
        assert dropped > 300
        assert memory_mb[2] - memory_mb[0] < 2.0, memory_mb
        slow.close()


def test_the_end_of_the_daemon_is_told_to_viewers_and_ends_the_process(raw):
    with serving() as served:
        viewer = raw(served)
        viewer.message()
        pid = served.process.pid
        served.process.close()
        assert viewer.closed() == (1001, "the daemon has stopped")
        assert not alive(pid)
        with pytest.raises(OSError):
            socket.create_connection(("127.0.0.1", served.port), 1.0)


def test_a_process_that_is_killed_is_started_again_and_told_what_stands():
    with serving() as served:
        served.tell(5)
        first = served.process.pid
        os.kill(first, signal.SIGKILL)
        until(lambda: not served.process.ready(time.monotonic_ns() // 1000))
        assert served.said == ["the live page's process ended by signal 9; it is started again"]
        served.begin()
        served.tell(2)
        assert served.process.pid != first
        messages, _ = received(served.url, 2)
        assert checked(messages[0])["kind"] == "hello"
        os.kill(served.process.pid, signal.SIGKILL)
        until(lambda: not served.process.ready(time.monotonic_ns() // 1000))
        assert len(served.said) == 1  # said once


def test_a_process_that_fails_ends_so_that_it_is_started_again():
    with serving() as served:
        served.until_ready()
        served.process.send(FRAME, b"no frame")
        until(lambda: not served.process.ready(time.monotonic_ns() // 1000))
        assert served.said == ["the live page's process ended with status 1; it is started again"]


def until(true, timeout_s=20.0):
    end_s = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def ended(connection):
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def status_of(served):
    try:
        return served.ask("/healthz")[0] if served.tell() is None else 0
    except (http.client.HTTPException, OSError):
        return 0


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def resident_mb(pid):
    with open(f"/proc/{pid}/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Raw:
    """A viewer down to the bytes, which can be as slow or as rude as a test wants."""

    KEY = "dGhlIHNhbXBsZSBub25jZQ=="

    def __init__(self, port, buffer=None, **headers):
        self._socket = socket.socket()
        if buffer:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self._socket.settimeout(20.0)
        self._socket.connect(("127.0.0.1", port))
        lines = {
            "Host": f"127.0.0.1:{port}",
            "Upgrade": "websocket",
            "Connection": "Upgrade",
            "Sec-WebSocket-Key": self.KEY,
            "Sec-WebSocket-Version": "13",
            **headers,
        }
        text = "GET /live HTTP/1.1\r\n" + "".join(f"{k}: {v}\r\n" for k, v in lines.items())
        self._socket.sendall(text.encode() + b"\r\n")
        self._file = self._socket.makefile("rb", buffering=1 << 16 if buffer is None else 0)
        self.answer = None if buffer else self._head()

    @classmethod
    def handshake(cls, port, **headers):
        """Status of the answer to a handshake."""
        viewer = cls(port, **headers)
        viewer.close()
        return viewer.answer

    def _head(self):
        status = int(self._file.readline().split()[1])
        while self._file.readline().strip():
            pass
        return (status,)

    def _frame(self):
        head = self._file.read(2)
        size = head[1] & 0x7F
        if size >= 126:
            size = int.from_bytes(self._file.read(2 if size == 126 else 8), "big")
        return head[0] & 0x0F, self._file.read(size)

    def message(self):
        """The next text message."""
        while True:
            kind, body = self._frame()
            if kind == 1:
                return body
            assert kind == 9, (kind, body)
            self._send(0x8A, body)  # the answer to a ping

    def closed(self):
        """Code and reason of the closing that comes."""
        while True:
            kind, body = self._frame()
            if kind == 8:
                return int.from_bytes(body[:2], "big"), body[2:].decode()

    def send(self, body):
        """A text message."""
        self._send(0x81, body)

    def _send(self, kind, body):
        """A frame with the mask that leaves it as it is."""
        size = len(body)
        length = bytes([0x80 | size]) if size < 126 else b"\xfe" + size.to_bytes(2, "big")
        self._socket.sendall(bytes([kind]) + length + bytes(4) + body)

    def close(self):
        self._file.close()
        self._socket.close()
