"""Who is let in: framing per link and peer, lists, signatures, echoes, and which link speaks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as peer

from links.mavlink import Decoder, Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.reception import (
    PEERS_MAX,
    Arrival,
    Received,
    Reception,
    ReceptionOptions,
    allow_table,
)
from links.mavlink.signing import SigningClock, SigningKey, Verifier
from links.vocabulary import Rejection

from .signed_traffic import NOW, NOW_UNIX_US, SECRET, Station, sealed, unsigned

MS = 1000


def reception(links: int = 1, *, key: bool = False, wants: Any = (), **options: Any) -> Reception:
    names = [f"link{k}" for k in range(links)]
    clock = SigningClock(0, lambda: NOW_UNIX_US)
    gate = Verifier(SigningKey(SECRET), clock) if key else None
    return Reception(ReceptionOptions(**options), names, gate, wants)


def joined(parts: Sequence[Received]) -> tuple[Any, ...]:
    """All that turns let in, as if it were one."""
    data = b"".join(p.data for p in parts)
    heard = [h for p in parts for h in p.heard]
    peers = set().union(*(p.peers for p in parts))
    rejected: dict[Any, int] = {}
    for part in parts:
        for key, count in part.rejected.items():
            rejected[key] = rejected.get(key, 0) + count
    return data, heard, peers, rejected


# ------------------------------------------------------------------ bytes of several do not mix


def test_halves_of_frames_of_two_links_do_not_mix() -> None:
    one, two = Encoder(1, 1).encode("ATTITUDE", roll=1.0), Encoder(7, 1).encode("ATTITUDE", yaw=2.0)
    gate = reception(2)
    got = gate.take([(0, one[:11], 1, None), (1, two[:9], 2, None), (0, one[11:], 3, None)])
    assert got.data == one
    got = gate.take([(1, two[9:], 4, None)])
    assert got.data == two
    assert not got.rejected


def test_halves_of_two_peers_of_one_link_do_not_mix() -> None:
    one, two = (Encoder(s, 1).encode("ATTITUDE", roll=1.0) for s in (1, 7))
    gate = reception()
    turns = [(0, one, 0, "a"), (0, two[:9], 1, "b"), (0, one[:11], 2, "a"), (0, two[9:], 3, "b")]
    got = gate.take([*turns, (0, one[11:], 4, "a")])
    assert got.data == one + two + one
    assert got.peers == {(0, "a"), (0, "b")}


def test_with_one_link_and_peer_every_byte_goes_on_as_it_came() -> None:
    frame = Encoder(1, 1).encode("HEARTBEAT", autopilot=3)
    stream = b"noise" + frame + b"\xfd\x09" + frame[:7] + frame
    gate = reception(wants=["HEARTBEAT"])
    parts = [gate.take([(0, stream[k : k + 3], k, None)]) for k in range(0, len(stream), 3)]
    data, heard, peers, rejected = joined(parts)
    assert data == stream
    assert [h.fields["autopilot"] for h in heard] == [3, 3]
    assert peers == {(0, None)}
    assert not rejected  # the decoder counts what was no frame
    assert gate.by_link[0][Rejection.GARBAGE] == 5 + 2 + 7


def test_many_strangers_leave_nothing_behind_and_displace_nobody() -> None:
    gate, vehicle = reception(wants=["HEARTBEAT"]), Encoder(1, 1)
    for k in range(1000):
        gate.take([(0, b"\xfd\xff junk %d" % k, k, ("10.0.0.9", k))])
    beat = vehicle.encode("HEARTBEAT", autopilot=3)
    assert gate.take([(0, beat, 2000, "vehicle")]).data == beat
    for k in range(1000):
        gate.take([(0, b"\xfd\xff junk %d" % k, 3000 + k, ("10.0.0.9", k))])
    parts = [gate.take([(0, half, 5000, "vehicle")]) for half in (beat[:9], beat[9:])]
    assert joined(parts)[0] == beat  # it kept its framer
    assert len(gate._streams) == PEERS_MAX


# ------------------------------------------------------------------ signatures demanded


def hostile(station: Station) -> list[bytes]:
    """Frames of a vehicle as somebody without its key would send them."""
    frame = station.attitude(5000)
    torn = bytearray(frame)
    torn[12] ^= 1
    thief = Station(secret=bytes(range(32)), time=NOW + 10**6)
    return [
        sealed(torn),
        unsigned(frame),
        Station(version=1, secret=None).attitude(5000),
        Station(secret=None).heartbeat(),
        thief.heartbeat(),
        Station(255, 190, secret=None).heartbeat(),
        Station(time=NOW - 10**8, system=9).heartbeat(),
    ]


def test_with_signing_demanded_a_forger_changes_nothing_at_all() -> None:
    gate, decoder, forger = reception(key=True, wants=["HEARTBEAT"]), Decoder(), Station()
    for k, frame in enumerate(hostile(forger)):
        got = gate.take([(0, frame, k, ("10.0.0.9", 1000 + k))])
        assert not got.data
        assert not got.heard
        assert not got.peers
        assert sum(got.rejected.values()) == 1
        decoder.feed(got.data, k)
    assert decoder.vehicle is None
    assert decoder.counters.messages == decoder.counters.bytes == 0
    assert not decoder.counters.by_source
    assert not decoder.clock.reboots
    assert gate.by_link[0] == {
        Rejection.BAD_SIGNATURE: 2,
        Rejection.UNSIGNED: 4,
        Rejection.OLD_SIGNATURE: 1,
    }


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_what_a_forger_slips_between_is_as_if_it_had_not_come(data: st.DataObject) -> None:
    """The same bytes, messages and peers, wherever, on which link and how cut it comes."""
    station, ground = Station(), Station(255, 190, 1)
    alone = reception(2, key=True, wants=["HEARTBEAT", "ATTITUDE"])
    beside = reception(2, key=True, wants=["HEARTBEAT", "ATTITUDE"])
    seen: list[bytes] = []
    for k in range(data.draw(st.integers(1, 12))):
        frame = station.attitude(100 * k) if k % 3 else ground.heartbeat()
        arrival = (k % 2 if data.draw(st.booleans()) else 0, frame, 100 * MS * k, None)
        bad: list[Arrival] = []
        for _ in range(data.draw(st.integers(0, 3))):
            forged = data.draw(st.sampled_from([*hostile(Station()), *seen, b"\xfd\xff\x01"]))
            cut = data.draw(st.integers(0, len(forged)))
            link, host_us = data.draw(st.integers(0, 1)), 100 * MS * k
            bad += [(link, forged[:cut], host_us, "x"), (link, forged[cut:], host_us, "x")]
        where = data.draw(st.integers(0, len(bad)))
        one = alone.take([arrival])
        two = beside.take([*bad[:where], arrival, *bad[where:]])
        assert (one.data, one.heard, one.peers) == (two.data, two.heard, two.peers)
        seen.append(frame)
    assert alone.accepted == beside.accepted
    verifiers = [gate._verifier for gate in (alone, beside)]
    assert verifiers[0] is not None
    assert verifiers[1] is not None
    assert verifiers[0].streams == verifiers[1].streams


def test_two_halves_of_a_forgery_are_not_joined_by_what_is_left_out_between() -> None:
    """A refused frame taken out of garbage must not make a whole one of it."""
    forged = Encoder(1, 1).encode("HEARTBEAT", autopilot=3)
    refused = Encoder(66, 6).encode("HEARTBEAT")
    gate = reception(allow=("1:190",))
    got = gate.take([(0, forged[:9] + refused + forged[9:], 0, None)])
    assert got.data == b""
    assert not Decoder().feed(got.data).rows


@pytest.mark.parametrize("where", ["accept_unsigned", "unsigned_links"])
def test_unsigned_packets_are_let_in_where_that_is_told_but_wrong_ones_never(where: str) -> None:
    options = {where: True if where == "accept_unsigned" else frozenset({0})}
    gate, bare = reception(2, key=True, **options), Station(secret=None)
    thief = Station(secret=bytes(range(32)))
    assert gate.take([(0, bare.heartbeat(), 0, None)]).data
    refused = gate.take([(0, thief.heartbeat(), 0, None)])
    assert not refused.data
    assert refused.rejected == {("frame", Rejection.BAD_SIGNATURE): 1}
    other = gate.take([(1, Station(2, 1, secret=None).heartbeat(), 0, None)])
    assert bool(other.data) is (where == "accept_unsigned")


def test_a_radio_cannot_sign_and_is_not_counted_as_an_intruder() -> None:
    report = Encoder(51, 68).encode("RADIO_STATUS", rssi=200)
    got = reception(key=True, wants=["RADIO_STATUS"]).take([(0, report, 0, None)])
    assert (got.data, got.heard, got.peers) == (b"", [], set())
    assert got.rejected == {("radio", Rejection.UNSIGNED): 1}


def test_without_a_key_signed_packets_are_taken_as_they_are() -> None:
    frame = Station().heartbeat()
    got = reception(wants=["HEARTBEAT"]).take([(0, frame, 7, None)])
    assert got.data == frame
    assert [(h.signed, h.host_us, h.frame) for h in got.heard] == [(False, 7, frame)]


def test_a_checked_signature_is_told() -> None:
    got = reception(key=True, wants=["HEARTBEAT"]).take([(0, Station().heartbeat(), 0, None)])
    assert [h.signed for h in got.heard] == [True]


# ------------------------------------------------------------------ lists, secrets, echoes


def test_the_allow_list_goes_by_system_and_component() -> None:
    gate = reception(allow=("1:*", "255:190", "*:240"), wants=["HEARTBEAT"])
    senders = [(1, 1), (1, 250), (255, 190), (255, 191), (7, 240), (7, 1)]
    arrivals = [(0, Encoder(*who).encode("HEARTBEAT"), k, who) for k, who in enumerate(senders)]
    got = gate.take(arrivals)
    assert [(h.system, h.component) for h in got.heard] == [(1, 1), (1, 250), (255, 190), (7, 240)]
    assert {who for _, who in got.peers} == {(1, 1), (1, 250), (255, 190), (7, 240)}
    assert got.rejected == {("frame", Rejection.NOT_ALLOWED): 2}


@pytest.mark.parametrize("pattern", ["1", "1:2:3", "256:1", "-1:1", "a:*", "", ":", "²:1"])
def test_a_pattern_that_is_none_is_told(pattern: str) -> None:
    with pytest.raises(ValueError, match="SYSTEM:COMPONENT"):
        allow_table([pattern])


@pytest.mark.parametrize("key", [False, True])
def test_keys_sent_over_the_network_reach_nobody(key: bool) -> None:
    """SETUP_SIGNING is not obeyed, and no service can ask to see it."""
    station = Station(255, 190, secret=SECRET if key else None)
    setup = station.frame(peer.MAVLink_setup_signing_message(1, 1, b"\x07" * 32, 0))
    gate = reception(2, key=key, wants=["SETUP_SIGNING"])
    got = gate.take([(0, setup, 0, None)])
    assert (got.data, got.heard, got.peers) == (b"", [], set())
    assert got.rejected == {("frame", Rejection.SECRET): 1}


def test_what_we_sent_does_not_come_in_but_services_may_look_at_it() -> None:
    gate = reception(2, wants=["HEARTBEAT"])
    gate.own = (1, 191)
    echo = Encoder(1, 191).encode("HEARTBEAT", type=18)
    got = gate.take([(0, echo, 5, "x")])
    assert (got.data, got.peers) == (b"", set())
    assert [(h.system, h.component, h.frame) for h in got.heard] == [(1, 191, echo)]
    assert got.rejected == {("frame", Rejection.OWN_ECHO): 1}
    other = Encoder(2, 191).encode("HEARTBEAT")
    assert gate.take([(0, other, 6, "x")]).data == other


def test_of_links_that_are_no_inputs_only_services_hear() -> None:
    gate = reception(2, inputs=frozenset({0}), wants=["PARAM_SET"])
    noise, frame = b"noise", Encoder(1, 1).encode("HEARTBEAT", autopilot=3)
    change = Encoder(255, 190).encode("PARAM_SET", param_id="MUTE_AIR0", param_value=1.0)
    got = gate.take([(0, noise + frame, 0, None), (1, change + frame, 1, "gcs")])
    assert got.data == noise + frame  # one input: its bytes as they came
    assert [(h.link, h.fields["param_id"]) for h in got.heard] == [(1, "MUTE_AIR0")]
    assert got.peers == {(0, None), (1, "gcs")}


# ------------------------------------------------------------------ which link speaks


def test_one_link_speaks_until_it_is_silent() -> None:
    gate = reception(2, takeover_us=500 * MS, wants=["HEARTBEAT"])
    beat = Encoder(1, 1).encode("HEARTBEAT", autopilot=3)
    told = [
        (link, at_ms, bool((got := gate.take([(link, beat, at_ms * MS, None)])).data), got.heard)
        for link, at_ms in [(0, 0), (1, 10), (0, 400), (1, 880), (1, 901), (0, 950), (1, 1400)]
    ]
    assert [let_in for _, _, let_in, _ in told] == [True, False, True, False, True, False, True]
    assert all(len(heard) == 1 for *_, heard in told)  # services hear every link
    assert gate.by_link[0][Rejection.SPARE_LINK] == 1
    assert gate.by_link[1][Rejection.SPARE_LINK] == 2
    assert gate.accepted == [3, 4]


def test_each_sender_has_its_own_link() -> None:
    gate = reception(2)
    one, two = Encoder(1, 1).encode("HEARTBEAT"), Encoder(255, 190).encode("HEARTBEAT")
    got = gate.take([(0, one, 0, None), (1, two, 1, None), (1, one, 2, None), (0, two, 3, None)])
    assert got.data == one + two


def test_copies_of_signed_packets_over_two_paths_are_one_stream_whichever_comes_first() -> None:
    gate, station = reception(2, key=True), Station()
    frames = [station.attitude(100 * k) for k in range(6)]
    order = [0, 1, 1, 0, 0, 1]  # the link on which a copy is first
    got = b""
    for k, (frame, link) in enumerate(zip(frames, order, strict=True)):
        first, second = (link, frame, 100 * MS * k, None), (1 - link, frame, 100 * MS * k, None)
        got += gate.take([first, second]).data
    assert got == b"".join(frames)


def test_a_vehicle_that_signs_for_two_links_speaks_by_one() -> None:
    gate = reception(2, key=True)
    one, two = Station(link=0), Station(link=1)
    got = gate.take([(0, one.attitude(1), 0, None), (1, two.attitude(1), 1, None)])
    assert got.rejected == {("frame", Rejection.SPARE_LINK): 1}
    assert gate.take([(1, two.attitude(2), 600 * MS, None)]).data


def test_who_signs_takes_the_word_from_who_does_not_and_keeps_it() -> None:
    gate = reception(2, key=True, accept_unsigned=True)
    bare, signed = Station(secret=None), Station()
    assert gate.take([(0, bare.attitude(1), 0, "x")]).data
    assert gate.take([(1, signed.attitude(2), 1, "y")]).data
    assert not gate.take([(0, bare.attitude(3), 2, "x")]).data
    assert gate.take([(1, signed.attitude(4), 3, "y")]).data


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_how_arrivals_are_grouped_does_not_matter(data: st.DataObject) -> None:
    key = data.draw(st.booleans())
    links = data.draw(st.integers(1, 2))
    senders = [Encoder(1, 1), Encoder(255, 190), Encoder(1, 191)]
    arrivals: list[Arrival] = []
    for k in range(data.draw(st.integers(1, 10))):
        frame = data.draw(st.sampled_from(senders)).encode("ATTITUDE", time_boot_ms=k)
        stream = data.draw(st.sampled_from([b"", b"junk", b"\xfd\x05"])) + frame
        cut = data.draw(st.integers(0, len(stream)))
        link, peer_ = data.draw(st.integers(0, links - 1)), data.draw(st.sampled_from("ab"))
        for piece in (stream[:cut], stream[cut:]):
            arrivals.append((link, piece, 90 * MS * len(arrivals), peer_))
    cuts = sorted(data.draw(st.sets(st.integers(1, len(arrivals) - 1))))
    edges = [0, *cuts, len(arrivals)]
    results = []
    for groups in ([(0, len(arrivals))], list(itertools.pairwise(edges))):
        gate = reception(links, key=key, accept_unsigned=True, wants=["ATTITUDE"])
        gate.own = (1, 191)
        parts = [gate.take(arrivals[a:b]) for a, b in groups]
        results.append((joined(parts), gate.by_link, gate.accepted))
    assert results[0] == results[1]


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1), st.binary(max_size=400), st.sampled_from("abc"))))
def test_no_bytes_raise(pieces: list[tuple[int, bytes, str]]) -> None:
    for key in (False, True):
        gate = reception(2, key=key, wants=["HEARTBEAT"])
        for k, (link, data, who) in enumerate(pieces):
            gate.take([(link, data, k, who)])


def test_every_message_of_the_dialect_is_read_as_pymavlink_reads_it() -> None:
    messages = [m for m in load_dialect().by_id.values() if m.name != "SETUP_SIGNING"]
    encoder, theirs = Encoder(1, 1), peer.MAVLink(None)
    gate = reception(wants=[m.name for m in messages])
    for message in messages:
        payload = bytes(k % 100 + 1 for k in range(message.dtype.itemsize))  # makes no NaN
        frame = encoder.packer(message.name)(*message.packer.unpack(payload))
        (heard,) = gate.take([(0, frame, 0, None)]).heard
        expected = theirs.parse_buffer(frame)[0].to_dict()
        assert heard.name == expected.pop("mavpackettype")
        assert heard.fields == expected
