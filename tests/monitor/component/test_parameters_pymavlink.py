"""Our parameters read and set by pymavlink's own client, over UDP on the loopback."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.mavparm import MAVParmDict

from links.mavlink import Decoder, Encoder
from links.mavlink.reception import Reception, ReceptionOptions
from monitor.component.assembly import assemble, identify
from monitor.component.parameters import Parameters
from monitor.component.tunables import RESET, TUNABLES, Type
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.settings import Settings
from monitor.tuning import Tuning

OURS = (7, 191)
ARDUPILOT, PX4 = 3, 12
COUNT = len(TUNABLES) + 1


class Monitor(threading.Thread):
    """The component on a socket: reception, services, encoder; no samples are judged."""

    def __init__(self, autopilot: int) -> None:
        super().__init__(daemon=True)
        settings = Settings.model_validate(
            {"component": {"listen_s": 0, "parameter_hz": 1000, "request_streams": False}}
        )
        decoder = Decoder(settings.links.decoder_options())
        pipeline, publisher = Pipeline(settings), Publisher(settings.publish, Encoder(1, 191).has)
        identity = identify(settings, decoder)
        self.tuning = Tuning(settings, [pipeline.retune, publisher.retune])
        self.parameters = Parameters(settings.component, identity, self.tuning)
        self.component = assemble(
            settings,
            identity,
            decoder,
            pipeline,
            publisher,
            others=[self.parameters],
            capabilities=lambda: self.parameters.capabilities,
        )
        self.reception = Reception(ReceptionOptions(), ["udp"], wants=self.component.wants)
        self.decoder = decoder
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.005)
        sender = dialect.MAVLink(None, 7, 1)
        for data in (
            sender.heartbeat_encode(1, autopilot, 0, 0, 4).pack(sender),
            sender.system_time_encode(0, 5000).pack(sender),
        ):
            self.use(data)
        self.stopped = threading.Event()

    def use(self, data: bytes) -> list[bytes]:
        now_us = time.monotonic_ns() // 1000
        received = self.reception.take([(0, data, now_us, None)])
        self.decoder.feed(received.data, now_us)
        out = [m for heard in received.heard for m in self.component.hear(heard, now_us)]
        out += self.component.due(now_us)
        address = self.component.address
        self.reception.own = address
        if address is None:
            return []
        self.encoder = getattr(self, "encoder", None) or Encoder(*address)
        frames = [self.encoder.encode(m.name, **m.fields) for m in out]
        for frame in frames:
            self.component.sent(frame)
        return frames

    def run(self) -> None:
        peer = None
        while not self.stopped.is_set():
            try:
                data, peer = self.socket.recvfrom(4096)
            except TimeoutError:
                data = b""
            for frame in self.use(data):
                if peer is not None:
                    self.socket.sendto(frame, peer)


@pytest.fixture
def monitor(request: pytest.FixtureRequest) -> Iterator[Monitor]:
    here = Monitor(request.param)
    here.start()
    yield here
    here.stopped.set()
    here.join(5.0)
    here.socket.close()


@pytest.fixture
def station(monitor: Monitor) -> Iterator[mavutil.mavfile]:
    port = monitor.socket.getsockname()[1]
    there = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{port}", source_system=255, dialect="ardupilotmega"
    )
    there.target_system, there.target_component = OURS
    yield there
    there.close()


def values(station: mavutil.mavfile, seconds: float = 5.0) -> dict[str, dialect.MAVLink_message]:
    """All of the list."""
    station.mav.param_request_list_send(*OURS)
    found: dict[str, dialect.MAVLink_message] = {}
    end = time.monotonic() + seconds
    while len(found) < COUNT and time.monotonic() < end:
        message = station.recv_match(type="PARAM_VALUE", blocking=True, timeout=1.0)
        if message is not None:
            assert (message.get_srcSystem(), message.get_srcComponent()) == OURS
            assert message.param_count == COUNT
            found[message.param_id] = message
    return found


def whole(message: dialect.MAVLink_message) -> int:
    """A whole number whose bytes were sent."""
    return int(struct.unpack("<I", struct.pack("<f", message.param_value))[0])


both = pytest.mark.parametrize("monitor", [ARDUPILOT, PX4], indirect=True)


@both
def test_the_list_comes_whole_and_one_is_read_by_name_and_index(
    monitor: Monitor, station: mavutil.mavfile
) -> None:
    found = values(station)
    assert list(found) == [t.name for t in (*TUNABLES, RESET)]
    assert [m.param_index for m in found.values()] == list(range(COUNT))
    for asked, name in (("AIR_CONFIRM", "AIR_CONFIRM"), (4, TUNABLES[4].name)):
        station.param_fetch_one(asked)
        message = station.recv_match(type="PARAM_VALUE", blocking=True, timeout=2.0)
        assert message is not None
        assert message.param_id == name


@both
def test_pymavlink_s_client_sets_a_number(monitor: Monitor, station: mavutil.mavfile) -> None:
    client = MAVParmDict()
    assert client.mavset(station, "IMU_LONE_SIG", 7.25)
    assert monitor.tuning.get("imu.single_sigma") == 7.25
    found = values(station)
    assert found["IMU_LONE_SIG"].param_value == 7.25
    assert client.mavset(station, "IMU_LONE_SIG", 1e9)  # echoed, with what is in force
    assert values(station)["IMU_LONE_SIG"].param_value == 7.25


@pytest.mark.parametrize("monitor", [ARDUPILOT], indirect=True)
def test_a_mask_is_a_plain_number_with_ardupilot(
    monitor: Monitor, station: mavutil.mavfile
) -> None:
    assert MAVParmDict().mavset(station, "MUTE_AIR", 0x103)
    assert values(station)["MUTE_AIR"].param_value == 0x103
    assert monitor.tuning.settings.mute.sensors == {"airspeed0", "airspeed1", "aoa0"}


@pytest.mark.parametrize("monitor", [PX4], indirect=True)
def test_a_mask_travels_as_its_bytes_with_px4(monitor: Monitor, station: mavutil.mavfile) -> None:
    assert MAVParmDict().mavset(station, "MUTE_AIR", 0x103, parm_type=int(Type.UINT16))
    assert whole(values(station)["MUTE_AIR"]) == 0x103
    assert monitor.tuning.settings.mute.sensors == {"airspeed0", "airspeed1", "aoa0"}
    assert MAVParmDict().mavset(station, "MUTE_AIR", 1)  # as a float: the wrong type
    assert whole(values(station)["MUTE_AIR"]) == 0x103


@both
def test_a_saved_file_is_loaded_back(
    monitor: Monitor, station: mavutil.mavfile, tmp_path: object
) -> None:
    """What a station saves it can load: numbers as they are, over a reset."""
    MAVParmDict().mavset(station, "IMU_LONE_SIG", 7.5)
    saved = MAVParmDict()
    saved.update({n: m.param_value for n, m in values(station).items() if m.param_type == 9})
    name = f"{tmp_path}/monitor.parm"
    saved.save(name)
    reset = struct.unpack("<f", struct.pack("<I", 1))[0] if monitor.parameters.bytewise else 1.0
    station.mav.param_set_send(*OURS, b"PARAM_RESET", reset, int(Type.UINT8))
    end = time.monotonic() + 5.0
    while monitor.tuning.own and time.monotonic() < end:
        time.sleep(0.01)
    fresh = MAVParmDict()
    fresh.update({n: m.param_value for n, m in values(station).items() if m.param_type == 9})
    assert fresh["IMU_LONE_SIG"] == 6.0
    fresh.load(name, mav=station)
    assert monitor.tuning.own == {"imu.single_sigma": 7.5}
