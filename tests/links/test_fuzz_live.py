"""A short run of hostile bytes through the live path, and what a peer can make the daemon open."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from links.mavlink import Encoder
from links.mavlink.dialect import load_dialect
from links.vocabulary import Rejection
from monitor.settings import load

from . import fuzz_live
from .fuzz_live import Lives, check_admitted, check_rows, flights, live, run_live
from .live_path import Life

WATCHED = ("open", "os.", "shutil.", "subprocess.", "socket.", "tempfile.", "pty.", "import")
_armed: list[list[str]] = []


def _listen(event: str, arguments: tuple[object, ...]) -> None:
    if _armed and event.startswith(WATCHED):
        _armed[-1].append(f"{event} {arguments!r}")


sys.addaudithook(_listen)  # there is no way to take one off again


@contextmanager
def watched() -> Iterator[list[str]]:
    """What Python is asked to open, run or connect to meanwhile."""
    seen: list[str] = []
    _armed.append(seen)
    try:
        yield seen
    finally:
        _armed.pop()


def test_half_a_megabyte_of_hostile_traffic_knocks_nothing_over() -> None:
    tally = run_live(600_000, 7, most=150_000)
    assert tally.lives >= 4
    assert tally.signed >= 1
    assert tally.rows > 500
    assert tally.heard > 100
    assert tally.genuine > 50
    assert tally.out > 1000
    assert {Rejection.BAD_CRC, Rejection.UNSIGNED, Rejection.BAD_SIGNATURE} <= tally.refused.keys()


@pytest.mark.parametrize("path", [b"../../../etc/passwd", b"/etc/shadow"])
def test_no_path_of_a_peer_is_opened(path: bytes) -> None:
    """Every message of the dialect, each text a path, from who is believed."""
    messages, settings = load_dialect().by_name.values(), load()

    def say_everything() -> int:
        life = Life(settings)
        vehicle, ground = Encoder(1, 1), Encoder(255, 190)
        now_us = 1_000_000
        for frame in flights()[1][:300]:
            now_us += 20_000
            life.turn([(0, frame, now_us, None)], now_us)
        for message in messages:
            fields = {n: path for n in message.wire_fields if message.dtype[n].kind == "S"}
            fields |= {
                n: np.frombuffer(path.ljust(message.dtype[n].itemsize, b"\0"), np.uint8)[:count]
                for n, count in zip(message.wire_fields, message.wire_counts, strict=True)
                if count > 1 and message.dtype[n].base == np.uint8
            }
            fields |= {"target_system": 1} if "target_system" in message.wire_fields else {}
            fields |= {"target_component": 191} if "target_component" in message.wire_fields else {}
            for sender in (vehicle, ground):
                now_us += 20_000
                life.turn([(0, sender.encode(message.name, **fields), now_us, None)], now_us)
        life.close()
        return life.heard

    say_everything()  # compiles and imports what it needs
    with watched() as seen:
        assert say_everything() > 20
    ours = "open ('/proc/"  # how much memory we use, for the page; which boot this is
    assert [event for event in seen if not event.startswith(ours)] == []
    with watched() as seen, open("/dev/null", "rb"):
        pass
    assert len(seen) == 1  # it would have been seen


def test_a_frame_that_nobody_signed_would_be_found() -> None:
    frames = [Encoder(1, 1).encode("HEARTBEAT")[:-2] + bytes(15) for _ in range(2)]
    assert check_admitted(frames[:1], set(frames)) == 1
    with pytest.raises(AssertionError, match="nobody with the key"):
        check_admitted(frames, set())
    with pytest.raises(AssertionError, match="twice"):
        check_admitted([frames[0], frames[0]], set(frames))


def test_a_gap_in_the_rows_would_be_found() -> None:
    life = Life(load())
    stream = b"".join(flights()[1][:200])
    life.turn([(0, stream, 1_000_000, None)], 1_000_000)
    check_rows(life.batches)
    rows = next(rows for rows in life.batches[0].rows.values() if len(rows) > 1)
    rows["seq"][0] += 1
    with pytest.raises(AssertionError, match="numbers"):
        check_rows(life.batches)


def test_a_life_is_lived_again_by_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = Lives(), Lives()
    for tally in (one, two):
        live(4, 3, tally, 60_000)
    assert (one.bytes, one.rows, one.heard) == (two.bytes, two.rows, two.heard)

    def breaks(*_: object) -> None:
        raise IndexError

    monkeypatch.setattr(fuzz_live, "check_rows", breaks)
    with pytest.raises(IndexError):
        run_live(1000, 3, 4, 5_000)
