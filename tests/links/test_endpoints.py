"""Connection strings over loopback, pseudo-terminals and files."""

import builtins
import os
import socket
import time

import pytest

from links.endpoints import Endpoint, LinkError, open_endpoint
from links.logs import TlogWriter
from links.mavlink import Encoder

WAIT_S = 5.0


def wait_for(link, wanted):
    """Bytes received until there are ``wanted`` of them."""
    got = b""
    deadline_s = time.monotonic() + WAIT_S
    while len(got) < wanted and time.monotonic() < deadline_s:
        got += b"".join(data for data, _ in link.recv(0.05))
    return got


@pytest.fixture
def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_udp_both_ways_and_counted():
    with (
        open_endpoint("udpin:127.0.0.1:0") as server,
        open_endpoint(f"udpout:127.0.0.1:{server.port}") as client,
    ):
        server.send(b"nobody yet")
        before_us = time.monotonic_ns() // 1000
        client.send(b"ping")
        ((data, host_us),) = server.recv(WAIT_S)
        assert data == b"ping"
        assert before_us <= host_us <= time.monotonic_ns() // 1000
        server.send(b"pong!")
        assert [d for d, _ in client.recv(WAIT_S)] == [b"pong!"]
        assert (server.counters.dropped, server.counters.received, server.counters.sent) == (
            1,
            1,
            1,
        )
        assert (client.counters.sent_bytes, client.counters.received_bytes) == (4, 5)
        assert not server.ended


def test_udp_answers_go_to_who_spoke_last():
    with open_endpoint("udpin:127.0.0.1:0") as server:
        clients = [open_endpoint(f"udpout:127.0.0.1:{server.port}") for _ in range(2)]
        for client in clients:
            client.send(b"hello")
            assert wait_for(server, 5) == b"hello"
        server.send(b"you")
        assert wait_for(clients[1], 3) == b"you"
        assert clients[0].recv(0.0) == []
        for client in clients:
            client.close()


def test_many_datagrams_come_with_one_call_and_in_order():
    with (
        open_endpoint("udpin:127.0.0.1:0") as server,
        open_endpoint(f"udpout:127.0.0.1:{server.port}") as client,
    ):
        sent = [b"%04d" % i for i in range(300)]
        for data in sent:
            client.send(data)
        time.sleep(0.05)
        assert [d for d, _ in server.recv(WAIT_S)] == sent


def test_udp_without_a_listener_is_counted_and_never_raises(free_port):
    with open_endpoint(f"udpout:127.0.0.1:{free_port}") as client:
        for _ in range(4):
            client.send(b"x")
            client.recv(0.02)
        assert client.counters.dropped >= 1


def test_recv_waits_no_longer_than_asked():
    with open_endpoint("udpin:127.0.0.1:0") as server:
        began_s = time.monotonic()
        assert server.recv(0.1) == []
        assert 0.08 < time.monotonic() - began_s < 1.0


def test_udp_over_ipv6():
    if not socket.has_ipv6:
        pytest.skip("no IPv6")
    try:
        server = open_endpoint("udpin:[::1]:0")
    except LinkError as error:
        pytest.skip(str(error))
    with server, open_endpoint(f"udpout:[::1]:{server.port}") as client:
        client.send(b"six")
        assert wait_for(server, 3) == b"six"


def test_tcp_both_ways():
    with (
        open_endpoint("tcpin:127.0.0.1:0") as server,
        open_endpoint(f"tcp:127.0.0.1:{server.port}") as client,
    ):
        client.recv(0.1)
        client.send(b"up")
        assert wait_for(server, 2) == b"up"
        server.send(b"down")
        assert wait_for(client, 4) == b"down"


def test_tcp_connects_again_when_the_server_comes_back(free_port, monkeypatch):
    monkeypatch.setattr("links.endpoints.tcp.RETRY_S", 0.02)
    with open_endpoint(f"tcp:127.0.0.1:{free_port}") as client:
        client.send(b"lost")
        assert client.counters.dropped == 1
        for word in (b"first", b"second"):
            with open_endpoint(f"tcpin:127.0.0.1:{free_port}") as server:
                deadline_s = time.monotonic() + WAIT_S
                heard = b""
                while heard != word and time.monotonic() < deadline_s:
                    server.send(word)
                    heard = b"".join(d for d, _ in client.recv(0.02))[: len(word)]
                assert heard == word
            client.recv(0.02)
        assert client.counters.opened == 2


def test_a_new_tcp_client_takes_the_place_of_the_last():
    with open_endpoint("tcpin:127.0.0.1:0") as server:
        first = open_endpoint(f"tcp:127.0.0.1:{server.port}")
        first.recv(0.05)
        first.send(b"one")
        assert wait_for(server, 3) == b"one"
        second = open_endpoint(f"tcp:127.0.0.1:{server.port}")
        second.recv(0.05)
        second.send(b"two")
        assert wait_for(server, 3) == b"two"
        server.send(b"for two")
        assert wait_for(second, 7) == b"for two"
        first.close()
        second.close()


def test_a_slow_tcp_reader_costs_whole_messages(monkeypatch):
    monkeypatch.setattr("links.endpoints.tcp.SEND_BACKLOG", 4096)
    with (
        open_endpoint("tcpin:127.0.0.1:0") as server,
        open_endpoint(f"tcp:127.0.0.1:{server.port}") as client,
    ):
        client.recv(0.1)
        server.recv(0.1)
        message = b"m" * 999 + b"\n"
        for _ in range(20_000):
            server.send(message)
            if server.counters.dropped > 10:
                break
        assert server.counters.dropped > 10
        expected = server.counters.sent * 1000
        got = b""
        deadline_s = time.monotonic() + WAIT_S
        while len(got) < expected and time.monotonic() < deadline_s:
            got += b"".join(d for d, _ in client.recv(0.0))
            server.recv(0.0)
        assert got == message * server.counters.sent


def test_serial_port_both_ways():
    pytest.importorskip("serial")
    master, slave = os.openpty()
    try:
        with open_endpoint(f"{os.ttyname(slave)}:57600") as link:
            os.write(master, b"from the radio")
            assert wait_for(link, 14) == b"from the radio"
            link.send(b"to the radio")
            assert os.read(master, 100) == b"to the radio"
            assert link.recv(0.01) == []
    finally:
        os.close(master)
        os.close(slave)


def test_a_serial_device_that_goes_is_not_an_error():
    pytest.importorskip("serial")
    master, slave = os.openpty()
    with open_endpoint(os.ttyname(slave)) as link:
        os.close(slave)
        os.close(master)
        for _ in range(5):
            assert link.recv(0.01) == []
            link.send(b"x")
        assert link.counters.dropped >= 1


def test_without_pyserial_the_extra_is_named(monkeypatch):
    real = builtins.__import__

    def no_serial(name, *args, **kwargs):
        if name == "serial":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_serial)
    with pytest.raises(LinkError, match=r"pip install 'mavsentry\[serial\]'"):
        open_endpoint("/dev/ttyACM0:57600")


def test_logs_are_played_frame_by_frame(tmp_path):
    path = tmp_path / "a.tlog"
    frames = [Encoder(1, 1).encode("ATTITUDE", time_boot_ms=i) for i in range(5000)]
    with TlogWriter(path) as writer:
        for i, frame in enumerate(frames):
            writer.write(frame, 1_700_000_000_000_000 + i)
    with open_endpoint(str(path)) as link:
        got = []
        while not link.ended:
            got += [d for d, _ in link.recv(0.0)]
        assert got == frames
        assert link.recv(0.0) == []


def test_what_is_sent_to_a_file_is_a_log(tmp_path):
    path = tmp_path / "out.tlog"
    frame = Encoder(1, 1).encode("ATTITUDE", time_boot_ms=5)
    with open_endpoint(str(path), write=True) as link:
        link.send(frame)
    with open_endpoint(str(path)) as link:
        assert [d for d, _ in link.recv(0.0)] == [frame]


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ("nonsense", "'nonsense' is not a link"),
        ("", "'' is not a link"),
        ("udpin:14550", "not of the form udpin:HOST:PORT"),
        ("udpin:127.0.0.1:99999", "not of the form udpin:HOST:PORT"),
        ("tcp:127.0.0.1", "not of the form tcp:HOST:PORT"),
        ("udpout:no-such-host.invalid:14550", "there is no host called no-such-host.invalid"),
        ("udpin:192.0.2.1:14550", "this computer has no such address"),
        ("/dev/no-such-device:57600", "there is no such device or file"),
        ("no-such-file.tlog", "there is no such device or file"),
    ],
)
def test_what_cannot_be_opened_is_said_in_one_sentence(spec, sentence):
    with pytest.raises(LinkError, match=sentence) as caught:
        open_endpoint(spec)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_port_in_use_is_said(kind):
    with (
        open_endpoint(f"{kind}:127.0.0.1:0") as first,
        pytest.raises(LinkError, match="the port is already in use"),
    ):
        open_endpoint(f"{kind}:127.0.0.1:{first.port}")


def test_every_kind_is_an_endpoint():
    with open_endpoint("udpin:127.0.0.1:0") as link:
        endpoint: Endpoint = link
        assert endpoint.name == "udpin:127.0.0.1:0"
        assert endpoint.counters.opened == 1
