"""Files that a page shows, each read by what would read it."""

from __future__ import annotations

import configparser
import io
import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import yaml

from monitor.settings import SettingsError
from monitor.settings import load as load_settings
from sim_feeds.injection import load_injection
from sim_feeds.scenario import ScenarioError
from sim_feeds.scenario import load as load_scenario
from tests.conftest import ROOT
from tests.docs.pages import Wrong

PROGRAMS = tomllib.loads(Path(__file__).with_name("programs.toml").read_text("utf-8"))
UNIT = ROOT / "packaging" / "systemd" / "mavsentry.service"


def toml(file: Path) -> None:
    """Settings, a scenario or faults, told by what stands in it."""
    try:
        keys = tomllib.loads(file.read_text("utf-8")).keys()
    except tomllib.TOMLDecodeError as error:
        raise Wrong(f"no TOML: {error}") from error
    try:
        if "aircraft" in keys:
            load_scenario(file)
        elif keys and keys <= {"title", "fault", "attitude"}:
            load_injection(file)
        else:
            load_settings(None, file)
    except (SettingsError, ScenarioError) as error:
        raise Wrong(str(error)) from error


def json_text(text: str) -> Any:
    """One document, or one a line."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as whole:
        try:
            return [json.loads(line) for line in text.splitlines() if line.strip()]
        except json.JSONDecodeError:
            raise Wrong(f"no JSON: {whole}") from whole


def keys_stand_in(shown: Any, written: Any, at: str = "") -> None:
    """Every key of what is shown stands in what was written, at its place."""
    if isinstance(shown, dict) and isinstance(written, dict):
        for key, value in shown.items():
            if key not in written:
                raise Wrong(f"{at}/{key} is not written")
            keys_stand_in(value, written[key], f"{at}/{key}")
    elif isinstance(shown, list) and isinstance(written, list) and written:
        for value in shown:
            keys_stand_in(value, written[0], f"{at}/0")
    elif isinstance(shown, dict | list) != isinstance(written, dict | list):
        raise Wrong(f"{at or '/'} is something else in the file")


def yaml_text(text: str) -> None:
    """Parsed."""
    try:
        yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise Wrong(f"no YAML: {error}") from error


def ini(text: str) -> None:
    """Parsed; of a router's configuration sections and keys exist."""
    parser = configparser.ConfigParser(strict=False, interpolation=None, allow_no_value=True)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        parser.read_file(io.StringIO(text))
    except configparser.Error as error:
        raise Wrong(f"no INI: {error}") from error
    known = PROGRAMS["mavlink-routerd"]["sections"]
    sections = [name.split()[0] for name in parser.sections() if name]
    if not any(name in known for name in sections):
        return
    for name in parser.sections():
        kind = name.split()[0]
        if kind not in known:
            raise Wrong(f"mavlink-router has no section [{kind}]")
        for key in parser[name]:
            if key.lower() not in {k.lower() for k in known[kind]}:
                raise Wrong(f"mavlink-router has no key {key} in [{kind}]")


def systemd(text: str, folder: Path) -> None:
    """What systemd itself says of it; a part of a unit goes on top of ours."""
    if shutil.which("systemd-analyze") is None:
        return
    program = "/opt/mavsentry/bin/mavsentry"
    unit = folder / "unit" / "mavsentry.service"
    unit.parent.mkdir(exist_ok=True)
    text = text.replace(program, sys.executable)
    if "ExecStart=" in text.replace("ExecStart=\n", ""):
        unit.write_text(text, "utf-8")
    else:
        unit.write_text(UNIT.read_text("utf-8").replace(program, sys.executable), "utf-8")
        part = unit.with_name("mavsentry.service.d") / "page.conf"
        part.parent.mkdir(exist_ok=True)
        part.write_text(text, "utf-8")
    done = subprocess.run(
        ["systemd-analyze", "--no-pager", "verify", str(unit)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    if done.returncode or done.stderr:
        raise Wrong(f"systemd: {done.stderr.strip()}")
