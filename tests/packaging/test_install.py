"""From the checkout to a program: sdist and wheel, uv, pipx, 64-bit Arm. Asks the package index."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from links.jit import cache_root
from monitor.commands.machine_speed import EXTRAS
from tests.conftest import ROOT
from tests.peers.conftest import missing

pytestmark = pytest.mark.external

PACKAGES = ("estimators", "links", "monitor", "sim_feeds")
ARM = "aarch64-manylinux_2_28"
"""Debian 11 to 13, Raspberry Pi OS, Ubuntu 20.04 and later have a C library as new as this."""


def call(*command, timeout=240.0, home=None, **environ):
    """What a program says; it must end well."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "MAVSENTRY_CACHE_DIR")}
    kept.setdefault("UV_CACHE_DIR", str(Path.home() / ".cache" / "uv"))
    own = kept | ({"HOME": str(home)} if home else {}) | environ
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=timeout, env=own, cwd=home
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def tool(name):
    """A program beside this Python, or on the path."""
    here = Path(sys.executable).with_name(name)
    found = str(here) if here.is_file() else shutil.which(name)
    return found or missing(f"{name} is not installed")


@pytest.fixture(scope="session")
def dist(tmp_path_factory):
    """Folder with the source distribution and the wheel that was built from it."""
    if importlib.util.find_spec("build") is None:
        missing("build is not installed")
    folder = tmp_path_factory.mktemp("dist")
    call(sys.executable, "-m", "build", "--outdir", folder, ROOT)
    return folder


@pytest.fixture(scope="session")
def wheel(dist):
    (file,) = dist.glob("*.whl")
    return file


@pytest.fixture(scope="session")
def home(tmp_path_factory):
    """An empty one."""
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="session")
def installed(wheel, home):
    """`uv tool install`, of the core alone: the command, and the environment it lives in."""
    places = {"UV_TOOL_DIR": str(home / "tools"), "UV_TOOL_BIN_DIR": str(home / "bin")}
    call(tool("uv"), "tool", "install", "--python", sys.executable, wheel, home=home, **places)
    return home / "bin" / "mavsentry", home / "tools" / "mavsentry"


@pytest.fixture(scope="session")
def kernels(installed, home):
    """Kernels of this checkout, in the places where those of the installed program are looked for.

    They are the same, since the sources are; to compile them takes minutes.
    """
    (site,) = installed[1].glob("lib/python*/site-packages")
    target = home / "kernels"
    moved = {f"{p.name}_{_path_hash(p)}": f"{p.name}_{_path_hash(to)}" for p, to in _folders(site)}
    for folder in cache_root().glob("*/*"):
        if folder.name in moved:
            shutil.copytree(folder, target / folder.parent.name / moved[folder.name])
    return str(target)


def _folders(site):
    for package in PACKAGES:
        for folder in (ROOT / package, *(p for p in (ROOT / package).rglob("*") if p.is_dir())):
            yield folder, site / folder.relative_to(ROOT)


def _path_hash(folder):
    return hashlib.sha1(str(folder).encode()).hexdigest()


def test_the_wheel_holds_the_packages_and_what_they_read(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
    assert {name.split("/")[0].split("-")[0] for name in names} == {*PACKAGES, "mavsentry"}
    assert {
        "monitor/service/mavsentry.service",
        "monitor/profiles/transport.toml",
        "sim_feeds/scenarios/demo.toml",
        *(f"{package}/py.typed" for package in PACKAGES),
    } <= names
    assert wheel.stat().st_size < 5e6


def test_the_source_distribution_can_be_tested(dist):
    (file,) = dist.glob("*.tar.gz")
    with tarfile.open(file) as archive:
        top = {name.split("/")[1] for name in archive.getnames() if "/" in name}
    assert {*PACKAGES, "tests", "docs", "Makefile", "pyproject.toml", "CHANGELOG.md"} <= top


def test_installed_by_uv_into_an_empty_home_it_flies_and_finds(installed, kernels, home):
    command, _ = installed
    environ = {"MAVSENTRY_CACHE_DIR": kernels}
    assert call(command, "--version", home=home).startswith("mavsentry 0.")
    said = call(command, "selftest", "--speed", 20, "--json", home=home, **environ)
    result = json.loads(said)
    assert result["passed"], result
    assert result["missing_extras"] == list(EXTRAS)
    call(command, "feed", "small-uav-pitot-blockage", "--to", "a.tlog", home=home, **environ)
    assert "airspeed0" in call(command, "analyze", "a.tlog", home=home, **environ)
    out = home / "mavsentry-out" / "a"
    assert json.loads((out / "summary.json").read_text())["faults"]
    assert not (out / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (["run", "--in", "/dev/ttyAMA0:921600"], "serial"),
        (["run", "--in", "udpin:127.0.0.1:0", "--web", "127.0.0.1:0"], "web"),
        (["fleet", "*.tlog", "--out", "fleet-out"], "fleet"),
        (["feed", "aerosonde-healthy", "--to", "b.tlog"], "sim"),
    ],
)
def test_what_needs_an_extra_says_which(installed, kernels, home, arguments, extra):
    done = subprocess.run(
        [str(installed[0]), *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=home,
        env=os.environ | {"HOME": str(home), "MAVSENTRY_CACHE_DIR": kernels, "PYTHONPATH": ""},
    )
    assert done.returncode == 2, done.stderr
    assert f"mavsentry[{extra}]" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_service_is_installed_from_it(installed, home, tmp_path):
    program = "/opt/mavsentry/bin/mavsentry"
    root = ("--root", tmp_path, "--program", program)
    call(installed[0], "service", "install", *root, home=home)
    unit = (tmp_path / "etc/systemd/system/mavsentry.service").read_text()
    assert f"ExecStart={program} run" in unit


def test_pipx_installs_it(wheel, home):
    places = {"PIPX_HOME": str(home / "pipx"), "PIPX_BIN_DIR": str(home / "pipx-bin")}
    call(tool("pipx"), "install", "--python", sys.executable, wheel, home=home, **places)
    said = call(home / "pipx-bin" / "mavsentry", "--version", home=home)
    assert said.startswith("mavsentry 0.")


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_all_of_a_companion_computer_comes_as_wheels_for_64_bit_arm(python):
    resolved = call(
        *(tool("uv"), "pip", "compile", "--quiet", "--no-header", "--no-annotate"),
        *("--python-platform", ARM, "--python-version", python, "--only-binary", ":all:"),
        *("--extra", "serial", "--extra", "report", "--extra", "web", ROOT / "pyproject.toml"),
    )
    names = {line.partition("==")[0] for line in resolved.splitlines()}
    assert {"numpy", "numba", "llvmlite", "pymavlink", "pyserial", "bokeh", "pyarrow"} <= names
