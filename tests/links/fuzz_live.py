"""Hostile bytes through the live path; ``python -m tests.links.fuzz live --bytes N --seed S``.

A *life* is a daemon without sockets (:mod:`tests.links.live_path`) that sees a flight or four in a
row. Link 0 carries the vehicle, link 1 ground stations,
copies of the vehicle's frames, and messages of every kind of the dialect with random or extreme
fields, most of them meant for us. Both streams are damaged (:mod:`tests.links.mutations`): half of
the damage keeps the checksum right, so that it reaches fields, requests and clocks. They arrive in
pieces of 1 byte to 16 kB from a few peers. Every third life demands signatures, with genuine ones
among the forged.

A life fails when anything is raised, a warning included, when it takes over two minutes, when
a row breaks what :mod:`links.samples` promises, when what we say is no frame of ours, when answers
outgrow what was asked, or when, with signatures demanded, anything but a genuine frame is let in,
or one of them twice.
"""

from __future__ import annotations

import faulthandler
import itertools
import resource
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as peer

from links.catalog import BOUNDS
from links.mavlink import Encoder
from links.mavlink.dialect import Message, load_dialect
from links.mavlink.framing import Framer
from links.mavlink.reception import Arrival
from links.mavlink.signing import Signer, SigningClock, SigningKey
from links.samples import Batch
from monitor.component.tunables import RESET, TUNABLES
from monitor.settings import load
from sim_feeds.player import frames_of

from .live_path import Life
from .mutations import FLOATS, drawn, mutated, stream_of

PEERS = (("10.0.0.1", 14550), ("10.0.0.2", 14550), ("10.0.0.9", 5))
BYTES_PER_S = 20_000
"""Host time passes by so many bytes of the vehicle's."""
SIGNED = 3
"""One life in so many demands signatures."""
MADE_UP = 800
"""Frames that are invented for a life; it sees them several times."""
SECONDS = 120
"""Longer than any life may take, on a busy machine too."""
ROOM = 1 << 30
"""Address space that all lives together may need beyond what was there before [bytes]."""
OUT_PER_S = 40_000
"""More than the daemon may ever say in a second, whatever it is asked [bytes]."""
REQUIRED = ("acc_m_s2", "gyro_rad_s", "static_press_pa", "temperature_k", "aoa_rad", "speed_rpm")

ASKED = (
    *("COMMAND_LONG", "COMMAND_INT", "COMMAND_ACK", "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ"),
    *("PARAM_SET", "PARAM_VALUE", "TIMESYNC", "PING", "HEARTBEAT", "STATUSTEXT", "SETUP_SIGNING"),
    *("NAMED_VALUE_FLOAT", "SYSTEM_TIME", "FILE_TRANSFER_PROTOCOL", "LOG_REQUEST_DATA"),
    *("AUTOPILOT_VERSION", "MESSAGE_INTERVAL", "RADIO_STATUS", "MISSION_REQUEST_LIST"),
    *("PARAM_EXT_SET", "PARAM_EXT_REQUEST_LIST", "LOGGING_DATA", "SERIAL_CONTROL"),
)
"""Messages that a component may feel spoken to by: half of what is made up."""
SENDERS = ((1, 1), (1, 1), (255, 190), (255, 190), (1, 191), (7, 1), (51, 68), (1, 195))
NAMES = [tunable.name for tunable in (*TUNABLES, RESET)]
COMMANDS = (246, 400, 510, 511, 512, 520, 42428, 0, 65535)


@dataclass(slots=True)
class Lives:
    """What went through."""

    lives: int = 0
    bytes: int = 0
    turns: int = 0
    rows: int = 0
    heard: int = 0
    out: int = 0
    signed: int = 0
    genuine: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    kinds: dict[str, int] = field(default_factory=dict)
    slowest_s: float = 0.0
    resident_mib: list[float] = field(default_factory=list)


# --------------------------------------------------------------------------- what arrives


@cache
def flights() -> tuple[tuple[bytes, ...], ...]:
    """Frames of undamaged flights, in order."""
    from .fuzz import LONG, SHORT, _flown

    return tuple(tuple(f for _, f in frames_of(_flown(text))) for text in (LONG, SHORT))


def made_up(rng: np.random.Generator, senders: dict[tuple[int, int], Encoder]) -> bytes:
    """A whole frame of any message with fields as nobody sends them."""
    dialect = load_dialect()
    names = ASKED if rng.random() < 0.5 else tuple(dialect.by_name)
    message = dialect.by_name.get(str(rng.choice(names)), dialect.by_name["HEARTBEAT"])
    who = SENDERS[int(rng.integers(len(SENDERS)))]
    if rng.random() < 0.1:
        who = int(rng.integers(1, 256)), int(rng.integers(1, 256))
    sender = senders.setdefault(who, Encoder(*who))
    return sender.packer(message.name)(*message.packer.unpack(_payload(rng, message)))


def _payload(rng: np.random.Generator, message: Message) -> bytes:
    """Random bytes, some fields extreme, most of them addressed to us."""
    payload = bytearray(rng.bytes(message.dtype.itemsize))
    fields: Any = message.dtype.fields
    if rng.random() < 0.3:
        payload[:] = bytes([int(rng.choice([0, 0x7F, 0x80, 0xFF]))]) * len(payload)
    for name, (kind, at) in fields.items():
        if kind.kind == "f" and rng.random() < 0.3:
            value = FLOATS[int(rng.integers(len(FLOATS) // 2))]
            payload[at : at + 4] = value[: kind.itemsize]
        if name == "command" and rng.random() < 0.8:
            payload[at : at + 2] = int(rng.choice(COMMANDS)).to_bytes(2, "little")
        elif name in ("param1", "param2") and rng.random() < 0.5:
            number = float(rng.choice([0, 1, 30, 74, 253, 265, 1e9, -1, -2]))
            payload[at : at + 4] = np.float32(number).tobytes()
        elif name == "param_id" and rng.random() < 0.7:
            text = str(rng.choice(["ARSPD_RATIO", "\x7f" * 16, *NAMES]))
            payload[at : at + 16] = text.encode().ljust(16, b"\0")
        elif name == "target_system" and rng.random() < 0.8:
            payload[at] = int(rng.choice([0, 1]))
        elif name == "target_component" and rng.random() < 0.8:
            payload[at] = int(rng.choice([0, 1, 191]))
        elif name == "autopilot" and rng.random() < 0.8:
            payload[at] = int(rng.choice([3, 8, 12]))
    return bytes(payload)


def streams(
    rng: np.random.Generator, key: SigningKey | None, tally: Lives
) -> tuple[list[bytes], set[bytes]]:
    """The two links' bytes, and every genuine frame among them."""
    senders: dict[tuple[int, int], Encoder] = {}
    rounds = int(rng.choice([1, 1, 1, 4]))
    chosen = [flights()[int(rng.random() < 0.2)] for _ in range(rounds)]
    vehicle = [frame for flight in chosen for frame in flight]
    invented = [made_up(rng, senders) for _ in range(MADE_UP)]
    ground = []
    for frame in vehicle[:: int(rng.choice([2, 3, 10]))]:
        ground += [frame] if rng.random() < 0.3 else [invented[int(rng.integers(MADE_UP))]]
    genuine: set[bytes] = set()
    if key is not None:
        clock = SigningClock()
        vehicle = _signed(rng, vehicle, Signer(key, clock, 0), genuine)
        ground = _signed(rng, ground, Signer(key, clock, 1), genuine)
    out = []
    for frames in (vehicle, ground):
        damage = [m for _ in range(int(rng.choice([0, 1, 3, 9]))) for m in drawn(rng)]
        damage = [m for m in damage if m.kind != "cut" or m.at > 0.8]  # or little would be left
        for m in damage:
            tally.kinds[m.kind] = tally.kinds.get(m.kind, 0) + 1
        data = b"".join(frames)
        out.append(mutated(stream_of("live", data), damage) if damage else data)
    return out, genuine


def _signed(
    rng: np.random.Generator, frames: list[bytes], signer: Signer, genuine: set[bytes]
) -> list[bytes]:
    """Most of the frames signed; the others are a forger's: bare, or by a key of his own."""
    thief = Signer(SigningKey(b"\x55" * 32), SigningClock(1 << 47), 0)
    out = []
    for frame in frames:
        chance = rng.random()
        if chance < 0.8:
            signed = signer.sign(frame)
            if int.from_bytes(frame[7:10], "little") != peer.MAVLINK_MSG_ID_SETUP_SIGNING:
                genuine.add(signed)
            out.append(signed)
        else:
            out.append(frame if chance < 0.9 else thief.sign(frame))
        if chance < 0.02:
            out.append(out[int(rng.integers(len(out)))])  # and what he heard before, again
    return out


def pieces(
    rng: np.random.Generator, data: list[bytes], now_us: int = 1_000_000
) -> Iterator[tuple[list[Arrival], int]]:
    """Both links' bytes as they arrive, turn by turn, and the host's time [us]."""
    places = [0, 0]
    while places[0] < len(data[0]) or places[1] < len(data[1]):
        arrivals: list[Arrival] = []
        for _ in range(int(rng.integers(1, 6))):
            link = int(rng.random() < len(data[1]) / (len(data[0]) + len(data[1])))
            size = int(np.exp(rng.uniform(0.0, np.log(16_000))))
            piece = data[link][places[link] : places[link] + size]
            places[link] += size
            now_us += int(len(piece) * 1e6 / BYTES_PER_S) + 1
            who = PEERS[0] if rng.random() < 0.95 else PEERS[int(rng.integers(len(PEERS)))]
            arrivals.append((link, piece, now_us, who))
        yield arrivals, now_us


# --------------------------------------------------------------------------- what must hold


def live(number: int, seed: int, tally: Lives, most: int | None = None) -> None:
    """One life; raises on whatever must not be.

    Parameters
    ----------
    most
        Bytes after which it ends early.
    """
    rng = np.random.default_rng([seed, number, 8])
    secret = b"\x42" * 32 if number % SIGNED == SIGNED - 1 else None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        life = Life(load(), secret)
        data, genuine = streams(rng, life.key, tally)
        said, used, now_us = [], 0, 0
        for arrivals, now_us in pieces(rng, data):
            begun = time.perf_counter()
            said.append(life.turn(arrivals, now_us))
            tally.slowest_s = max(tally.slowest_s, time.perf_counter() - begun)
            tally.turns += 1
            used += sum(len(piece) for _, piece, _, _ in arrivals)
            if most is not None and used >= most:
                break
        life.close()
        check_rows(life.batches)
        check_said(b"".join(said), life, now_us)
        if life.key is not None:
            tally.signed += 1
            tally.genuine += check_admitted(life.admitted, genuine)
    tally.lives += 1
    tally.bytes += used
    tally.heard += life.heard
    tally.out += sum(map(len, said))
    tally.rows += sum(len(batch) for batch in life.batches)
    for link in life.gate.by_link:
        for why, n in link.items():
            tally.refused[why] = tally.refused.get(why, 0) + n


def check_rows(batches: list[Batch]) -> None:
    """Rows are numbered without a gap, and their values are such as a sensor can have."""
    parts = [rows["seq"] for batch in batches for rows in batch.rows.values()]
    seq = np.sort(np.concatenate(parts)) if parts else np.empty(0)
    assert np.array_equal(seq, np.arange(len(seq))), "numbers of the rows"
    for batch in batches:
        for sensor, rows in batch.rows.items():
            for name in set(rows.dtype.names or ()) & set(REQUIRED):
                low, high = BOUNDS[name]
                assert ((rows[name] >= low) & (rows[name] <= high)).all(), (sensor, name)


def check_said(said: bytes, life: Life, now_us: int) -> None:
    """Whole frames of ours, and not more than a link can bear."""
    framer = Framer(load_dialect())
    frames = framer.feed(said)
    framer.finish()
    assert framer.bad_bytes == 0
    assert not framer.unknown
    assert set(frames.component.tolist()) <= {191}
    assert life.outbox.dropped == 0
    assert len(said) < OUT_PER_S * (now_us / 1e6 + 1), "we are an amplifier"


def check_admitted(admitted: list[bytes], genuine: set[bytes]) -> int:
    """Only genuine frames, each once; how many."""
    data, at, seen = b"".join(admitted), 0, set()
    while at < len(data):
        end = at + 10 + data[at + 1] + 2 + 13
        frame = data[at:end]
        assert frame in genuine, "a frame was let in that nobody with the key sent"
        assert frame not in seen, "a frame was let in twice"
        seen.add(frame)
        at = end
    return len(seen)


def run_live(
    count: int,
    seed: int,
    only: int | None = None,
    most: int | None = None,
    *,
    watch: bool = False,
) -> Lives:
    """Lives until ``count`` bytes went through; with ``watch`` one that hangs ends the process."""
    tally = Lives()
    for number in itertools.count() if only is None else [only]:
        if watch:
            faulthandler.dump_traceback_later(SECONDS, exit=True)
        try:
            live(number, seed, tally, most)
        except BaseException:
            print(f"python -m tests.links.fuzz live --seed {seed} --only {number}", flush=True)
            raise
        if watch:
            faulthandler.cancel_dump_traceback_later()
        tally.resident_mib.append(_statm(1) / 2**20)
        if tally.bytes >= count:
            break
    return tally


def long_life(count: int, seed: int) -> tuple[Lives, Life]:
    """One daemon sees stream after stream of other lives; resident memory after each."""
    tally, life, now_us = Lives(), Life(load()), 1_000_000
    while tally.bytes < count:
        rng = np.random.default_rng([seed, tally.lives, 9])
        data, _ = streams(rng, None, tally)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for arrivals, turn_us in pieces(rng, data, now_us):
                now_us = turn_us
                life.turn(arrivals, now_us)
                tally.turns += 1
        tally.rows += sum(len(batch) for batch in life.batches)
        life.batches.clear()
        tally.lives += 1
        tally.bytes += sum(map(len, data))
        tally.resident_mib.append(_statm(1) / 2**20)
    life.close()
    return tally, life


def work_long(count: int, seed: int) -> None:
    """The command with ``--one-life``."""
    begun = time.perf_counter()
    tally, life = long_life(count, seed)
    shown = tally.resident_mib[:: max(len(tally.resident_mib) // 8, 1)]
    print(
        f"live, one life: {tally.bytes} bytes in {tally.turns} turns, seed {seed}: nothing raised; "
        f"{tally.rows} rows, {life.heard} messages heard; {time.perf_counter() - begun:.0f} s; "
        f"resident memory [MiB] along it: {', '.join(f'{m:.0f}' for m in shown)}"
    )


def work(count: int, seed: int, only: int | None) -> None:
    """The command: lives within a bound of memory, and what went through them."""
    flights()
    for number in range(SIGNED):  # compile and load before measuring
        live(number, 0, Lives())
    resource.setrlimit(resource.RLIMIT_AS, (_statm(0) + ROOM, resource.RLIM_INFINITY))
    begun = time.perf_counter()
    tally = run_live(count, seed, only, watch=True)
    took_s, resident = time.perf_counter() - begun, tally.resident_mib
    third = max(len(resident) // 3, 1)
    kinds = ", ".join(f"{name} {n}" for name, n in sorted(tally.kinds.items()))
    refused = ", ".join(f"{why} {n}" for why, n in sorted(tally.refused.items()))
    print(
        f"live: {tally.bytes} bytes in {tally.lives} lives of {tally.turns} turns, seed {seed}: "
        f"none failed; {tally.rows} rows, {tally.heard} messages heard, {tally.out} bytes said; "
        f"{tally.signed} lives demanded signatures and let in {tally.genuine} frames, all genuine; "
        f"{took_s:.0f} s, slowest turn {tally.slowest_s:.2f} s; resident at "
        f"most {max(resident[:third]):.0f} MiB after a life of the first third, "
        f"{max(resident[-third:]):.0f} MiB of the last\n  refused: {refused}\n  mutations: {kinds}"
    )


def _statm(place: int) -> int:
    """Address space (0) or resident memory (1) of the process [bytes]."""
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[place]) * resource.getpagesize()
