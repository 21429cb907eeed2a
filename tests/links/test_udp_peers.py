"""UDP: who is answered, who is read, and names that lead elsewhere."""

import socket
import sys
import time

import pytest

from links.endpoints import Hub, LinkOptions, open_endpoint
from links.endpoints.flood_guard import ALARM
from links.endpoints.peers import MOST_PEERS, Peers, Strangers

from .waiting import now_us, until

S = 1_000_000


class Station:
    """Somebody with a UDP socket of its own."""

    def __init__(self, host="127.0.0.1"):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((host, 0))
        self.socket.setblocking(False)

    def say(self, data, link):
        self.socket.sendto(data, ("127.0.0.1", link.port))

    def heard(self):
        out = []
        while True:
            try:
                out.append(self.socket.recv(4096))
            except BlockingIOError:
                return out

    @property
    def address(self):
        return self.socket.getsockname()


@pytest.fixture
def station():
    made = []

    def make(host="127.0.0.1"):
        made.append(Station(host))
        return made[-1]

    yield make
    for one in made:
        one.socket.close()


@pytest.fixture
def link():
    with open_endpoint("udpin:127.0.0.1:0", options=LinkOptions(peer_timeout_s=5.0)) as made:
        yield made


def test_only_who_was_believed_is_answered(link, station):
    hub, vehicle, stranger = Hub([link]), station(), station()
    vehicle.say(b"frame", link)
    stranger.say(b"junk", link)
    arrivals = hub.recv(1.0)
    assert {(a.data, a.peer) for a in arrivals} == {
        (b"frame", vehicle.address),
        (b"junk", stranger.address),
    }
    hub.send(b"to nobody yet", 0)
    assert link.counters.dropped == 1
    hub.accepted(0, vehicle.address)
    for _ in range(3):
        stranger.say(b"junk", link)
        hub.recv(0.1)
        hub.send(b"answer", 0)
    assert vehicle.heard() == [b"answer"] * 3
    assert stranger.heard() == []


def test_all_live_peers_are_answered_and_nothing_is_passed_on(link, station):
    hub, router, ground = Hub([link]), station(), station()
    for one in (router, ground):
        one.say(b"frame of " + str(one.address[1]).encode(), link)
        for arrival in hub.recv(1.0):
            hub.accepted(0, arrival.peer)
    hub.tend(now_us())
    assert router.heard() == ground.heard() == []  # what one says does not reach the other
    hub.send(b"ours", 0)
    assert router.heard() == ground.heard() == [b"ours"]
    assert hub.states()[0].peers == 2


def test_a_peer_that_comes_back_from_another_address_takes_over(link, station):
    before, after = station(), station("127.0.0.2")
    start_us = now_us()
    link.accepted(before.address, start_us)
    link.accepted(after.address, start_us + 4 * S)
    link.tend(start_us + 4 * S)
    link.send(b"both, for either may be alive")
    link.accepted(after.address, start_us + 6 * S)
    link.tend(start_us + 6 * S)
    link.send(b"the one that speaks")
    assert len(before.heard()) == 1
    assert after.heard()[1:] == [b"the one that speaks"]


def test_the_last_peer_is_answered_through_a_silence(link, station):
    vehicle = station()
    start_us = now_us()
    link.accepted(vehicle.address, start_us)
    link.tend(start_us + 3600 * S)
    link.send(b"still here")
    assert vehicle.heard() == [b"still here"]


def test_the_table_of_peers_is_bounded_and_the_most_silent_gives_way():
    peers = Peers(timeout_s=1e9)
    for k in range(10 * MOST_PEERS):
        peers.heard(0, 1000 + k)  # one that goes on speaking
        peers.heard(k, k)
    assert len(peers) == MOST_PEERS
    assert 0 in peers
    assert 10 * MOST_PEERS - 1 in peers


def test_a_stranger_has_a_first_lot_and_then_a_rate():
    strangers = Strangers()
    assert sum(strangers.lets("a", 0) for _ in range(5000)) == Strangers.EACH
    later = sum(strangers.lets("a", k * 100) for k in range(1, 10_000))  # 10,000 a second, 1 s
    assert later == pytest.approx(Strangers.EACH_PER_S, abs=2)
    assert strangers.lets("the vehicle from elsewhere", S)


def test_strangers_from_very_many_addresses_are_bounded_together():
    strangers = Strangers()
    passed = sum(strangers.lets(k, k * 50) for k in range(200_000))  # 20,000 a second, 10 s
    assert passed == pytest.approx(Strangers.ALL + 10 * Strangers.ALL_PER_S, rel=0.01)
    assert len(strangers._each) <= Strangers.TABLE


def flood(link, strangers, count):
    for k in range(count):
        strangers[k % len(strangers)].say(b"junk %d" % k, link)
        if k % 100 == 0:
            yield


@pytest.mark.parametrize("addresses", [1, 200])
def test_a_flood_costs_the_vehicle_nothing_and_an_end_ends_it(link, station, addresses):
    hub, vehicle = Hub([link]), station()
    strangers = [station(f"127.0.1.{k + 1}") for k in range(addresses)]
    vehicle.say(b"v", link)
    hub.accepted(0, hub.recv(1.0)[0].peer)
    sent, got, junk = 0, 0, 0
    for _ in flood(link, strangers, 20_000):
        vehicle.say(b"v%d" % sent, link)
        sent += 1
        for arrival in hub.recv(0.0):
            known = arrival.peer == vehicle.address
            got, junk = got + known, junk + (not known)
        hub.tend(now_us())
    assert (got, sent) == (200, 200)
    assert junk <= Strangers.ALL + 3 * Strangers.ALL_PER_S
    assert link.counters.refused > ALARM
    assert link._guard.on or sys.platform != "linux"
    link.tend(now_us() + 2 * S)
    assert link.counters.refused + junk == pytest.approx(20_000, rel=0.001)
    assert link.counters.overflowed == 0
    moved = station("127.0.0.3")  # in the middle of it, the vehicle comes back from elsewhere
    for _ in flood(link, strangers, 20_000):
        moved.say(b"vehicle", link)
        for arrival in hub.recv(0.0):
            if arrival.peer == moved.address:
                hub.accepted(0, arrival.peer)
        hub.tend(now_us())
        if link.peers == 2:
            break
    assert link.peers == 2
    link.tend(now_us() + 100 * S)
    assert not link._guard.on


def test_udpout_asks_for_the_name_again_while_nobody_answers(station, monkeypatch):
    first, second = station("127.0.0.2"), station("127.0.0.3")
    first.socket.close()
    port = second.address[1]
    leads_to = ["127.0.0.2"]
    monkeypatch.setattr(
        socket,
        "getaddrinfo",
        lambda host, port, **_: [(socket.AF_INET, 0, 0, "", (leads_to[-1], port))],
    )
    quick = LinkOptions(retry_first_s=0.02, retry_longest_s=0.05)
    with open_endpoint(f"udpout:ground.example:{port}", options=quick) as link:
        link.send(b"lost")
        until(lambda: link.trouble != "", link)
        leads_to.append("127.0.0.3")

        def arrived():
            link.send(b"found")
            return b"found" in second.heard()

        until(arrived, link)
        assert link.counters.opened == 2


def test_of_several_addresses_the_one_where_somebody_listens_is_found(station, monkeypatch):
    nobody, somebody = station("127.0.0.2"), station("127.0.0.3")
    nobody.socket.close()
    monkeypatch.setattr(
        socket,
        "getaddrinfo",
        lambda host, port, **_: [
            (socket.AF_INET, 0, 0, "", (address, port)) for address in ("127.0.0.2", "127.0.0.3")
        ],
    )
    quick = LinkOptions(retry_first_s=0.02, retry_longest_s=0.05)
    with open_endpoint(f"udpout:localhost:{somebody.address[1]}", options=quick) as link:

        def arrived():
            link.send(b"here")
            return b"here" in somebody.heard()

        until(arrived, link)
        for _ in range(5):  # and stays there
            link.send(b"more")
            link.tend(now_us())
        assert somebody.heard() == [b"more"] * 5


def test_a_name_that_cannot_be_resolved_yet_is_waited_for(station, monkeypatch):
    ground = station()
    known = []

    def ask(host, port, **_):
        if not known:
            raise socket.gaierror("no name server yet")
        return [(socket.AF_INET, 0, 0, "", ("127.0.0.1", port))]

    monkeypatch.setattr(socket, "getaddrinfo", ask)
    patient = LinkOptions(patient=True, retry_first_s=0.02, retry_longest_s=0.05)
    with open_endpoint(f"udpout:gcs.local:{ground.address[1]}", options=patient) as link:
        assert not link.is_open
        assert "there is no host called gcs.local" in link.trouble
        assert link.backoff_s > 0
        link.send(b"lost")
        known.append(True)
        until(lambda: link.is_open, link)
        assert link.trouble == ""
        link.send(b"there")
        time.sleep(0.01)
        assert ground.heard() == [b"there"]
