"""Rankings and engine-speed channels that were chosen, in logs of records and on the link alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from links import catalog, catalog_dataflash, catalog_ulog
from links.logs import open_log
from links.mavlink.options import DecoderOptions
from links.samples import Batch
from monitor.settings import load
from sim_feeds.dataflash import DataflashWriter
from sim_feeds.ulog import UlogWriter, message

T_US = range(1_000_000, 4_000_000, 50_000)


@pytest.fixture
def dataflash(tmp_path: Path) -> Path:
    """A flight whose engine speeds and airspeeds come in several messages."""
    log = DataflashWriter()
    log.define("RPM", "QBf", "TimeUS,I,RPM")
    log.define("EFI", "Qf", "TimeUS,Rpm")
    log.define("ESC", "QBf", "TimeUS,Instance,RPM")
    log.define("NVAL", "QIZfBB", "TimeUS,TimeBootMS,Name,Value,SSys,SCom")
    log.define("ARSP", "QBff", "TimeUS,I,Airspeed,DiffPress")
    log.define("CTUN", "Qf", "TimeUS,As")
    for t in T_US:
        for k in range(3):
            log.put("RPM", t, k, 1000.0 + k)
            log.put("ESC", t, k, 3000.0 + k)
        log.put("EFI", t, 2000.0)
        log.put("NVAL", t, 1, "N1", 80.0, 1, 158)
        log.put("NVAL", t, 1, "N1", 99.0, 1, 191)
        log.put("ARSP", t, 0, 20.0, 200.0)
        log.put("CTUN", t, 17.0)
    file = tmp_path / "x.BIN"
    file.write_bytes(log.content())
    return file


@pytest.fixture
def ulog(tmp_path: Path) -> Path:
    """The same from PX4."""
    log = UlogWriter(T_US[0])
    t = np.array(T_US)
    for k in range(3):
        log.topic("rpm", "float rpm_estimate", t, {"rpm_estimate": 1000.0 + k}, k)
    log.topic(
        "internal_combustion_engine_status", "float engine_speed_rpm", t, {"engine_speed_rpm": 2e3}
    )
    for name, value in (("N1", 80.0), ("N2", 99.0)):
        fields = "char[10] key;float value"
        log.topic("debug_key_value", fields, t, {"key": name.encode(), "value": value})
    airspeed = "float indicated_airspeed_m_s"
    log.topic("airspeed", airspeed, t, {airspeed[6:]: 20.0})
    offset = "float differential_pressure_pa"
    log.topic("differential_pressure", offset, t, {offset[6:]: 61.25})
    file = tmp_path / "x.ulg"
    file.write_bytes(log.content())
    return file


def values(file: Path, field: str, **options: Any) -> dict[str, float]:
    batch = Batch.concatenate(open_log(file, DecoderOptions(**options)))
    rows = {s: r[field] for s, r in batch.rows.items() if field in (r.dtype.names or ())}
    assert all(len(x) in (len(T_US), 20) for x in rows.values())  # a mixture waits for 2 s
    return {sensor: float(x[-1]) for sensor, x in rows.items()}


CHANNELS = {
    "spool0": ("RPM.rpm2", 1.0),
    "spool1": ("EFI_STATUS.rpm", 0.5),
    "spool3": ("NAMED_VALUE_FLOAT.N1", 50.0),
    "spool4": ("RAW_RPM.2", 1.0),
}
SPEEDS = {"spool0": 1001.0, "spool1": 1000.0, "spool3": 4000.0, "spool4": 1002.0}


@pytest.mark.parametrize("kind", ["dataflash", "ulog"])
def test_channels_by_name_are_the_same_parts_in_every_format(
    kind: str, request: pytest.FixtureRequest
) -> None:
    file = request.getfixturevalue(kind)
    assert values(file, "speed_rpm", spools=CHANNELS) == SPEEDS
    assert set(values(file, "speed_rpm")) == {"spool0", "spool1", "spool2"}


def test_an_esc_by_its_number(dataflash: Path, tmp_path: Path) -> None:
    chosen = {"spool1": ("ESC_TELEMETRY.3", 0.1)}
    assert values(dataflash, "speed_rpm", spools=chosen) == {"spool1": pytest.approx(300.2)}
    esc = b"esc_report:int32_t esc_rpm;"
    log = UlogWriter(T_US[0])
    log.topic("esc_status", "int32_t[4] esc", np.array(T_US), {"esc": [3000, 3001, 3002, 3003]})
    flat = b"esc_status:uint64_t timestamp;int32_t[4] esc;"
    nested = message("F", esc) + message("F", flat.replace(b"int32_t", b"esc_report"))
    file = tmp_path / "esc.ulg"
    file.write_bytes(log.content().replace(message("F", flat), nested))
    assert values(file, "speed_rpm", spools=chosen) == {"spool1": pytest.approx(300.2)}


def test_a_ranking_goes_by_each_formats_own_messages(dataflash: Path, ulog: Path) -> None:
    chosen = {"airspeed": ("VFR_HUD", "CTUN", "differential_pressure")}
    assert values(dataflash, "cas_m_s", ranking=chosen) == {"airspeed0": 17.0}
    assert values(dataflash, "cas_m_s") == {"airspeed0": 20.0}
    assert values(ulog, "cas_m_s", ranking=chosen) == {"airspeed0": pytest.approx(10.0)}
    assert values(ulog, "cas_m_s") == {"airspeed0": 20.0}
    foreign = {"airspeed": ("VFR_HUD",), "spool": ("EFI", "rpm")}
    assert values(dataflash, "cas_m_s", ranking=foreign) == {"airspeed0": 20.0}
    assert values(dataflash, "speed_rpm", ranking=foreign) == {"spool0": 2000.0}
    assert set(values(ulog, "speed_rpm", ranking=foreign)) == {"spool0", "spool1", "spool2"}


def test_the_links_own_ranking_stands_where_only_a_logs_messages_are_named() -> None:
    options = DecoderOptions(ranking={"airspeed": ("CTUN",), "imu": ("SCALED_IMU", "IMU")})
    ranked = options.ranked(catalog.RANKING, catalog.SOURCES)
    assert ranked["airspeed"] == catalog.RANKING["airspeed"]
    assert ranked["imu"] == ("SCALED_IMU",)


def test_settings_know_the_messages_of_every_format(tmp_path: Path) -> None:
    file = tmp_path / "sentry.toml"
    file.write_text('[links.sources]\nairspeed = ["AIRSPEED", "CTUN", "airspeed_validated"]\n')
    ranking = load(file=file).links.decoder_options().ranking
    assert ranking == {"airspeed": ("AIRSPEED", "CTUN", "airspeed_validated")}
    file.write_text('[links.sources]\nairspeed = ["BARO"]\n')
    with pytest.raises(ValueError, match="airspeed is not carried by BARO"):
        load(file=file)


def test_every_ranked_key_has_a_line() -> None:
    for table in (catalog, catalog_dataflash, catalog_ulog):
        named = {getattr(table, "NAMED", "NAMED_VALUE_FLOAT")}
        for quantity, keys in table.RANKING.items():
            lines = {s.key for s in table.SOURCES if s.quantity == quantity}
            assert set(keys) <= lines | named, (table.__name__, quantity)


def test_a_topic_that_is_logged_too_seldom_is_said(tmp_path: Path) -> None:
    log = UlogWriter(T_US[0])
    t = np.array(T_US)
    fields = "float[3] gyro_rad;float[3] accelerometer_m_s2"
    log.topic("sensor_combined", fields, t[::4], {})
    log.topic("airspeed", "float indicated_airspeed_m_s", t, {})
    file = tmp_path / "x.ulg"
    file.write_bytes(log.content())
    reader = open_log(file)
    assert set(Batch.concatenate(reader).rows) == {"airspeed0"}
    assert reader.info.notes == [
        "sensor_combined was logged at 5 Hz, too seldom to watch an IMU by (8 Hz at least): "
        "no IMU is watched"
    ]


def test_what_the_autopilot_demands(tmp_path: Path) -> None:
    log = UlogWriter(T_US[0])
    names = ("altitude_sp", "altitude_filtered", "true_airspeed_sp", "true_airspeed_filtered")
    told = dict(zip(names, (120.0, 100.0, 18.0, 21.0), strict=True))
    log.topic("tecs_status", ";".join(f"float {n}" for n in names), np.array(T_US), told)
    file = tmp_path / "x.ulg"
    file.write_bytes(log.content())
    rows = Batch.concatenate(open_log(file)).rows["demand"]
    assert set(rows["height_error_m"].tolist()) == {20.0}
    assert set(rows["airspeed_error_sign"].tolist()) == {-1.0}
