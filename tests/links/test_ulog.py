"""ULog: what pyulog reads is read, any chunk gives the same, damage costs what it touched."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from links.logs import LogError, open_log, read_ulog
from links.logs.ulog import columns_of
from links.logs.ulog_format import UlogParser
from links.samples import Batch
from monitor.analyze import analyze_log
from monitor.settings import Settings
from sim_feeds.scenario import load
from sim_feeds.ulog import UlogWriter, dropout, logged, message, parameter, px4_log


@pytest.fixture(scope="module")
def sample(shared_data: Path) -> Path:
    return shared_data / "ulog" / "sample_log_small.ulg"


def topics(raw: bytes, chunk: int) -> dict[tuple[str, int], Any]:
    parser = UlogParser()
    blocks = [parser.feed(raw[i : i + chunk]) for i in range(0, len(raw), chunk)]
    parts: dict[tuple[str, int], list[Any]] = {}
    for block in [*blocks, parser.finish()]:
        for part in block.data:
            parts.setdefault((part.topic.name, part.topic.instance), []).append(part.payload)
    return {key: np.concatenate(rows) for key, rows in parts.items()}


@pytest.mark.parametrize("chunk", [1 << 20, 4099])
def test_every_field_of_every_topic_is_what_pyulog_reads(sample: Path, chunk: int) -> None:
    pyulog = pytest.importorskip("pyulog")
    theirs = {(d.name, d.multi_id): d.data for d in pyulog.ULog(str(sample)).data_list}
    ours = topics(sample.read_bytes(), chunk)
    assert set(ours) == set(theirs)
    for key, rows in ours.items():
        columns = columns_of(rows)
        for name in columns.dtype.names:
            if "_padding" not in name:
                np.testing.assert_array_equal(columns[name], theirs[key][name], err_msg=f"{key}")


def rows_of(path: Path, chunk: int) -> Batch:
    return Batch.concatenate(read_ulog(path, chunk=chunk))


@pytest.mark.parametrize("chunk", [7777, 100_003])
def test_a_chunk_of_any_size_gives_the_same_rows(sample: Path, chunk: int) -> None:
    whole, cut = rows_of(sample, 1 << 22), rows_of(sample, chunk)
    assert whole.rejected == cut.rejected
    assert {s: r.tobytes() for s, r in whole.rows.items()} == {
        s: r.tobytes() for s, r in cut.rows.items()
    }


def test_the_recorded_log_is_known_for_what_it_is(sample: Path) -> None:
    log = open_log(sample)
    batch = Batch.concatenate(log)
    assert (log.info.format, log.info.messages, log.info.bad_bytes) == ("ulg", 15_900, 0)
    assert log.info.vehicle.autopilot == 12
    assert log.info.sources["imu0"] == "sensor_combined"  # vehicle_imu was logged at 2 Hz
    assert "imu1" not in batch.rows
    assert len(batch.rows["param"]) == 980
    assert bytes(batch.rows["text"]["text"][0]) == b"[commander] Takeoff detected"
    assert np.abs(np.median(batch.rows["imu0"]["acc_m_s2"], axis=0)[2] + 9.81) < 0.2
    assert log.info.gaps == [(batch.rows["imu0"]["t_us"][0], 30_000)] or len(log.info.gaps) == 1


def test_damage_costs_what_it_touched(sample: Path, tmp_path: Path) -> None:
    raw = bytearray(sample.read_bytes())
    raw[500_000:500_400] = bytes(range(200)) * 2
    file = tmp_path / "damaged.ulg"
    file.write_bytes(b"garbage in front" + raw[:-100])
    log = read_ulog(file)
    batch = Batch.concatenate(log)
    whole = rows_of(sample, 1 << 20)
    assert 300 < log.info.bad_bytes < 3000
    assert len(whole.rows["imu0"]) - len(batch.rows["imu0"]) < 10


def definitions(log: UlogWriter) -> bytes:
    """The log with parameters, information and a format that has no data among the others."""
    key = b"char[40] ver_sw"
    info = message("I", bytes([len(key)]) + key + b"0" * 40)
    several = message("M", bytes([0, len(key)]) + key + b"1" * 40)
    log.parameters = parameter("ONE", 1.0) + info + several + parameter("TWO", 2.0)
    for k in range(4):
        t = np.arange(1_000_000, 6_000_000, 50_000) + k
        log.topic(f"topic_{k}" if k else "airspeed", "float indicated_airspeed_m_s", t, {})
    return log.content()


def test_a_damaged_size_in_the_definitions_costs_one_message(tmp_path: Path) -> None:
    raw = definitions(UlogWriter(1_000_000))
    file = tmp_path / "x.ulg"
    at, lost = 16, []
    while raw[at + 2] != ord("D"):
        size = int.from_bytes(raw[at : at + 2], "little")
        for bit in range(16):
            file.write_bytes(raw[:at] + (size ^ 1 << bit).to_bytes(2, "little") + raw[at + 2 :])
            with contextlib.suppress(LogError):
                if len(Batch.concatenate(read_ulog(file)).rows.get("airspeed0", ())) == 100:
                    continue
            lost.append((chr(raw[at + 2]), raw[at + 3 : at + 3 + size]))
        at += 3 + size
    assert {kind for kind, _ in lost} == {"F", "A"}
    assert all(b"airspeed" in body for _, body in lost)


def test_a_damaged_format_costs_its_topic_alone(tmp_path: Path) -> None:
    """Every message of the topic then has a size that its format does not tell."""
    raw = definitions(UlogWriter(1_000_000))
    file = tmp_path / "x.ulg"
    file.write_bytes(raw.replace(b"topic_2:uint64_t timestamp;", b"topic_2:uint16_t timestamp;"))
    reader = read_ulog(file)
    rows = Batch.concatenate(reader).rows
    assert len(rows["airspeed0"]) >= 99
    assert reader.info.bad_bytes < 100


def test_what_is_no_ulog_is_refused_in_a_sentence(tmp_path: Path) -> None:
    file = tmp_path / "x.ulg"
    file.write_bytes(b"no log at all" * 100)
    with pytest.raises(LogError, match="has no data"):
        list(open_log(file))


def test_parameters_texts_dropouts_and_the_pressure_offset(tmp_path: Path) -> None:
    log = UlogWriter(1_000_000)
    log.parameters = parameter("SENS_DPRES_OFF", 10.0)
    t = np.arange(1_000_000, 3_000_000, 50_000)
    pressure = {"differential_pressure_pa": 110.0}
    log.topic("differential_pressure", "float differential_pressure_pa", t, pressure)
    log.put(2_000_000, logged(2_000_000, "airspeed0 FAULTY"))
    log.put(2_000_000, dropout(40))
    file = tmp_path / "x.ulg"
    file.write_bytes(log.content())
    reader = read_ulog(file)
    rows = Batch.concatenate(reader).rows
    np.testing.assert_allclose(rows["airspeed0"]["cas_m_s"], np.sqrt(2.0 * 100.0 / 1.225))
    assert rows["text"]["severity"].tolist() == [4]
    assert rows["param"]["t_us"].tolist() == [1_000_000]
    assert reader.info.gaps == [(2_000_000, 40_000)]


def found(tmp_path: Path, name: str, **how: bool) -> Iterator[tuple[str, float]]:
    file = tmp_path / f"{name}.ulg"
    file.write_bytes(px4_log(load(name).fly(), **how).content())
    for fault in analyze_log(file, Settings()).faults:
        yield fault["sensor"], fault["onset_s"]


@pytest.mark.parametrize("name", ["small-uav-imu-bias", "small-uav-pitot-blockage"])
def test_injected_faults_are_found_in_a_px4_log(tmp_path: Path, name: str) -> None:
    injected = {f.sensor: f.start_s for f in load(name).faults()}
    faults = dict(found(tmp_path, name))
    assert set(faults) == set(injected)
    for sensor, onset_s in faults.items():
        assert abs(onset_s - injected[sensor]) < 15.0


def test_a_healthy_flight_logged_as_px4_does_by_default_is_healthy(tmp_path: Path) -> None:
    assert list(found(tmp_path, "small-uav-healthy", seldom=True)) == []
