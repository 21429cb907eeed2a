"""A web process behind a real socket, told the example's messages; and how to ask it."""

import asyncio
import http.client
import json
import time
from contextlib import contextmanager

from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from monitor.web.address import listen
from monitor.web.pipe import BEGIN, FRAME
from monitor.web.process import WebProcess

from .example import all_frames, hello

SETUP = {
    "token": None,
    "hosts": ["127.0.0.1"],
    "viewers": 3,
    "behind_s": 2.0,
    "history_s": 20.0,
    "rate_hz": 5.0,
}
READY_S = 30.0


def now_us():
    return time.monotonic_ns() // 1000


class Served:
    """The process, its port, and what it was told."""

    def __init__(self, process, port, said):
        self.process, self.port, self.said = process, port, said
        self.frames = [json.dumps(frame).encode() for frame in all_frames()]
        self.next = 0

    @property
    def url(self):
        return f"ws://127.0.0.1:{self.port}/live"

    def begin(self):
        self.until_ready()
        self.process.fresh = False
        self.process.send(BEGIN, json.dumps(hello([])).encode())

    def tell(self, count=1):
        """Send the next frames of the example."""
        for _ in range(count):
            self.until_ready()
            self.process.send(FRAME, self.frames[self.next % len(self.frames)])
            self.next += 1

    def until_ready(self):
        end_s = time.monotonic() + READY_S
        while not self.process.ready(now_us()):
            assert time.monotonic() < end_s
            time.sleep(0.01)

    def ask(self, path="/", method="GET", body=None, **headers):
        """Status, headers and body of an answer; ``Host`` is ours unless given."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=READY_S)
        headers = {key.replace("_", "-"): value for key, value in headers.items()}
        try:
            connection.request(method, path, body=body, headers=headers)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def until_heard(self):
        """Wait until the process has taken all that was sent."""
        end_s = time.monotonic() + READY_S
        wanted = self.next - 1
        while newest(self.ask("/metrics")[2]) != wanted:
            assert time.monotonic() < end_s
            time.sleep(0.02)


def newest(text):
    """Number of the newest frame, as the metrics say it."""
    for line in text.decode().splitlines():
        if line.startswith("mavsentry_snapshot_number "):
            return int(float(line.split()[1]))
    return None


@contextmanager
def serving(**changes):
    """A web process with its setup changed so."""
    listening = listen("127.0.0.1:0")
    said = []
    setup = SETUP | {"port": listening.port} | changes
    process = WebProcess(listening, setup, said.append)
    try:
        served = Served(process, listening.port, said)
        served.begin()
        yield served
    finally:
        process.close()


def received(url, count, timeout_s=READY_S, **headers):
    """The first messages that a viewer hears; None is the end of the connection."""

    async def listen_to():
        socket = await websocket_connect(HTTPRequest(url, headers=headers))
        messages, message = [], b""
        for _ in range(count):
            message = await asyncio.wait_for(socket.read_message(), timeout_s)
            messages.append(message)
            if message is None:
                break
        closed = (socket.close_code, socket.close_reason)
        socket.close()
        while message is not None:  # until the other side has heard that it is over
            message = await asyncio.wait_for(socket.read_message(), timeout_s)
        return messages, closed

    return asyncio.run(listen_to())
