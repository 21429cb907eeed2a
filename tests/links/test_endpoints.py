"""Connection strings over loopback, pseudo-terminals and files."""

import builtins
import socket
import time

import pytest

from links.endpoints import Endpoint, LinkError, LinkOptions, open_endpoint
from links.logs import TlogWriter
from links.mavlink import Encoder

from .waiting import WAIT_S, wait_for


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


def test_udp_answers_go_to_everybody_who_spoke():
    with open_endpoint("udpin:127.0.0.1:0") as server:
        clients = [open_endpoint(f"udpout:127.0.0.1:{server.port}") for _ in range(2)]
        for client in clients:
            client.send(b"hello")
            assert wait_for(server, 5) == b"hello"
        server.send(b"you")
        for client in clients:
            assert wait_for(client, 3) == b"you"
            client.close()
        assert server.counters.sent == 2


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


def test_tcp_connects_again_when_the_server_comes_back(free_port):
    quick = LinkOptions(retry_first_s=0.02, retry_longest_s=0.05)
    with open_endpoint(f"tcp:127.0.0.1:{free_port}", options=quick) as client:
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


def test_a_tcp_server_hears_and_answers_all_of_its_clients():
    with open_endpoint("tcpin:127.0.0.1:0") as server:
        clients = [open_endpoint(f"tcp:127.0.0.1:{server.port}") for _ in range(3)]
        for k, client in enumerate(clients):
            client.recv(0.2)
            client.send(b"%d" % k)
            assert wait_for(server, 1) == b"%d" % k
        assert server.peers == 3
        server.send(b"for all")
        for client in clients:
            assert wait_for(client, 7) == b"for all"
        clients[0].close()
        server.recv(0.1)
        assert server.peers == 2
        server.send(b"still here")
        for client in clients[1:]:
            assert wait_for(client, 10) == b"still here"
            client.close()


def test_a_slow_tcp_reader_costs_the_oldest_messages_and_never_half_of_one():
    with (
        open_endpoint("tcpin:127.0.0.1:0", options=LinkOptions(queue_bytes=4096)) as server,
        open_endpoint(f"tcp:127.0.0.1:{server.port}") as client,
    ):
        client.recv(0.1)
        server.recv(0.1)
        count = 0
        while server.counters.dropped < 100:
            server.send(b"%06d" % count + b"m" * 993 + b"\n")
            count += 1
        got = b""
        deadline_s = time.monotonic() + WAIT_S
        while b"%06d" % (count - 1) not in got[-1000:] and time.monotonic() < deadline_s:
            got += b"".join(d for d, _ in client.recv(0.0))
            server.tend(time.monotonic_ns() // 1000)
        numbers = [int(line[:6]) for line in got.splitlines()]
        assert {len(line) for line in got.splitlines()} == {999}
        assert numbers == sorted(set(numbers))
        assert numbers[-1] == count - 1  # the newest has come through, older ones have not
        assert len(numbers) == server.counters.sent == count - server.counters.dropped


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
