"""What others said stands in every kind of log, dated by the vehicle's clock, and is no sensor."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from links.logs import LogError, TlogWriter, read_dataflash, read_tlog, read_ulog
from links.mavlink import DecoderOptions, Encoder
from links.samples import WORD, Batch
from sim_feeds.dataflash import DataflashWriter
from sim_feeds.ulog import UlogWriter, logged

UNIX_US = 1_700_000_000_000_000
STAMP = {"time_boot_ms": 0}


def heard(words: np.ndarray) -> list[tuple[Any, ...]]:
    return [tuple(word) for word in words.tolist()]


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Ten seconds of attitude; a monitor, another component and another vehicle speak."""
    vehicle, monitor, camera = (Encoder(1, component) for component in (1, 191, 100))
    other = Encoder(2, 191)
    zero = dict.fromkeys(("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"), 0.0)
    beat = {"type": 1, "autopilot": 3, "base_mode": 0, "custom_mode": 0, "system_status": 4}
    file = tmp_path / "flight.tlog"
    with TlogWriter(file) as log:
        # Before the vehicle is known and has a clock; dated by its first stamp.
        log.write(monitor.encode("STATUSTEXT", severity=2, text="early"), UNIX_US)
        log.write(vehicle.encode("HEARTBEAT", mavlink_version=3, **beat), UNIX_US)
        for k in range(100):
            t_ms = 20_000 + 100 * k
            stamp = UNIX_US + 100_000 * k
            log.write(vehicle.encode("ATTITUDE", time_boot_ms=t_ms, **zero), stamp)
            if k in (30, 60):
                named = {"time_boot_ms": 5, "name": "FLT_AIR", "value": k / 30}
                log.write(monitor.encode("NAMED_VALUE_FLOAT", **named), stamp)
                log.write(other.encode("NAMED_VALUE_FLOAT", **named), stamp)
            if k == 50:
                log.write(camera.encode("STATUSTEXT", severity=6, text="click"), stamp)
                log.write(vehicle.encode("STATUSTEXT", severity=6, text="mine"), stamp)
    return file


@pytest.mark.parametrize("chunk", [1 << 20, 997, 61])
def test_a_telemetry_log_tells_who_said_what_when(flight: Path, chunk: int) -> None:
    batch = Batch.concatenate(read_tlog(flight, chunk=chunk))
    assert heard(batch.words) == [
        (20_000_000, 1, 191, b"", 0.0, b"early"),
        (23_000_000, 1, 191, b"FLT_AIR", 1.0, b""),
        (25_000_000, 1, 100, b"", 0.0, b"click"),
        (26_000_000, 1, 191, b"FLT_AIR", 2.0, b""),
    ]
    assert set(batch.rows) == {"attitude", "heartbeat", "text"}
    assert {text.rstrip(b"\0") for text in batch.rows["text"]["text"].tolist()} == {
        b"click",
        b"mine",
    }


def test_words_of_no_vehicle_wait_in_bounded_memory(tmp_path: Path) -> None:
    monitor = Encoder(1, 191)
    file = tmp_path / "alone.tlog"
    with TlogWriter(file) as log:
        for k in range(900):
            log.write(monitor.encode("STATUSTEXT", severity=6, text=str(k)), UNIX_US + k)
    reader = read_tlog(file, DecoderOptions(hold_back=100), chunk=500)
    with pytest.raises(LogError, match="no message of a vehicle"):
        list(reader)
    assert sum(len(words) for _, words in reader._words._waiting) == 100


def test_our_own_frames_fill_no_gap_of_the_recording(tmp_path: Path) -> None:
    monitor, vehicle = Encoder(1, 191), Encoder(1, 1)
    beat = {"type": 1, "autopilot": 3, "base_mode": 0, "custom_mode": 0, "system_status": 4}
    file = tmp_path / "gap.tlog"
    with TlogWriter(file) as log:
        for k in range(60):
            sender = monitor if 10 <= k < 40 else vehicle
            log.write(sender.encode("HEARTBEAT", mavlink_version=3, **beat), UNIX_US + k * 10**6)
    reader = read_tlog(file)
    assert sum(map(len, reader)) >= 0
    assert reader.info.gaps == [(UNIX_US + 9_000_000, 31_000_000)]


@pytest.fixture
def dataflash(tmp_path: Path) -> Path:
    """As ArduPilot logs them: NVAL with its sender, MSG with the sender before the text."""
    log = DataflashWriter()
    log.define("NVAL", "QINfBB", "TimeUS,TimeBootMS,Name,Value,SSys,SCom")
    log.define("MSG", "QZ", "TimeUS,Message")
    log.define("RPM", "QBfff", "TimeUS,I,RPM,Qual,H")
    long = "wing_right.lift FAULTY: 14.2 % low since 125 s...."
    log.put("MSG", 1_000_000, "ArduPlane V4.6.0")
    for k in range(10):
        t_us = 1_000_000 * (k + 1)
        log.put("RPM", t_us, 0, 4000.0, 1.0, 1.0)
        log.put("NVAL", t_us + 1, 1, "FLT_WNG", 4.0, 1, 191)
        if k == 4:
            log.put("MSG", t_us + 2, "SRC=1/191:" + long)
            log.put("MSG", t_us + 3, "GCS:airspeed0 FAULTY: not a monitor")
    file = tmp_path / "flight.BIN"
    file.write_bytes(log.content())
    return file


@pytest.fixture
def ulog(tmp_path: Path) -> Path:
    """As PX4 logs them: named values of anyone, texts with the component before them."""
    log = UlogWriter(1_000_000)
    t_us = np.arange(1, 11) * 1_000_000
    log.topic("rpm", "float rpm_estimate", t_us, {"rpm_estimate": 4000.0})
    columns = {"key": b"FLT_WNG", "value": 4.0}
    log.topic("debug_key_value", "char[10] key;float value", t_us + 1, columns)
    text = "[mavlink: component 191] wing_right.lift FAULTY: 14.2 % low since 125 s...."
    log.put(5_000_002, logged(5_000_002, text))
    log.put(5_000_003, logged(5_000_003, "[commander] Takeoff detected"))
    file = tmp_path / "flight.ulg"
    file.write_bytes(log.content())
    return file


READERS: dict[str, Callable[..., Any]] = {"dataflash": read_dataflash, "ulog": read_ulog}


@pytest.mark.parametrize("chunk", [1 << 20, 700])
@pytest.mark.parametrize(
    ("kind", "named", "texts"), [("dataflash", (1, 191), (1, 191)), ("ulog", (0, 0), (0, 191))]
)
def test_the_autopilots_own_logs_tell_it_too(kind, named, texts, chunk, request) -> None:
    batch = Batch.concatenate(READERS[kind](request.getfixturevalue(kind), chunk=chunk))
    words = batch.words
    assert words.dtype == WORD
    values = words[words["name"] != b""]
    assert heard(values) == [
        (1_000_000 * k + 1, *named, b"FLT_WNG", 4.0, b"") for k in range(1, 11)
    ]
    assert heard(words[words["name"] == b""]) == [
        (5_000_002, *texts, b"", 0.0, b"wing_right.lift FAULTY: 14.2 % low since 125 s....")
    ]


@pytest.mark.parametrize("kind", ["dataflash", "ulog"])
def test_damage_costs_words_and_never_the_log(kind, request, tmp_path: Path) -> None:
    content = bytearray(request.getfixturevalue(kind).read_bytes())
    random = np.random.default_rng(1)
    for at in random.integers(300, len(content), 40):
        content[at] ^= 1 << random.integers(8)
    file = tmp_path / "damaged"
    file.write_bytes(content)
    words = Batch.concatenate(READERS[kind](file)).words
    assert len(words) <= 12
    assert words.dtype == WORD
