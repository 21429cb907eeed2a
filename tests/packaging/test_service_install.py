"""The service below a private root: installed, again, dry, refused, taken away."""

import os
import shutil
import sys
import tomllib
from pathlib import Path

import pytest

from monitor.cli import invoke
from monitor.commands import service
from monitor.service.installation import rules_text, serial_group, unit_text
from monitor.settings import load

PROGRAM = "/opt/mavsentry/bin/mavsentry"
PORT = "/dev/serial/by-id/usb-CubePilot_CubeOrange_2F00-if00"
UNIT = "etc/systemd/system/mavsentry.service"
CONFIG = "etc/mavsentry/mavsentry.toml"
WANTED = "etc/systemd/system/multi-user.target.wants/mavsentry.service"
RULES = "etc/udev/rules.d/70-mavsentry.rules"


@pytest.fixture
def root(tmp_path):
    """A system of which only the groups are there."""
    folder = tmp_path / "image"
    (folder / "etc").mkdir(parents=True)
    (folder / "etc/group").write_text("root:x:0:\ndialout:x:20:\n")
    return folder


@pytest.fixture
def said(root, capsys):
    """Calls `mavsentry service` below the root: status, standard output, standard error."""

    def call(*arguments):
        status = invoke(["service", *map(str, arguments), "--root", str(root)])
        return status, *capsys.readouterr()

    return call


def files(root):
    """Everything below the root with its content, and when it was written."""
    found = [path for path in root.rglob("*") if path.is_file() or path.is_symlink()]
    return {
        str(path.relative_to(root)): (
            os.readlink(path) if path.is_symlink() else path.read_text(),
            path.lstat().st_mtime_ns,
        )
        for path in found
    }


def test_one_command_brings_unit_configuration_rules_and_the_start(root, said):
    status, out, err = said("install", "--program", PROGRAM, "--in", f"{PORT}:921600")
    assert (status, err) == (0, "")
    assert set(files(root)) == {"etc/group", UNIT, CONFIG, WANTED, RULES}
    unit = (root / UNIT).read_text()
    assert f"\nExecStart={PROGRAM} run --config /etc/mavsentry/mavsentry.toml\n" in unit
    assert "\nSupplementaryGroups=dialout\n" in unit
    assert os.readlink(root / WANTED) == f"/{UNIT}"
    assert 'ENV{ID_SERIAL}=="CubePilot_CubeOrange_2F00"' in (root / RULES).read_text()
    for path in (UNIT, CONFIG, WANTED, RULES):
        assert str(root / path) in out


def test_the_configuration_is_one_that_run_takes_and_records(root, said):
    said("install", "--program", PROGRAM, "--in", f"{PORT}:921600", "--profile", "transport")
    settings = load(None, root / CONFIG)
    assert settings.links.inputs == (f"{PORT}:921600",)
    assert settings.profile == "transport"
    assert settings.recorder.folder == "/var/lib/mavsentry/recordings"
    assert (root / CONFIG).stat().st_mode & 0o777 == 0o644  # the service's user must read it


def test_done_again_it_touches_nothing(root, said):
    said("install", "--program", PROGRAM)
    before = files(root)
    status, out, _ = said("install", "--program", PROGRAM)
    assert status == 0
    assert "wrote" not in out
    assert files(root) == before


def test_a_configuration_that_is_there_stays_and_an_old_unit_does_not(root, said):
    own = '[links]\ninputs = ["udpin:127.0.0.1:14999"]\n'
    (root / CONFIG).parent.mkdir()
    (root / CONFIG).write_text(own)
    said("install", "--program", "/opt/old/bin/mavsentry")
    said("install", "--program", PROGRAM)
    assert (root / CONFIG).read_text() == own
    assert PROGRAM in (root / UNIT).read_text()
    status, _, err = said("install", "--program", PROGRAM, "--in", "udpin:127.0.0.1:1")
    assert status == 2
    assert "is not written over" in err


def test_a_dry_run_says_all_and_does_nothing(root, said):
    before = files(root)
    status, out, _ = said("install", "--program", PROGRAM, "--in", f"{PORT}:921600", "--dry-run")
    assert status == 0
    assert files(root) == before
    for path in (UNIT, CONFIG, RULES):
        assert f"would write {root / path}" in out
    assert f"would link {root / WANTED}" in out


def test_taken_away_it_leaves_configuration_and_state_purged_nothing(root, said):
    before = files(root)
    said("install", "--program", PROGRAM)
    state = root / "var/lib/private/mavsentry"
    state.mkdir(parents=True)
    (state / "checkpoint-1-191").write_text("")
    (root / "var/lib/mavsentry").symlink_to("private/mavsentry")  # as systemd leaves it
    assert said("uninstall")[0] == 0
    left = set(files(root)) - set(before)
    assert left == {CONFIG, "var/lib/mavsentry", "var/lib/private/mavsentry/checkpoint-1-191"}
    assert said("uninstall", "--purge")[0] == 0
    assert files(root) == before
    assert said("uninstall", "--purge") == (0, "", "")


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--in", "pigeon:1"], "pigeon:1"),
        (["--profile", "zeppelin"], "zeppelin"),
        (["--program", "bin/mavsentry"], "absolute"),
    ],
)
def test_what_would_not_start_is_refused_before_anything_is_written(root, said, arguments, names):
    before = files(root)
    status, _, err = said("install", "--program", PROGRAM, *arguments)
    assert status == 2
    assert names in err
    assert len(err.splitlines()) == 1
    assert files(root) == before


def test_a_broken_configuration_is_refused_with_its_fault(root, said):
    (root / CONFIG).parent.mkdir()
    (root / CONFIG).write_text("[links]\ninputz = []\n")
    status, _, err = said("install", "--program", PROGRAM)
    assert status == 2
    assert "inputz" in err
    assert not (root / UNIT).exists()


def test_a_serial_port_without_its_extra_is_refused(said, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    status, _, err = said("install", "--program", PROGRAM, "--in", "/dev/ttyAMA0:921600")
    assert status == 2
    assert "mavsentry[serial]" in err


def test_a_program_that_the_service_cannot_see_is_refused(said, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/home/pi/.local/bin/python")
    monkeypatch.setattr(Path, "is_file", lambda path: True)
    status, _, err = said("install")
    assert status == 2
    assert "cannot see /home/pi/.local/bin/mavsentry" in err


def test_on_a_computer_without_systemd_it_says_what_to_do(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(service, "SYSTEMD_RUNS", tmp_path / "none")
    monkeypatch.setattr(service, "_program", lambda given, here: Path(PROGRAM))
    assert invoke(["service", "install"]) == 2
    assert "--root DIR" in capsys.readouterr().err


def test_on_a_computer_with_systemd_it_asks_for_root_and_says_what_it_would_run(
    capsys, monkeypatch, tmp_path
):
    monkeypatch.setattr(service, "SYSTEMD_RUNS", tmp_path)
    monkeypatch.setattr(service, "_program", lambda given, here: Path(PROGRAM))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert invoke(["service", "install"]) == 2
    assert "sudo" in capsys.readouterr().err
    assert invoke(["service", "install", "--dry-run"]) == 0
    runs = [x for x in capsys.readouterr().out.splitlines() if x.startswith("would run")]
    kernels = f"would run env MAVSENTRY_CACHE_DIR=/var/cache/mavsentry/kernels {PROGRAM} warmup"
    assert runs[0] == "would run systemctl daemon-reload"
    assert runs[-2:] == [kernels, "would run systemctl restart mavsentry"]


@pytest.mark.parametrize(
    ("link", "rule"),
    [
        ("/dev/serial/by-id/usb-Hex_ProfiCNC_CubeBlack*-if00:921600", "Hex_ProfiCNC_CubeBlack*"),
        ("/dev/serial/by-id/usb-FTDI_FT232R_A1-if00-port0", "FTDI_FT232R_A1"),
        ("/dev/ttyACM1", "ttyACM1"),
        ("/dev/ttyAMA0:921600", None),
        ("udpin:0.0.0.0:14550", None),
    ],
)
def test_modem_manager_is_kept_off_usb_ports_and_only_those(link, rule):
    text = rules_text([link])
    assert (f'=="{rule}", ENV{{ID_MM_PORT_IGNORE}}="1"' in text) if rule else not text


def test_the_group_of_serial_ports_is_the_systems(root):
    assert serial_group(root) == "dialout"
    (root / "etc/group").write_text("uucp:x:986:\n")
    assert serial_group(root) == "uucp"
    (root / "etc/group").unlink()
    assert serial_group(root) is None
    assert "SupplementaryGroups" not in unit_text(Path(PROGRAM), None)


def test_a_program_with_a_blank_in_its_path_stays_one_word():
    assert '\nExecStart="/opt/my tools/mavsentry" run ' in unit_text(
        Path("/opt/my tools/mavsentry")
    )


@pytest.mark.skipif(shutil.which("systemctl") is None, reason="systemctl is not installed")
def test_systemctl_itself_takes_it_for_enabled(root, said):
    import subprocess

    said("install", "--program", PROGRAM)
    done = subprocess.run(
        ["systemctl", "--root", str(root), "is-enabled", "mavsentry"],
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert done.stdout.strip() == "enabled", done.stderr


def test_the_example_keys_in_the_comments_are_keys():
    text = service._CONFIG.format(profile="small-uav", inputs='"udpin:0.0.0.0:14550"')
    marked = text.replace("# [web]", "[web]").replace("# address", "address")
    assert tomllib.loads(marked)["web"]["address"] == "127.0.0.1:8080"
