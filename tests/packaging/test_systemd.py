"""The unit file as systemd itself sees it, and what it promises of the program."""

import configparser
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from monitor.security.key import CREDENTIAL
from monitor.service.installation import unit_text
from tests.conftest import ROOT

UNIT = ROOT / "monitor" / "service" / "mavsentry.service"

EXPOSURE_MAX = 2.0
"""Of systemd's own scale, 0 to 10; up to 2 is "OK"."""


@pytest.fixture(scope="module")
def keys():
    class Several(dict):
        """Keys that stand several times, as DeviceAllow, keep every value."""

        def __setitem__(self, key, value):
            if isinstance(value, list) and key in self:
                value = [*self[key], *value]
            super().__setitem__(key, value)

    parser = configparser.ConfigParser(strict=False, interpolation=None, dict_type=Several)
    parser.optionxform = str
    parser.read(UNIT, encoding="utf-8")
    return parser


@pytest.fixture
def unit(tmp_path):
    """The unit as it is installed, with a program that is there."""
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    file = tmp_path / "mavsentry.service"
    file.write_text(unit_text(Path(sys.executable)))
    return file


def analyze(*arguments):
    return subprocess.run(
        ["systemd-analyze", "--no-pager", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "SYSTEMD_COLORS": "0"},
    )


def test_systemd_finds_nothing_wrong_with_it(unit):
    done = analyze("verify", str(unit))
    assert (done.returncode, done.stderr) == (0, "")


def test_a_misspelt_key_would_be_found(unit):
    unit.write_text(unit.read_text().replace("WatchdogSec=", "WatchdogSeconds="))
    assert "WatchdogSeconds" in analyze("verify", str(unit)).stderr


def test_it_is_exposed_as_little_as_a_program_with_serial_ports_can_be(unit):
    done = analyze("security", "--offline=true", str(unit))
    (said,) = [line for line in done.stdout.splitlines() if "Overall exposure" in line]
    exposure = float(said.partition(": ")[2].split()[0])
    assert exposure <= EXPOSURE_MAX, done.stdout


def test_a_hanging_loop_is_noticed_and_started_again_for_ever(keys):
    service = keys["Service"]
    assert service["Type"] == "notify"
    assert service["NotifyAccess"] == "main"
    assert 1 <= int(service["WatchdogSec"]) <= 10
    assert service["Restart"] == "always"
    assert keys["Unit"]["StartLimitIntervalSec"] == "0"
    assert service["ExecReload"] == "/bin/kill -HUP $MAINPID"


def test_what_must_outlive_it_has_a_folder(keys):
    service = keys["Service"]
    assert {service[f"{k}Directory"] for k in ("State", "Cache", "Runtime")} == {"mavsentry"}
    assert "MAVSENTRY_CACHE_DIR=%C/mavsentry/kernels" in service["Environment"].split()
    assert f"LoadCredential={CREDENTIAL}:" in UNIT.read_text()


def test_what_would_keep_it_from_working_is_left_open(keys):
    service = keys["Service"]
    assert "MemoryDenyWriteExecute" not in service  # kernels are compiled
    assert "ProcSubset" not in service  # LLVM reads the processor's name there on Arm
    assert "PrivateDevices" not in service  # serial ports
    assert {"AF_INET", "AF_INET6", "AF_UNIX"} <= set(service["RestrictAddressFamilies"].split())
