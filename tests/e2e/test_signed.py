"""The daemon as a process with a key: who has it is answered, who has not is air."""

from __future__ import annotations

import hashlib
import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as wire

from monitor.commands.daemon_process import DaemonProcess

PASSPHRASE = "only for those who fly"
READY_S = 150.0
"""The daemon may have to compile its kernels first."""


class Station:
    """A peer on a socket of its own that signs with pymavlink, or not."""

    def __init__(self, port: int, system: int, component: int, passphrase: str | None) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(0.05)
        self.mav: Any = wire.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.sent: list[bytes] = []
        self.got: list[Any] = []
        if passphrase is not None:
            self.mav.signing.secret_key = hashlib.sha256(passphrase.encode()).digest()
            self.mav.signing.sign_outgoing = True
            self.mav.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)

    def say(self, *messages: Any) -> None:
        for message in messages:
            frame = bytes(message.pack(self.mav))
            self.mav.seq = (self.mav.seq + 1) % 256
            self.sent.append(frame)
            self.put(frame)

    def put(self, data: bytes) -> None:
        try:
            self.socket.send(data)
        except ConnectionRefusedError:  # the daemon does not listen yet
            time.sleep(0.05)

    def listen(self, seconds: float) -> list[Any]:
        """What came meanwhile; a frame that is not rightly signed comes as BAD_DATA."""
        end_s, new = time.monotonic() + seconds, []
        while time.monotonic() < end_s:
            try:
                new += self.mav.parse_buffer(self.socket.recv(4096)) or ()
            except (TimeoutError, ConnectionRefusedError):
                continue
        self.got += new
        return new


def heartbeat() -> Any:
    return wire.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)


def attitude(ms: int) -> Any:
    return wire.MAVLink_attitude_message(ms, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Some seconds of a vehicle that signs, and of strangers who claim to be it."""
    folder = tmp_path_factory.mktemp("signed")
    key = folder / "key"
    key.touch(0o600)
    key.write_text(PASSPHRASE + "\n")
    config = folder / "sentry.toml"
    config.write_text(f'[security]\nkey_file = "{key}"\n[component]\nlisten_s = 0.2\n')
    seen: dict[str, Any] = {"state": folder / "state"}
    with DaemonProcess(("--config", str(config)), state=folder / "state") as daemon:
        vehicle = Station(daemon.port, 1, 1, PASSPHRASE)
        strangers = {
            "bare": Station(daemon.port, 1, 1, None),
            "thief": Station(daemon.port, 1, 1, "a guess"),
            "replay": Station(daemon.port, 1, 1, None),
        }
        ms, end_s = 10_000, time.monotonic() + READY_S
        while not any(m.get_type() == "HEARTBEAT" for m in vehicle.got):
            assert time.monotonic() < end_s, daemon.notes
            ms += 50
            vehicle.say(heartbeat(), attitude(ms))
            vehicle.listen(0.05)
        ask = wire.MAVLink_param_request_list_message(1, 191)
        for k in range(40):
            ms += 50
            for name in ("bare", "thief"):
                strangers[name].say(heartbeat(), attitude(ms + 5_000_000), ask)
            strangers["replay"].put(b"".join(vehicle.sent[-20:]))
            vehicle.say(heartbeat(), attitude(ms), *([ask] if k == 10 else []))
            vehicle.listen(0.05)
        vehicle.listen(0.3)
        for stranger in strangers.values():
            stranger.listen(0.1)
        seen |= {"vehicle": vehicle, "strangers": strangers, "status": daemon.stop()}
        seen |= {"notes": daemon.notes, "last": daemon.last_status}
    yield seen
    for station in (vehicle, *strangers.values()):
        station.socket.close()


def test_who_has_the_key_is_answered_in_signed_packets(flown: dict[str, Any]) -> None:
    got = flown["vehicle"].got
    assert {m.get_type() for m in got} >= {"HEARTBEAT", "PARAM_VALUE"}
    assert not [m for m in got if m.get_type() == "BAD_DATA"]
    assert all(m.get_signed() for m in got)
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in got} == {(1, 191)}


@pytest.mark.parametrize("who", ["bare", "thief", "replay"])
def test_who_has_not_gets_no_answer(flown: dict[str, Any], who: str) -> None:
    assert flown["strangers"][who].got == []


def test_the_vehicle_s_time_is_not_moved_by_a_stranger(flown: dict[str, Any]) -> None:
    """They said that it was 5000 s later."""
    assert flown["status"] == 0
    stamps = [m.time_boot_ms for m in flown["vehicle"].got if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert all(stamp < 1_000_000 for stamp in stamps)


def test_signing_times_are_kept_and_the_key_is_nowhere(flown: dict[str, Any]) -> None:
    state: Path = flown["state"]
    kept = json.loads((state / "signing-191.json").read_text())
    newest = int.from_bytes(flown["vehicle"].sent[-1][-12:-6], "little")
    assert kept["streams"] == [[1, 1, 0, newest]]
    written = [p.read_bytes() for p in state.rglob("*") if p.is_file()]
    secret = hashlib.sha256(PASSPHRASE.encode())
    for text in (*written, flown["notes"].encode(), json.dumps(flown["last"]).encode()):
        assert PASSPHRASE.encode() not in text
        assert secret.digest() not in text
        assert secret.hexdigest().encode() not in text
