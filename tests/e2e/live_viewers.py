"""What the live page costs: two daemons hear the same flight, one of them is watched.

    python -m tests.e2e.live_viewers [--minutes 10] [--viewers 5] [--chromium] [--json FILE]

A synthetic flight with two IMUs at 200 Hz is sent in real time to two daemons at once, frame by
frame the same. One runs with ``--web`` and has viewers: WebSocket clients in a process of their
own that read all there is (``--chromium``: real pages instead). Told of both, after so many
minutes: how long answers took, processor time per second of flight, memory over the first and the
last third; of the viewers: frames heard and missed. The status is 1 if

the verdicts of the two differ in a bit, or none is of a fault;
the answers of the watched one took more than ``--slower`` longer (median; both in one run, so what
else the machine does slows both);
memory of the watched daemon or of its web process grew by more than ``--grown`` from the first
third to the last (the history is shortened to fill within the first);
a viewer missed a frame.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.commands.daemon_process import DaemonProcess
from monitor.recorder import whole_frames

COMMAND = (sys.executable, "-m", "monitor.cli")
READY_S = 900.0
"""The daemons may have to compile their kernels first."""
SETTLE_S = 2.0
TICK_S = 0.005
SAMPLE_S = 2.0
RATE_HZ = 5.0

SCENARIO = """\
title = "Turns and straight legs, two IMUs at 200 Hz; an accelerometer and a pitot break"
aircraft = "transport"
seed = 3

[start]
speed_m_s = 100.0
agl_m = 1500.0

{legs}
[[wind]]
kind = "constant"
speed_m_s = 9.0
toward_deg = 110.0

[imu]
count = 2
rate_hz = 200.0

[airspeed]
count = 2

[[fault]]
sensor = "imu0.acc_x"
kind = "bias"
start_s = {imu_s}
end_s = {imu_end_s}
size_m_s2 = 1.5

[[fault]]
sensor = "airspeed1"
kind = "bias"
start_s = {pitot_s}
size_m_s = -15.0
"""
LEGS = """\
[[leg]]
do = "turn"
angle_deg = {angle_deg}
bank_deg = 25.0
[[leg]]
do = "level"
duration_s = 20.0
"""
LEGS_S = 50.0
"""A pair of legs takes at least so long."""


@dataclass(slots=True)
class Watched:
    """One daemon over the flight."""

    name: str
    daemon: DaemonProcess
    web_pid: int | None = None
    memory_mb: list[float] = field(default_factory=list)
    web_memory_mb: list[float] = field(default_factory=list)
    began_s: tuple[float, float] = (0.0, 0.0)
    used_s: tuple[float, float] = (0.0, 0.0)

    def cpu_s(self) -> tuple[float, float]:
        """Processor time of the daemon and of its web process so far."""
        return usage(self.daemon.pid)[0], usage(self.web_pid)[0]

    def sample(self) -> None:
        self.memory_mb.append(usage(self.daemon.pid)[1])
        self.web_memory_mb.append(usage(self.web_pid)[1])

    def changes(self) -> list[dict[str, Any]]:
        return [change for _, change in self.daemon.changes]


def usage(pid: int | None) -> tuple[float, float]:
    """Processor time so far [s] and memory now [MB] of a process; zeros of none."""
    if pid is None:
        return 0.0, 0.0
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    ticks = int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK"), pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    """Fly, measure, print."""
    options = _options()
    if options.watch:
        return watch(options)
    with tempfile.TemporaryDirectory(prefix="live-viewers-") as scratch:
        log = make(Path(scratch), options.minutes)
        found = fly(log, options, Path(scratch))
    print_out(found)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    for broken in found["broken"]:
        print(f"BROKEN: {broken}")
    return 1 if found["broken"] else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--viewers", type=int, default=5)
    parser.add_argument("--chromium", action="store_true", help="real pages instead of clients")
    parser.add_argument("--slower", type=float, default=1.0, help="milliseconds")
    parser.add_argument("--grown", type=float, default=3.0, help="megabytes")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--watch", metavar="URL", help=argparse.SUPPRESS)
    return parser.parse_args()


def make(folder: Path, minutes: float) -> Path:
    """The flight as a telemetry log."""
    seconds = 60.0 * minutes
    pairs = int(seconds / LEGS_S) + 2
    legs = "".join(LEGS.format(angle_deg=90.0 if i % 2 else -90.0) for i in range(pairs))
    text = SCENARIO.format(
        legs=legs, imu_s=0.35 * seconds, imu_end_s=0.5 * seconds, pitot_s=0.7 * seconds
    )
    scenario, log = folder / "flight.toml", folder / "flight.tlog"
    scenario.write_text(text)
    subprocess.run(
        [*COMMAND, "feed", str(scenario), "--to", str(log), "--speed", "max"], check=True
    )
    return log


def frames_of(log: Path, seconds: float) -> Iterator[tuple[float, bytes]]:
    """Seconds from the start and what is sent then: the frames of one tick."""
    framer = Framer(load_dialect(), stamped=True)
    first_us: int | None = None
    with log.open("rb") as file:
        while data := file.read(1 << 16):
            for frame, stamp_us in whole_frames(framer.feed(data)):
                first_us = stamp_us if first_us is None else first_us
                at_s = (stamp_us - first_us) / 1e6
                if at_s > seconds:
                    return
                yield at_s, frame


def fly(log: Path, options: argparse.Namespace, scratch: Path) -> dict[str, Any]:
    """Send the flight to both daemons and measure."""
    seconds = 60.0 * options.minutes
    config = scratch / "sentry.toml"
    history_s = max(10.0, min(300.0, seconds / 4.0))
    config.write_text(f"[web]\nrate_hz = {RATE_HZ}\nhistory_s = {history_s}\n")
    arguments = ("--profile", "transport", "--config", str(config))
    with (
        DaemonProcess(arguments) as alone,
        DaemonProcess((*arguments, "--web", "127.0.0.1:0")) as seen,
    ):
        both = [Watched("alone", alone), Watched("watched", seen)]
        url = until_ready(both[1])
        viewers = begin_viewers(url, options)
        time.sleep(SETTLE_S)
        send(log, seconds, both)
        time.sleep(SETTLE_S)
        statuses = [status_of(one.daemon) for one in both]
        metrics = read(url, "/metrics")
        told = end_viewers(viewers)
        for one in both:
            if one.daemon.stop() != 0:
                raise SystemExit(f"{one.name}: {one.daemon.notes}")
    return account(both, statuses, told, metrics, seconds, options)


def until_ready(seen: Watched) -> str:
    """Wait until the watched daemon works (the other one began before it); its page."""
    end_s = time.monotonic() + READY_S
    while time.monotonic() < end_s and seen.daemon.running:
        found = re.search(r"live page on (http://\S+)", seen.daemon.notes)
        if found and well(found[1]):
            children = Path(f"/proc/{seen.daemon.pid}/task/{seen.daemon.pid}/children")
            seen.web_pid = int(children.read_text().split()[0])
            return found[1]
        time.sleep(0.1)
    raise SystemExit(f"the daemon did not start: {seen.daemon.notes}")


def well(page: str) -> bool:
    try:
        return read(page, "/healthz") == "ok\n"
    except OSError:
        return False


def read(page: str, path: str) -> str:
    with urllib.request.urlopen(page.rstrip("/") + path, timeout=10.0) as answer:
        return str(answer.read().decode())


def send(log: Path, seconds: float, both: list[Watched]) -> None:
    """Send in real time, each frame to both; the order of the two alternates."""
    ports = [one.daemon.port for one in both]
    for one in both:
        one.began_s = one.cpu_s()
    sampled_s = -SAMPLE_S
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        began_s = time.monotonic()
        for at_s, frame in frames_of(log, seconds):
            ahead_s = began_s + at_s - time.monotonic()
            if ahead_s > TICK_S:
                time.sleep(ahead_s)
            ports.reverse()
            for port in ports:
                sock.sendto(frame, ("127.0.0.1", port))
            if at_s - sampled_s >= SAMPLE_S:
                sampled_s = at_s
                for one in both:
                    one.sample()
    for one in both:
        one.used_s = one.cpu_s()


def status_of(daemon: DaemonProcess) -> dict[str, Any]:
    """How the loop is doing, asked for by its signal."""
    os.kill(daemon.pid, signal.SIGUSR1)
    end_s = time.monotonic() + 10.0
    while daemon.last_status is None:
        if time.monotonic() > end_s:
            raise SystemExit(f"no status: {daemon.notes}")
        time.sleep(0.02)
    return daemon.last_status


def begin_viewers(url: str, options: argparse.Namespace) -> subprocess.Popen[str]:
    """The viewers, in a process of their own."""
    kind = ["--chromium"] if options.chromium else []
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "tests.e2e.live_viewers", "--watch", url),
            *("--viewers", str(options.viewers), *kind),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    end_s = time.monotonic() + 120.0
    while f"mavsentry_web_viewers {options.viewers:.1f}" not in read(url, "/metrics"):
        if time.monotonic() > end_s or process.poll() is not None:
            process.kill()
            raise SystemExit("the viewers did not connect")
        time.sleep(0.1)
    return process


def end_viewers(process: subprocess.Popen[str]) -> list[dict[str, Any]]:
    """What each viewer has heard."""
    out, _ = process.communicate("enough\n", timeout=60.0)
    told: list[dict[str, Any]] = json.loads(out)
    return told


def watch(options: argparse.Namespace) -> int:
    """The viewers' own process: read until told that it is enough, then tell what was heard."""
    if options.chromium:
        told = pages(options.watch, options.viewers)
    else:
        told = asyncio.run(clients(options.watch, options.viewers))
    print(json.dumps(told))
    return 0


async def clients(page: str, count: int) -> list[dict[str, Any]]:
    """Viewers that read all there is."""
    url = page.replace("http", "ws", 1).rstrip("/") + "/live"
    heard: list[dict[str, Any]] = [
        {"frames": 0, "missed": 0, "bytes": 0, "newest": None} for _ in range(count)
    ]
    tasks = [asyncio.create_task(client(url, one)) for one in heard]
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return heard


async def client(url: str, heard: dict[str, Any]) -> None:
    from tornado.websocket import websocket_connect

    connection = await websocket_connect(url)
    while (text := await connection.read_message()) is not None:
        message = json.loads(text)
        heard["bytes"] += len(text)
        if message["kind"] == "frame":
            number, newest = message["number"], heard["newest"]
            heard["frames"] += 1
            heard["missed"] += 0 if newest is None else number - newest - 1
            heard["newest"] = number


def pages(page: str, count: int) -> list[dict[str, Any]]:
    """Real pages in Chromium, and what they complained of."""
    from playwright.sync_api import sync_playwright

    from tests.browser.visits import find_chromium, flags

    heard: list[dict[str, Any]] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=flags())
        for _ in range(count):
            one: dict[str, Any] = {"frames": 0, "missed": 0, "bytes": 0, "newest": None}
            heard.append(one)
            tab = browser.new_page()
            tab.on("websocket", lambda socket, one=one: socket.on("framereceived", counting(one)))
            tab.goto(page)
        while True:  # the pages' events come while their driver is called
            tab.wait_for_timeout(200)
            if ready_to_end():
                break
        browser.close()
    return heard


def counting(heard: dict[str, Any]) -> Any:
    """Counts what a page receives."""

    def count(text: str | bytes) -> None:
        head = text[:80] if isinstance(text, str) else text[:80].decode()
        heard["bytes"] += len(text)
        found = re.match(r'\{"kind": ?"frame", ?"number": ?(\d+)', head)
        if found:
            number, newest = int(found[1]), heard["newest"]
            heard["frames"] += 1
            heard["missed"] += 0 if newest is None else number - newest - 1
            heard["newest"] = number

    return count


def ready_to_end() -> bool:
    import select

    return bool(select.select([sys.stdin], [], [], 0.0)[0])


def thirds(values: list[float]) -> tuple[float, float]:
    """Medians of the first and of the last third."""
    third = max(1, len(values) // 3)
    return statistics.median(values[:third]), statistics.median(values[-third:])


def account(
    both: list[Watched],
    statuses: list[dict[str, Any]],
    told: list[dict[str, Any]],
    metrics: str,
    seconds: float,
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Everything measured, and what of it does not hold."""
    daemons: dict[str, dict[str, Any]] = {}
    for one, status in zip(both, statuses, strict=True):
        memory, web_memory = thirds(one.memory_mb), thirds(one.web_memory_mb)
        used = [after - before for after, before in zip(one.used_s, one.began_s, strict=True)]
        daemons[one.name] = {
            "latency": status["latency"],
            "datagrams": status["datagrams"],
            "cpu_per_s": used[0] / seconds,
            "web_cpu_per_s": used[1] / seconds,
            "memory_mb": memory,
            "web_memory_mb": web_memory,
            "faults": sorted({c["sensor"] for c in one.changes() if c["state"] == "faulty"}),
        }
    alone, watched = daemons["alone"], daemons["watched"]
    broken = []
    if both[0].changes() != both[1].changes():
        broken.append("the verdicts differ")
    if not watched["faults"]:
        broken.append("no fault was found")
    slower = watched["latency"]["median_ms"] - alone["latency"]["median_ms"]
    if slower > options.slower:
        broken.append(f"answers took {slower:.2f} ms longer")
    for key in ("memory_mb", "web_memory_mb"):
        first, last = watched[key]
        if last - first > options.grown:
            broken.append(f"{key} grew by {last - first:.1f}")
    broken += [f"viewer {i} missed {v['missed']} frames" for i, v in enumerate(told) if v["missed"]]
    wanted = ("mavsentry_web_frames_dropped_total", "mavsentry_snapshots_dropped_total")
    counts = {
        name: float(value)
        for name, value in re.findall(r"^(mavsentry_\w+) (\S+)$", metrics, re.M)
        if name in (*wanted, "mavsentry_snapshot_cpu_seconds")
    }
    return {
        "minutes": seconds / 60.0,
        "viewers": "chromium" if options.chromium else "clients",
        "daemons": daemons,
        "verdicts": len(both[0].changes()),
        "same_verdicts": both[0].changes() == both[1].changes(),
        "heard": told,
        "counts": counts,
        "broken": broken,
    }


def print_out(found: dict[str, Any]) -> None:
    """The tables."""
    alone, watched = found["daemons"]["alone"], found["daemons"]["watched"]
    table = Table("", "alone", f"watched by {len(found['heard'])} {found['viewers']}")
    rows = [
        (f"answers: {key}", alone["latency"][key], watched["latency"][key])
        for key in ("count", "median_ms", "p99_ms", "worst_ms")
    ]
    rows += [
        (what, 1e3 * alone[key], 1e3 * watched[key])
        for what, key in (
            ("daemon: processor time (ms per s)", "cpu_per_s"),
            ("web process: processor time (ms per s)", "web_cpu_per_s"),
        )
    ]
    for what, key in (("daemon", "memory_mb"), ("web process", "web_memory_mb")):
        for third, i in (("first", 0), ("last", 1)):
            rows.append((f"{what}: memory, {third} third (MB)", alone[key][i], watched[key][i]))
    for what, a, b in rows:
        table.add_row(what, f"{a:.4g}", f"{b:.4g}")
    table.add_row("faulty", ", ".join(alone["faults"]), ", ".join(watched["faults"]))
    console = Console(width=110)
    console.print(f"{found['minutes']:g} minutes; {found['verdicts']} changes of state", end=", ")
    console.print("the same of both" if found["same_verdicts"] else "NOT THE SAME of both")
    console.print(table)
    for i, one in enumerate(found["heard"]):
        console.print(
            f"viewer {i}: {one['frames']} frames heard, {one['missed']} missed, "
            f"{one['bytes'] / 1e6:.1f} MB"
        )
    console.print(found["counts"])


if __name__ == "__main__":
    raise SystemExit(main())
