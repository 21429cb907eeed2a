"""Frames and hellos out of a made-up pipeline: complete, of the protocol, nothing twice."""

import json
from collections import Counter
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from links.samples import empty_rows
from links.vocabulary import Kind, Reason, Rejection, State
from monitor.daemon import Status
from monitor.latency import Latency
from monitor.pages.units import on_screen
from monitor.settings.engine import EngineSettings
from monitor.streams import Stream
from monitor.summary import faults
from monitor.verdict import (
    AIR_ESTIMATE,
    AIR_EXPECTED,
    AIR_TESTS,
    ENGINE_ESTIMATE,
    ENGINE_TESTS,
    IMU_ESTIMATE,
    IMU_TESTS,
    WING_ESTIMATE,
    WING_TESTS,
    StepResult,
    Verdict,
    ratio_column,
)
from monitor.web.found import LISTED, Found
from monitor.web.measured import STEPS_WAITING, Measured
from monitor.web.snapshot import CHANGES, About, Snapshots, _sensor
from monitor.web.store import Store
from monitor.web.wire import fault

from .checked import checked

S = 1_000_000


class FakePipeline:
    now_us = 5 * S
    flying = True

    def __init__(self):
        self.rejected = Counter({("frame", Rejection.BAD_CRC): 2})
        self.streams = {"imu0": Stream(None, samples=0), "spool1": Stream(None, blank=True)}


class FakeReceived:
    bytes, bad_bytes, lost = 1000, 7, 1


class FakeRecorder:
    path = Path("somewhere/mavsentry-1.tlog")
    file_bytes, bytes, stopped = 10, 20, None


def status(t_us=5 * S, **changes):
    values = {"t_us": t_us, "silent": False, "silent_s": 0.01, "turns": 1, "datagrams": 0}
    values |= {"rows": 0, "sent": 3, "latency": Latency(0, nan, nan, nan)}
    return Status(**(values | changes))


class Maker:
    """Snapshots of the fakes, read as a viewer reads them."""

    def __init__(self):
        self.pipeline, self.measured = FakePipeline(), Measured(EngineSettings())
        about = About("udpin:127.0.0.1:14550", "transport", "1.2.3", 5.0, 60.0)
        self.made = Snapshots(about, self.pipeline, FakeReceived(), self.measured, FakeRecorder())
        self.now_us = 100 * S

    def frame(self, *verdicts, after_us=200_000, given=None, **estimates):
        self.now_us += after_us
        self.made.note(StepResult(list(verdicts), estimates))
        return checked(self.made.frame(self.now_us, given or status()))

    def hello(self):
        return checked(self.made.hello(status()))


@pytest.fixture
def maker():
    return Maker()


def rows(dtype, count=1, **values):
    out = np.full(count, nan, dtype) if dtype.names is None else np.zeros(count, dtype)
    for name in dtype.names[1:]:
        out[name] = nan
    out["t_us"] = np.arange(count) * 200_000
    for name, value in values.items():
        out[name] = value
    return out


PITOT = Verdict(
    4 * S,
    "airspeed0",
    State.FAULTY,
    kind=Kind.BIAS,
    onset_t_us=3 * S,
    magnitude=-3.1,
    unit="m/s",
    statistic=31.0,
    threshold=inf,
    estimator="air",
    evidence="reads low",
)
VANE = Verdict(4 * S, "aoa0", State.FAULTY, kind=Kind.BIAS, magnitude=0.1, unit="rad")
GROUND = Verdict(S, "airspeed0", State.UNMONITORED, reason=Reason.ON_GROUND)


def test_a_frame_of_nothing_new_is_small(maker):
    maker.frame()
    frame = maker.frame()
    assert set(frame) == {"kind", "number", "unix_s", "t_s", "flying", "link"}
    assert (frame["number"], frame["t_s"], frame["flying"]) == (1, 5.0, True)


def test_before_a_vehicle_is_heard_there_is_no_time(maker):
    from monitor.pipeline import Pipeline
    from monitor.settings import Settings

    maker.pipeline.now_us = Pipeline(Settings(), watches=[]).now_us
    never = status(None, silent=True, silent_s=None)
    frame = maker.frame(given=never)
    assert frame["t_s"] is None
    assert (frame["link"]["silent"], frame["link"]["silent_s"]) == (True, None)


def test_a_change_is_said_once_with_its_why(maker):
    frame = maker.frame(GROUND, PITOT)
    first, second = frame["changes"]["airspeed0"]
    assert (first["state"], first["reason"], first["kind"]) == ("unmonitored", "on ground", None)
    assert (second["state"], second["kind"], second["size"]) == ("faulty", "bias", "3.1 m/s low")
    assert (second["t_s"], second["onset_t_s"], second["evidence"]) == (4.0, 3.0, "reads low")
    assert "changes" not in maker.frame()


def test_a_fault_is_said_when_it_is_found_and_when_it_ends(maker):
    (found,) = maker.frame(PITOT)["faults"]
    assert (found["number"], found["magnitude"], found["unit"]) == (0, -3.1, "m/s")
    assert (found["onset_t_s"], found["cleared_t_s"], found["threshold"]) == (3.0, None, None)
    assert "faults" not in maker.frame()
    (ended,) = maker.frame(Verdict(9 * S, "airspeed0", State.OK))["faults"]
    assert ended == found | {"cleared_t_s": 9.0}


def test_angles_are_in_degrees(maker):
    (found,) = maker.frame(VANE)["faults"]
    assert (found["magnitude"], found["unit"]) == (
        pytest.approx(5.73, abs=0.01),
        on_screen("rad")[1],
    )
    air = rows(AIR_ESTIMATE, aoa_rad=0.1, cas_m_s=100.0)
    frame = maker.frame(air=air, imu1=rows(IMU_ESTIMATE, gyro_fault_rad_s=0.1))
    assert frame["air"]["aoa_deg"] == pytest.approx(5.72958)
    assert frame["air"]["cas_m_s"] == 100.0
    assert frame["air"]["ssa_deg"] is None
    assert frame["air"]["wind_ned_m_s"] == [None] * 3
    assert frame["imu"]["imu1"]["gyro_fault_deg_s"] == pytest.approx([5.72958] * 3)


def test_an_engine_that_stops_is_an_event(maker):
    stopped = Verdict(2 * S, "engine0", State.STOPPED, onset_t_us=S, evidence="no power")
    (event,) = maker.frame(stopped)["events"]
    assert (event["what"], event["onset_t_s"], event["ended_t_s"]) == ("engine0", 1.0, None)


def test_the_newest_estimate_is_said_once(maker):
    air = rows(AIR_ESTIMATE, 3)
    frame = maker.frame(
        air=air, engine=rows(ENGINE_ESTIMATE, speed_rpm=900.0), wing=rows(WING_ESTIMATE)
    )
    assert frame["air"]["t_s"] == 0.4
    assert frame["engine"]["speed_rpm"] == [900.0] * 4
    assert "lift_apart_std_percent" not in frame["wing"]
    assert not {"air", "engine", "wing"} & set(maker.frame())


def test_what_a_pitot_and_a_vane_should_show(maker):
    expected = rows(AIR_EXPECTED, airspeed0_m_s=30.0, airspeed0_std_m_s=0.5, aoa1_rad=0.1)
    assert maker.frame(air_expected=expected)["expected"] == {
        "airspeed0": [30.0, 0.5],
        "aoa1": [pytest.approx(5.72958), None],
    }


def test_of_tests_the_largest_ratio_since_the_last_frame_is_said(maker):
    for ratio in (0.2, 1.5, nan, 0.4):
        maker.made.note(StepResult([], {"imu0_tests": rows(IMU_TESTS, acc_x_ratio=ratio)}))
    frame = maker.frame(air_tests=rows(AIR_TESTS, 2, airspeed0_ratio=[0.1, 0.3]))
    assert frame["tests"] == {"imu0.acc_x": 1.5, "airspeed0": 0.3}
    assert "tests" not in maker.frame()


@pytest.mark.parametrize(
    ("table", "dtype"),
    [
        ("imu3_tests", IMU_TESTS),
        ("air_tests", AIR_TESTS),
        ("engine_tests", ENGINE_TESTS),
        ("wing_tests", WING_TESTS),
    ],
)
def test_every_ratio_has_the_name_of_its_sensor(table, dtype):
    for column in dtype.names[1:]:
        assert ratio_column(_sensor(table, column)) == (table, column)


def test_measurements_are_ranges_since_the_last_frame(maker):
    pitot = empty_rows("airspeed0", 30)
    pitot["t_us"] = np.arange(30) * 20_000
    pitot["cas_m_s"] = 20.0
    pitot["cas_m_s"][[3, 9]] = 18.0, 25.0
    for some in np.array_split(pitot, 7):
        maker.measured.step({"airspeed0": some})
    frame = maker.frame()
    assert frame["measured"] == {"airspeed0": [18.0, 25.0]}
    assert frame["channels"] == {"airspeed0": "m/s"}
    later = pitot.copy()
    later["t_us"] += 600_000
    later["cas_m_s"] = 21.0
    maker.measured.step({"airspeed0": later})
    frame = maker.frame()
    assert frame["measured"] == {"airspeed0": [21.0, 21.0]}
    assert "channels" not in frame
    assert "measured" not in maker.frame()


def test_measurements_wait_in_bounded_memory(maker):
    row = empty_rows("imu0", 1)
    for k in range(3 * STEPS_WAITING):
        row = row.copy()
        row["t_us"] = k * 20_000
        row["gyro_rad_s"] = 0.1 * (k == 5)
        maker.measured.step({"imu0": row})
        assert len(maker.measured._waiting.get("imu0", ())) < STEPS_WAITING
    assert maker.frame()["measured"]["imu0.gyro_z"] == [0.0, pytest.approx(5.72958)]


def test_what_seldom_changes_comes_once_a_second(maker):
    first = maker.frame()
    seldom = {"streams", "latency", "recorder", "process", "rejected"}
    assert seldom <= set(first)
    assert first["recorder"]["file"] == "mavsentry-1.tlog"
    assert set(first["streams"]) == {"imu0"}  # one that says nothing is not shown
    for _ in range(4):
        assert not seldom & set(maker.frame())
    assert set(maker.frame()) & seldom == seldom - {"rejected"}
    maker.pipeline.rejected["gps0", Rejection.LATE] += 1
    assert maker.frame(after_us=S)["rejected"]["gps0"] == {"late": 1}


def test_rates_are_those_of_the_last_seconds(maker):
    for second in range(8):
        maker.pipeline.streams["imu0"].samples = 200 * second if second < 5 else 800
        given = status(datagrams=500 * second, rows=600 * second)
        frame = maker.frame(after_us=S, given=given)
        if second == 4:
            assert frame["streams"]["imu0"]["rate_hz"] == 200.0
    assert frame["streams"]["imu0"]["rate_hz"] == 0.0
    assert (frame["link"]["datagrams_s"], frame["link"]["rows_s"]) == (500.0, 600.0)


def test_a_frame_that_is_left_out_is_counted_and_loses_nothing(maker):
    maker.frame()
    maker.made.note(StepResult([GROUND]))
    maker.made.skip()
    frame = maker.frame(PITOT, after_us=S)
    assert frame["number"] == 2
    assert [s["state"] for s in frame["changes"]["airspeed0"]] == ["unmonitored", "faulty"]
    assert frame["process"]["dropped"] == 1


def test_changes_without_end_stay_bounded(maker):
    for k in range(5000):
        state = State.FAULTY if k % 2 else State.OK
        maker.made.note(StepResult([Verdict(k * S, "airspeed0", state)]))
    frame = maker.frame()
    assert len(frame["changes"]["airspeed0"]) == CHANGES
    assert len(frame["faults"]) == LISTED
    assert frame["faults"][-1]["number"] == 2499


def test_hello_is_all_that_stands_and_takes_nothing_from_the_next_frame(maker):
    maker.frame(GROUND, Verdict(S, "gps0", State.OK))
    maker.made.note(StepResult([PITOT], {"air": rows(AIR_ESTIMATE)}))
    hello = maker.hello()
    assert hello["number"] == 0
    assert set(hello["timeline"]) == {"gps0"}  # what changes now comes with the next frame
    assert len(hello["faults"]) == 1
    assert {"streams", "recorder", "rejected", "process", "latency"} <= set(hello)
    frame = maker.frame()
    assert set(frame["changes"]) == {"airspeed0"}
    assert len(frame["faults"]) == 1
    assert "air" in frame
    assert maker.hello()["run"] != Maker().hello()["run"]


def test_a_viewer_who_comes_late_is_told_the_same(maker):
    """Hello, then frames, through the store of the web process."""
    store = Store(100)
    maker.pipeline.now_us = 2 * S
    maker.frame(GROUND)
    store.begin(maker.made.hello(status()))
    store.add(json.dumps(maker.frame(PITOT)).encode())
    late = checked(store.hello())
    assert [s["state"] for s in late["timeline"]["airspeed0"]] == ["unmonitored", "faulty"]
    assert late["number"] == 1
    assert [f["number"] for f in late["faults"]] == [0]
    assert store.found == {"airspeed0": 1}


def test_faults_are_those_of_the_summary():
    said = [
        PITOT,
        VANE,
        Verdict(5 * S, "airspeed0", State.STALE),
        Verdict(6 * S, "airspeed0", State.FAULTY, magnitude=1.0),
        Verdict(7 * S, "airspeed0", State.OK),
        Verdict(8 * S, "airspeed0", State.FAULTY, magnitude=2.0, detected_t_us=7 * S),
    ]
    found = Found(State.FAULTY, fault)
    for verdict in said:
        found.add(verdict)
    expected = faults(said, 0)
    same = {"onset_s": "onset_t_s", "detected_s": "detected_t_s", "isolated_s": "isolated_t_s"}
    same |= {"cleared_s": "cleared_t_s", "sensor": "sensor", "kind": "kind"}
    shown = [{a: entry[b] for a, b in same.items()} for entry in found.all()]
    assert shown == [{a: entry[a] for a in same} for entry in expected]
