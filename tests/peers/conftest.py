"""Where the peers are installed, and a flight that daemons and peers share over loopback."""

from __future__ import annotations

import os
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from monitor.commands.daemon_process import DaemonProcess, free_port
from sim_feeds import player, scenario

ROOT = Path(__file__).resolve().parents[2]
PASSPHRASE = "only for those who fly"
FLIGHT = "small-uav-imu-bias"
READY_S = 180.0
"""A daemon may have to compile its kernels first."""


def missing(what: str) -> None:
    """Skip; in continuous integration, where everything must be there, fail."""
    if os.environ.get("CI", "").lower() in ("true", "1"):
        pytest.fail(f"{what}; `make test-external` installs it", pytrace=False)
    pytest.skip(f"{what}; `make test-external` installs it")


@pytest.fixture(scope="session")
def peers() -> Path:
    """Folder that ``tests/peers/install`` filled."""
    return Path(os.environ.get("MAVSENTRY_PEERS", ROOT / ".venv" / "peers"))


@pytest.fixture(scope="session")
def peers_python(peers) -> Path:
    """The Python with MAVProxy and MAVSDK."""
    path = peers / "python" / "bin" / "python"
    if not path.exists():
        missing("MAVProxy and MAVSDK are not installed")
    return path


@pytest.fixture(scope="session")
def node_modules(peers) -> Path:
    """Folder with node-mavlink."""
    path = peers / "node" / "node_modules"
    if shutil.which("node") is None or not path.exists():
        missing("node-mavlink is not installed")
    return path


class Vehicle(threading.Thread):
    """An autopilot in real time that sends the same to all ports.

    Parameters
    ----------
    ports
        UDP ports of the loopback; may grow.
    """

    def __init__(self, ports: list[int]) -> None:
        super().__init__(daemon=True)
        self.ports = ports
        self._frames = list(player.frames_of(scenario.load(FLIGHT).fly()))
        self._ended = threading.Event()

    def run(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            begun_s, first_us = time.monotonic(), self._frames[0][0]
            for t_us, frame in self._frames:
                due_s = begun_s + (t_us - first_us) / 1e6
                if self._ended.wait(max(0.0, due_s - time.monotonic())):
                    return
                for port in self.ports:
                    out.sendto(frame, ("127.0.0.1", port))

    def end(self) -> None:
        self._ended.set()
        self.join(5.0)


class Flown:
    """A flight in progress: the ports on which peers see vehicle and monitor as on one link."""

    def __init__(self, folder: Path) -> None:
        self.proxy_port, self.sdk_port = free_port(), free_port()
        self.folders = {"unsigned": folder / "unsigned", "signed": folder / "signed"}
        key = folder / "key"
        key.touch(0o600)
        key.write_text(PASSPHRASE + "\n")
        config = folder / "signed.toml"
        config.write_text(f'[security]\nkey_file = "{key}"\naccept_unsigned = true\n')
        self._begun_s = 0.0
        self._heard = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in self.folders]
        for heard in self._heard:
            heard.bind(("127.0.0.1", 0))
            heard.settimeout(READY_S)
        ready = [f"udpout:127.0.0.1:{heard.getsockname()[1]}" for heard in self._heard]
        outputs = [f"udpout:127.0.0.1:{port}" for port in (self.proxy_port, self.sdk_port)]
        self.daemons = [
            DaemonProcess(("--record", str(self.folders[kind]), "--out", out, *more))
            for kind, out, more in (
                ("unsigned", ready[0], ("--out", outputs[0], "--out", outputs[1])),
                ("signed", ready[1], ("--config", str(config))),
            )
        ]
        self.vehicle = Vehicle([*(d.port for d in self.daemons), self.proxy_port, self.sdk_port])

    def begin(self) -> None:
        for daemon, heard in zip(self.daemons, self._heard, strict=True):
            try:
                heard.recv(1024)
            except TimeoutError:
                pytest.fail(f"a daemon says nothing: {daemon.notes}")
        self.vehicle.start()
        self._begun_s = time.monotonic()

    def end(self, after_s: float = 0.0) -> None:
        """End it, once it has lasted so long."""
        time.sleep(max(0.0, self._begun_s + after_s - time.monotonic()))
        for heard in self._heard:
            heard.close()
        if self.vehicle.is_alive():
            self.vehicle.end()
        for daemon in self.daemons:
            daemon.stop()


@pytest.fixture(scope="session")
def flown(tmp_path_factory) -> Iterator[Flown]:
    """The flight; the last test ends it."""
    flight = Flown(tmp_path_factory.mktemp("peers"))
    try:
        flight.begin()
        yield flight
    finally:
        flight.end()
