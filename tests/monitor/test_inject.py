"""``mavsentry inject``: what is typed, written and said."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from links.logs import read_tlog
from links.samples import Batch
from monitor.cli import invoke
from sim_feeds.faults import lu2016_table2
from sim_feeds.player import frames_of, unix_us
from sim_feeds.scenario import parse

UNUSABLE = 2

SCENARIO = """
title = "A short flight"
aircraft = "small-uav"
seed = 2
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 10.0
"""
PITOT_HIGH = """
[[fault]]
sensor = "airspeed0"
kind = "scale"
fraction = 0.3
start_s = {start_s}
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    from links.logs import TlogWriter

    flight = parse(SCENARIO).fly()
    file = tmp_path_factory.mktemp("log") / "flight.tlog"
    with TlogWriter(file) as writer:
        for t_us, frame in frames_of(flight):
            writer.write(frame, unix_us(flight, t_us))
    return file


def write(tmp_path, text: str, name: str = "faults.toml"):
    file = tmp_path / name
    file.write_text(text)
    return file


def refused(capsys, *arguments) -> str:
    assert invoke(["inject", *(str(a) for a in arguments)]) == UNUSABLE
    said = capsys.readouterr()
    assert said.out == ""
    (sentence,) = said.err.splitlines()
    return sentence.removeprefix("mavsentry: ")


def rows_of(file) -> Batch:
    return Batch.concatenate(read_tlog(file))


def test_the_log_is_written_anew_with_the_fault_in_it(log, tmp_path, capsys):
    out = tmp_path / "broken.tlog"
    faults = write(tmp_path, PITOT_HIGH.format(start_s=6.0))
    assert invoke(["inject", str(log), str(faults), "--to", str(out)]) == 0
    said = capsys.readouterr().out
    assert "airspeed0" in said
    assert "SCALED_PRESSURE" in said
    assert "VFR_HUD" in said
    before, after = rows_of(log), rows_of(out)
    t = (before.rows["airspeed0"]["t_us"] - read_info(log).first_t_us) * 1e-6
    factor = np.where(t >= 6.0, 1.3, 1.0)
    cas = before.rows["airspeed0"]["cas_m_s"]
    assert_allclose(after.rows["airspeed0"]["cas_m_s"], factor * cas, rtol=1e-6)
    assert after.rows["imu0"].tobytes() == before.rows["imu0"].tobytes()
    assert not list(tmp_path.glob("*.part"))


def read_info(file):
    reader = read_tlog(file)
    for _ in reader:
        pass
    return reader.info


def test_no_faults_give_the_same_file(log, tmp_path, capsys):
    out = tmp_path / "same.tlog"
    assert invoke(["inject", str(log), str(write(tmp_path, "")), "--to", str(out)]) == 0
    assert out.read_bytes() == log.read_bytes()
    assert "no faults: the output is the same as the log" in capsys.readouterr().out


def test_the_seed_is_of_the_noise(log, tmp_path):
    noise = write(tmp_path, '[[fault]]\nsensor="imu0.acc_x"\nkind="noise"\nsize_m_s2=1\nstart_s=2')
    written = []
    for k, seed in enumerate(("1", "1", "2")):
        out = tmp_path / f"{k}.tlog"
        assert invoke(["inject", str(log), str(noise), "--to", str(out), "--seed", seed]) == 0
        written.append(out.read_bytes())
    assert written[0] == written[1] != written[2]


def test_the_example_is_printed_and_can_be_used(log, tmp_path, capsys):
    assert invoke(["inject", "--example"]) == 0
    example = capsys.readouterr().out
    for start_s in ("120.0", "200.0"):
        example = example.replace(start_s, "3.0")
    faults = write(tmp_path, example.replace("180.0", "8.0"))
    assert invoke(["inject", str(log), str(faults), "--to", str(tmp_path / "o.tlog")]) == 0
    said = capsys.readouterr().out
    assert "attitude" in said
    assert "RAW_IMU" in said


def test_what_changes_nothing_is_said(log, tmp_path, capsys):
    faults = write(
        tmp_path,
        '[[fault]]\nsensor="airspeed0"\nkind="stuck"\nstart_s=3.01\nend_s=3.011',
    )
    assert invoke(["inject", str(log), str(faults), "--to", str(tmp_path / "o.tlog")]) == 0
    assert "airspeed0 has no reading that the faults change" in capsys.readouterr().out


# ----------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (PITOT_HIGH.format(start_s=600.0), "begins at 600 s, but the log ends at 1"),
        (PITOT_HIGH.format(start_s=1).replace("airspeed0", "airspeed2"), "no airspeed2: it has"),
        (PITOT_HIGH.format(start_s=1).replace("scale", "scael"), "did you mean 'scale'?"),
        (PITOT_HIGH.format(start_s=1).replace("fault]]", "fail]]"), "did you mean 'fault'?"),
        (PITOT_HIGH.format(start_s=-5), "start_s"),
        ("[[fault]]\nsensor=", "is no TOML"),
        ('[[fault]]\nsensor="imu0.acc_x"\nkind="bias"\nstart_s=1', "needs size_m_s2"),
    ],
)
def test_a_fault_that_does_not_fit_is_refused(log, tmp_path, capsys, text, says):
    out = tmp_path / "out.tlog"
    assert says in refused(capsys, log, write(tmp_path, text), "--to", out)
    assert not out.exists()


def test_files_that_cannot_be_used_are_refused(log, tmp_path, capsys):
    faults = write(tmp_path, PITOT_HIGH.format(start_s=2.0))
    out = tmp_path / "out.tlog"
    assert "--to another name" in refused(capsys, log, faults, "--to", log)
    link = tmp_path / "link.tlog"
    link.symlink_to(log)
    assert "--to another name" in refused(capsys, log, faults, "--to", link)
    assert "directory" in refused(capsys, log, faults, "--to", tmp_path)
    assert "called .tlog" in refused(capsys, log, faults, "--to", tmp_path / "out.bin")
    assert "cannot write" in refused(capsys, log, faults, "--to", tmp_path / "no" / "out.tlog")
    assert "cannot read" in refused(capsys, tmp_path / "none.tlog", faults, "--to", out)
    assert "cannot read" in refused(capsys, log, tmp_path / "none.toml", "--to", out)
    empty = write(tmp_path, "", "empty.tlog")
    assert "is empty" in refused(capsys, empty, faults, "--to", out)
    words = write(tmp_path, "no telemetry " * 100, "words.tlog")
    assert "no MAVLink message" in refused(capsys, words, faults, "--to", out)
    onboard = tmp_path / "log.bin"
    onboard.write_bytes(b"\xa3\x95\x80" + bytes(200))
    assert "telemetry logs (.tlog) only" in refused(capsys, onboard, faults, "--to", out)
    px4 = tmp_path / "log.ulg"
    px4.write_bytes(b"ULog\x01\x12\x35" + bytes(200))
    assert "telemetry logs (.tlog) only" in refused(capsys, px4, faults, "--to", out)
    assert not out.exists()
    assert log.stat().st_size > 0


def test_a_write_that_fails_leaves_the_old_output(log, tmp_path, capsys, monkeypatch):
    import os

    def full(*_):
        raise OSError(28, "No space left on device")

    out = tmp_path / "out.tlog"
    out.write_bytes(b"what was there")
    monkeypatch.setattr(os, "replace", full)
    faults = write(tmp_path, PITOT_HIGH.format(start_s=2.0))
    assert "No space left on device" in refused(capsys, log, faults, "--to", out)
    assert out.read_bytes() == b"what was there"
    assert not list(tmp_path.glob("*.part"))


def test_control_c_leaves_nothing_behind(log, tmp_path, monkeypatch):
    from links.mavlink.patch import StreamPatcher

    def interrupted(self, data):
        raise KeyboardInterrupt

    monkeypatch.setattr(StreamPatcher, "feed", interrupted)
    faults = write(tmp_path, PITOT_HIGH.format(start_s=2.0))
    out = tmp_path / "out.tlog"
    assert invoke(["inject", str(log), str(faults), "--to", str(out)]) == 130
    assert [p.name for p in tmp_path.iterdir()] == ["faults.toml"]


# ----------------------------------------------------------------------------- recorded flights

ALFA = "alfa/carbonZ_2018-07-30-17-36-35_engine_failure_with_emr_traj.tlog"
LU2016 = """
[[fault]]
sensor = "imu0.acc_x"
kind = "bias"
size_m_s2 = 3.0
start_s = 60.0
end_s = 80.0
[[fault]]
sensor = "imu0.acc_y"
kind = "drift"
rate_m_s2_per_s = 0.1
start_s = 60.0
end_s = 80.0
[[fault]]
sensor = "imu0.acc_z"
kind = "oscillation"
size_m_s2 = -4.0
period_s = 4.0
start_s = 60.0
end_s = 80.0
[[fault]]
sensor = "imu0.gyro_x"
kind = "bias"
size_deg_s = 1.5
start_s = 60.0
end_s = 80.0
[[fault]]
sensor = "imu0.gyro_y"
kind = "oscillation"
size_deg_s = 1.0
period_s = 4.0
start_s = 60.0
end_s = 80.0
[[fault]]
sensor = "imu0.gyro_z"
kind = "bias"
size_deg_s = 3.0
start_s = 60.0
end_s = 80.0
"""


def test_lu2016_table_2_in_a_real_flight(shared_data, tmp_path):
    """Six faults at once in an ALFA log that mixes MAVLink 1 and 2 (lu2016 section 3.2)."""
    from sim_feeds.injection import Injection, RowInjector

    log = shared_data / ALFA
    out = tmp_path / "lu2016.tlog"
    faults = write(tmp_path, LU2016)
    assert invoke(["inject", str(log), str(faults), "--to", str(out)]) == 0
    before, after, info = rows_of(log), rows_of(out), read_info(log)
    rows = RowInjector(Injection(lu2016_table2("imu0", 60.0, 80.0)), 0, info.first_t_us)
    expected = rows.apply(before).rows["imu0"]
    imu = after.rows["imu0"]
    assert_allclose(imu["acc_m_s2"], expected["acc_m_s2"], atol=0.5 * 9.80665e-3 + 1e-9)
    assert_allclose(imu["gyro_rad_s"], expected["gyro_rad_s"], atol=0.5e-3 + 1e-9)
    for sensor, r in before.rows.items():
        if sensor != "imu0":
            assert after.rows[sensor].tobytes() == r.tobytes()
    assert len(log.read_bytes()) == len(out.read_bytes())  # MAVLink 1 payloads keep their length


def test_pymavlink_accepts_every_frame_that_was_written(shared_data, tmp_path):
    """CRCs by another implementation, on a log of MAVLink 2 with truncated payloads."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    from links.mavlink.dialect import load_dialect
    from links.mavlink.framing import Framer

    log, out = shared_data / "sitl" / "n1_calm_nominal.tlog", tmp_path / "out.tlog"
    text = PITOT_HIGH.format(start_s=150.0) + '[[fault]]\nsensor="imu0.gyro_x"\nkind="dead"\n'
    text += 'start_s=100.0\n[[fault]]\nsensor="airspeed1"\nkind="dead"\nstart_s=200.0\n'
    text += '[[fault]]\nsensor="gps0"\nkind="outage"\nstart_s=250.0\n'
    assert invoke(["inject", str(log), str(write(tmp_path, text)), "--to", str(out)]) == 0
    data = {file: file.read_bytes() for file in (log, out)}
    found = {}
    for file, content in data.items():
        framer = Framer(load_dialect(), stamped=True)
        frames = framer.feed(content)
        assert framer.bad_bytes == 0
        found[file] = [
            content[a:b] for a, b in zip(frames.start.tolist(), frames.end.tolist(), strict=True)
        ]
    assert len(found[log]) == len(found[out])
    parser = mavlink.MAVLink(None)
    changed = [b for a, b in zip(found[log], found[out], strict=True) if a != b]
    names = {parser.decode(bytearray(frame)).get_type() for frame in changed}
    assert len(changed) > 10_000
    assert names == {
        "RAW_IMU", "SCALED_PRESSURE", "SCALED_PRESSURE2", "VFR_HUD", "GPS_RAW_INT",
        "NAMED_VALUE_FLOAT",
    }  # fmt: skip


def test_an_injected_pitot_fault_is_found(shared_data, tmp_path):
    """inject, then analyze: the pitot that reads 30 % high is named, and nothing else."""
    log, out = shared_data / "sitl" / "n1_calm_nominal.tlog", tmp_path / "high.tlog"
    faults = write(tmp_path, PITOT_HIGH.format(start_s=150.0))
    assert invoke(["inject", str(log), str(faults), "--to", str(out)]) == 0
    assert invoke(["analyze", str(out), "--out", str(tmp_path), "--exit-code"]) == 1
    summary = json.loads((tmp_path / "high" / "summary.json").read_text())
    (fault,) = summary["faults"]
    assert fault["sensor"] == "airspeed0"
    assert fault["kind"] == "scale"
    assert 150.0 <= fault["detected_s"] < 155.0
    assert fault["magnitude"] == pytest.approx(0.3 * 20.0, abs=2.0)


def test_rows_and_log_give_the_same_verdicts(shared_data, tmp_path):
    """Decoded rows changed in memory are judged as the rewritten log is, within rounding."""
    from monitor.analyze import analyze_log
    from monitor.pipeline import Pipeline
    from monitor.settings import load
    from sim_feeds.injection import RowInjector, load_injection

    log, out = shared_data / "sitl" / "n1_calm_nominal.tlog", tmp_path / "out.tlog"
    text = PITOT_HIGH.format(start_s=120.0) + "end_s = 160.0\n"
    text += '[[fault]]\nsensor = "imu0.acc_x"\nkind = "bias"\nsize_m_s2 = 2.0\nstart_s = 200.0\n'
    faults = write(tmp_path, text)
    assert invoke(["inject", str(log), str(faults), "--to", str(out)]) == 0
    settings = load(None, None)
    wire = [v for v in analyze_log(out, settings).verdicts if v.state == "faulty"]
    info = read_info(log)
    pipeline = Pipeline(settings)
    injector = RowInjector(load_injection(faults), 0, info.first_t_us)
    rows = [*pipeline.feed(injector.apply(rows_of(log))).verdicts, *pipeline.finish().verdicts]
    rows = [v for v in rows if v.state == "faulty"]
    assert [v.sensor for v in rows] == [v.sensor for v in wire]
    assert {v.sensor for v in rows} >= {"airspeed0", "imu0.acc_x"}
    for a, b in zip(rows, wire, strict=True):
        assert a.t_us == pytest.approx(b.t_us, abs=200_000)
