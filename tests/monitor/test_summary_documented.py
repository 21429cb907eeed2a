"""Every key of ``summary.json`` stands in the documentation and no other; what is shown of it."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from links.logs import TlogWriter
from links.mavlink import Encoder
from links.vocabulary import State
from monitor import summary
from monitor.analyze import analyze_into
from monitor.commands import analysis_shown
from monitor.commands.analysis_shown import show
from monitor.commands.feed import write_log
from monitor.learn.flights import digest
from monitor.settings import Settings
from monitor.settings.learnt import LearntLog, LearntSettings
from monitor.traces import MEASURED
from monitor.verdict import Verdict
from sim_feeds.scenario import load

PAGE = Path(__file__).parents[2] / "docs" / "analysis.md"

FLIGHT = """\
title = "A minute in the air, a pitot breaks"
aircraft = "small-uav"
seed = 3
[start]
speed_m_s = 20.0
agl_m = 150.0
[[leg]]
do = "level"
duration_s = 15.0
[[leg]]
do = "turn"
angle_deg = 180.0
[[leg]]
do = "level"
duration_s = 25.0
[airspeed]
count = 2
[[fault]]
sensor = "airspeed0"
kind = "bias"
size_m_s = -9.0
start_s = 30.0
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A summary in which no list is empty."""
    folder = tmp_path_factory.mktemp("documented")
    (folder / "flight.toml").write_text(FLIGHT)
    log = folder / "flight.tlog"
    write_log(load(folder / "flight.toml").fly(), log)
    content = log.read_bytes()
    first_us = int.from_bytes(content[:8], "big")
    vehicle, monitor = Encoder(1, 1), Encoder(1, 191)
    with TlogWriter(folder / "end.tlog") as end:
        for k in range(65, 96):  # the log goes on after a gap
            at_us, t_ms = first_us + k * 1_000_000, (20 + k) * 1000
            end.write(vehicle.encode("SYSTEM_TIME", time_unix_usec=0, time_boot_ms=t_ms), at_us)
            for name in ("FLT_AIR", "MON_AIR") if k in (66, 95) else ():
                named = {"time_boot_ms": t_ms, "name": name, "value": float(k == 66)}
                end.write(monitor.encode("NAMED_VALUE_FLOAT", **named), at_us)
        said = "Airspeed sensor 1 failure. Disabling"
        end.write(vehicle.encode("STATUSTEXT", severity=3, text=said), at_us)
    log.write_bytes(content + (folder / "end.tlog").read_bytes())
    learnt = LearntSettings(logs=[LearntLog(name="x", sha256=digest(log), seconds=1.0)])
    settings = Settings(learnt=learnt)
    analyze_into(folder / "out", log, settings)
    content = json.loads((folder / "out" / "summary.json").read_text())
    content["events"] += summary.events([Verdict(1, "engine0", State.STOPPED)], 0)
    return content


def documented() -> dict[str, set[str]]:
    """Key of the summary -> the keys in it, as the page's table says."""
    _, _, section = PAGE.read_text(encoding="utf-8").partition("key by key")
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", section.partition("\n## ")[0], re.MULTILINE)
    return {key: set(re.findall(r"`(\w+)`", text)) for key, text in rows}


def keys(value: Any) -> set[str]:
    """All keys in a value, however deep."""
    if isinstance(value, dict):
        return set(value).union(*map(keys, value.values()))
    return set().union(*map(keys, value)) if isinstance(value, list) else set()


def test_every_key_is_documented_and_every_documented_key_is_written(written) -> None:
    table = documented()
    assert set(table) == set(written)
    named = {"rejected": {}, "made_by": {**written["made_by"], "changed": {}}}
    baselines = written["baselines"]
    named["baselines"] = {**baselines, "settings": [*baselines["settings"].values()]}
    for key, expected in table.items():
        assert keys(named.get(key, written[key])) == expected, key


def test_the_overview_has_every_key(written) -> None:
    section = PAGE.read_text(encoding="utf-8").partition("## What it writes")[2]
    overview = section.partition("###")[0]
    assert {key for key in written if f"| `{key}` |" not in overview} == {"schema"}


def test_live_is_shown_beside_replay(written, capsys) -> None:
    (line,) = written["live"]["faults"]
    odd = {**line, "said": "airspeed0 FAULTY: [/b]"}
    lines = [odd, {**line, "sensor": "aoa0", "agreement": "not heard", "live_s": None}]
    show({**written, "live": {**written["live"], "faults": lines}}, [Path("summary.json")])
    said = capsys.readouterr().out
    assert "live (component 191), heard 66 to 95 s, silent 66 to 95 s:" in said
    first, second = [r for r in said.splitlines() if r.startswith(("│ airspeed0", "│ aoa0"))][-2:]
    assert f"before {line['live_s']:.1f} s" in first
    assert first.rstrip("│ ").endswith("airspeed0 FAULTY: [/b]")
    assert "not heard" in second


def test_on_a_narrow_screen_what_was_said_stands_below(written, capsys, monkeypatch) -> None:
    (line,) = written["live"]["faults"]
    faults = [{**line, "said": "airspeed0 FAULTY: [/b]"}]
    narrow = Console(width=80)
    monkeypatch.setattr(analysis_shown, "console", lambda: narrow)
    show({**written, "live": {**written["live"], "faults": faults}}, [Path("summary.json")])
    said = capsys.readouterr().out
    assert "\n  airspeed0 FAULTY: [/b]\n" in said
    assert "said in flight" not in said


def test_every_quantity_that_is_traced_is_documented() -> None:
    text = PAGE.read_text("utf-8")
    rows = dict(re.findall(r"^\| `measured_([a-z]+?)0?`(?:\.\.\.)? \| (.+) \|$", text, re.M))
    assert rows.keys() == MEASURED.keys()
    for quantity, dtype in MEASURED.items():
        columns = [name for name in dtype.names or () if name != "t_us"]
        stems = {re.split(r"_(?:low|high|rad$)", name)[0] for name in columns}
        assert set(re.findall(r"`(\w+)`", rows[quantity])) == stems
