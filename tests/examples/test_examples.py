"""Every example runs and shows what it says."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
TRIED = {"arrays.py", "embed.py", "real_log.ipynb"}
BURST = 20


def example(name: str) -> ModuleType:
    spec = spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run_notebook(log: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Execute the notebook's cells in one namespace, as Jupyter does, without a screen."""
    matplotlib = pytest.importorskip("matplotlib", reason="the notebook draws with matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    monkeypatch.setenv("MAVSENTRY_LOG", str(log))
    notebook = json.loads((EXAMPLES / "real_log.ipynb").read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    try:
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                exec(compile("".join(cell["source"]), f"cell {cell['id']}", "exec"), names)
        names["figures"] = len(pyplot.get_fignums())
    finally:
        pyplot.close("all")
    return names


def test_none_is_left_out() -> None:
    assert {path.name for path in EXAMPLES.iterdir() if path.is_file()} == TRIED


def test_arrays_of_an_icing_pitot_are_judged() -> None:
    module = example("arrays")
    done = subprocess.run(
        [sys.executable, "-W", "error", str(EXAMPLES / "arrays.py")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    (found,) = [line for line in done.stdout.splitlines() if " faulty " in line]
    seconds, _, sensor, _, evidence = found.split(maxsplit=4)
    assert sensor == "airspeed0"
    assert module.ONSET_S < float(seconds) < module.ONSET_S + 30.0
    assert "below what GPS and wind say" in evidence


@pytest.mark.alone
def test_a_vehicle_on_a_port_is_watched(blockage_frames: list[tuple[int, bytes]]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as place:
        place.bind(("127.0.0.1", 0))
        port = place.getsockname()[1]
    command = [sys.executable, "-W", "error", str(EXAMPLES / "embed.py"), str(port), "2"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as embedded,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
    ):
        assert embedded.stdout is not None
        assert embedded.stdout.readline() == f"listening on port {port}\n".encode()
        link.connect(("127.0.0.1", port))
        for at in range(0, len(blockage_frames), BURST):
            link.send(b"".join(frame for _, frame in blockage_frames[at : at + BURST]))
            if at % (10 * BURST) == 0:  # who reads must keep up: what a full buffer drops is lost
                time.sleep(0.015)
        told = embedded.stdout.read().decode()
    assert embedded.returncode == 0, told
    assert any("airspeed0" in line and " faulty " in line for line in told.splitlines()), told


def test_the_notebook_finds_what_was_broken(
    blockage_log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = run_notebook(blockage_log, monkeypatch)
    assert names["figures"] == 2
    assert [f["sensor"] for f in names["analysis"].faults] == ["airspeed0", "airspeed1"]
    assert "airspeed0      " in capsys.readouterr().out


def test_the_notebook_on_a_real_flight(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A T-28 of ALFA whose pitot was dead the whole flight."""
    (real,) = (shared_data / "alfa").glob("*elevator_failure.tlog")
    names = run_notebook(real, monkeypatch)
    assert names["figures"] == 2
    assert {f["sensor"] for f in names["analysis"].faults} == {"airspeed0"}
    assert "airspeed0" in capsys.readouterr().out


def test_the_notebook_is_kept_without_what_it_said() -> None:
    notebook = json.loads((EXAMPLES / "real_log.ipynb").read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])
