"""The daemon as a process among others: an autopilot that answers, a station, a second vehicle."""

import socket
import time
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as wire

from links.mavlink import Encoder
from links.mavlink.dialect import load_dialect
from monitor.commands.daemon_process import DaemonProcess
from sim_feeds.answering import AnsweringAutopilot
from sim_feeds.player import frames
from sim_feeds.scenario import load

from .test_live import READY_S

SLOW_HZ = 3.0
SPEED = 2.0
NUMBER = {name: message.id for name, message in load_dialect("ardupilotmega").by_name.items()}


class Network:
    """One UDP socket that is everybody but the daemon; what the daemon says, by pymavlink."""

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._to = ("127.0.0.1", port)
        self._parser = wire.MAVLink(None)
        self.pilot = AnsweringAutopilot(1, SLOW_HZ)
        self.said: list[tuple[float, object]] = []
        self.t_us = 1_000_000
        self._first_us: int | None = None

    def close(self) -> None:
        self._socket.close()

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, self._to)

    def listen(self) -> None:
        """Take what has come, and let the autopilot answer."""
        while True:
            try:
                data = self._socket.recv(4096)
            except BlockingIOError:
                return
            for message in self._parser.parse_buffer(data) or ():
                self.said.append((time.monotonic(), message))
            for answer in self.pilot.hear(data, self.t_us):
                self.send(answer)

    def rest(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self.listen()
            time.sleep(0.01)

    def fly(self, flight, until_s: float, each=lambda: None) -> None:
        """Play until so many seconds of flight have passed."""
        begin_s = None
        for t_us, frame in flight:
            now_s = time.monotonic()
            self._first_us = t_us if self._first_us is None else self._first_us
            begin_s = now_s - t_us / 1e6 / SPEED if begin_s is None else begin_s
            self.t_us = t_us
            if (wait_s := begin_s + t_us / 1e6 / SPEED - now_s) > 0.002:
                self.rest(wait_s)
            if (due := self.pilot.send(t_us, frame)) is not None:
                self.send(due)
            each()
            if (t_us - self._first_us) / 1e6 > until_s:
                return

    def of(self, kind: str) -> list:
        return [m for _, m in self.said if m.get_type() == kind]


def station_command(number: int, *params: float, system=255, component=190) -> bytes:
    sender = wire.MAVLink(None, system, component)
    values = [*params, *[0.0] * (7 - len(params))]
    return bytes(sender.command_long_encode(1, 191, number, 0, *values).pack(sender))


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A flight of which the daemon wants more, asked things by a station and a strange vehicle."""
    log = tmp_path_factory.mktemp("log") / "events.jsonl"
    with DaemonProcess(("--log", str(log))) as daemon:
        network = Network(daemon.port)
        try:
            _flown(network, daemon)
            network.log = log.read_text()
            yield network, daemon
        finally:
            network.close()


def _flown(network: Network, daemon: DaemonProcess) -> None:
    other, clash = Encoder(9, 1), Encoder(1, 191)
    beat = {"type": 1, "autopilot": 3, "system_status": 4, "mavlink_version": 3}
    flight = frames(load("demo"))
    end_s = time.monotonic() + READY_S
    while not network.said and time.monotonic() < end_s:  # an autopilot on the bench
        network.send(Encoder(1, 1).encode("HEARTBEAT", **beat))
        network.rest(0.5)
    assert network.said, f"the daemon is not ready after {READY_S} s: {daemon.notes}"
    network.fly(flight, 20.0)
    network.fast = dict(network.pilot.intervals_us)
    network.send(other.encode("HEARTBEAT", **beat))
    network.send(station_command(512, NUMBER["AUTOPILOT_VERSION"]))
    network.send(station_command(246, 1))
    network.send(station_command(512, NUMBER["HEARTBEAT"], system=9, component=1))
    network.send(Encoder(255, 190).encode("PING", time_usec=5, seq=8))
    network.send(Encoder(255, 190).encode("TIMESYNC", tc1=0, ts1=4711))
    network.fly(flight, 23.0)
    for _ in range(3):
        network.send(clash.encode("HEARTBEAT", type=18, autopilot=8, system_status=4))
    network.fly(flight, 26.0)
    network.status = daemon.stop()
    network.rest(1.0)


def test_streams_are_asked_for_and_come(flown):
    network, daemon = flown
    # of the two that carry the attitude, the one that is used
    for name in ("RAW_IMU", "ATTITUDE_QUATERNION", "SCALED_PRESSURE"):
        assert network.fast[NUMBER[name]] < 0.9e6 / SLOW_HZ, (name, daemon.notes)
    asked = [m for m in network.of("COMMAND_LONG") if m.command == 511]
    assert {(m.target_system, m.target_component) for m in asked} == {(1, 1)}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in asked} == {(1, 191)}


def test_streams_are_put_back_at_the_end(flown):
    network, daemon = flown
    assert network.status == 0, daemon.notes
    initial_us = round(1e6 / SLOW_HZ)
    assert all(us in (initial_us, -1) for us in network.pilot.intervals_us.values())
    assert network.pilot.intervals_us[NUMBER["RAW_IMU"]] == initial_us


def test_a_station_is_answered_and_another_vehicle_is_not(flown):
    network, daemon = flown
    acks = {(m.command, m.result, m.target_system) for m in network.of("COMMAND_ACK")}
    assert acks == {
        (512, wire.MAV_RESULT_ACCEPTED, 255),
        (246, wire.MAV_RESULT_DENIED, 255),
    }, daemon.notes
    (version,) = network.of("AUTOPILOT_VERSION")
    assert version.capabilities & wire.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    assert any("reboot" in m.text for m in network.of("STATUSTEXT"))
    (pong,) = network.of("PING")
    assert (pong.seq, pong.target_system, pong.target_component) == (8, 255, 190)
    assert [m.ts1 for m in network.of("TIMESYNC") if m.tc1] == [4711]


def test_its_own_timesync_goes_to_the_autopilot_now_and_then(flown):
    network, _ = flown
    requests = [at for at, m in network.said if m.get_type() == "TIMESYNC" and not m.tc1]
    assert len(requests) >= 4
    assert all(b - a > 0.9 for a, b in pairwise(requests))


def test_another_sender_with_our_id_is_said_once(flown):
    network, daemon = flown
    texts = [m.text for m in network.of("STATUSTEXT") if "our id" in m.text]
    assert texts == ["MAVSENTRY: another sender has our id 191"], daemon.notes


def test_the_second_vehicle_is_told(flown):
    network, _ = flown
    assert "vehicle 1 is watched; also heard: 9" in network.log
    assert "another sender uses our id" in network.log
