"""Signatures against pymavlink's, and every way of forging one."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as peer

from links.mavlink import Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.signing import (
    NEW_STREAM_TICKS,
    STREAMS_MAX,
    Signer,
    SigningClock,
    SigningKey,
    Verifier,
    is_signed,
    ticks_of_unix_us,
)
from links.vocabulary import Rejection

from .signed_traffic import (
    NOW,
    NOW_UNIX_US,
    PASSPHRASE,
    SECRET,
    Station,
    heard_by_pymavlink,
    sealed,
    unsigned,
)

KEY = SigningKey(SECRET)


def clock(start: int = 0, behind_us: int = 0) -> SigningClock:
    return SigningClock(start, lambda: NOW_UNIX_US - behind_us)


def verifier(key: SigningKey = KEY) -> Verifier:
    return Verifier(key, clock())


# ------------------------------------------------------------------ what we sign


def test_pymavlink_believes_every_message_that_we_sign() -> None:
    encoder, signer = Encoder(1, 191), Signer(KEY, clock(), 3)
    rng = np.random.default_rng(1)
    sent = []
    for message in load_dialect().by_id.values():
        payload = rng.bytes(message.dtype.itemsize)
        values = message.packer.unpack(payload)
        sent.append(signer.sign(encoder.packer(message.name)(*values)))
    heard = heard_by_pymavlink(b"".join(sent))
    assert [m.get_msgId() for m in heard] == list(load_dialect().by_id)
    assert all(m.get_signed() and m.get_link_id() == 3 for m in heard)


def test_times_rise_over_all_links_and_never_fall_behind_what_was_believed() -> None:
    now = clock(NOW + 500)
    one, two = Signer(KEY, now, 0), Signer(KEY, now, 1)
    frame = Encoder(1, 191).encode("HEARTBEAT")
    times = [int.from_bytes(s.sign(frame)[-12:-6], "little") for s in (one, two, one)]
    assert times == [NOW + 501, NOW + 502, NOW + 503]
    now.believe(NOW + 10_000)
    assert int.from_bytes(two.sign(frame)[-12:-6], "little") == NOW + 10_001
    assert ticks_of_unix_us(0) == 0


@pytest.mark.parametrize("version", [1, 2])
def test_what_cannot_be_signed_is_refused(version: int) -> None:
    frame = Encoder(1, 191, version=version).encode("HEARTBEAT")
    if version == 2:
        frame = Signer(KEY, clock(), 0).sign(frame)
    with pytest.raises(ValueError, match="MAVLink 2 frame"):
        Signer(KEY, clock(), 0).sign(frame)


# ------------------------------------------------------------------ what we believe


def test_what_pymavlink_signs_is_believed_once() -> None:
    gate, station = verifier(), Station()
    frames = [station.heartbeat() for _ in range(3)]
    assert [gate.check(f) for f in frames] == [None] * 3
    assert {gate.check(f) for f in frames} == {Rejection.REPLAYED}
    assert gate.streams == {(1, 1, 0): NOW + 2}


def test_a_packet_of_one_link_is_not_believed_on_another() -> None:
    # the stream is the sender's link id, whichever of our links it comes in on
    gate, frame = verifier(), Station(link=4).heartbeat()
    assert gate.check(frame) is None
    assert gate.check(frame) is Rejection.REPLAYED
    relabelled = bytearray(frame)
    relabelled[-13] = 5
    assert gate.check(bytes(relabelled)) is Rejection.BAD_SIGNATURE


@pytest.mark.parametrize(
    ("time", "verdict"),
    [
        (NOW - NEW_STREAM_TICKS, None),
        (NOW - NEW_STREAM_TICKS - 1, Rejection.OLD_SIGNATURE),
        (0, Rejection.OLD_SIGNATURE),
        (NOW + NEW_STREAM_TICKS, None),
    ],
)
def test_the_first_packet_of_a_stream_is_not_older_than_a_minute(
    time: int, verdict: Rejection | None
) -> None:
    gate = verifier()
    assert gate.check(Station(time=time).heartbeat()) is verdict
    assert bool(gate.streams) is (verdict is None)


def test_our_time_follows_what_was_believed_and_nothing_else() -> None:
    now = clock()
    gate = Verifier(KEY, now)
    gate.check(Station(secret=bytes(range(32)), time=NOW + 10**9).heartbeat())
    assert now.now() == NOW
    assert gate.check(Station(time=NOW + 9_000_000).heartbeat()) is None
    assert now.now() == NOW + 9_000_000
    assert gate.check(Station(2, 1, time=NOW).heartbeat()) is Rejection.OLD_SIGNATURE


def test_a_forgery_does_not_lock_its_victim_out() -> None:
    gate = verifier()
    forged = Station(secret=bytes(range(32)), time=(1 << 48) - 10).heartbeat()
    assert gate.check(forged) is Rejection.BAD_SIGNATURE
    assert gate.check(Station().heartbeat()) is None


def test_streams_of_an_earlier_run_go_on() -> None:
    first, station = verifier(), Station()
    old = station.heartbeat()
    first.check(old)
    again = Verifier(KEY, clock(), first.streams.items())
    assert again.check(old) is Rejection.REPLAYED
    assert again.check(station.heartbeat()) is None


def test_streams_are_bounded_and_only_harmless_ones_forgotten() -> None:
    old = NOW - NEW_STREAM_TICKS - 1
    known = {(k >> 8, k & 0xFF, 0): NOW for k in range(STREAMS_MAX - 1)}
    gate = Verifier(KEY, clock(), [*known.items(), ((255, 1, 9), old)])
    assert gate.check(Station(200, 1).heartbeat()) is None  # the old one made room
    assert (255, 1, 9) not in gate.streams
    assert gate.check(Station(201, 1).heartbeat()) is Rejection.OVERFLOW
    assert len(gate.streams) == STREAMS_MAX


FORGERIES = ("again", "bit", "payload", "sender", "link", "time", "other key", "bare", "cut off")


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 1),  # which sender
            st.sampled_from(["genuine", "genuine", *FORGERIES]),
            st.integers(0, 1 << 30),
        ),
        max_size=25,
    )
)
def test_no_forgery_and_no_replay_is_ever_believed(script: list[tuple[int, str, int]]) -> None:
    gate = verifier()
    stations = [Station(1, 1, 0), Station(255, 190, 2)]
    thief = Station(1, 1, 0, NOW + 5_000_000, bytes(range(1, 33)))
    sent: list[bytes] = []
    newest: dict[int, bytes] = {}
    for who, what, n in script:
        before = gate.streams
        frame = stations[who].attitude(1000)  # a genuine one, which the forger keeps from us
        match what:
            case "genuine":
                assert gate.check(frame) is None
                sent.append(frame)
                newest[who] = frame
                continue
            case "again":
                if not sent:
                    continue
                assert gate.check(sent[n % len(sent)]) is Rejection.REPLAYED
            case "bit":  # anywhere but in the checksum's cover of length and flags
                at = 4 + n % (len(frame) - 4)
                torn = bytearray(frame)
                torn[at] ^= 1 << n % 8
                assert gate.check(bytes(torn)) is Rejection.BAD_SIGNATURE
            case "payload" | "sender":
                torn = bytearray(frame)
                torn[10 + n % frame[1] if what == "payload" else 5 + n % 2] ^= 1 << n % 8
                assert gate.check(sealed(torn)) is Rejection.BAD_SIGNATURE
            case "link" | "time":
                torn = bytearray(frame)
                torn[-13 if what == "link" else -12 + n % 6] ^= 1 << n % 8
                assert gate.check(bytes(torn)) is Rejection.BAD_SIGNATURE
            case "other key":
                assert gate.check(thief.attitude(n)) is Rejection.BAD_SIGNATURE
            case "bare":
                assert not is_signed(unsigned(frame))
            case "cut off":  # signature of one message after another
                other = stations[who].heartbeat()
                assert gate.check(other[:-13] + frame[-13:]) is Rejection.BAD_SIGNATURE
        assert gate.streams == before


# ------------------------------------------------------------------ the key keeps itself


def test_the_passphrase_is_hashed_as_ground_stations_do() -> None:
    assert SigningKey.of_passphrase(PASSPHRASE) == KEY
    assert SigningKey.of_passphrase("another") != KEY


def test_a_key_is_never_shown_nor_copied_out() -> None:
    shown = f"{KEY} {KEY!r} {[KEY]} {Signer(KEY, clock(), 0)!r} {verifier()!r}"
    assert SECRET.hex() not in shown
    assert repr(SECRET)[2:-1] not in shown
    assert not hasattr(KEY, "__dict__")
    for leak in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match="not pickled"):
            leak(KEY)


@pytest.mark.parametrize("secret", [b"", bytes(31), bytes(32), bytes(33)])
def test_what_is_no_key_is_refused(secret: bytes) -> None:
    with pytest.raises(ValueError, match="signing key"):
        SigningKey(secret)


def test_version_one_and_unsigned_frames_are_not_signed() -> None:
    assert is_signed(Station().heartbeat())
    assert not is_signed(Station(version=1).heartbeat())
    assert not is_signed(Station(secret=None).heartbeat())
    assert peer.WIRE_PROTOCOL_VERSION == "2.0"
