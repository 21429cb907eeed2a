"""The live page as it is made: its policy, its figures, its columns are of the protocol."""

import base64
import hashlib
import json
import re
from typing import get_type_hints

import pytest

from links.vocabulary import GYRO_ACC_AXES, State
from monitor.pages.palette import dark_by_light
from monitor.web import protocol
from monitor.web.catalogue import IMUS, charts
from monitor.web.figures import TONES, WINDOWS_S
from monitor.web.page import SCRIPTS, rendered

GROUPS = {"air": protocol.Air, "engine": protocol.Engine, "wing": protocol.Wing}
SENSORS = re.compile(r"(airspeed|aoa)[0-2]|spool[0-3]|wing_(left|right)\.(lift|drag)|imu\d\.\w+")


@pytest.fixture(scope="module")
def page():
    return rendered().html.decode()


@pytest.fixture(scope="module")
def shown(page):
    text = re.search(r'<script type="application/json" id="catalogue">(.*?)</script>', page)
    return json.loads(text.group(1))


def test_the_policy_admits_the_page_s_scripts_and_no_other(page):
    policy = rendered().policy
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(scripts) == 2 + len(SCRIPTS)
    digests = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["script-src"].split() == [f"'sha256-{digest}'" for digest in digests]
    assert rules["default-src"] == "'none'"
    assert rules["connect-src"] == "'self'"
    assert "unsafe-eval" not in policy
    assert policy in page.replace("&#39;", "'")


def test_the_page_loads_nothing(page):
    shell = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert re.findall(r'(?:src|href)="([^"#][^"]*)"', shell) == ["data:,"]
    own = re.sub(r"<script>.*?</script>", "", page, count=2, flags=re.DOTALL)
    assert not re.search(r"style=\"|onclick|@import|url\(", own.split("<noscript>")[0])


def test_every_column_is_of_the_protocol():
    for chart in charts():
        for line in chart.lines:
            for column in filter(None, (line.column, line.std)):
                group, _, rest = column.partition(".")
                if column.endswith(".test"):
                    assert SENSORS.fullmatch(column.removesuffix(".test")), column
                elif not rest:
                    assert SENSORS.fullmatch(column), column
                else:
                    kind = protocol.Imu if group == "imu0" else GROUPS[group]
                    name, _, index = rest.partition(".")
                    is_list = get_type_hints(kind)[name] in (protocol.Vector, list[float | None])
                    assert is_list == bool(index), column


def test_each_imu_has_its_three_charts(shown):
    keys = [chart["key"] for chart in shown["charts"]]
    assert len(keys) == len(set(keys))
    at = keys.index("imu0-acc")
    wanted = [f"imu{i}-{what}" for i in range(IMUS) for what in ("acc", "gyro", "tests")]
    assert keys[at : at + len(wanted)] == wanted
    last = shown["charts"][keys.index("imu4-tests")]
    assert [line["column"] for line in last["series"]] == [f"imu4.{a}.test" for a in GYRO_ACC_AXES]


def test_a_figure_has_a_renderer_and_a_source_column_for_each_line(shown):
    for entry in shown["charts"]:
        text = json.dumps(entry["item"])
        for line in entry["series"]:
            assert f'"name": "{line["column"]}"' in text
            assert (f"{line['column']}.low" in text) == (line["std"] is not None)
        assert "CustomJS" not in text, "the policy forbids eval"


def test_every_colour_of_a_figure_has_a_dark_one(shown):
    known = {colour.lower() for colour in dark_by_light()}
    for entry in [*shown["charts"], shown["timeline"]]:
        used = set(re.findall(r"#[0-9a-f]{6}", json.dumps(entry["item"]).lower()))
        assert used
        assert used <= known, (entry["key"], used - known)
    assert {tone.light.lower() for tone in TONES} <= known


def test_every_state_has_bars_of_its_own_and_a_word(shown):
    assert set(shown["looks"]) == {str(state) for state in State}
    assert set(shown["timeline"]["states"]) == {str(s) for s in State} - {"absent"}
    text = json.dumps(shown["timeline"]["item"])
    assert all(f'"state-{state}"' in text for state in shown["timeline"]["states"])


def test_the_axis_names_every_tick_of_every_window(shown):
    item = json.dumps(shown["timeline"]["item"], ensure_ascii=False)
    for window_s in WINDOWS_S:
        assert f"−{window_s // 60}:00" in item
    assert '"now"' in item
