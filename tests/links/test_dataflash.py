"""DataFlash: what DFReader reads is read, any chunk gives the same, damage costs what it hit."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from links import catalog_dataflash as table
from links.clock import VehicleClock
from links.dataflash_columns import COLUMNS
from links.logs import LogError, dataflash, open_log, read_dataflash
from links.logs.dataflash_parser import DataflashParser
from links.mavlink import DecoderOptions
from links.samples import Batch
from links.vocabulary import Rejection
from monitor.analyze import analyze_log
from monitor.settings import Settings
from sim_feeds.dataflash import DataflashWriter

PART = 1_500_000
"""Bytes of the recorded log that the slower tests read: FMT, parameters, half a minute's flight."""


@pytest.fixture(scope="module")
def flight(shared_data: Path) -> Path:
    return shared_data / "sitl" / "f6_accel_bias.BIN"


@pytest.fixture(scope="module")
def raw(flight: Path) -> bytes:
    with flight.open("rb") as file:
        return file.read(PART)


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Any]:
    """Content of a file to its batch and its reader."""

    def run(content: bytes, chunk: int = 1 << 20, **options: Any) -> Any:
        file = tmp_path / "x.BIN"
        file.write_bytes(content)
        reader = read_dataflash(file, DecoderOptions(**options), chunk=chunk)
        return Batch.concatenate(reader), reader

    return run


def test_every_field_that_is_used_is_what_dfreader_reads(tmp_path: Path, raw: bytes) -> None:
    dfreader = pytest.importorskip("pymavlink.DFReader")
    file = tmp_path / "part.BIN"
    file.write_bytes(raw)
    theirs: dict[str, dict[str, list[Any]]] = {}
    counts: Counter[str] = Counter()
    log = dfreader.DFReader_binary(str(file), zero_time_base=False)
    while (message := log.recv_msg()) is not None:
        counts[message.get_type()] += 1
        columns = theirs.setdefault(message.get_type(), {})
        for name in message.get_fieldnames():
            columns.setdefault(name, []).append(getattr(message, name))
    log.data_map.close()
    log.filehandle.close()
    parser = DataflashParser()
    parts: dict[str, dict[str, list[Any]]] = {}
    for steps in (parser.feed(raw), parser.finish()):
        for part in (part for step in steps for part in step):
            for name, values in part.columns():
                parts.setdefault(part.format.name, {}).setdefault(name, []).append(values)
    used = [name for name in COLUMNS if name in theirs]
    assert len(used) >= 18
    assert {name: counts[name] for name in used} == {name: parser.by_name[name] for name in used}
    for name in used:
        for column, pieces in parts[name].items():
            ours = np.concatenate(pieces)
            if ours.dtype.kind == "S":
                assert [v.decode() for v in ours.tolist()] == theirs[name][column]
            else:
                np.testing.assert_array_equal(ours, theirs[name][column], err_msg=name + column)


@pytest.mark.parametrize("chunk", [997, 65_537])
def test_a_chunk_of_any_size_gives_the_same_rows(
    read: Callable[..., Any], raw: bytes, same_batch: Callable[..., None], chunk: int
) -> None:
    content = raw[: PART // 4 if chunk < 1000 else PART]
    content += raw[:300_000] + b"garbage" + raw[600_000:700_000]
    same_batch(read(content)[0], read(content, chunk)[0])


def test_the_same_flight_in_both_formats_has_the_same_faults(flight: Path) -> None:
    found = []
    for file in (flight, flight.with_suffix(".tlog")):
        result = analyze_log(file, Settings())
        zero_s = 0.0 if file.suffix == ".tlog" else 28.945
        found.append([(f["sensor"], f["kind"], f["onset_s"] + zero_s) for f in result.faults])
    faults = [("imu0.acc_x", "bias"), ("imu0.acc_z", "bias")]
    for flown in found:
        assert [(sensor, kind) for sensor, kind, _ in flown] == faults
    np.testing.assert_allclose([f[2] for f in found[0]], [f[2] for f in found[1]], atol=0.5)


def test_the_recorded_log_is_known_for_what_it_is(read: Callable[..., Any], raw: bytes) -> None:
    batch, reader = read(raw)
    info, rows = reader.info, batch.rows
    assert (info.format, info.first_t_us) == ("bin", 28_945_084)
    assert info.bad_bytes < 300  # the record that the part cuts
    assert (info.vehicle.system_id, info.vehicle.autopilot, info.vehicle.type) == (1, 3, 1)
    assert info.sources["attitude"] == "ATT"
    assert not any("SIM" in source for source in info.sources.values())
    assert "aoa0" not in rows
    assert rows["heartbeat"]["autonomous"].all()
    assert set(rows["heartbeat"]["vehicle_type"].tolist()) == {1}
    assert set(rows["sys_status"]["health"].tolist()) == {0x10}
    assert bytes(rows["text"]["text"][0]) == b"ArduPlane V4.6.0-dev (fbb78585)"
    imu, attitude = rows["imu0"], rows["attitude"]
    assert np.median(np.diff(imu["t_us"])) == pytest.approx(20_000, rel=0.05)
    at = np.searchsorted(imu["t_us"], attitude["t_us"][-1])
    np.testing.assert_allclose(attitude["rate_rad_s"][-1], imu["gyro_rad_s"][at - 1], atol=0.05)
    again, _ = read(raw, ranking={})
    seqs = np.sort(np.concatenate([r["seq"] for r in again.rows.values()]))
    np.testing.assert_array_equal(seqs, np.arange(len(batch)))


def test_the_filters_quaternion_means_what_att_says(raw: bytes) -> None:
    parser = DataflashParser(frozenset({"ATT", "XKQ"}))
    parts = [p for step in (*parser.feed(raw), *parser.finish()) for p in step]
    euler = np.concatenate([_euler(p) for p in parts if p.format.name == "ATT"])
    quaternion = np.concatenate(
        [
            np.stack([p.column(f"Q{k}") for k in range(1, 5)], axis=1)[p.column("C") == 0]
            for p in parts
            if p.format.name == "XKQ"
        ]
    )
    n = min(len(euler), len(quaternion))
    close = np.abs(np.sum(euler[:n] * quaternion[:n], axis=1))
    assert np.median(close) > 0.999


def _euler(part: Any) -> Any:
    fill = next(s for s in table.SOURCES if s.message == "ATT").fills[0]
    assert fill.compute is not None
    columns = np.empty(len(part), [(name, "<f8") for name in ("Roll", "Pitch", "Yaw")])
    for name in ("Roll", "Pitch", "Yaw"):
        columns[name] = part.column(name)
    return fill.compute(columns)


# --------------------------------------------------------------------------- damage


def test_damage_costs_what_it_touched(read: Callable[..., Any], raw: bytes) -> None:
    whole, _ = read(raw)
    damaged = bytearray(raw)
    damaged[900_000:900_400] = bytes(range(200)) * 2
    batch, reader = read(b"garbage in front" + damaged[:-100])
    assert 300 < reader.info.bad_bytes < 1500
    assert batch.rejected["frame", Rejection.GARBAGE] == reader.info.bad_bytes
    for sensor in ("imu0", "gps0", "attitude", "airspeed0"):
        assert 0 <= len(whole.rows[sensor]) - len(batch.rows[sensor]) < 8


def test_a_second_log_in_the_same_file_is_a_second_boot(
    read: Callable[..., Any], raw: bytes
) -> None:
    one, _ = read(raw)
    batch, reader = read(raw + raw)
    assert len(batch.boots) == 1
    assert reader.info.bad_bytes < 300
    t_us = batch.rows["imu0"]["t_us"]
    assert (np.diff(t_us) >= 0).all()
    assert len(t_us) == pytest.approx(2 * len(one.rows["imu0"]), abs=10)


@pytest.mark.parametrize("seed", range(12))
def test_no_bytes_are_an_exception(read: Callable[..., Any], raw: bytes, seed: int) -> None:
    random = np.random.default_rng(seed)
    start = int(random.integers(200_000, PART - 60_000))
    data = bytearray(raw[:120_000] + raw[start : start + 50_000])
    for at in random.integers(0, len(data), 100).tolist():
        data[at] = int(random.integers(0, 256))
    cut = int(random.integers(1000, len(data)))
    with contextlib.suppress(LogError):
        read(bytes(data[:cut] + data[cut // 2 :]), 50_021)


def test_what_is_no_log_is_refused_in_a_sentence(tmp_path: Path) -> None:
    file = tmp_path / "x.bin"
    file.write_bytes(b"no log at all" * 100)
    with pytest.raises(LogError, match="has no data"):
        list(open_log(file))


# --------------------------------------------------------------------------- made-up logs


def test_warming_up_meets_a_record(monkeypatch: pytest.MonkeyPatch) -> None:
    called = []
    monkeypatch.setattr(VehicleClock, "advance", lambda *_: called.append(1))
    dataflash.warm_up()
    assert called == [1]


def test_units_and_multipliers_are_taken_where_they_are_told(read: Callable[..., Any]) -> None:
    log = DataflashWriter()
    log.tell_units()
    names = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    log.define("IMU", "QBhhhfff", names, units="s#kkk---", mult="F-CCC---")
    for k in range(20):
        log.put("IMU", 1000 * (k + 1), 1, 1000, 0, -1000, 0.0, 0.0, -9.8)
    batch, _ = read(log.content())
    assert set(batch.rows) == {"imu1"}
    np.testing.assert_allclose(batch.rows["imu1"]["gyro_rad_s"][0], np.radians([1.0, 0.0, -1.0]))


def test_logs_of_before_instances(read: Callable[..., Any]) -> None:
    log = DataflashWriter()
    log.define("PARM", "QNf", "TimeUS,Name,Value")
    log.define("MSG", "QZ", "TimeUS,Message")
    for name in ("IMU", "IMU2"):
        log.define(name, "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS2", "QBBcLLeffff", "TimeUS,Status,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw")
    log.define("GPA2", "QCCCCB", "TimeUS,VDop,HAcc,VAcc,SAcc,VV")
    log.define("NKF1", "Qcccffffff", "TimeUS,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD")
    log.define("POS", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt")
    log.define("ARSP", "Qff", "TimeUS,Airspeed,DiffPress")
    log.define("CTUN", "Qf", "TimeUS,As")
    log.define("RCOU", "QHH", "TimeUS,C1,C2")
    log.define("RCO2", "QHH", "TimeUS,C15,C16")
    log.define("STAT", "QBB", "TimeUS,isFlying,Armed")
    log.define("MODE", "QMB", "TimeUS,Mode,ModeNum")
    log.put("PARM", 1000, "ARSPD_RATIO", 1.5)
    log.put("MSG", 1000, "ArduPlane V3.9.0 (12345678)")
    log.put("RCO2", 1000, 1515, 1516)
    log.put("GPA2", 1000, 1.0, 0.5, 0.0, 0.2, 0)
    log.put("NKF1", 1000, 0, 0, 0, 10.0, 0.5, -1.0, 0, 0, 0)
    for k in range(100):
        t = 2000 + 50_000 * k
        if k in (0, 50):
            log.put("MODE", t, 10 if k else 0, 10 if k else 0)
        for name in ("IMU", "IMU2"):
            log.put(name, t, 0.1, 0, 0, 0, 0, -9.8)
        log.put("GPS2", t, 3, 9, 1.1, 47.1, 8.5, 400.0, 20.0, 90.0, 1.5, 0)
        log.put("POS", t, 47.1, 8.5, 400.0, 20.0, 20.0)
        log.put("ARSP", t, 18.0, 200.0)
        log.put("CTUN", t, 17.0)
        log.put("RCOU", t, 1100, 1200)
        log.put("STAT", t, 1, 1)
    batch, reader = read(log.content())
    rows = batch.rows
    assert {"imu0", "imu1", "gps1", "nav", "airspeed0", "servo", "heartbeat"} <= set(rows)
    np.testing.assert_allclose(rows["airspeed0"]["cas_m_s"], np.sqrt(300.0))
    gps = rows["gps1"][0]
    np.testing.assert_allclose(gps["vel_ned_m_s"], [0.0, 20.0, np.nan], atol=1e-9)
    assert (gps["h_std_m"], gps["vel_std_m_s"]) == (0.5, 0.2)
    assert np.isnan(gps["v_std_m"])
    np.testing.assert_allclose(rows["nav"]["vel_ned_m_s"][0], [10.0, 0.5, -1.0])
    assert rows["servo"]["pwm_us"][0, [0, 1, 2, 14, 15]].tolist() == [1100, 1200, 0, 1515, 1516]
    assert rows["heartbeat"]["autonomous"].tolist() == [False] * 50 + [True] * 50
    assert set(rows["heartbeat"]["vehicle_type"].tolist()) == {1}
    assert reader.info.vehicle.type == 1


def test_named_values_of_others_are_inputs_and_our_own_never(read: Callable[..., Any]) -> None:
    log = DataflashWriter()
    log.define("NVAL", "QIZfBB", "TimeUS,TimeBootMS,Name,Value,SSys,SCom")
    log.define("RPM", "QBfff", "TimeUS,I,RPM,Qual,H")
    for k in range(10):
        t = 1000 * (k + 1)
        log.put("NVAL", t, 1, "AOA1", 5.0, 1, 158)
        log.put("NVAL", t, 1, "AOA2", 7.0, 1, 191)
        log.put("RPM", t, 3, 4000.0, 1.0, 1.0)
    rows = read(log.content())[0].rows
    assert set(rows) == {"aoa0", "named", "spool3"}
    np.testing.assert_allclose(rows["aoa0"]["aoa_rad"], np.radians(5.0))
    assert set(rows["named"]["name"].tolist()) == {b"AOA1"}
    only = read(log.content(), components={"NAMED_VALUE_FLOAT": frozenset({1})})[0].rows
    assert "aoa0" not in only


def test_a_hole_in_the_records_is_told(read: Callable[..., Any]) -> None:
    log = DataflashWriter()
    log.define("RPM", "Qff", "TimeUS,rpm1,rpm2")
    for k in range(40):
        log.put("RPM", 1_000_000 + 100_000 * k + (3_000_000 if k >= 2 else 0), 3000.0, -1.0)
    assert read(log.content())[1].info.gaps == [(1_100_000, 4_000_000)]
