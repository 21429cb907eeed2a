"""Metrics as Prometheus' own parser reads them: its conventions, the newest frame's values."""

import json
import re
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from links.vocabulary import State
from monitor.web.metrics import exposition
from monitor.web.store import Store
from monitor.web.viewers import Viewers

from .example import all_frames, hello


def families(store, viewers=None):
    text, kind = exposition(store, Viewers(3, 10) if viewers is None else viewers)
    assert kind.startswith("text/plain; version=0.0.4")
    return {family.name: family for family in text_string_to_metric_families(text.decode())}


@pytest.fixture(scope="module")
def read():
    store = Store(100)
    store.begin(json.dumps(hello([])).encode())
    for frame in all_frames():
        store.add(json.dumps(frame).encode())
    viewers = Viewers(3, 10)
    viewers.refused, viewers.dropped = 2, 5
    return families(store, viewers)


def value(read, name, **labels):
    (sample,) = [
        s for f in read.values() for s in f.samples if s.name == name and s.labels == labels
    ]
    return sample.value


@pytest.mark.parametrize(
    ("name", "labels", "expected"),
    [
        ("mavsentry_link_silent", {}, 1.0),
        ("mavsentry_link_datagrams_total", {}, 88_000),
        ("mavsentry_link_received_bytes_total", {}, 7_040_000),
        ("mavsentry_stream_rate_hertz", {"stream": "imu0"}, 200.0),
        ("mavsentry_stream_stale", {"stream": "imu1"}, 1.0),
        ("mavsentry_answer_latency_seconds", {"quantile": "0.99"}, 0.0245),
        ("mavsentry_sensor_state", {"sensor": "airspeed0", "state": "faulty"}, 1.0),
        ("mavsentry_sensor_state", {"sensor": "airspeed0", "state": "ok"}, 0.0),
        ("mavsentry_faults_total", {"sensor": "airspeed0"}, 1.0),
        ("mavsentry_faults_total", {"sensor": "aoa0"}, 0.0),
        ("mavsentry_rejected_total", {"what": "frame", "reason": "bad crc"}, 2.0),
        ("mavsentry_recorder_recording", {}, 1.0),
        ("mavsentry_recorder_bytes_total", {}, 7_040_000),
        ("mavsentry_web_viewers", {}, 0.0),
        ("mavsentry_web_viewers_refused_total", {}, 2.0),
        ("mavsentry_web_frames_dropped_total", {}, 5.0),
        ("mavsentry_process_cpu_seconds_total", {"process": "daemon"}, 36.0),
        ("mavsentry_process_resident_memory_bytes", {"process": "daemon"}, 180e6),
        ("mavsentry_vehicle_time_seconds", {}, 176.0),
        ("mavsentry_build_info", {"profile": "transport", "version": "0.1.0"}, 1.0),
    ],
)
def test_values_are_those_of_the_newest_frame(read, name, labels, expected):
    assert value(read, name, **labels) == pytest.approx(expected)


def test_every_sensor_is_in_one_state(read):
    by_sensor = {}
    for sample in read["mavsentry_sensor_state"].samples:
        by_sensor.setdefault(sample.labels["sensor"], []).append(sample.value)
    assert len(by_sensor) > 10
    assert all(sorted(v) == [0.0] * (len(State) - 1) + [1.0] for v in by_sensor.values())


def test_names_keep_the_conventions(read):
    for name, family in read.items():
        assert name.startswith("mavsentry_")
        assert name == name.lower()
        assert family.documentation.endswith(".")
        assert not name.endswith(("_ms", "_mb", "_percent", "_hz"))
        if family.type == "counter":
            assert {s.name for s in family.samples} <= {f"{name}_total"}


def test_before_the_daemon_said_anything_there_are_viewers_only():
    assert set(families(Store(3))) == {
        "mavsentry_web_viewers",
        "mavsentry_web_viewers_refused",
        "mavsentry_web_frames_dropped",
    }


def test_what_is_not_known_is_left_out():
    store = Store(3)
    said = hello([])
    said |= {"latency": {"count": 0, "median_ms": None, "p99_ms": None, "worst_ms": None}}
    said |= {"process": {"cpu_s": 1.0, "memory_mb": None, "snapshot_ms": None, "dropped": 0}}
    store.begin(json.dumps(said | {"recorder": None}).encode())
    read = families(store)
    assert not read["mavsentry_answer_latency_seconds"].samples
    assert "mavsentry_recorder_bytes" not in read
    assert "mavsentry_vehicle_time_seconds" not in read


def test_every_metric_in_the_docs_is_served(read):
    docs = Path(__file__).parents[3] / "docs" / "live.md"
    documented = set(re.findall(r"mavsentry_[a-z_]+[a-z]\b(?!\*)", docs.read_text("utf-8")))
    served = {sample.name for family in read.values() for sample in family.samples}
    assert len(documented) > 15
    assert documented <= served
