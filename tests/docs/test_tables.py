import re
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from links.vocabulary import Reason

DOCS = Path(__file__).parents[2] / "docs"

PAGE = """## False alarms

| flights | configuration | number | judged hours | false alarms | at most an hour |
|---|---|---:|---:|---:|---:|
| kite | one pitot | 2 | 0.5 | 0 | 6 |
| kite | two pitots | 2 | 0.5 | 1 | 9.5 |

### kite: one pitot

| broken | step 10 s | step 30 s | step 60 s | ramp/min 10 s | ramp/min 30 s | ramp/min 60 s | trials | wrong instrument | wrong first |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|
| `airspeed0` [% of airspeed] | 50 | 30 | 20 | > 500 | 100 | 50 | 80 | 0 | 3 |
| `aoa0` [deg] | 1 | 1 | 1 | 10 | 5 | 2 | 70 | 0 | 0 |
"""  # noqa: E501


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    spec = spec_from_file_location("pages", DOCS / "tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_rows_of_a_sensor_come_with_their_configuration(pages: ModuleType) -> None:
    page = "before\n<!-- measured airspeed0 -->\nold\n<!-- end of the table -->\nafter\n"
    lines = pages.filled(page, PAGE).splitlines()
    assert (lines[0], lines[-2], lines[-1]) == ("before", "<!-- end of the table -->", "after")
    assert [line for line in lines if "airspeed0`" in line] == [
        "| kite, one pitot | `airspeed0` [% of airspeed] "
        "| 50 | 30 | 20 | > 500 | 100 | 50 | 80 | 3 |"
    ]
    assert "old" not in lines


def test_false_alarms_of_the_configurations_that_are_asked_for(pages: ModuleType) -> None:
    page = "<!-- false alarms of two pitots; three -->\n<!-- end of the table -->\n"
    rows = re.findall(r"^\| kite.*", pages.filled(page, PAGE), re.MULTILINE)
    assert rows == ["| kite | two pitots | 0.5 | 1 | 9.5 |"]


@pytest.mark.parametrize("asked", ["measured spool0", "measured aoa0 of none", "false alarms of"])
def test_what_was_not_measured_is_an_error(pages: ModuleType, asked: str) -> None:
    with pytest.raises(LookupError):
        pages.filled(f"<!-- {asked} -->\n<!-- end of the table -->\n", PAGE)


def test_settings_come_from_their_definitions(pages: ModuleType) -> None:
    page = "<!-- settings air.min_shift air.horizon.horizon_s -->\n<!-- end of the table -->\n"
    rows = re.findall(r"^\* `.*", pages.filled(page, PAGE), re.MULTILINE)
    assert rows[0].startswith("* `air.min_shift` (0.075, transport 0.045): Least shift")
    assert rows[1].startswith("* `air.horizon.horizon_s` (300): Length")
    with pytest.raises(LookupError):
        pages.filled("<!-- settings air.nothing -->\n<!-- end of the table -->\n", PAGE)


def test_reasons_are_the_closed_list(pages: ModuleType) -> None:
    page = pages.filled("<!-- reasons -->\n<!-- end of the table -->\n", PAGE)
    assert all(f"| {reason} |" in page for reason in Reason)


def test_tables_of_the_pages_are_those_that_were_measured() -> None:
    done = subprocess.run(
        [sys.executable, str(DOCS / "tables.py"), "--check"], capture_output=True, text=True
    )
    assert done.returncode == 0, f"run python docs/tables.py: {done.stdout}{done.stderr}"
