"""The live page of a real daemon that is killed and started again: nobody presses reload."""

import re
import socket
import time

import pytest

from monitor.commands.daemon_process import DaemonProcess

pytestmark = pytest.mark.external

READY_S = 300.0
"""The daemon may have to compile its kernels first."""


def free_tcp_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def served(port):
    """A daemon whose page listens on the port; it hears no vehicle."""
    daemon = DaemonProcess(("--web", f"127.0.0.1:{port}"))
    end_s = time.monotonic() + READY_S
    while not re.search(r"live page on http://127\.0\.0\.1", daemon.notes):
        assert daemon.running, daemon.notes
        assert time.monotonic() < end_s, daemon.notes
        time.sleep(0.05)
    return daemon


def waits(page, condition, timeout_s=READY_S):
    end_s = time.monotonic() + timeout_s
    while not page.evaluate(condition):
        assert time.monotonic() < end_s, f"not within {timeout_s:g} s: {condition}"
        page.wait_for_timeout(100)


def test_a_restarted_daemon_is_shown_again(visit):
    visit.forgiven.append("WebSocket connection to")
    port = free_tcp_port()
    said = "document.getElementById('connection').textContent"
    with served(port) as daemon:
        page = visit(f"http://127.0.0.1:{port}/").page
        waits(page, f"{said}.includes('Waiting for the vehicle')")
        assert page.evaluate("app.connection.open")
        first = page.evaluate("app.run")
        assert daemon.stop() == 0
    waits(page, "document.documentElement.dataset.link === 'lost'", 10.0)
    waits(page, f"{said}.includes('No connection to mavsentry')", 10.0)
    with served(port):
        waits(page, f"{said}.includes('Waiting for the vehicle')")
        assert page.evaluate("app.run") != first
        assert page.evaluate("document.title").startswith("vehicle silent")
