"""Many links as one, and that none of them ever holds the others up."""

import errno
import os
import socket
import sys
import threading
import time

import pytest

from links.endpoints import Hub, LinkOptions, open_endpoint
from links.endpoints.base import MAX_PER_RECV, Waiter

from .waiting import WAIT_S, now_us, until

S = 1_000_000
QUICK = LinkOptions(patient=True, retry_first_s=0.02, retry_longest_s=0.05)


def gathered(hub, count):
    out = []
    deadline_s = time.monotonic() + WAIT_S
    while len(out) < count and time.monotonic() < deadline_s:
        hub.tend(now_us())
        out += hub.recv(0.02)
    return out


@pytest.fixture
def ground():
    with open_endpoint("tcpin:127.0.0.1:0") as server:
        yield server


def test_three_inputs_and_three_outputs_at_once(tmp_path, ground):
    pytest.importorskip("serial")
    master, slave = os.openpty()
    viewer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    viewer.bind(("127.0.0.1", 0))
    viewer.settimeout(WAIT_S)
    out_file = tmp_path / "out.tlog"
    specs = [
        "udpin:127.0.0.1:0",
        "tcpin:127.0.0.1:0",
        os.ttyname(slave),
        f"udpout:127.0.0.1:{viewer.getsockname()[1]}",
        f"tcp:127.0.0.1:{ground.port}",
        str(out_file),
    ]
    links = [open_endpoint(spec, write=True, options=QUICK) for spec in specs]
    with Hub(links) as hub:
        assert hub.names == tuple(specs)
        udp = open_endpoint(f"udpout:127.0.0.1:{links[0].port}")
        tcp = open_endpoint(f"tcp:127.0.0.1:{links[1].port}")
        until(lambda: tcp.is_open, tcp)
        udp.send(b"by udp")
        tcp.send(b"by tcp")
        os.write(master, b"by wire")
        arrived = gathered(hub, 3)
        assert {(a.link, a.data) for a in arrived} == {
            (0, b"by udp"),
            (1, b"by tcp"),
            (2, b"by wire"),
        }
        for arrival in arrived:
            hub.accepted(arrival.link, arrival.peer)
        ground.take(1)
        for number in range(6):
            hub.send(b"answer %d" % number, number)
        assert udp.recv(WAIT_S)[0][0] == b"answer 0"
        assert tcp.recv(WAIT_S)[0][0] == b"answer 1"
        assert os.read(master, 100) == b"answer 2"
        assert viewer.recv(100) == b"answer 3"
        assert ground.recv(WAIT_S)[0][0] == b"answer 4"
        states = hub.states()
        assert [s.kind for s in states] == ["udpin", "tcpin", "serial", "udpout", "tcp", "file"]
        assert [s.open for s in states] == [True] * 6
        assert [s.heard_us is not None for s in states] == [True] * 3 + [False] * 3
        assert [s.counters.sent for s in states] == [1] * 6
        udp.close()
        tcp.close()
    assert out_file.read_bytes()[8:] == b"answer 5"
    viewer.close()
    os.close(master)
    os.close(slave)


def test_waits_for_all_links_together_and_no_longer_than_asked():
    with Hub([open_endpoint("udpin:127.0.0.1:0") for _ in range(3)]) as hub:
        began_s = time.monotonic()
        assert hub.recv(0.1) == []
        assert 0.08 < time.monotonic() - began_s < 1.0
        last = hub._links[2].port
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            later = threading.Timer(0.05, vehicle.sendto, (b"now", ("127.0.0.1", last)))
            later.start()
            (arrival,) = hub.recv(WAIT_S)
            later.join()
        assert (arrival.link, arrival.data) == (2, b"now")


def test_a_flood_on_one_link_does_not_starve_another():
    with Hub([open_endpoint("udpin:127.0.0.1:0") for _ in range(2)]) as hub:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood:
            for _ in range(3000):
                flood.sendto(b"junk", ("127.0.0.1", hub._links[0].port))
            flood.sendto(b"frame", ("127.0.0.1", hub._links[1].port))
        arrivals = hub.recv(1.0)
        assert len(arrivals) <= 2 * MAX_PER_RECV
        assert b"frame" in [a.data for a in arrivals if a.link == 1]


def test_a_link_that_goes_does_not_touch_the_others():
    with Hub([open_endpoint(f"{kind}:127.0.0.1:0") for kind in ("tcpin", "udpin")]) as hub:
        tcp = open_endpoint(f"tcp:127.0.0.1:{hub._links[0].port}")
        udp = open_endpoint(f"udpout:127.0.0.1:{hub._links[1].port}")
        until(lambda: tcp.is_open, tcp)
        for k in range(20):
            udp.send(b"u%d" % k)
            if k == 10:
                tcp.close()
        assert [a.data for a in gathered(hub, 20)] == [b"u%d" % k for k in range(20)]
        hub.tend(now_us())
        assert [(s.open, s.trouble) for s in hub.states()] == [(False, ""), (True, "")]
        udp.close()


@pytest.mark.alone
def test_nothing_blocks_the_loop(monkeypatch):
    """Longest call while a serial port hangs as it opens and the name server does not answer."""
    serial = pytest.importorskip("serial")
    release, hanging = threading.Event(), threading.Event()
    real = socket.getaddrinfo

    def ask(host, *args, **more):
        if host == "127.0.0.1":
            return real(host, *args, **more)
        if hanging.is_set():
            release.wait(10)
        raise socket.gaierror("no answer")

    def open_port(*_, **__):
        if hanging.is_set():
            release.wait(10)
        raise serial.SerialException(errno.ENOENT, "not there")

    monkeypatch.setattr(serial, "serial_for_url", open_port)
    monkeypatch.setattr(socket, "getaddrinfo", ask)
    away = ("/dev/ttyACM0", "udpout:gcs.example:14550", "tcp:gcs.example:5760")
    links = [open_endpoint(spec, options=QUICK) for spec in ("udpin:127.0.0.1:0", *away)]
    hanging.set()
    longest_s, got = 0.0, 0
    with Hub(links) as hub, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        for _ in range(200):
            vehicle.sendto(b"frame", ("127.0.0.1", links[0].port))
            for call in (
                lambda: hub.tend(now_us()),
                lambda: [hub.send(b"ours", number) for number in range(4)],
                lambda: hub.recv(0.0),
                hub.states,
            ):
                began_s = time.monotonic()
                result = call()
                longest_s = max(longest_s, time.monotonic() - began_s)
                got += sum(getattr(a, "data", b"") == b"frame" for a in result or ())
            time.sleep(0.001)
        assert [s.open for s in hub.states()] == [True, False, False, False]
        said = {note.partition(": ")[0] for note in hub.notes}
        assert {"cannot open /dev/ttyACM0", "udpout:gcs.example:14550"} <= said
        began_s = time.monotonic()
    closing_s = time.monotonic() - began_s
    release.set()
    assert got == 200
    assert longest_s < 0.05
    assert closing_s < 0.05


@pytest.mark.alone
def test_tcp_waits_longer_after_each_failure_and_not_in_step(ground):
    port = ground.port
    ground.close()
    options = LinkOptions(retry_first_s=0.5, retry_longest_s=10.0)
    firsts = set()
    with open_endpoint(f"tcp:127.0.0.1:{port}", options=options) as link:
        waits, at_us = [], now_us()
        while len(waits) < 8:
            link.tend(at_us)
            if not link._opener.idle and not link._opener._running:
                waits.append(link.backoff_s)
                at_us += 20 * S
                link.tend(at_us)
                deadline_s = time.monotonic() + WAIT_S
                while link._opener._done is None and time.monotonic() < deadline_s:
                    time.sleep(0.001)
            time.sleep(0.001)
        assert "nobody listens there" in link.trouble
    for wait_s, whole_s in zip(waits, (0.5, 1, 2, 4, 8, 10, 10, 10), strict=True):
        assert 0.75 * whole_s <= wait_s <= 1.25 * whole_s
        firsts.add(round(wait_s / whole_s, 6))
    assert len(firsts) > 4


def test_who_only_sends_is_connected_too(ground):
    with open_endpoint(f"tcp:127.0.0.1:{ground.port}", options=QUICK) as link:
        got = []
        deadline_s = time.monotonic() + WAIT_S
        while not got and time.monotonic() < deadline_s:
            link.send(b"fed")
            got = ground.recv(0.01)
        assert got[0][0].startswith(b"fed")


def test_a_silent_tcp_server_is_connected_to_anew(ground):
    with open_endpoint(f"tcp:127.0.0.1:{ground.port}", options=QUICK) as link:
        until(lambda: link.is_open, link)
        link.tend(now_us() + 3600 * S)
        assert link.is_open  # never heard: an output
        until(lambda: ground.peers == 1, ground)
        ground.send(b"x")
        until(lambda: link.heard_us is not None, link)
        link.tend(now_us() + 11 * S)
        assert "silent for 11 s" in link.trouble
        until(lambda: link.counters.opened == 2, link)


@pytest.mark.skipif(sys.platform != "linux", reason="names of Linux")
def test_half_open_connections_are_noticed_by_the_system(ground):
    with open_endpoint(f"tcp:127.0.0.1:{ground.port}") as link:
        until(lambda: link.is_open, link)
        ground.take(1)
        for stream in (link._stream, *ground._clients.values()):
            assert stream.sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
            ask = [
                stream.sock.getsockopt(socket.IPPROTO_TCP, option)
                for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
            ]
            assert ask[0] + ask[1] * ask[2] < 15
            assert stream.sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 10_000


def test_a_file_ends_the_hub_when_it_has_been_read(tmp_path):
    log = tmp_path / "a.tlog"
    log.write_bytes(b"")
    with Hub([open_endpoint(str(log)), open_endpoint("udpin:127.0.0.1:0")]) as hub:
        assert not hub.ended
        assert hub.recv(WAIT_S) == []
        assert hub.ended


def test_the_waiter_follows_descriptors_that_come_and_go():
    waiter = Waiter()
    ends = [os.pipe() for _ in range(3)]
    for chosen in ((0,), (0, 1, 2), (2,), (1, 2)):
        readers = tuple(ends[k][0] for k in chosen)
        assert not waiter(readers, 0.0)
        os.write(ends[chosen[-1]][1], b"x")
        assert waiter(readers, WAIT_S)
        os.read(readers[-1], 1)
    for end in ends:
        os.close(end[0])
        os.close(end[1])
