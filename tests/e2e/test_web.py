"""``run --web`` as processes over real sockets: what a browser and Prometheus get of a flight."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from contextlib import suppress

import pytest
from prometheus_client.parser import text_string_to_metric_families

from monitor.analyze import analyze_log
from monitor.commands.daemon_process import DaemonProcess
from monitor.settings import load
from tests.monitor.web.checked import checked
from tests.monitor.web.serving import received

from .conftest import COMMAND

READY_S = 150.0
"""The daemon may have to compile its kernels first."""

SPEED = "10"


class Live:
    """A daemon with a live page."""

    def __init__(self, daemon):
        self.daemon = daemon
        until(lambda: "live page on" in daemon.notes or not daemon.running)
        found = re.search(r"live page on http://127\.0\.0\.1:(\d+)/", daemon.notes)
        assert found, daemon.notes
        self.port = int(found[1])
        self.url = f"ws://127.0.0.1:{self.port}/live"
        until(self.well)

    def well(self):
        try:
            return self.ask("/healthz") == b"ok\n"
        except OSError:
            return False

    def ask(self, path):
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=20.0) as answer:
            return answer.read()

    def metrics(self):
        text = self.ask("/metrics").decode()
        return {
            (sample.name, *sorted(sample.labels.values())): sample.value
            for family in text_string_to_metric_families(text)
            for sample in family.samples
        }

    def web_pid(self):
        """Process id of the daemon's child."""
        children = f"/proc/{self.daemon.pid}/task/{self.daemon.pid}/children"
        with open(children) as file:
            pids = file.read().split()
        return int(pids[0]) if pids else None

    def fly(self, log):
        to = f"udpout:127.0.0.1:{self.daemon.port}"
        done = subprocess.run(
            [*COMMAND, "replay", str(log), "--to", to, "--speed", SPEED],
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr
        time.sleep(0.7)


def until(true, timeout_s=READY_S):
    end_s = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def started(port=0, *arguments):
    return DaemonProcess(("--web", f"127.0.0.1:{port}", *arguments))


class Watching(threading.Thread):
    """A viewer that reads all there is until its connection ends."""

    def __init__(self, url):
        super().__init__(daemon=True)
        self.url, self.messages, self.closed = url, [], None
        self.start()

    def run(self):
        messages, self.closed = received(self.url, 1_000_000)
        self.messages += [checked(message) for message in messages[:-1]]


@pytest.fixture(scope="module")
def watched(flight_log, tmp_path_factory):
    """A flight with five viewers: what each heard, metrics at its end, the daemon's changes."""
    folder = tmp_path_factory.mktemp("recording")
    with started(0, "--record", str(folder)) as daemon:
        live = Live(daemon)
        viewers = [Watching(live.url) for _ in range(5)]
        until(lambda: live.metrics()[("mavsentry_web_viewers",)] == 5.0)
        live.fly(flight_log)
        late = [checked(m) for m in received(live.url, 2)[0]]
        metrics = live.metrics()
        assert daemon.stop() == 0, daemon.notes
        for viewer in viewers:
            viewer.join(20.0)
    return viewers, late, metrics, [change for _, change in daemon.changes]


def test_every_viewer_hears_every_frame_and_the_end(watched):
    viewers, *_ = watched
    for viewer in viewers:
        kinds = [message["kind"] for message in viewer.messages]
        assert kinds[:2] == ["hello", "history"]
        frames = [m for m in viewer.messages if m["kind"] == "frame"]
        numbers = [frame["number"] for frame in frames]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        assert len(numbers) > 30
        assert viewer.closed == (1001, "the daemon has stopped")


def test_the_page_is_told_each_change_that_the_daemon_prints(watched):
    viewers, late, _, changes = watched
    heard = [
        (sensor, standing["state"], standing["t_s"])
        for message in viewers[0].messages
        if message["kind"] == "frame"
        for sensor, standings in message.get("changes", {}).items()
        for standing in standings
    ]
    printed = [(c["sensor"], c["state"], round(c["t_us"] / 1e6, 3)) for c in changes]
    assert set(heard) == set(printed)
    standing = {sensor: standings[-1]["state"] for sensor, standings in late[0]["timeline"].items()}
    assert standing == {c["sensor"]: c["state"] for c in changes}


def test_faults_and_their_evidence_are_shown(watched):
    _, (hello, _), _, changes = watched
    faulty = {c["sensor"] for c in changes if c["state"] == "faulty"}
    assert {fault["sensor"] for fault in hello["faults"]} == faulty == {"imu0.acc_x", "airspeed0"}
    assert all(fault["evidence"] for fault in hello["faults"])


def test_frames_hold_what_was_measured_tested_and_estimated(watched):
    _, (_, history), _, _ = watched
    frames = history["frames"]
    assert {"measured", "tests", "air", "imu"} <= {key for frame in frames for key in frame}
    measured = [f["measured"]["airspeed0"] for f in frames if "airspeed0" in f.get("measured", {})]
    assert len(measured) > 20
    assert all(low <= high for low, high in measured)
    assert min(low for low, _ in measured) < 16.0 < max(high for _, high in measured)
    assert max(f["tests"].get("airspeed0", 0.0) for f in frames if "tests" in f) > 1.0


def test_metrics_tell_the_same(watched):
    _, (hello, _), metrics, _ = watched
    assert metrics[("mavsentry_sensor_state", "airspeed0", "faulty")] == 1.0
    assert metrics[("mavsentry_faults_total", "airspeed0")] == 1.0
    assert metrics[("mavsentry_link_datagrams_total",)] > 1000.0
    assert metrics[("mavsentry_recorder_bytes_total",)] > 10_000.0
    assert metrics[("mavsentry_process_cpu_seconds_total", "daemon")] > 0.1
    assert metrics[("mavsentry_process_resident_memory_bytes", "web")] > 1e6
    assert metrics[("mavsentry_web_frames_dropped_total",)] == 0.0
    assert (
        metrics[("mavsentry_stream_samples_total", "imu0")] == (hello["streams"]["imu0"]["samples"])
    )


def test_a_web_process_that_stands_still_costs_the_verdicts_nothing(flight_log):
    with started() as daemon:
        live = Live(daemon)
        web = live.web_pid()
        os.kill(web, signal.SIGSTOP)
        try:
            live.fly(flight_log)
        finally:
            with suppress(ProcessLookupError):  # it stood for so long that it was started again
                os.kill(web, signal.SIGCONT)
        until(live.well)
        assert daemon.stop() == 0, daemon.notes
    expected = [(v.t_us, v.sensor, str(v.state)) for v in analyze_log(flight_log, load()).verdicts]
    said = [(c["t_us"], c["sensor"], c["state"]) for _, c in daemon.changes]
    assert said == expected


def test_a_web_process_that_dies_is_said_once_and_comes_back():
    with started() as daemon:
        live = Live(daemon)
        first, run = live.web_pid(), checked(received(live.url, 1)[0][0])["run"]
        os.kill(first, signal.SIGKILL)
        until(lambda: live.web_pid() not in (None, first))
        until(live.well)
        assert checked(received(live.url, 1)[0][0])["run"] == run
        assert daemon.notes.count("the live page's process ended by signal 9") == 1


def test_a_restart_on_the_same_port_is_another_run_and_a_viewer_reconnects():
    with started() as daemon:
        live = Live(daemon)
        viewer = Watching(live.url)
        until(lambda: live.metrics()[("mavsentry_web_viewers",)] == 1.0)
    viewer.join(20.0)
    with started(live.port) as daemon:
        again = Live(daemon)
        assert again.port == live.port
        assert checked(received(again.url, 1)[0][0])["run"] != viewer.messages[0]["run"]


def test_a_daemon_that_is_killed_takes_the_web_process_along():
    with started() as daemon:
        live = Live(daemon)
        web = live.web_pid()
        os.kill(daemon.pid, signal.SIGKILL)
        until(lambda: not running(web), 20.0)
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", live.port))


def running(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_without_it_nothing_of_it_is_loaded(flight_log):
    code = (
        "import sys, monitor.cli as c;"
        f"status = c.invoke(['run', '--json', '--in', {str(flight_log)!r}]);"
        "print('LOADED', *sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=READY_S
    )
    (loaded,) = (line for line in done.stdout.splitlines() if line.startswith("LOADED"))
    assert "monitor.daemon" in loaded.split(), done.stderr
    strange = {"tornado", "bokeh", "jinja2", "prometheus_client", "monitor.web", "asyncio"}
    assert not strange & set(loaded.split())
