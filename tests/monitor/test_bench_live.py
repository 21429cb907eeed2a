"""The benchmarks of a live link: both sides read what the other reads."""

from links.mavlink import Encoder
from monitor.commands.bench import NAMES
from monitor.commands.bench_cases.live import (
    BLOCKS,
    TURN,
    decode_live,
    reception_live,
    reception_signed,
    udp_roundtrip,
)


def test_both_sides_read_every_frame():
    sender = Encoder(1, 1)
    frames = [
        sender.encode("HEARTBEAT", type=1, autopilot=3),
        *(sender.encode("ATTITUDE", time_boot_ms=1000 + k, roll=0.1) for k in range(40)),
    ]
    for name, size in BLOCKS.items():
        case = decode_live(name, frames, size)
        assert case.calls == len(frames)
        assert case.run() >= len(frames) // size  # batches with rows of attitude
        assert {peer: run() for peer, run in case.peers.items()} == dict.fromkeys(
            ("pymavlink", "pymavlink_buffer"), len(frames)
        )


def test_a_message_comes_back_on_both_sides():
    case = udp_roundtrip(trips=20)
    for run in (case.run, case.peers["pymavlink"]):
        run()
        run()  # sockets are opened anew


def test_the_cases_are_those_that_the_command_knows():
    assert set(NAMES["live"]) == {*BLOCKS, "reception_live", "reception_signed", "udp_roundtrip"}


def test_reception_lets_in_what_the_peer_believes():
    sender = Encoder(1, 1)
    frames = [sender.encode("ATTITUDE", time_boot_ms=1000 + k, roll=0.1) for k in range(40)]
    open_case, signed = reception_live(frames), reception_signed(frames)
    assert open_case.calls == 40 / TURN
    assert open_case.run() == sum(map(len, frames))
    assert signed.run() == signed.peers["pymavlink"]() == signed.calls == len(frames)
