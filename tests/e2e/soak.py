"""Hours of flight through a daemon: memory, backlog, heartbeats, losses, processor time.

    python -m tests.e2e.soak --minutes 30                          real time
    python -m tests.e2e.soak --flight-hours 4 --speed max          as fast as holds
    ... [--imus 4] [--sample-s 10] [--json FILE]

A process of its own flies laps without end (``long_flight``: four IMUs at 200 Hz, two pitots, 890
messages a second) and sends each message as a datagram over loopback. The daemon is watched from
outside: its memory and processor time, what waits in its socket and what the system threw away
there, how far its vehicle time is behind the flight, and every heartbeat that a ground station
would hear. ``--speed max`` raises the speed until something does not hold and flies on at nine
tenths of the last speed that did. The status is 1 if

memory grew by more than ``--grown-mb`` from the second fifth of the run to the last;
a datagram was lost, or the daemon was behind by more than half a second;
two heartbeats were further apart than a second and a half;
a fault was announced: nothing breaks in this flight;
the daemon did not end within a second of being told to.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from monitor.commands.daemon_process import DaemonProcess

READY_S = 240.0
GAP_S, BEHIND_S = 1.5, 0.5
SETTLE_S = 3.0
FIRST_SPEED, STEP, MOST_SPEED, MARGIN = 2.0, 1.5, 500.0, 0.9


@dataclass(frozen=True, slots=True)
class Sample:
    """How the daemon was doing at a moment.

    Attributes
    ----------
    at_s, flown_s
        Since the first frame, real and of the flight [s].
    memory_mb, cpu
        Resident [MB]; processor time since the sample before, of one core.
    behind_s
        Real time by which the daemon's newest vehicle time is behind what was sent [s].
    queue_kb, lost
        What waits in the daemon's socket; datagrams that the system threw away there so far.
    gap_s
        Longest time between two heartbeats since the sample before [s].
    late_s
        By which the player itself is behind: above zero the machine is too slow for it [s].
    latency_ms
        Median and 99th percentile of the daemon's answers so far.
    """

    at_s: float
    flown_s: float
    speed: float
    memory_mb: float
    cpu: float
    behind_s: float
    queue_kb: float
    lost: int
    gap_s: float
    late_s: float
    latency_ms: tuple[float, float]


class Heartbeats:
    """A ground station that only listens for heartbeats."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.2)
        self.port = self.socket.getsockname()[1]
        self.count, self.longest_s = 0, 0.0
        self._last_s: float | None = None
        self._since_s = 0.0
        self._ended = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def begin(self) -> None:
        """Gaps count from now on."""
        self.count, self.longest_s, self._since_s = 0, 0.0, 0.0

    def longest_since(self) -> float:
        """Longest gap since the last call, the one that lasts included [s]."""
        lasting_s = 0.0 if self._last_s is None else time.monotonic() - self._last_s
        longest_s, self._since_s = max(self._since_s, lasting_s), 0.0
        self.longest_s = max(self.longest_s, longest_s)
        return longest_s

    def close(self) -> None:
        """Listen no more."""
        self._ended = True
        self._thread.join()
        self.socket.close()

    def _listen(self) -> None:
        while not self._ended:
            try:
                data = self.socket.recv(4096)
            except TimeoutError:
                continue
            if data[7:10] != b"\0\0\0":
                continue
            now_s = time.monotonic()
            if self._last_s is not None:
                self._since_s = max(self._since_s, now_s - self._last_s)
                self.longest_s = max(self.longest_s, now_s - self._last_s)
            self._last_s = now_s
            self.count += 1


class Player:
    """The process that flies."""

    def __init__(self, port: int, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.e2e.long_flight", "--to", str(port), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.frames_per_s = float(json.loads(self._process.stdout.readline())["frames_per_s"])
        self.speed = 0.0
        self.told: dict[str, Any] = {}
        self._told_s = 0.0
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def fly(self, speed: float) -> None:
        """So many times real time from now on; 0 pauses."""
        self._order({"speed": speed})
        self.speed = speed

    def t_us(self) -> float:
        """Vehicle time that is being sent now."""
        passed_s = time.monotonic() - self._told_s
        late = self.told["late_s"] > 0.05
        return float(self.told["t_us"]) + (0.0 if late else passed_s * self.speed * 1e6)

    def close(self) -> None:
        """End it; what it told last stays."""
        if self._process.poll() is None:
            self._order({"end": True})
        self._process.wait(10)
        self._thread.join(10)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def _order(self, order: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.told = json.loads(line)
            self._told_s = time.monotonic()


class Soak:
    """Flies a daemon and watches it."""

    def __init__(self, daemon: DaemonProcess, player: Player, heartbeats: Heartbeats) -> None:
        self._daemon, self._player, self._heartbeats = daemon, player, heartbeats
        self._began_s = time.monotonic()
        self._used_s, self._sampled_s = daemon.usage()[0], self._began_s
        wait_until(lambda: bool(player.told), 60.0, "the player")
        self.first_us = float(player.told["t_us"])
        self.samples: list[Sample] = []

    def sample(self) -> Sample:
        """How it is doing now."""
        daemon, player = self._daemon, self._player
        status = self.status()
        behind_s = 0.0
        if player.speed and status["t_us"]:
            behind_s = max(player.t_us() - status["t_us"], 0.0) * 1e-6 / player.speed
        now_s = time.monotonic()
        used_s, memory_mb = daemon.usage()
        queue_bytes, lost = socket_of(daemon.port)
        latency = status["latency"]
        out = Sample(
            at_s=now_s - self._began_s,
            flown_s=(float(player.told["t_us"]) - self.first_us) * 1e-6,
            speed=player.speed,
            memory_mb=memory_mb,
            cpu=(used_s - self._used_s) / max(now_s - self._sampled_s, 1e-3),
            behind_s=behind_s,
            queue_kb=queue_bytes / 1e3,
            lost=lost,
            gap_s=self._heartbeats.longest_since(),
            late_s=float(player.told["late_s"]),
            latency_ms=tuple(round(latency[key] or 0.0, 2) for key in ("median_ms", "p99_ms")),
        )
        self._used_s, self._sampled_s = used_s, now_s
        self.samples.append(out)
        return out

    def status(self) -> dict[str, Any]:
        """What the daemon says of itself."""
        daemon, before = self._daemon, self._daemon.last_status
        os.kill(daemon.pid, signal.SIGUSR1)
        wait_until(lambda: daemon.last_status is not before, 30.0, "the daemon's status")
        assert daemon.last_status is not None
        return daemon.last_status

    def fastest(self, trial_s: float, say: Callable[[str], None]) -> float:
        """The speed to fly at: raised until something does not hold."""
        speed, held, failed = FIRST_SPEED, 0.0, False
        while speed <= MOST_SPEED:
            self._player.fly(speed)
            time.sleep(SETTLE_S)
            lost = self.sample().lost
            end_s = time.monotonic() + trial_s
            holds = True
            while holds and time.monotonic() < end_s:
                time.sleep(1.0)
                one = self.sample()
                holds = one.lost == lost and max(one.behind_s, one.late_s) < BEHIND_S
                holds = holds and one.gap_s < GAP_S
            say(
                f"{speed:.1f} times real time {'holds' if holds else 'does not hold'}: "
                f"{100 * one.cpu:.0f} % of a core, {one.behind_s:.2f} s behind, {one.lost - lost} "
                f"lost, {one.gap_s:.2f} s between heartbeats, the player {one.late_s:.2f} s late"
            )
            if not holds and failed:
                break
            failed = not holds  # once may be somebody else's work on this machine: try again
            if holds:
                held, speed = speed, speed * STEP
            else:
                self.last()
        return max(round(held * MARGIN, 1), 1.0)

    def begin(self) -> tuple[int, int]:
        """Forget what was seen so far; as :meth:`last`."""
        self.last()
        before = self.last()
        self.sample()
        self.samples.clear()
        self._heartbeats.begin()
        self._began_s, self.first_us = time.monotonic(), float(self._player.told["t_us"])
        return before

    def last(self) -> tuple[int, int]:
        """Frames sent and datagrams heard in all, when nothing is on its way any more."""
        self._player.fly(0.0)
        time.sleep(1.5)
        return int(self._player.told["sent"]), int(self.status()["datagrams"])


def wait_until(true: Callable[[], bool], timeout_s: float, what: str) -> None:
    """Wait for something that another process brings about."""
    end_s = time.monotonic() + timeout_s
    while not true():
        if time.monotonic() > end_s:
            raise TimeoutError(f"{what} did not come within {timeout_s:.0f} s")
        time.sleep(0.005)


def socket_of(port: int) -> tuple[int, int]:
    """Bytes that wait in the UDP socket of this port, and datagrams that were thrown away."""
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        fields = line.split()
        if int(fields[1].partition(":")[2], 16) == port:
            return int(fields[4].partition(":")[2], 16), int(fields[-1])
    return 0, 0


def verdict(
    samples: list[Sample], sent: int, heard: int, longest_s: float, faults: int, grown_mb: float
) -> list[str]:
    """What does not hold; nothing if all does."""
    fifth = max(len(samples) // 5, 1)
    early = statistics.median(s.memory_mb for s in samples[fifth : 2 * fifth] or samples)
    late = statistics.median(s.memory_mb for s in samples[-fifth:])
    behind_s = max(s.behind_s for s in samples)
    wrong = {
        f"memory grew by {late - early:.1f} MB": late - early > grown_mb,
        f"{sent - heard} of {sent} datagrams were lost": sent != heard,
        f"{behind_s:.2f} s behind": behind_s > BEHIND_S,
        f"{longest_s:.2f} s without a heartbeat": longest_s > GAP_S,
        f"{faults} faults announced": faults > 0,
    }
    return [what for what, is_so in wrong.items() if is_so]


def show(samples: list[Sample], rows: int = 24) -> Table:
    """At most so many of the samples."""
    table = Table(title="The daemon, as seen from outside")
    heads = (
        "real s,flown s,speed,memory MB,core %,behind s,queue kB,lost,longest gap s,p50 / p99 ms"
    )
    for head in heads.split(","):
        table.add_column(head, justify="right")
    for s in samples[:: max(len(samples) // rows, 1)]:
        table.add_row(
            f"{s.at_s:.0f}",
            f"{s.flown_s:.0f}",
            f"{s.speed:g}",
            f"{s.memory_mb:.1f}",
            f"{100 * s.cpu:.0f}",
            f"{s.behind_s:.2f}",
            f"{s.queue_kb:.0f}",
            str(s.lost),
            f"{s.gap_s:.2f}",
            "{:.1f} / {:.1f}".format(*s.latency_ms),
        )
    return table


def soak(arguments: argparse.Namespace, say: Callable[[str], None]) -> tuple[dict[str, Any], bool]:
    """Fly, watch, judge: figures, and whether all held."""
    heartbeats = Heartbeats()
    out = ("--out", f"udpout:127.0.0.1:{heartbeats.port}")
    with DaemonProcess((*out, *arguments.run)) as daemon:
        wait_until(lambda: heartbeats.count > 0, READY_S, "the daemon's first heartbeat")
        shape = [f"--imus={arguments.imus}", f"--laps={arguments.laps}"]
        player = Player(daemon.port, *shape, f"--straight-s={arguments.straight_s}")
        say(f"{player.frames_per_s:.0f} messages a second of flight")
        try:
            watched = Soak(daemon, player, heartbeats)
            speed = arguments.speed
            if speed == "max":
                speed = watched.fastest(arguments.trial_s, say)
            before = watched.begin()
            began_s, began_us = time.monotonic(), float(player.told["t_us"])
            player.fly(float(speed))
            while True:
                time.sleep(arguments.sample_s)
                one = watched.sample()
                flown_s = (float(player.told["t_us"]) - began_us) * 1e-6
                if arguments.verbose:
                    say(str(one))
                if arguments.flight_hours and flown_s >= arguments.flight_hours * 3600.0:
                    break
                real_s = time.monotonic() - began_s
                if not arguments.flight_hours and real_s >= arguments.minutes * 60.0:
                    break
            sent, heard = (now - then for now, then in zip(watched.last(), before, strict=True))
        finally:
            player.close()
        told_s = time.monotonic()
        os.kill(daemon.pid, signal.SIGTERM)
        wait_until(lambda: not daemon.running, 30.0, "the daemon's end")
        stop_s = time.monotonic() - told_s
        status = daemon.stop()
        faults = sum(change["state"] == "faulty" for _, change in daemon.changes)
    heartbeats.close()
    samples = watched.samples
    wrong = verdict(samples, sent, heard, heartbeats.longest_s, faults, arguments.grown_mb)
    if status != 0 or stop_s > 1.0:
        wrong.append(f"it ended with status {status} after {stop_s:.1f} s")
    Console(width=120).print(show(samples))
    figures = {
        "speed": float(speed),
        "real_s": real_s,
        "flown_s": flown_s,
        "sent": sent,
        "lost": sent - heard,
        "heartbeats": heartbeats.count,
        "longest_gap_s": heartbeats.longest_s,
        "memory_mb": [samples[0].memory_mb, samples[-1].memory_mb],
        "behind_s": max(s.behind_s for s in samples),
        "cpu": statistics.mean(s.cpu for s in samples),
        "faults": faults,
        "stop_s": stop_s,
        "wrong": wrong,
        "samples": [asdict(s) for s in samples],
    }
    say(
        f"{flown_s / 3600:.2f} h of flight in {real_s / 60:.1f} min at {float(speed):g} times real "
        f"time: {sent} datagrams, {figures['lost']} lost, {heartbeats.count} heartbeats at most "
        f"{heartbeats.longest_s:.2f} s apart, memory {samples[0].memory_mb:.0f} to "
        f"{samples[-1].memory_mb:.0f} MB, {100 * figures['cpu']:.0f} % of a core, at most "
        f"{figures['behind_s']:.2f} s behind, ended in {stop_s:.2f} s"
    )
    say("all holds" if not wrong else "DOES NOT HOLD: " + "; ".join(wrong))
    return figures, not wrong


def arguments_of(given: list[str] | None = None) -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=1.0, help="real ones")
    parser.add_argument("--flight-hours", type=float, help="simulated ones, instead of --minutes")
    parser.add_argument("--speed", type=lambda s: s if s == "max" else float(s), default=1.0)
    parser.add_argument("--imus", type=int, default=4)
    parser.add_argument("--laps", type=int, default=3, help="laps that are flown anew in turn")
    parser.add_argument("--straight-s", type=float, default=20.0, help="straight parts of a lap")
    parser.add_argument("--sample-s", type=float, default=5.0)
    parser.add_argument("--trial-s", type=float, default=15.0, help="each speed, of --speed max")
    parser.add_argument("--grown-mb", type=float, default=8.0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="all figures and samples")
    parser.add_argument("--verbose", action="store_true", help="each sample as it is taken")
    parser.add_argument("run", nargs="*", help="further arguments of `mavsentry run`, after --")
    return parser.parse_args(given)


def main() -> int:
    """See the module."""
    arguments = arguments_of()
    figures, held = soak(arguments, lambda text: print(text, flush=True))
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
