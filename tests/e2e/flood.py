"""A flood of junk at the daemon's socket, beside a flight: what is lost, how late, at what cost.

    python -m tests.e2e.flood [--rate 20000] [--addresses 1] [--seconds 20] [--json FILE]

A flight of two IMUs at 200 Hz is sent in real time: alone for a while, then with a process beside
it that sends so many datagrams of random bytes a second to the same socket, from so many addresses
in turn. Told of both: how long answers took (they also wait for the flood's own processor time
where the machine has few cores), processor time, and how many of the vehicle's samples did not
arrive in all. The status is 1 if one did not, or a fault was announced.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

from links.mavlink import Decoder
from monitor.commands.daemon_process import DaemonProcess

from .long_flight import Laps, fly
from .soak import READY_S, Heartbeats, Player, Soak, wait_until

SHAPE = {"imus": 2, "laps": 1, "straight_s": 5.0}


def send(port: int, rate: float, addresses: int, seconds: float) -> int:
    """Junk for so long; how many datagrams it was."""
    sockets = []
    for k in range(addresses):
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        one.bind((f"127.{1 + k // 62500}.{k // 250 % 250}.{1 + k % 250}", 0))
        one.connect(("127.0.0.1", port))
        sockets.append(one)
    junk = [os.urandom(random.randint(20, 280)) for _ in range(64)]
    sent, began_s = 0, time.monotonic()
    while (passed_s := time.monotonic() - began_s) < seconds:
        while sent < passed_s * rate:
            sockets[sent % addresses].send(junk[sent % 64])
            sent += 1
        time.sleep(0.001)
    for one in sockets:
        one.close()
    return sent


def rows_of(frames: int) -> int:
    """Rows that so many frames of the flight give, decoded without a link."""
    laps = Laps(*fly(**SHAPE))
    decoder = Decoder()
    count = sum(len(decoder.feed(frame)) for _, frame in islice(laps, frames))
    return count + len(decoder.finish())


def flood(
    rate: float, addresses: int, seconds: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Fly without and with a flood, and compare."""
    heartbeats = Heartbeats()
    with DaemonProcess(("--out", f"udpout:127.0.0.1:{heartbeats.port}")) as daemon:
        wait_until(lambda: heartbeats.count > 0, READY_S, "the daemon's first heartbeat")
        player = Player(daemon.port, *(f"--{k.replace('_', '-')}={v}" for k, v in SHAPE.items()))
        try:
            watched = Soak(daemon, player, heartbeats)
            player.fly(1.0)
            time.sleep(3.0)
            heartbeats.begin()
            watched.sample()
            time.sleep(seconds)
            calm = watched.sample()
            junk = subprocess.Popen(
                [
                    *(sys.executable, "-m", "tests.e2e.flood", "--send", str(daemon.port)),
                    *("--rate", str(rate), "--addresses", str(addresses)),
                    *("--seconds", str(seconds)),
                ],
                stdout=subprocess.PIPE,
                text=True,
            )
            time.sleep(seconds * 0.9)
            flooded = watched.sample()
            sent_junk = int(junk.communicate()[0])
            sent, _ = watched.last()
            rows = watched.status()["rows"]
        finally:
            player.close()
        faults = sum(change["state"] == "faulty" for _, change in daemon.changes)
    heartbeats.close()
    expected = rows_of(sent)
    figures = {
        "junk": sent_junk,
        "junk_per_s": sent_junk / seconds,
        "addresses": addresses,
        "rows": rows,
        "rows_lost": expected - rows,
        "latency_ms": {"calm": calm.latency_ms, "flood": flooded.latency_ms},
        "cpu": {"calm": calm.cpu, "flood": flooded.cpu},
        "longest_gap_s": heartbeats.longest_s,
        "faults": faults,
    }
    say(
        f"{sent_junk / seconds:.0f} junk datagrams a second from {addresses} addresses: "
        f"{expected - rows} of {expected} samples lost; answers {calm.latency_ms[0]:.1f} / "
        f"{calm.latency_ms[1]:.1f} ms before, {flooded.latency_ms[0]:.1f} / "
        f"{flooded.latency_ms[1]:.1f} ms with it (median / p99 since the start); processor "
        f"{100 * calm.cpu:.0f} % before, {100 * flooded.cpu:.0f} % with it; heartbeats at most "
        f"{heartbeats.longest_s:.2f} s apart; {faults} faults announced"
    )
    return figures


def main() -> int:
    """See the module."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rate", type=float, default=20_000.0)
    parser.add_argument("--addresses", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--send", type=int, metavar="PORT", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.send:
        print(send(asked.send, asked.rate, asked.addresses, asked.seconds))
        return 0
    figures = flood(asked.rate, asked.addresses, asked.seconds, print)
    if asked.json is not None:
        asked.json.write_text(json.dumps(figures, indent=1) + "\n")
    return int(figures["rows_lost"] != 0 or figures["faults"] != 0)


if __name__ == "__main__":
    sys.exit(main())
