"""The component behind real bytes: pymavlink asks, frames go through the gate's reception.

What answers is parsed by pymavlink again, so that both directions are held against it.
"""

import io
import random
import struct

import pytest
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

from links.mavlink import Decoder, Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.reception import Reception, ReceptionOptions
from monitor.component.assembly import assemble, identify
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.settings import Settings

S = 1_000_000
OURS = (7, 191)
DIALECT = load_dialect("ardupilotmega")


class Vehicle:
    """Bytes in, messages out: what the loop does, without its clock."""

    def __init__(self, **component: object) -> None:
        settings = Settings.model_validate({"component": {"listen_s": 0} | component})
        decoder = Decoder(settings.links.decoder_options())
        publisher = Publisher(settings.publish, Encoder(1, 191).has)
        self.component = assemble(
            settings, identify(settings, decoder), decoder, Pipeline(settings), publisher
        )
        self.decoder = decoder
        self.reception = Reception(ReceptionOptions(), ["a", "b"], wants=self.component.wants)
        self.encoders: dict[tuple[int, int], Encoder] = {}
        self.parser = dialect.MAVLink(io.BytesIO())
        self.parser.robust_parsing = True
        self.now_us = 0

    def hears(self, data: bytes, link: int = 0) -> list[tuple[int | None, object]]:
        """(link, message) of every answer and of all that is due then."""
        self.now_us += S // 10
        received = self.reception.take([(link, data, self.now_us, None)])
        self.decoder.feed(received.data, self.now_us)
        out = []
        for heard in received.heard:
            out += self.component.hear(heard, self.now_us)
        out += self.component.due(self.now_us)
        self.reception.own = address = self.component.address
        if address is None:
            return []
        encoder = self.encoders.setdefault(address, Encoder(*address))
        parsed = []
        for message in out:
            frame = encoder.encode(message.name, **message.fields)
            self.component.sent(frame)
            (there,) = self.parser.parse_buffer(frame)
            parsed.append((message.link, there))
        return parsed


@pytest.fixture
def autopilot() -> dialect.MAVLink:
    return dialect.MAVLink(None, 7, 1)


@pytest.fixture
def station() -> dialect.MAVLink:
    return dialect.MAVLink(None, 255, 190)


def beat(sender: dialect.MAVLink, autopilot: int = 3) -> bytes:
    return sender.heartbeat_encode(1, autopilot, 0, 0, 4).pack(sender)


def stamp(sender: dialect.MAVLink) -> bytes:
    return sender.system_time_encode(0, 5000).pack(sender)


def command(sender: dialect.MAVLink, number: int, *params: float, target=OURS) -> bytes:
    values = [*params, *[0.0] * (7 - len(params))]
    return sender.command_long_encode(*target, number, 0, *values).pack(sender)


def started(vehicle: Vehicle, autopilot: dialect.MAVLink) -> Vehicle:
    vehicle.hears(beat(autopilot) + stamp(autopilot))
    return vehicle


def test_a_ground_station_asks_over_either_link(autopilot, station):
    vehicle = started(Vehicle(), autopilot)
    for link in (0, 1):
        vehicle.now_us += S  # later than a copy of the same command would come
        answers = vehicle.hears(command(station, 512, 148), link)
        told = {m.get_type(): m for at, m in answers if at == link}
        assert told["COMMAND_ACK"].result == dialect.MAV_RESULT_ACCEPTED
        assert (told["COMMAND_ACK"].target_system, told["COMMAND_ACK"].target_component) == (
            255,
            190,
        )
        version = told["AUTOPILOT_VERSION"]
        assert (version.get_srcSystem(), version.get_srcComponent()) == OURS
        assert version.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2


def test_a_reboot_is_refused_and_the_reason_is_text(autopilot, station):
    vehicle = started(Vehicle(), autopilot)
    answers = vehicle.hears(command(station, 246, 1)) + vehicle.hears(b"")
    told = {m.get_type(): m for _, m in answers}
    assert told["COMMAND_ACK"].result == dialect.MAV_RESULT_DENIED
    assert "reboot" in told["STATUSTEXT"].text


def test_commands_to_the_autopilot_or_another_vehicle_are_not_answered(autopilot, station):
    vehicle = started(Vehicle(timesync_s=0), autopilot)
    for target in ((7, 1), (8, 191), (255, 191)):
        assert vehicle.hears(command(station, 400, 1, target=target)) == []


def test_another_vehicle_s_autopilot_commands_nothing(autopilot):
    vehicle = started(Vehicle(timesync_s=0), autopilot)
    other = dialect.MAVLink(None, 8, 1)
    vehicle.hears(beat(other))
    assert vehicle.hears(command(other, 512, 148)) == []
    assert "8" in vehicle.component.notes[0]


def test_ping_and_timesync_over_bytes(autopilot, station):
    vehicle = started(Vehicle(timesync_s=0), autopilot)
    ((_, pong),) = vehicle.hears(station.ping_encode(123456789, 3, 0, 0).pack(station), 1)
    assert (pong.get_type(), pong.time_usec, pong.seq) == ("PING", 123456789, 3)
    assert (pong.target_system, pong.target_component) == (255, 190)
    ((link, answer),) = vehicle.hears(station.timesync_encode(0, 42).pack(station), 1)
    assert (link, answer.get_type(), answer.ts1) == (1, "TIMESYNC", 42)
    assert answer.tc1 == vehicle.now_us * 1000
    assert vehicle.hears(station.timesync_encode(99, 42).pack(station)) == []


def test_the_autopilot_s_clock_is_asked_and_understood(autopilot):
    vehicle = started(Vehicle(), autopilot)
    ahead_ns = 5_000_000_000
    for _ in range(20):
        for _, m in vehicle.hears(beat(autopilot)):
            if m.get_type() == "TIMESYNC":
                reply = autopilot.timesync_encode(m.ts1 + ahead_ns + 50_000_000, m.ts1)
                vehicle.hears(reply.pack(autopilot))
    assert any("+5.0" in fact for fact in vehicle.component.facts)


def framed(name: str, payload: bytes, sender: tuple[int, int], sequence: int) -> bytes:
    """A frame with a right checksum around any payload."""
    message = DIALECT.by_name[name]
    head = bytes([len(payload), 0, 0, sequence & 0xFF, *sender]) + message.id.to_bytes(3, "little")
    crc = mcrf4xx(head + payload + bytes([message.crc_extra]))
    return b"\xfd" + head + payload + crc.to_bytes(2, "little")


def test_no_payload_of_any_message_stops_the_component(autopilot):
    vehicle, draw = started(Vehicle(), autopilot), random.Random(1)
    names = sorted(vehicle.component.wants & DIALECT.by_name.keys())
    senders = [(255, 190), (7, 1), (7, 191), (7, 240), (9, 1), (0, 0)]
    answers = 0
    for k in range(4000):
        name = names[k % len(names)]
        size = DIALECT.by_name[name].packer.size
        payload = bytearray(draw.randbytes(size))
        if draw.random() < 0.7:  # to us, where the message has a target
            fields = DIALECT.by_name[name].dtype.fields
            for field, value in (("target_system", 7), ("target_component", 191)):
                if field in fields:
                    payload[fields[field][1]] = value
            if name.startswith("COMMAND_") and name != "COMMAND_ACK":
                number = draw.choice([246, 510, 511, 512, 520, draw.randrange(1 << 16)])
                at = fields["command"][1]
                payload[at : at + 2] = number.to_bytes(2, "little")
                if draw.random() < 0.5:
                    payload[:4] = struct.pack("<f", draw.choice([0, 148, 251, 253, 231]))
        data = framed(name, bytes(payload[: draw.randrange(1, size + 1)]), draw.choice(senders), k)
        answers += len(vehicle.hears(data, k % 2))
    assert answers > 100
