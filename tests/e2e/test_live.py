"""The daemon as a process over real UDP: the same verdicts as from the log, published in time."""

import json
import socket
import subprocess
import threading
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as wire

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.analyze import analyze_log
from monitor.commands.daemon_process import DaemonProcess
from monitor.commands.showing import as_json
from monitor.recorder import whole_frames
from monitor.settings import load

from .conftest import COMMAND

OURS, HEARTBEAT = 191, 0

READY_S = 150.0
"""The daemon may have to compile its kernels first."""


class Listener:
    """What arrives on a UDP port, decoded by pymavlink as a ground station would."""

    def __init__(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.2)
        self.port = self._socket.getsockname()[1]
        self.messages = []
        self.raw = []
        self._ended = False
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended = True
        self._thread.join()
        self._socket.close()

    def _listen(self):
        parser = wire.MAVLink(None)
        while not self._ended:
            try:
                data = self._socket.recv(4096)
            except TimeoutError:
                continue
            self.raw.append(data)
            for message in parser.parse_buffer(data) or ():
                self.messages.append((time.monotonic(), message))

    def wait_for(self, kind, timeout_s):
        end_s = time.monotonic() + timeout_s
        while not any(m.get_type() == kind for _, m in list(self.messages)):
            assert time.monotonic() < end_s, f"no {kind} in {timeout_s} s"
            time.sleep(0.05)

    def of(self, kind):
        return [m for _, m in self.messages if m.get_type() == kind]

    def named(self, name):
        return [m.value for m in self.of("NAMED_VALUE_FLOAT") if m.name == name]


def replayed(log, speed, *arguments):
    """Changes of state and messages of a daemon that a log was replayed to over UDP."""
    with (
        Listener() as listener,
        DaemonProcess(("--out", f"udpout:127.0.0.1:{listener.port}", *arguments)) as daemon,
    ):
        listener.wait_for("HEARTBEAT", READY_S)
        to = f"udpout:127.0.0.1:{daemon.port}"
        sent = subprocess.run(
            [*COMMAND, "replay", str(log), "--to", to, "--speed", str(speed)],
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert sent.returncode == 0, sent.stderr
        time.sleep(0.5)
        assert daemon.stop() == 0, daemon.notes
        return [change for _, change in daemon.changes], listener, daemon


def from_log(log):
    verdicts = analyze_log(log, load()).verdicts
    return [json.loads(json.dumps(as_json(v))) for v in verdicts]


@pytest.fixture(scope="module")
def live(flight_log, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    changes, listener, daemon = replayed(flight_log, 10, "--record", str(folder))
    return changes, listener, daemon, folder


def test_live_verdicts_are_those_of_the_log_to_the_last_bit(flight_log, live):
    changes, _, daemon, _ = live
    expected = from_log(flight_log)
    assert [c for c in expected if c["state"] == "faulty"]
    assert changes == expected, daemon.notes


def test_what_broke_is_named_and_nothing_else(live):
    changes, *_ = live
    assert {c["sensor"] for c in changes if c["state"] == "faulty"} == {"imu0.acc_x", "airspeed0"}


def test_a_recorded_flight_gives_the_same_verdicts_live(shared_data):
    log = shared_data / "sitl" / "f2_pitot_block_pressure.tlog"
    changes, _, daemon = replayed(log, 40)
    assert changes == from_log(log), daemon.notes


def test_the_recording_is_what_was_sent_and_what_was_said(flight_log, live):
    _, listener, _, folder = live
    (recording,) = folder.glob("*.tlog")
    assert frames(recording) == frames(flight_log)
    ours = frames(recording, OURS)
    said = {content(frame) for frame in ours}
    before = [frame for frame in listener.raw if content(frame) not in said]
    assert {message_id(frame) for frame in before} == {HEARTBEAT}  # before the vehicle was heard
    assert len(ours) > len(before)
    assert from_log(recording) == from_log(flight_log)


def test_the_recording_tells_live_beside_replay(live):
    *_, folder = live
    (recording,) = folder.glob("*.tlog")
    summary = analyze_log(recording, load()).summary
    (monitor,) = summary["live"]["monitors"]
    assert (monitor["component_id"], monitor["left_out"]) == (OURS, 0)
    lines = {line["sensor"]: line for line in summary["live"]["faults"]}
    assert set(lines) == {fault["sensor"] for fault in summary["faults"]}
    for fault in summary["faults"]:
        line = lines[fault["sensor"]]
        assert line["agreement"] == "both"
        assert line["replay_s"] == fault["isolated_s"]
        assert 0.0 <= line["delay_s"] <= 10.0  # at ten times real time: half a second a mask
        assert line["said"].startswith(f"{fault['sensor']} FAULTY")
        assert (line["live_cleared_s"] is None) == (fault["cleared_s"] is None)


def content(frame):
    """What of a frame is the same on every link: frames are numbered for each link."""
    return frame[5 : 10 + frame[1]]


def message_id(frame):
    return int.from_bytes(frame[7:10], "little")


def frames(log, component=1):
    framer = Framer(load_dialect(), stamped=True)
    parts = [framer.feed(log.read_bytes()), framer.finish()]
    parts = [part.take(part.component == component) for part in parts]
    return [frame for part in parts for frame, _ in whole_frames(part)]


def test_a_ground_station_reads_what_is_published(live):
    _, listener, _, _ = live
    assert {(m.get_srcSystem(), m.get_srcComponent()) for _, m in listener.messages} == {(1, 191)}
    beats = listener.of("HEARTBEAT")
    assert {4, 5} <= {m.system_status for m in beats}
    assert 1 in {int(v) for v in listener.named("FLT_IMU0")}
    assert 1 in {int(v) for v in listener.named("FLT_AIR")}
    assert int(listener.named("MON_IMU0")[-1]) == 0b111111
    texts = [m.text for m in listener.of("STATUSTEXT")]
    assert any(t.startswith("imu0.acc_x FAULTY") for t in texts)
    assert any(t.startswith("airspeed0 FAULTY") for t in texts)
    assert all(len(t) <= 50 for t in texts)
    assert listener.named("R_CAS")
    assert {m.id for m in listener.of("AIRSPEED")} == {9}
    assert listener.of("WIND_COV")
    assert {m.array_id for m in listener.of("DEBUG_FLOAT_ARRAY")} >= {0}


def test_our_own_output_is_never_an_input(flight_log, live, tmp_path):
    _, listener, _, _ = live
    ours = list(listener.raw)
    assert len(ours) > 100
    log = tmp_path / "echo.tlog"
    theirs = frames(flight_log)
    every = max(1, len(theirs) // len(ours))
    with log.open("wb") as file:
        for k, frame in enumerate(theirs):
            file.write((1_700_000_000_000_000 + k * 1000).to_bytes(8, "big") + frame)
            if k % every == 0 and ours:
                file.write((1_700_000_000_000_000 + k * 1000).to_bytes(8, "big") + ours.pop(0))
    assert from_log(log) == from_log(flight_log)


def test_a_port_that_is_taken_is_refused(command):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        done = command("run", "--in", f"udpin:127.0.0.1:{port}")
    assert done.returncode == 2
    (sentence,) = done.stderr.splitlines()
    assert str(port) in sentence
    assert "in use" in sentence


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_run_ends_with_0_when_told_to_stop(number):
    import signal

    with Listener() as listener:
        process = subprocess.Popen(
            [
                *COMMAND,
                "run",
                "--in",
                "udpin:127.0.0.1:0",
                "--out",
                f"udpout:127.0.0.1:{listener.port}",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        listener.wait_for("HEARTBEAT", READY_S)
        process.send_signal(getattr(signal, number))
        out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    assert out == ""
    assert "stopped" in err
    assert {m.system_status for m in listener.of("HEARTBEAT")} == {6}


def test_a_peer_that_is_not_there_is_no_error():
    import signal

    process = subprocess.Popen(
        [*COMMAND, "run", "--in", "tcp:127.0.0.1:1", "--out", "udpout:127.0.0.1:1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(4.0)
    assert process.poll() is None, process.stderr.read()
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 0, err


@pytest.mark.alone
@pytest.mark.parametrize("arguments", [("replay",), ("analyze",)])
def test_ctrl_c_ends_with_130(flight_log, tmp_path, arguments):
    import os
    import signal

    extra = ("--to", "udpout:127.0.0.1:9", "--speed", "1") if arguments == ("replay",) else ()
    many = [str(flight_log)]
    if not extra:
        many = [str(tmp_path / f"{k}.tlog") for k in range(1000)]
        for name in many:
            os.link(flight_log, name)
    out = () if extra else ("--out", str(tmp_path))
    with subprocess.Popen(
        [*COMMAND, *arguments, *many, *extra, *out],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # A shell's background job ignores SIGINT and would hand that down.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        time.sleep(3.0)
        process.send_signal(signal.SIGINT)
        try:
            _, err = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 130
    assert "Traceback" not in err


def test_the_status_is_told_while_it_runs(flight_log):
    import os
    import signal

    with DaemonProcess() as daemon:
        time.sleep(0.1)
        end_s = time.monotonic() + READY_S
        while daemon.last_status is None and time.monotonic() < end_s:
            if "listening" in daemon.notes:
                time.sleep(1.0)
                os.kill(daemon.pid, signal.SIGUSR1)
            time.sleep(0.2)
        assert daemon.last_status is not None
        assert daemon.last_status["silent"]
