"""The page on the MAVLink interface says what the code does."""

import re
from pathlib import Path

from links.mavlink import OUTPUT_MESSAGES
from monitor.component.asking import MavCmd
from monitor.component.timesync import ANSWERS
from monitor.needs import NEEDS, Need
from monitor.settings.component import ComponentSettings

PAGE = Path(__file__).parents[3] / "docs" / "mavlink.md"


def row(need: Need) -> str:
    """A line of the table of streams."""
    px4 = need.px4 or need.message
    rates = f"{need.wanted_hz:g} Hz | {need.least_hz:g} Hz"
    return f"| `{need.stream}` | {need.message} | {px4} | {rates} | {need.loss} |"


def test_the_table_of_streams_is_that_of_the_code():
    text = PAGE.read_text("utf-8")
    shown = text.partition("|---|---|---|---|---|---|\n")[2].partition("\n\n")[0].splitlines()
    assert shown == [row(need) for need in NEEDS.values()]


def test_all_that_is_sent_and_obeyed_is_on_the_page():
    text = PAGE.read_text("utf-8")
    for name in OUTPUT_MESSAGES:
        assert name in text or name.rstrip("0123456789") in text
    for command in MavCmd:
        assert f"({command.value})" in text
        assert command.name in text


def test_every_key_on_the_page_exists():
    keys = set(re.findall(r"`\[component\] (\w+)", PAGE.read_text("utf-8")))
    assert keys
    assert keys <= set(ComponentSettings.model_fields)
    assert ANSWERS == 8


def test_the_texts_on_the_page_are_those_of_the_code():
    code = "".join(
        p.read_text("utf-8") for p in (PAGE.parents[1] / "monitor/component").glob("*.py")
    )
    page = PAGE.read_text("utf-8")
    shown = re.findall(r"^\| `((?:Streams|MAVSENTRY)[^`]*)`", page, re.MULTILINE)
    assert len(shown) == 3
    for text in shown:
        assert len(text) <= 50
        begin = re.match(r"[A-Za-z: ]+", text)
        assert begin is not None
        assert begin[0].removesuffix(" imu") in code
