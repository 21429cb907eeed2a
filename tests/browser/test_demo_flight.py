"""The live page while the demo flies: what a pilot would have seen of it, fault by fault."""

import re
import socket
import subprocess
import time

import pytest

from monitor.commands.daemon_process import DaemonProcess

from .conftest import COMMAND

pytestmark = pytest.mark.external

SPEED = 6
READY_S = 300.0
"""The daemon may have to compile its kernels first."""

FAULTS = {
    "imu0.acc_x": (r"1\.\d m/s(?:\^2|²) high", "imu0-acc"),
    "airspeed1": (r"\d\.\d m/s low", "airspeed"),
    "imu0.gyro_y": (r"2\.\d deg/s high|2\.\d °/s high", "imu0-gyro"),
    "aoa2": ("stuck", "aoa"),
}
"""What breaks in the demo, in its order -> how it is told, and beginning of its chart's name."""


class Flight:
    """A daemon with its page, and a demo that flies into it once a page looks on."""

    def __init__(self, daemon, published):
        self.daemon = daemon
        self._published = published
        self.address = self._said(r"live page on (\S+)")
        self.feed = None

    def _said(self, pattern):
        end_s = time.monotonic() + READY_S
        while not (found := re.search(pattern, self.daemon.notes)):
            assert self.daemon.running, self.daemon.notes
            assert time.monotonic() < end_s, self.daemon.notes
            time.sleep(0.05)
        return found[1] if found.groups() else found[0]

    def begin(self):
        self._published.recv(4096)  # its first heartbeat: it works
        to = f"udpout:127.0.0.1:{self.daemon.port}"
        self.feed = subprocess.Popen(
            [*COMMAND, "feed", "demo", "--to", to, "--speed", str(SPEED)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def end(self):
        if self.feed is not None:
            self.feed.kill()
            self.feed.wait()


@pytest.fixture
def flight():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as published:
        published.bind(("127.0.0.1", 0))
        published.settimeout(READY_S)
        out = f"udpout:127.0.0.1:{published.getsockname()[1]}"
        options = ("--profile", "transport", "--web", "127.0.0.1:0", "--out", out)
        with DaemonProcess(options) as daemon:
            flown = Flight(daemon, published)
            yield flown
            flown.end()


def wait_until(visited, holds, timeout_s):
    end_s = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < end_s, visited.text()
        visited.page.wait_for_timeout(100)


def wait_for(visited, selector, pattern, timeout_s):
    """Wait until this stands in a place on the page."""
    place = visited.page.locator(selector)
    wait_until(visited, lambda: re.search(pattern, place.inner_text()), timeout_s)


def test_the_page_tells_each_fault_of_the_demo_then_silence_then_the_end(flight, visit):
    desk, phone = visit(flight.address), visit(flight.address, phone=True, dark=True)
    for visited in (desk, phone):
        visited.remember("#alarm")
    flight.begin()
    for number, (sensor, (words, _)) in enumerate(FAULTS.items(), start=1):
        alarm = rf"(?s){re.escape(sensor)}\s+FAULTY\s.*{words}"
        for visited in (desk, phone):
            wait_until(
                visited,
                lambda visited=visited, alarm=alarm: any(
                    re.search(alarm, said) for said in visited.remembered("#alarm")
                ),
                60.0,
            )
        for visited, kind in ((desk, "desk"), (phone, "phone-dark")):
            visited.screen(f"live-{number}-{sensor}-{kind}")
            assert visited.overflow_px() <= 0, visited.too_wide()
            assert visited.low_contrast() == []

    rows = desk.page.locator("#faults tr").all_inner_texts()
    assert [row.split()[0] for row in rows] == [*reversed(FAULTS)]
    for row, (words, _) in zip(rows, reversed(FAULTS.values()), strict=True):
        assert re.search(words, row), row
    for place in ("#timeline", *(f"[id^=plot-{chart}]" for _, chart in FAULTS.values())):
        desk.page.locator(place).first.scroll_into_view_if_needed()
        desk.page.wait_for_timeout(600)
        assert desk.inks(place) > 5, place

    flight.end()
    wait_for(desk, "header", "(?i)silent", 20.0)
    desk.screen("live-5-silent")

    visit.forgiven.append("ERR_CONNECTION_")
    assert flight.daemon.stop() == 0, flight.daemon.notes
    wait_for(desk, "header", "(?i)lost|stopped|gone|not connected|no connection", 20.0)
    desk.screen("live-6-daemon-gone")
