"""What the service manager is told, over a socket in its place."""

import socket

import pytest

from monitor.service import Notifier
from monitor.service.notifier import STATUS_US

S = 1_000_000


class Manager:
    def __init__(self, address):
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address)
        self._socket.setblocking(False)
        self.notifiers = []

    def notifier(self, pid=None, **environ):
        self.notifiers.append(Notifier({"NOTIFY_SOCKET": self.name, **environ}, pid))
        return self.notifiers[-1]

    def told(self):
        out = []
        while True:
            try:
                out.append(self._socket.recv(4096).decode())
            except BlockingIOError:
                return out

    def close(self):
        self._socket.close()
        for notifier in self.notifiers:
            notifier.close()


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    if request.param == "path":
        address = name = str(tmp_path / "notify")
    else:
        name = f"@mavsentry-{tmp_path.name}"
        address = "\0" + name[1:]
    manager = Manager(address)
    manager.name = name
    yield manager
    manager.close()


def test_each_message_is_as_the_protocol_has_it(manager):
    notifier = manager.notifier()
    assert notifier.active
    notifier.starting("compiling", 900.0)
    notifier.ready()
    notifier.status("vehicle 1\nflying")
    notifier.stopping()
    assert manager.told() == [
        "STATUS=compiling\nEXTEND_TIMEOUT_USEC=900000000",
        "READY=1",
        "STATUS=vehicle 1 flying",
        "STOPPING=1",
    ]
    notifier.close()
    notifier.ready()
    assert manager.told() == []


def test_a_reload_carries_the_moment_in_the_same_message(manager):
    import time

    before_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    manager.notifier().reloading()
    after_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    first, second = manager.told()[0].split("\n")
    assert first == "RELOADING=1"
    assert before_us <= int(second.removeprefix("MONOTONIC_USEC=")) <= after_us


def test_the_watchdog_is_fed_twice_as_often_as_it_asks(manager):
    notifier = manager.notifier(WATCHDOG_USEC="2000000")
    for ms in range(0, 10_000, 50):
        notifier.turned(ms * 1000)
    assert manager.told() == ["WATCHDOG=1"] * 10


@pytest.mark.parametrize(
    ("more", "fed"),
    [
        ({}, False),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "41"}, False),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "42"}, True),
        ({"WATCHDOG_USEC": "soon"}, False),
        ({"WATCHDOG_USEC": "0"}, False),
    ],
)
def test_a_watchdog_that_is_none_or_anothers_is_not_fed(manager, more, fed):
    notifier = manager.notifier(42, **more)
    notifier.turned(S)
    assert manager.told() == (["WATCHDOG=1"] if fed else [])


def test_the_status_is_told_when_it_is_another_and_not_often(manager):
    notifier = manager.notifier()
    wanted = [us for us in range(0, 20 * S, 50_000) if notifier.wants_status(us)]
    assert wanted == list(range(0, 20 * S, STATUS_US))
    for text in ("a", "a", "b", "a"):
        notifier.status(text)
    assert manager.told() == ["STATUS=a", "STATUS=b", "STATUS=a"]


def test_programs_that_we_start_cannot_speak_for_us(manager):
    environ = {"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": "1", "WATCHDOG_PID": "1", "A": "b"}
    Notifier(environ).close()
    assert environ == {"A": "b"}


@pytest.mark.parametrize("address", ["", "vsock:2:1234", "relative/path"])
def test_without_a_manager_that_we_can_reach_nothing_is_said(address):
    notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "1000000"})
    assert not notifier.active
    assert not notifier.wants_status(0)
    notifier.ready()
    notifier.turned(0)


def test_a_manager_that_is_gone_or_does_not_read_holds_nothing_up(manager):
    notifier = manager.notifier(WATCHDOG_USEC="2")
    for k in range(5000):  # its socket is full long before
        notifier.turned(k)
    assert 0 < len(manager.told()) < 5000
    manager._socket.close()
    notifier.ready()
