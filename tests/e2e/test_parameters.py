"""A ground station sets parameters of the daemon as a process; it is killed and has them again."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as wire
from pymavlink.mavparm import MAVParmDict

from monitor.commands.daemon_process import DaemonProcess

OURS = (1, 191)
READY_S = 150.0
"""The daemon may have to compile its kernels first."""


class Station:
    """A ground station that passes on what its vehicle says; both on one UDP port."""

    def __init__(self, port: int) -> None:
        self.link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=255, dialect="ardupilotmega"
        )
        self.link.target_system, self.link.target_component = OURS
        self.vehicle = wire.MAVLink(self.link, 1, 1)
        self.begun_s = time.monotonic()

    def __enter__(self) -> Station:
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def beat(self) -> None:
        """What an idle vehicle says."""
        self.vehicle.heartbeat_send(1, 3, 0, 0, 4)
        boot_ms = round(1000 * (time.monotonic() - self.begun_s)) + 1
        self.vehicle.raw_imu_send(1000 * boot_ms, 0, 0, -1000, 0, 0, 0, 0, 0, 0)

    def wait_for(self, kind: str, timeout_s: float = 10.0) -> wire.MAVLink_message:
        """The next message of a kind from the daemon."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            self.beat()
            message = self.link.recv_match(type=kind, blocking=True, timeout=0.2)
            if message is not None and message.get_srcComponent() == OURS[1]:
                return message
        raise AssertionError(f"no {kind} in {timeout_s} s")

    def read(self, name: str) -> float:
        """A parameter's value."""
        self.link.mav.param_request_read_send(*OURS, name.encode(), -1)
        message = self.wait_for("PARAM_VALUE")
        assert message.param_id == name
        return float(message.param_value)


def test_what_is_set_is_in_force_and_outlives_a_kill(tmp_path: Path) -> None:
    kept = tmp_path / "parameters.json"
    with DaemonProcess(state=tmp_path) as daemon, Station(daemon.port) as station:
        station.wait_for("HEARTBEAT", READY_S)
        client = MAVParmDict()
        assert station.read("IMU_LONE_SIG") == 6.0
        assert client.mavset(station.link, "IMU_LONE_SIG", 7.25)
        assert client.mavset(station.link, "MUTE_IMU0", 63)
        assert client.mavset(station.link, "AIR_CONFIRM", -3.0)
        assert station.read("AIR_CONFIRM") == 1.0
        end_s = time.monotonic() + 10.0
        while len(json.loads(kept.read_text())["values"]) < 2:
            assert time.monotonic() < end_s
            time.sleep(0.05)
        daemon.kill()
    with DaemonProcess(state=tmp_path) as daemon, Station(daemon.port) as station:
        station.wait_for("HEARTBEAT", READY_S)
        assert station.read("IMU_LONE_SIG") == 7.25
        assert station.read("MUTE_IMU0") == 63.0
        assert station.read("AIR_CONFIRM") == 1.0
        assert daemon.stop() == 0, daemon.notes


def test_config_show_tells_what_was_set_over_mavlink(
    tmp_path: Path, command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    values = {"imu.single_sigma": 7.25, "imu.confirm_s": -1}
    kept = {"schema": "mavsentry/parameters/1", "values": values}
    (tmp_path / "parameters.json").write_text(json.dumps(kept))
    shown = command("config", "show", "--live")
    assert shown.returncode == 0
    (line,) = [line for line in shown.stdout.splitlines() if line.startswith("imu.single_sigma")]
    assert line.split() == ["imu.single_sigma", "=", "7.25", "#", "parameter"]
    assert "not used: imu.confirm_s" in shown.stderr
    plain = command("config", "show").stdout
    assert "parameter\n" not in plain
    assert "imu.single_sigma = 6.0" in plain
