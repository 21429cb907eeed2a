"""Programs of others on a link with us: MAVProxy, MAVSDK and node-mavlink understand what we say.

One flight serves all of them; it is recorded meanwhile, and read at its end.
"""

from __future__ import annotations

import json
import os
import queue
import re
import subprocess
import threading
import time
from collections import Counter
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as wire

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.recorder import whole_frames

from .conftest import PASSPHRASE

pytestmark = pytest.mark.external

OURS = 191
FLOWN_S = 60.0
HERE = Path(__file__).parent


class MavProxy:
    """MAVProxy without a terminal: what is typed into it and what it says."""

    def __init__(self, python: Path, port: int, folder: Path) -> None:
        self._process = subprocess.Popen(
            [
                *(python, "-u", python.with_name("mavproxy.py")),
                *(f"--master=udpin:127.0.0.1:{port}", "--source-system=255"),
                *("--target-system=1", f"--target-component={OURS}", "--default-modules=param"),
                *(f"--state-basedir={folder}", f"--logfile={folder / 'mav.tlog'}"),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env={**os.environ, "HOME": str(folder)},
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self.said = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line)

    def type(self, command: str) -> None:
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()

    def ask(self, command: str, pattern: str, timeout_s: float = 40.0) -> re.Match[str]:
        """Type a command, again every few seconds, until what it says has this in it."""
        end_s, heard = time.monotonic() + timeout_s, ""
        while time.monotonic() < end_s:
            self.type(command)
            again_s = time.monotonic() + 4.0
            while time.monotonic() < again_s:
                try:
                    heard += self._lines.get(timeout=0.2)
                except queue.Empty:
                    continue
                if found := re.search(pattern, heard):
                    self.said += heard
                    return found
        raise AssertionError(f"{command}: no {pattern} in {self.said + heard}")

    def __enter__(self) -> MavProxy:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join(5.0)
        self._process.stdin.close()
        self._process.stdout.close()


def test_mavproxy_sees_us_reads_our_parameters_and_sets_one(flown, peers_python, tmp_path):
    with MavProxy(peers_python, flown.proxy_port, tmp_path) as proxy:
        named = proxy.ask("status NAMED_VALUE_FLOAT", r"name : (\w+), value : ([-\d.]+)")
        assert named[1]
        proxy.type(f"set target_component {OURS}")
        fetched = proxy.ask("param fetch", r"Received (\d+) parameters")
        assert int(fetched[1]) > 20
        before = proxy.ask("param show IMU_LONE_SIG", r"IMU_LONE_SIG\s+([\d.]+)")
        assert float(before[1]) == 6.0
        proxy.type("param set IMU_LONE_SIG 7.25")
        proxy.ask("param fetch IMU_LONE_SIG", r"IMU_LONE_SIG\s+=? ?7\.25")
        proxy.ask("param show MUTE_IMU0", r"MUTE_IMU0\s+0")
    heard = sent_by(OURS, tmp_path / "mav.tlog")
    assert Counter(m.get_type() for m in heard)["HEARTBEAT"] >= 1
    assert "FLT_IMU0" in {m.name for m in heard if m.get_type() == "NAMED_VALUE_FLOAT"}
    assert not [m for m in heard if m.get_type() == "BAD_DATA"]


def test_mavsdk_sees_the_vehicle_undisturbed_and_sets_a_parameter_of_ours(flown, peers_python):
    done = subprocess.run(
        [peers_python, HERE / "see.py", str(flown.sdk_port)],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    seen = json.loads(next(s for s in done.stdout.splitlines() if s.startswith("{")))
    assert seen["system"] == 1
    assert {1, OURS} <= set(seen["components"])
    assert seen["connected"]
    assert seen["still"]
    assert seen["rolls"] > 3, "telemetry of the vehicle comes on"
    assert all(abs(angle) > 0.1 for angle in seen["position"])
    assert seen["parameter"][0] != seen["parameter"][1] == 4.25


@pytest.fixture(scope="module")
def recorded(flown) -> dict[str, list[bytes]]:
    """Our frames of a minute of the flight, which this ends; as the two daemons sent them."""
    flown.end(FLOWN_S)
    return {name: ours(folder) for name, folder in flown.folders.items()}


@pytest.mark.parametrize("kind", ["unsigned", "signed"])
def test_node_mavlink_reads_all_that_we_sent(recorded, node_modules, tmp_path, kind):
    frames = recorded[kind]
    file = tmp_path / "frames.bin"
    file.write_bytes(b"".join(frames))
    done = subprocess.run(
        ["node", HERE / "read.cjs", file, *([PASSPHRASE] if kind == "signed" else [])],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "NODE_PATH": str(node_modules)},
    )
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout)
    messages = parsed(frames)
    assert len(frames) > 5 * FLOWN_S
    assert read["packets"] == len(frames)
    assert (read["bad"], read["forged"]) == (0, 0)
    assert read["signed"] == (len(frames) if kind == "signed" else 0)
    names = Counter(m.get_type() for m in messages)
    assert read["unknown"] == names.pop("AIRSPEED")  # its tables are older than that message
    assert read["names"] == names
    named = [m for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert {name.rstrip("\0") for name, _ in read["values"]} >= {"FLT_IMU0", "MON_IMU0"}
    for (name, value), message in zip(read["values"], named, strict=True):
        assert name.rstrip("\0") == message.name
        assert value == pytest.approx(message.value, nan_ok=True) or value is None
    texts = [m.text for m in messages if m.get_type() == "STATUSTEXT"]
    assert [text.rstrip("\0") for text in read["texts"]] == texts
    assert read["names"]["HEARTBEAT"] > 0.8 * FLOWN_S


def ours(folder: Path) -> list[bytes]:
    """Frames that we sent, of a folder of recordings."""
    out: list[bytes] = []
    for file in sorted(folder.glob("*.tlog")):
        framer = Framer(load_dialect(), stamped=True)
        for part in (framer.feed(file.read_bytes()), framer.finish()):
            out += [frame for frame, _ in whole_frames(part.take(part.component == OURS))]
    return out


def parsed(frames: list[bytes]) -> list[wire.MAVLink_message]:
    """The same frames as pymavlink reads them."""
    parser = wire.MAVLink(None)
    return [message for frame in frames for message in parser.parse_buffer(frame) or ()]


def sent_by(component: int, log: Path) -> list[wire.MAVLink_message]:
    """What a log of MAVProxy has of a component."""
    framer = Framer(load_dialect(), stamped=True)
    parts = (framer.feed(log.read_bytes()), framer.finish())
    frames = [f for p in parts for f, _ in whole_frames(p.take(p.component == component))]
    return parsed(frames)
