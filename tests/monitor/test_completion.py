"""What a shell offers: asked as bash, zsh and fish ask, and of bash itself."""

import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from monitor.cli import invoke
from monitor.commands.completing import _files


def asked(shell: str, line: str, folder: Path) -> list[str]:
    """Words offered for a line, as this shell's script asks."""
    words = line.split(" ")
    variables = {
        "_MAVSENTRY_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
        "_TYPER_COMPLETE_ARGS": line,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }
    done = subprocess.run(
        [sys.executable, "-c", "import sys, monitor.cli as c; sys.argv[0]='mavsentry'; c.main()"],
        env=os.environ | variables,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.fixture
def flights(tmp_path: Path) -> Path:
    for name in ("flight.tlog", "flight2.BIN", "notes.txt", "flight.toml", "my.ulg"):
        (tmp_path / name).touch()
    (tmp_path / "flights").mkdir()
    (tmp_path / "flights" / "old.tlog").touch()
    return tmp_path


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("mavsentry ana", ["analyze"]),
        ("mavsentry analyze --profile l", ["light-aircraft"]),
        ("mavsentry analyze fl", ["flight.tlog", "flight2.BIN", "flights/"]),
        ("mavsentry analyze flights/", ["flights/old.tlog"]),
        ("mavsentry feed small-uav-p", ["small-uav-pitot-blockage"]),
        ("mavsentry run --config fl", ["flight.toml", "flights/"]),
        ("mavsentry run --in udpin", ["udpin:0.0.0.0:14550"]),
        ("mavsentry config show air.conf", ["air.confirm_s"]),
        ("mavsentry completion z", ["zsh"]),
    ],
)
def test_what_fits_is_offered(line: str, offered: list[str], flights: Path) -> None:
    assert asked("bash", line, flights) == offered


def test_zsh_and_fish_get_the_words_with_their_meaning(flights: Path) -> None:
    zsh = asked("zsh", "mavsentry analyze --pro", flights)
    assert '"--profile":"Class of airframe' in zsh[0]
    fish = asked("fish", "mavsentry analyze --pro", flights)
    assert fish[0].startswith("--profile\tClass of airframe")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_a_script_that_asks_the_program(
    shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert f"_MAVSENTRY_COMPLETE=complete_{shell}" in script
    if found := shutil.which(shell):
        subprocess.run([found, "-n"], input=script, text=True, check=True)


def test_bash_completes_a_link_behind_its_colon(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "mavsentry"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m monitor.cli "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    assert invoke(["completion", "bash"]) == 0
    script = tmp_path / "script"
    script.write_text(capsys.readouterr().out)
    line = "mavsentry run --in udpin:0"
    ask = (
        f"source {script}; COMP_LINE='{line}'; COMP_POINT={len(line)}\n"
        f"COMP_WORDS=(mavsentry run --in udpin : 0); COMP_CWORD=5\n"
        f"COMP_WORDBREAKS=$' \\t\\n\"\\'><=;|&(:'\n"
        f"_mavsentry {program}; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("0.0.0.0:14550\n", "")


def test_a_folder_that_cannot_be_read_offers_nothing(tmp_path: Path) -> None:
    assert _files(f"{tmp_path}/nowhere/", (".tlog",)) == []


def test_words_that_need_no_settings_load_no_numerics(flights: Path) -> None:
    code = (
        "import os, sys, monitor.cli as c, monitor.commands.completing as w\n"
        "w.profiles(''); w.scenarios(''); w.links('u'); w.logs('')\n"
        "print(*sys.modules)"
    )
    began_s = time.process_time()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numba", "numpy", "pydantic", "pymavlink"} & set(done.stdout.split())
    assert time.process_time() - began_s < 5.0
