"""A flight as ArduPilot would have logged it: what DFReader reads of it, what is found in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from links.logs import read_dataflash
from links.samples import Batch
from monitor.analyze import analyze_log
from monitor.settings import Settings
from sim_feeds.dataflash import DataflashWriter, ardupilot_log
from sim_feeds.scenario import load


def test_rows_stand_in_order_of_time_as_dfreader_reads_them(tmp_path: Path) -> None:
    dfreader = pytest.importorskip("pymavlink.DFReader")
    log = DataflashWriter()
    log.tell_units()
    log.define("ATT", "Qcf", "TimeUS,Roll,Yaw", units="sdd", mult="FB0")
    log.define("MSG", "QZ", "TimeUS,Message", units="s-", mult="F-")
    log.rows("ATT", np.array([1000, 3000]), [1.25, -2.5], 90.0)
    log.rows("MSG", np.array([2000]), "hello")
    file = tmp_path / "x.BIN"
    file.write_bytes(log.content(2))
    reader = dfreader.DFReader_binary(str(file))
    told = []
    while (message := reader.recv_msg()) is not None:
        if message.get_type() in ("ATT", "MSG"):
            told.append([getattr(message, name) for name in message.get_fieldnames()])
    reader.data_map.close()
    reader.filehandle.close()
    assert told == 2 * [[1000, 1.25, 90.0], [2000, "hello"], [3000, -2.5, 90.0]]


@pytest.mark.parametrize("name", ["small-uav-imu-bias", "small-uav-healthy"])
def test_injected_faults_are_found_in_an_ardupilot_log(tmp_path: Path, name: str) -> None:
    file = tmp_path / "x.BIN"
    file.write_bytes(ardupilot_log(load(name).fly()).content())
    batch = Batch.concatenate(read_dataflash(file))
    assert not batch.rejected
    assert {"imu0", "imu1", "attitude", "nav", "gps0", "baro1", "airspeed1"} <= set(batch.rows)
    injected = {f.sensor: f.start_s for f in load(name).faults()}
    found = {f["sensor"]: f["onset_s"] for f in analyze_log(file, Settings()).faults}
    assert set(found) == set(injected)
    for sensor, onset_s in found.items():
        assert abs(onset_s - injected[sensor]) < 15.0
