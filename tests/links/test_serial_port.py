"""Serial ports on pseudo-terminals: devices that go, come back under other names, or hang."""

import errno
import os
import threading
import time

import pytest

from links.endpoints import LinkError, LinkOptions, open_endpoint
from links.endpoints.serial_port import SerialEndpoint

from .waiting import now_us, until, wait_for

serial = pytest.importorskip("serial")

S = 1_000_000
QUICK = LinkOptions(patient=True, retry_first_s=0.02, retry_longest_s=0.05)


class Device:
    """A pseudo-terminal: ``name`` is the port, ``master`` the device's side of it."""

    def __init__(self):
        self.master, self._slave = os.openpty()
        self.name = os.ttyname(self._slave)

    def unplug(self):
        if self.master >= 0:
            os.close(self._slave)
            os.close(self.master)
            self.master = -1


@pytest.fixture
def device():
    made = []

    def make():
        made.append(Device())
        return made[-1]

    yield make
    for one in made:
        one.unplug()


def test_both_ways(device):
    radio = device()
    with open_endpoint(f"{radio.name}:57600") as link:
        os.write(radio.master, b"from the radio")
        assert wait_for(link, 14) == b"from the radio"
        link.send(b"to the radio")
        assert os.read(radio.master, 100) == b"to the radio"
        assert link.recv(0.01) == []
        assert (link.counters.sent, link.counters.sent_bytes) == (1, 12)


def test_a_device_that_comes_back_under_another_name_is_found_by_its_id(device, tmp_path):
    """As of USB: ttyACM0 goes, ttyACM1 comes, /dev/serial/by-id/... leads to either."""
    by_id = tmp_path / "usb-ArduPilot_CubeOrange_1F00-if00"
    first = device()
    by_id.symlink_to(first.name)
    with link_of(by_id) as link:
        os.write(first.master, b"first")
        assert wait_for(link, 5) == b"first"
        first.unplug()
        by_id.unlink()
        until(lambda: not link.is_open, link)
        assert "gone" in link.trouble
        link.send(b"lost")
        until(lambda: "no such device" in link.trouble, link)
        second = device()
        by_id.symlink_to(second.name)
        until(lambda: link.is_open, link)
        os.write(second.master, b"second")
        assert wait_for(link, 6) == b"second"
        link.send(b"answer")
        assert os.read(second.master, 100) == b"answer"
        assert (link.counters.opened, link.counters.dropped) == (2, 1)
        assert link.trouble == ""


def test_a_name_that_has_come_to_mean_another_device_is_followed(device, tmp_path):
    by_id = tmp_path / "by-id"
    first, second = device(), device()
    by_id.symlink_to(first.name)
    with link_of(by_id) as link:
        by_id.unlink()
        by_id.symlink_to(second.name)
        until(lambda: link.counters.opened == 2, link)
        os.write(second.master, b"here")
        assert wait_for(link, 4) == b"here"


def test_a_pattern_takes_the_first_device_that_fits(device, tmp_path):
    radio = device()
    with link_of(tmp_path / "usb-*Cube*-if00") as link:
        assert not link.is_open
        assert "no device fits" in link.trouble
        (tmp_path / "usb-CubePilot_CubeBlack-if02").symlink_to("/dev/null")
        (tmp_path / "usb-CubePilot_CubeBlack-if00").symlink_to(radio.name)
        until(lambda: link.is_open, link)
        os.write(radio.master, b"cube")
        assert wait_for(link, 4) == b"cube"


def test_a_silent_port_is_opened_anew_once_it_has_been_heard(device):
    radio = device()
    options = LinkOptions(retry_first_s=0.02, retry_longest_s=0.05, watchdog_s=10.0)
    with open_endpoint(radio.name, options=options) as link:
        link.tend(now_us() + 3600 * S)
        assert link.counters.opened == 1  # never heard: an output
        os.write(radio.master, b"x")
        assert wait_for(link, 1) == b"x"
        link.tend(now_us() + 9 * S)
        assert link.is_open
        link.tend(now_us() + 11 * S)
        assert not link.is_open
        assert "silent for 11 s" in link.trouble
        until(lambda: link.counters.opened == 2, link)


def test_permission_denied_says_what_to_do(monkeypatch):
    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(LinkError, match=r"permission denied: .* sudo usermod -aG dialout \$USER"):
        open_endpoint("/dev/ttyACM0", options=QUICK)


def test_a_port_that_another_program_holds_is_said(device):
    radio = device()
    with (
        open_endpoint(radio.name),
        pytest.raises(LinkError, match="another program has it open"),
    ):
        open_endpoint(radio.name)


def test_a_port_that_hangs_while_it_opens_holds_nobody_up(device, monkeypatch):
    radio, release, real = device(), threading.Event(), serial.serial_for_url
    with open_endpoint(radio.name, options=QUICK) as link:

        def hang(*args, **more):
            release.wait(10)
            return real(*args, **more)

        monkeypatch.setattr(serial, "serial_for_url", hang)
        threads = threading.active_count()
        link._lose("unplugged")
        end_s = time.monotonic() + 0.3
        longest_s = 0.0
        while time.monotonic() < end_s:
            began_s = time.monotonic()
            link.tend(now_us())
            link.take(10)
            link.send(b"lost")
            longest_s = max(longest_s, time.monotonic() - began_s)
            time.sleep(0.005)
        assert longest_s < 0.1
        assert not link.is_open
        assert threading.active_count() <= threads + 1  # one attempt hangs, no more are begun
        release.set()
        until(lambda: link.is_open, link)


def test_a_slow_port_keeps_a_second_of_the_newest_messages(device):
    radio = device()
    with open_endpoint(f"{radio.name}:57600") as link:
        count = 0
        while link.counters.dropped < 50:
            link.send(b"%05d" % count + b"m" * 94 + b"\n")
            count += 1
        waiting = count - link.counters.dropped - link.counters.sent
        assert waiting * 100 <= 57600 // 10 + 100
        got = b""
        deadline_s = time.monotonic() + 5
        while b"%05d" % (count - 1) not in got and time.monotonic() < deadline_s:
            got += os.read(radio.master, 4096)
            link.tend(now_us())
        lines = got.replace(b"\r", b"").splitlines()
        numbers = [int(line[:5]) for line in lines]
        assert numbers == sorted(set(numbers))
        assert numbers[-1] == count - 1


@pytest.mark.parametrize(
    ("spec", "device_name", "baud"),
    [
        ("/dev/ttyACM0", "/dev/ttyACM0", 115200),
        ("/dev/ttyACM0:57600", "/dev/ttyACM0", 57600),
        ("/dev/ttyACM0,921600", "/dev/ttyACM0", 921600),  # as MAVProxy writes it
        ("serial:/dev/ttyUSB0:57600", "/dev/ttyUSB0", 57600),
        ("/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0:57600", None, 57600),
        ("/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0", None, 115200),
        ("hwgrep://2DAE:1016", "hwgrep://2DAE:1016", 115200),
        ("hwgrep://2DAE:1016@57600", "hwgrep://2DAE:1016", 57600),
        ("COM3:57600", "COM3", 57600),
    ],
)
def test_names_of_ports(monkeypatch, spec, device_name, baud):
    asked = []

    def open_port(name, baudrate, **_):
        asked.append((name, baudrate))
        raise serial.SerialException(errno.ENOENT, "none")

    monkeypatch.setattr(serial, "serial_for_url", open_port)
    with open_endpoint(spec, options=LinkOptions(patient=True)) as link:
        assert link.kind == "serial"
    assert asked == [(device_name or spec.removesuffix(":57600"), baud)]


def link_of(path):
    return SerialEndpoint(str(path), str(path), 115200, QUICK)
