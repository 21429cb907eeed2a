"""The daemon as a service: told by a manager's socket, by signals and in its log; from --config."""

import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from links.mavlink import Encoder
from monitor.commands.daemon_process import free_port

READY_S = 150.0
"""The daemon may have to compile its kernels first."""

STOP_S = 1.0

CONFIG = """\
[links]
inputs = ["udpin:127.0.0.1:{port}"]
outputs = ["udpout:127.0.0.1:{out}"]
silent_after_s = {silent_s}

[recorder]
folder = "{folder}/recordings"

[log]
to = "{folder}/events.jsonl"
"""


class Service:
    """``mavsentry run --config`` under a manager, with a vehicle that says little."""

    def __init__(self, folder):
        self.folder = folder
        self.config = folder / "mavsentry.toml"
        self.port, self.out = free_port(), free_port()
        self.write()
        self._manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._manager.bind(str(folder / "notify"))
        self._manager.settimeout(0.1)
        self.said = []
        environ = {
            **os.environ,
            "NOTIFY_SOCKET": str(folder / "notify"),
            "WATCHDOG_USEC": "1000000",
            "STATE_DIRECTORY": str(folder / "state"),
        }
        self.process = subprocess.Popen(
            [sys.executable, "-m", "monitor.cli", "run", "--config", str(self.config)],
            env=environ,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def write(self, silent_s=3.0):
        self.config.write_text(
            CONFIG.format(port=self.port, out=self.out, folder=self.folder, silent_s=silent_s)
        )

    def until(self, wanted, timeout_s=20.0):
        """Messages up to the first that begins so."""
        end_s = time.monotonic() + timeout_s
        new = []
        while not any(text.startswith(wanted) for text in new):
            assert time.monotonic() < end_s, (wanted, self.said)
            assert self.process.poll() is None, self.process.stderr.read()
            try:
                new.append(self._manager.recv(4096).decode())
            except TimeoutError:
                continue
            finally:
                self.said += new[-1:]
        return new

    def rest(self):
        """Messages that were sent and not read yet."""
        out = []
        while True:
            try:
                out.append(self._manager.recv(4096).decode())
            except TimeoutError:
                return out

    def events(self, event=None):
        lines = (self.folder / "events.jsonl").read_text().splitlines()
        found = [json.loads(line) for line in lines]
        return [e for e in found if event in (None, e["event"])]

    def wait_for(self, event, count=1, timeout_s=20.0):
        end_s = time.monotonic() + timeout_s
        while len(self.events(event)) < count:
            assert time.monotonic() < end_s, self.events()
            time.sleep(0.05)
        return self.events(event)[-1]

    def hear_a_vehicle(self):
        """Vehicle 7 says for two seconds that it is there; until the status tells of it."""
        encoder = Encoder(7, 1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            for k in range(40):
                beat = encoder.encode("HEARTBEAT", type=1, autopilot=3)
                time_ms = 10_000 + 100 * k
                beat += encoder.encode("ATTITUDE", time_boot_ms=time_ms)
                vehicle.sendto(beat, ("127.0.0.1", self.port))
                time.sleep(0.05)
        self.status = self.until("STATUS=vehicle 7", 15.0)[-1]

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.stderr.close()
        self.process.wait(10.0)
        self._manager.close()


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    service = Service(tmp_path_factory.mktemp("service"))
    service.until("READY=1", READY_S)
    service.hear_a_vehicle()
    yield service
    service.close()


def test_it_is_ready_when_it_turns_and_feeds_the_watchdog(service):
    began_s = time.monotonic()
    for _ in range(4):
        service.until("WATCHDOG=1", 5.0)
    assert 1.0 < time.monotonic() - began_s < 4.0  # each half second


def test_the_first_event_says_what_runs(service):
    start = service.events("start")[0]
    assert start["links"] == [f"udpin:127.0.0.1:{service.port}", f"udpout:127.0.0.1:{service.out}"]
    assert start["pid"] == service.process.pid
    assert {e["name"] for e in service.events("link_up")} == set(start["links"])


def test_a_vehicle_is_an_event_and_shows_in_the_status(service):
    assert service.wait_for("vehicle")["system_id"] == 7
    assert "sensors ok" in service.status


def test_a_reload_takes_what_can_be_taken(service):
    service.write(silent_s=1.5)
    os.kill(service.process.pid, signal.SIGHUP)
    reloading = service.until("RELOADING=1")[-1]
    assert "\nMONOTONIC_USEC=" in reloading
    service.until("READY=1")
    event = service.wait_for("reload")
    assert event["taken"] == ["links.silent_after_s"]
    assert event["waiting"] == []
    assert "links.silent_after_s" in event["message"]


def test_a_configuration_that_is_broken_changes_nothing(service):
    before = len(service.events("reload"))
    service.config.write_text("[links]\nsilent_after_s = -1\n")
    os.kill(service.process.pid, signal.SIGHUP)
    event = service.wait_for("reload", before + 1)
    assert event["level"] == "error"
    assert "silent_after_s" in event["message"]
    assert "nothing was changed" in event["message"]
    service.until("WATCHDOG=1")
    service.write(silent_s=1.5)


@pytest.mark.alone
def test_a_log_that_was_moved_away_is_begun_anew(service):
    (service.folder / "events.jsonl").rename(service.folder / "events.jsonl.1")
    os.kill(service.process.pid, signal.SIGUSR1)
    end_s = time.monotonic() + 10.0
    while not (service.folder / "events.jsonl").exists():
        assert time.monotonic() < end_s
        time.sleep(0.05)
    status = service.wait_for("status")
    assert status["rows"] > 0
    assert status["beat_gap_s"] < 2.0


@pytest.mark.alone
def test_it_stops_within_a_second_in_order_and_says_all(service):
    service.rest()  # what a manager has not read leaves no room for more
    began_s = time.monotonic()
    os.kill(service.process.pid, signal.SIGTERM)
    status = service.process.wait(20.0)
    took_s = time.monotonic() - began_s
    assert status == 0
    assert service.rest()[-1] == "STOPPING=1"
    assert service.events("stop")[-1]["sent"] > 3
    (recording,) = (service.folder / "recordings").glob("*.tlog")
    assert recording.stat().st_size > 1000
    kept = [path.name for path in (service.folder / "state").iterdir()]
    assert "checkpoint-7-191" in kept
    assert took_s < STOP_S


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[log]\nto = '/nowhere/at/all'\n", "cannot log to"),
        ("[log]\nlevel = 'loud'\n", "log.level"),
        ("[links]\ninputs = ['pigeon:1']\n", "pigeon:1"),
        ("[links]\ninputs = []\n", "links.inputs"),
        ("[web]\naddress = 'everywhere'\n", "everywhere"),
        ("[recorder]\nfolder = '/dev/null/x'\n", "cannot record"),
        ("[service]\nx = 1\n", "service"),
    ],
)
def test_a_wrong_value_is_refused_in_a_sentence(tmp_path, command, text, said):
    config = tmp_path / "wrong.toml"
    config.write_text(text if "inputs" in text else f"{text}[links]\ninputs=['udpin:127.0.0.1:0']")
    done = command("run", "--config", config)
    assert done.returncode == 2
    sentence = done.stderr.splitlines()[-1]
    assert said in sentence
    assert "Traceback" not in done.stderr
